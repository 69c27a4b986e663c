"""The ontology of a map in a store: read, replaced, and extended by labels of networks."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import TYPE_CHECKING, Final

from pyoxigraph import Quad

from kg.knowledge.ontology.catalogue import StoredCatalogue
from kg.knowledge.ontology.loading import ontology_of
from kg.knowledge.ontology.provisional_classes import (
    add_provisional_classes,
    clean,
    remove_unused_name,
)
from kg.knowledge.words.classes import add_label_classes
from kg.maps.thing_names import (
    category_of_name,
    check_no_label,
    checked_name,
    nearest_category,
)
from kg.maps.update.validation import UpdateValidator
from kg.model import vocabulary as v
from kg.model.errors import InvalidFactError
from kg.rdf.quad_store import QuadStore
from kg.rdf.skolem import anonymous
from kg.store.scheduling import WriterLock
from kg.store.transactional import TransactionalStore

if TYPE_CHECKING:
    from kg.knowledge.ontology.replacement import Replacement, ReplacementPlan

MAX_LABELS: Final = 50_000  # of one network; more are no labels


class StoredOntology:
    """The ontology of the map in `store`, as `kg.maps.map_parts.MapOntology` documents it.

    `guard` is held from reading to writing.
    """

    def __init__(
        self, store: TransactionalStore, categories: StoredCatalogue, guard: WriterLock
    ) -> None:
        self._store, self._categories, self._guard = store, categories, guard
        self._validator: UpdateValidator | None = None

    def quads(self) -> tuple[Quad, ...]:
        """The quads of the ontology, with blank nodes, sorted."""
        return ontology_quads(self._store.engine)

    def replace(
        self, quads: Iterable[Quad], *, by: str | None = None, whole: bool = False
    ) -> Replacement:
        """Replace the ontology in one transaction."""
        from kg.knowledge.ontology.diagnostics import check_valid
        from kg.knowledge.ontology.replacement import plan_replacement

        ontology = ontology_of(anonymous(quads))
        warnings = check_valid(ontology)
        with self._guard:
            plan = plan_replacement(self._store.engine, ontology.quads, whole=whole)
            return self.write(replace(plan, warnings=tuple(warnings)), by)

    def write(self, plan: ReplacementPlan, by: str | None) -> Replacement:
        """Write a planned replacement that fits the map; the caller holds the map."""
        with self._guard:
            taken = plan.write(self._store, by)
            if taken.commit is not None:
                self.reread()
            return taken

    def learn(self, labels: Iterable[str], kind: str, *, model: str) -> dict[str, str]:
        """The category of each label of a network; classes of words or provisional ones are new.

        Labels and `model` are cut to a line of `MAX_LABEL` characters.
        """
        names, model = {label: clean(label) for label in labels}, clean(model)
        if len(names) > MAX_LABELS:
            raise InvalidFactError(f"a network has up to {MAX_LABELS:,} labels, got {len(names):,}")
        with self._guard:
            self._store.check_writable()
            known = self._categories()
            unknown = [n for n in names.values() if n and not known.for_label(n, kind)]
            if unknown and kind == "object":
                if add_label_classes(self._store, known, unknown, model) is not None:
                    self.reread()
                    known = self._categories()
                unknown = [n for n in unknown if not known.for_label(n, kind)]
            if add_provisional_classes(self._store, known, unknown, kind, model) is not None:
                self.reread()
            known = self._categories()
            found = {label: known.for_label(n, kind) for label, n in names.items() if n}
        return {label: category.iri for label, category in found.items() if category is not None}

    def category_named(self, name: str, by: str) -> str:
        """IRI of the category with the name that a person gives a thing; a new one is added.

        Raises InvalidFactError for what is no name of a thing.
        """
        checked = checked_name(name)
        with self._guard:
            self._store.check_writable()
            known = self._categories()
            found = category_of_name(known, checked)
            if found is None:
                check_no_label(self._store.engine, known, checked)
                above = nearest_category(known, checked)
                nearest = () if above is None else (above.iri,)
                add_provisional_classes(self._store, known, [checked], "name", by, nearest)
                self.reread()
                found = self._categories().find(checked, "object")
            return found.iri

    def forget_name(self, iri: str, by: str | None) -> None:
        """Remove a category that `category_named` added, where nothing refers to it any more."""
        with self._guard:
            if remove_unused_name(self._store, iri, by) is not None:
                self.reread()

    def reread(self) -> None:
        """Read the categories and shapes again at their next use."""
        self._categories.forget()
        self._validator = None

    def validator(self) -> UpdateValidator:
        """The validator of updates by the ontology's terms and shapes."""
        self._validator = self._validator or UpdateValidator(self._store)
        return self._validator


def ontology_quads(engine: QuadStore) -> tuple[Quad, ...]:
    """The quads of graph:ontology, with blank nodes, sorted."""
    quads = engine.quads_for_pattern(None, None, None, v.ONTOLOGY_GRAPH)
    return tuple(sorted(anonymous(quads), key=str))

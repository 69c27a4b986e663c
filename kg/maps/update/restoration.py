"""Restoration of a past state: computes the changes that lead back to it.

A restoration is one new transaction; the history keeps the transactions that it undoes. It covers
all graphs of the history, ontology and common sense included, or the given scopes: objects (with
their observations and assertions), places (with their beliefs), assertions alone (perception's
beliefs stay), the ontology, or single things by IRI. The number of the next object never decreases,
so that a mapper that continues gives no old number to a new object.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass
from functools import cached_property
from typing import Final

from pyoxigraph import NamedNode, Quad

from kg.history.point_in_time import Difference, difference, replay
from kg.history.storage.log import BACKGROUND, HistoryLog
from kg.history.timestamps import thing
from kg.knowledge.ontology.replacement import check_used_terms
from kg.maps.facts.assertion_service import AssertionService
from kg.maps.facts.assertions import Assertions
from kg.maps.facts.objects_and_places import RecordCodec
from kg.maps.update.change_draft import ChangeDraft
from kg.maps.update.validation import added_things, is_place, removed_things, things_in
from kg.model import vocabulary as v
from kg.model.errors import QueryParameterError
from kg.rdf.quad_store import QuadStore
from kg.store.transactional import TransactionalStore

#: Scopes of a restoration, beside single things by their IRI.
SCOPES: Final = ("objects", "places", "assertions", "ontology")


@dataclass(frozen=True, slots=True)
class Restored:
    """Changes of a restoration of the state after transaction `restored`, or of a dry run."""

    restored: int
    sequence: int | None  # of the restoration; None where nothing differs, and in a dry run
    added: int  # triples
    removed: int
    objects_back: int = 0
    objects_gone: int = 0
    places_back: int = 0
    places_gone: int = 0
    skipped: tuple[str, ...] = ()  # IRIs of things that are not in the map: not asserted again


class Restoration:
    """Computes the change that restores the state after transaction `sequence`.

    `only` has names of `SCOPES` and of things (object/17); if it is empty, everything is restored.
    `pending` is the change. Raises QueryParameterError for another name, HistoryError for a past
    that is not kept, OntologyError if the restored ontology lacks categories that the map uses.
    """

    def __init__(
        self,
        store: TransactionalStore,
        log: HistoryLog,
        facts: RecordCodec,
        assertions: AssertionService,
        *,
        sequence: int,
        only: Collection[str] = (),
    ) -> None:
        self._store, self._log, self._facts, self._service = store, log, facts, assertions
        self._sequence, self._assertions = sequence, Assertions(facts.base)
        self._scopes = {scope for scope in only if scope in SCOPES}
        self._things = {self._thing(name) for name in only if name not in SCOPES}
        self.pending = ChangeDraft(store)
        self.skipped: tuple[str, ...] = ()
        if only:
            self._undo_scopes()
        else:
            self._undo(lambda quad: quad.predicate.value != v.NEXT_OBJECT)

    @property
    def changes_ontology(self) -> bool:
        """Whether the ontology or the common sense compiled from it changes."""
        changed = (*self.pending.added, *self.pending.removed)
        return any(quad.graph_name in BACKGROUND for quad in changed)

    def outcome(self) -> Restored:
        """Counts of the change; to be called before it is committed."""
        pending, facts = self.pending, self._facts
        removed, back = removed_things(pending, facts), added_things(pending, facts)
        places_gone = sum(is_place(pending.before, facts, one) for one in removed)
        places_back = sum(is_place(pending.after, facts, one) for one in back)
        return Restored(
            restored=self._sequence,
            sequence=None,
            added=len(pending.added),
            removed=len(pending.removed),
            objects_back=len(back) - places_back,
            objects_gone=len(removed) - places_gone,
            places_back=places_back,
            places_gone=places_gone,
            skipped=self.skipped,
        )

    @cached_property
    def _difference(self) -> Difference:
        """From now to then: `added` holds the quads of then that are missing now."""
        return difference(self._log, self._log.last, self._sequence)

    @cached_property
    def _then(self) -> QuadStore:
        return replay(self._log, self._store.engine, self._sequence)

    def _undo(self, is_wanted: Callable[[Quad], bool]) -> None:
        removed, back = self._difference.removed, self._difference.added
        self.pending.change(filter(is_wanted, removed), filter(is_wanted, back))

    def _undo_scopes(self) -> None:
        if "ontology" in self._scopes:
            self._undo_ontology()
        if self._scopes & {"objects", "places"} or self._things:
            self._undo(self._is_within_scopes)
            self._add_agents()
        if "assertions" in self._scopes:
            self._reassert()

    def _undo_ontology(self) -> None:
        self._undo(lambda quad: quad.graph_name in BACKGROUND)
        old = tuple(self.pending.before(None, None, None, v.ONTOLOGY_GRAPH))
        new = tuple(self.pending.after(None, None, None, v.ONTOLOGY_GRAPH))
        relations = set(self.pending.after(None, None, None, v.COMMONSENSE_GRAPH))
        check_used_terms(self._store.engine, old, new, relations)

    def _is_within_scopes(self, quad: Quad) -> bool:
        if quad.graph_name not in (v.MAP_GRAPH, v.ASSERTIONS_GRAPH):
            return False
        iri = self._owner(_iri(quad.subject))
        if iri in self._things or _iri(quad.object) in self._things:
            return True
        return self._kinds.get(iri) in self._scopes

    @cached_property
    def _kinds(self) -> dict[str, str]:
        """Kind, object or place, of each thing that differs, by IRI."""
        changed = (*self._difference.added, *self._difference.removed)
        kinds: dict[str, str] = {}
        for iri in {self._owner(_iri(quad.subject)) for quad in changed} - {""}:
            node = NamedNode(iri)
            for read in (self.pending.before, self._then.quads_for_pattern):
                if things_in(read(node, None, None, v.MAP_GRAPH), self._facts):
                    kinds[iri] = "places" if is_place(read, self._facts, node) else "objects"
                    continue
                types = [quad.object for quad in read(node, v.RDF_TYPE, None, v.MAP_GRAPH)]
                if NamedNode(v.DEPARTED_OBJECT) in types:
                    kinds.setdefault(iri, "objects")
        return kinds

    def _owner(self, iri: str) -> str:
        """The object or place to which a node (an observation, belief, ...) belongs."""
        if (about := self._assertions.subject(iri)) is not None:
            return about
        observation = f"{self._facts.base}observation/"
        if iri.startswith(observation):
            return f"{self._facts.base}object/{iri.removeprefix(observation)}"
        iri = iri.removesuffix("/observation").partition("/belief/")[0]
        return iri.partition("/relation/")[0].partition("/label/")[0]

    def _add_agents(self) -> None:
        """Describe the authors of restored assertions."""
        agents = {
            quad.object
            for quad in self.pending.added
            if quad.predicate.value == v.PROV_ATTRIBUTED_TO
        }
        back = self._difference.added
        self.pending.change((), (quad for quad in back if quad.subject in agents))

    def _reassert(self) -> None:
        changed = (*self._difference.added, *self._difference.removed)
        nodes = {_iri(quad.subject) for quad in changed if quad.graph_name == v.ASSERTIONS_GRAPH}
        about = {iri for node in nodes if (iri := self._assertions.subject(node)) is not None}
        assertions_of = {iri: self._assertions.of(self._then, iri) for iri in about}
        delete, insert, self.skipped = self._service.with_assertions(assertions_of)
        self.pending.change((quad for quad in delete if quad not in insert), insert)

    def _thing(self, name: str) -> str:
        try:
            return thing(name, self._facts.base).value
        except QueryParameterError as error:
            raise QueryParameterError(
                f"nothing to restore is called {name!r}; there are {', '.join(SCOPES)}, and single "
                "things: object/17, place/1 or an IRI"
            ) from error


def _iri(term: object) -> str:
    return term.value if isinstance(term, NamedNode) else ""

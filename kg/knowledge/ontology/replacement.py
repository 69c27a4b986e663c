"""Replacement of a map's ontology in one transaction, also while the map is in use.

graph:ontology becomes the new ontology. In graph:commonsense the compiled quads of the old ontology
are replaced by those of the new one. Relations that people or imports wrote or changed there stay.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Final

from pyoxigraph import BlankNode, NamedNode, Quad

from kg.knowledge.ontology.diff import OntologyChange, changes_of_named, renamed_terms
from kg.knowledge.ontology.import_closure import headers
from kg.knowledge.ontology.loading import compile_commonsense
from kg.knowledge.ontology.provisional_classes import provisional_to_keep
from kg.model import vocabulary as v
from kg.model.errors import OntologyError
from kg.model.transactions import Cause, ChangeSet
from kg.rdf.findings import Finding
from kg.rdf.quad_store import QuadStore
from kg.rdf.skolem import named
from kg.store.transactional import TransactionalStore

MAX_NOTE: Final = 500  # characters of the change in words kept with its transaction

_FACTS: Final = (v.MAP_GRAPH, v.ASSERTIONS_GRAPH, v.DATASET_GRAPH)
_IMPORTS: Final = NamedNode(v.OWL_IMPORTS)
_OWL_CLASS: Final = NamedNode(v.OWL_CLASS)
_MAX_LISTED = 5  # terms named in one message


@dataclass(frozen=True, slots=True)
class Replacement:
    """Result of a replacement; `commit` is None without a change."""

    changes: tuple[OntologyChange, ...]
    kept: tuple[str, ...]  # IRIs of relations that people changed in the map
    commit: ChangeSet | None
    warnings: tuple[Finding, ...] = ()  # what the new ontology says and a map does not use


@dataclass(frozen=True, slots=True)
class ReplacementPlan:
    """A replacement before it is written, computed from one state of the map."""

    changes: tuple[OntologyChange, ...]
    kept: tuple[str, ...]  # as of `Replacement`
    delete: tuple[Quad, ...]  # quads of the state
    insert: tuple[Quad, ...]  # quads that the state lacks
    lost: tuple[str, ...]  # IRIs of categories that the new ontology lacks
    unnamed: bool  # whether the state has blank nodes in its ontology
    warnings: tuple[Finding, ...] = ()  # as of `Replacement`

    def fits(self, engine: QuadStore) -> bool:
        """Whether `engine`, with the same ontology, uses no category that would be lost."""
        return not any(_is_used(engine, NamedNode(iri)) for iri in self.lost)

    def write(self, store: TransactionalStore, by: str | None) -> Replacement:
        """Write it to a store that it fits, in one transaction."""
        if self.unnamed:
            stored = store.engine.quads_for_pattern(None, None, None, v.ONTOLOGY_GRAPH)
            store.rewrite_graph(v.ONTOLOGY_GRAPH, named(stored))
        note = "; ".join(change.words for change in self.changes)[:MAX_NOTE]
        cause = Cause("ontology", by, note)
        commit = store.commit(self.delete, self.insert, cause, exact_at=store.sequence)
        return Replacement(self.changes, self.kept, commit, self.warnings)


def plan_replacement(
    engine: QuadStore, quads: Iterable[Quad], *, whole: bool = False
) -> ReplacementPlan:
    """Plan the replacement of the ontology in `engine` by validated quads.

    Provisional categories that the map refers to are always kept.

    Raises:
        OntologyError: the quads do not declare terms that the map uses, or are not marked as the
            `whole` ontology and lack an ontology that the map has.
    """
    given = [Quad(q.subject, q.predicate, q.object, v.ONTOLOGY_GRAPH) for q in quads]
    new = named(_without_types_of_classes(given))
    stored = tuple(engine.quads_for_pattern(None, None, None, v.ONTOLOGY_GRAPH))
    old = named(stored)
    new += tuple(provisional_to_keep(old, new, lambda node: _is_used(engine, node)))
    compiled = compile_commonsense(new)
    present = set(engine.quads_for_pattern(None, None, None, v.COMMONSENSE_GRAPH))
    before = compiled_before(old, present)
    _check_core_terms(old, new)
    check_complete(old, new, whole=whole)
    check_used_terms(engine, old, new, present - before)
    delete, insert, kept = recompiled(present, before, set(compiled))
    removed = (set(old) - set(new)) | (set(delete) & present - set(insert))
    added = (set(new) - set(old)) | (set(insert) - present)
    return ReplacementPlan(
        changes=tuple(changes_of_named(old, new)),
        kept=kept,
        delete=tuple(sorted(removed, key=str)),
        insert=tuple(sorted(added, key=str)),
        lost=tuple(sorted(_classes(old) - _classes(new))),
        unnamed=any(isinstance(t, BlankNode) for q in stored for t in (q.subject, q.object)),
    )


def _without_types_of_classes(quads: list[Quad]) -> Iterator[Quad]:
    """The quads without a class as an individual of another (OWL 2 punning): it is no thing."""
    classes = {q.subject for q in quads if q.predicate == v.RDF_TYPE and q.object == _OWL_CLASS}
    for q in quads:
        if not (q.predicate == v.RDF_TYPE and q.subject in classes and q.object in classes):
            yield q


def compiled_before(old: Iterable[Quad], present: set[Quad]) -> set[Quad]:
    """Quads that `old` compiled to; all `present` ones where it is invalid."""
    try:
        return set(compile_commonsense(old))
    except OntologyError:
        return present


def check_complete(old: Iterable[Quad], new: Iterable[Quad], *, whole: bool) -> None:
    """Raise OntologyError if `new` lacks ontologies of `old` and is not the `whole`."""
    old, new = tuple(old), tuple(new)
    missing = () if whole else left_out(old, new)
    if missing:
        names = ", ".join(f"<{iri}>" for iri in missing)
        lost = sorted(_classes(old) - _classes(new))
        without = f", and with it {_listed(lost)}" if lost else ""
        raise OntologyError(
            f"the ontology is refused: it leaves out {names} of the map{without}; a folder or file "
            "that has or imports them would work, or --whole, which removes them"
        )


def left_out(old: Iterable[Quad], new: Iterable[Quad]) -> tuple[str, ...]:
    """IRIs of ontologies in `old` that `new` lacks: no header, and missing statements.

    An edited export or merger is one file with a header of its own and with all terms of hereabouts
    itself: what it lacks was deleted. Of another file that imports nothing, only missing classes
    count, otherwise every missing statement.
    """
    old, new = tuple(old), tuple(new)
    missing = headers(old) - headers(new)
    if not missing:
        return ()
    if any(q.predicate == _IMPORTS for q in new):
        lost = any(_is_of_a_file(q, missing) for q in set(named(old)) - set(named(new)))
    elif not headers(old) & headers(new) and not _core_terms(old) - _declared(new):
        lost = False
    else:
        lost = bool(_classes(old) - _classes(new))
    return tuple(sorted(missing)) if lost else ()


def _is_of_a_file(quad: Quad, headers: frozenset[str]) -> bool:
    subject = getattr(quad.subject, "value", "")
    return subject not in headers and not subject.startswith((v.PROVISIONAL, v.WORD))


def recompiled(
    present: set[Quad], before: set[Quad], after: set[Quad]
) -> tuple[list[Quad], list[Quad], tuple[str, ...]]:
    """Quads to delete and insert in graph:commonsense, and IRIs of kept relations.

    Args:
        present: quads of the graph.
        before: compiled quads of the old ontology.
        after: compiled quads of the new ontology.
    """
    there, was, will = (_by_relation(quads) for quads in (present, before, after))
    delete = [q for q in before - after if not _is_relation(q)]
    insert = [q for q in after if not _is_relation(q)]
    kept = []
    for iri in sorted(was.keys() | will.keys()):
        stored_quads = there.get(iri, set())
        if not stored_quads or stored_quads in (was.get(iri), will.get(iri)):
            delete += stored_quads - will.get(iri, set())
            insert += will.get(iri, set())
        else:
            kept.append(iri)
    return delete, insert, tuple(kept)


def _by_relation(quads: Iterable[Quad]) -> dict[str, set[Quad]]:
    nodes: dict[str, set[Quad]] = defaultdict(set)
    for quad in quads:
        if _is_relation(quad):
            nodes[getattr(quad.subject, "value", "")].add(quad)
    return dict(nodes)


def _is_relation(quad: Quad) -> bool:
    return getattr(quad.subject, "value", "").startswith(v.RELATION)


def _classes(quads: Iterable[Quad]) -> set[str]:
    return {
        q.subject.value
        for q in quads
        if q.predicate == v.RDF_TYPE and q.object == _OWL_CLASS and isinstance(q.subject, NamedNode)
    }


def _declared(quads: Iterable[Quad]) -> set[str]:
    return {getattr(q.subject, "value", "") for q in quads if q.predicate == v.RDF_TYPE}


def _core_terms(old: Iterable[Quad]) -> set[str]:
    """The terms of hereabouts itself that `old` declares."""
    return {iri for iri in _declared(old) if iri.startswith(v.HERE) and iri in v.TERMS}


def _check_core_terms(old: Iterable[Quad], new: Iterable[Quad]) -> None:
    """Raise OntologyError if `new` lacks terms of hereabouts itself."""
    lost = sorted(_core_terms(old) - _declared(new))
    if lost:
        raise OntologyError(
            f"the ontology is refused: it lacks {_listed(lost)}, which maps are written in; "
            f"have it import <{v.CORE_ONTOLOGY}>"
        )


def check_used_terms(
    engine: QuadStore, old: Iterable[Quad], new: Iterable[Quad], by_hand: set[Quad]
) -> None:
    """Raise OntologyError if `new` lacks categories that the map or relations `by_hand` use."""
    related = {q.object for q in by_hand if _is_relation(q)}
    lost = [
        iri
        for iri in sorted(_classes(old) - _classes(new))
        if NamedNode(iri) in related or _is_used(engine, NamedNode(iri))
    ]
    if lost:
        renamed = renamed_terms(old, new)
        others = [
            f"{v.curie(iri)} is {v.curie(renamed[iri])} there" for iri in lost if iri in renamed
        ]
        words = f" ({', '.join(others[:_MAX_LISTED])})" if others else ""
        raise OntologyError(
            f"the ontology is refused: the map uses {_listed(lost)}, which it does not "
            f"declare{words}; keep them, or take them out of the map first"
        )


def _is_used(engine: QuadStore, node: NamedNode) -> bool:
    """Whether any fact of the map refers to a category."""
    facts = (engine.quads_for_pattern(None, None, node, graph) for graph in _FACTS)
    return any(next(iter(found), None) for found in facts)


def _listed(iris: list[str]) -> str:
    more = f" and {len(iris) - _MAX_LISTED} more" if len(iris) > _MAX_LISTED else ""
    return ", ".join(iri.replace(v.HERE, "here:") for iri in iris[:_MAX_LISTED]) + more

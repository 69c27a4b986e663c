"""Type inference (RDFS entailment, pattern rdfs9): superclasses of individuals, as stored quads.

Things state their most specific class. graph:inferred holds each further class along `here:isA`,
the closed hierarchy in graph:commonsense, so that every form of a query finds it. It is written in
the same atomic update as the facts from which it follows. It is no part of the history: a replay
infers it again, from the classes and the ontology of that time. A type that is stated in some graph
is not inferred too, since the union of the graphs would give it twice; a class is no individual.

Source: RDF 1.1 Semantics, section 9.2.1.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator
from typing import Final

from pyoxigraph import BlankNode, NamedNode, Quad, Store, Triple

from kg.model import vocabulary as v
from kg.rdf.quad_store import QuadStore, Term

_IS_A: Final = NamedNode(v.IS_A)
_Node = NamedNode | BlankNode | Triple
_Types = dict[_Node, set[Term]]


def infer_all(engine: QuadStore) -> Iterator[Quad]:
    """Every quad of graph:inferred for the other graphs of a store."""
    classes: _Types = defaultdict(set)
    for quad in engine.quads_for_pattern(None, _IS_A, None, v.COMMONSENSE_GRAPH):
        classes[quad.subject].add(quad.object)
    found: _Types = defaultdict(set)
    for cls, above in classes.items():
        if len(above) > 1:
            for subject in _stated_of(engine, cls):
                found[subject] |= above
    for kind in set[Term]().union(*found.values()):
        for subject in _stated_of(engine, kind):
            found[subject].discard(kind)
    for subject in found.keys() - classes.keys():
        yield from (_inferred(subject, kind) for kind in found[subject])


def is_inferred(engine: QuadStore) -> bool:
    """Whether a store has its inferred types; those written before version 0.3 have none."""
    if next(iter(engine.quads_for_pattern(None, None, None, v.INFERRED_GRAPH)), None) is not None:
        return True
    return next(infer_all(engine), None) is None


def complete_types(engine: Store) -> None:
    """Make graph:inferred what it must be; writes nothing where it is."""
    wanted = set(infer_all(engine))
    stored = set(engine.quads_for_pattern(None, None, None, v.INFERRED_GRAPH))
    for quad in stored - wanted:
        engine.remove(quad)
    if missing := wanted - stored:
        engine.extend(missing)


def with_types(quads: Iterable[Quad]) -> Store:
    """A store in memory of the quads and of the types that follow from them."""
    copy = Store()
    copy.bulk_extend(quads)
    complete_types(copy)
    return copy


def inferred_changes(
    engine: QuadStore, removed: Iterable[Quad], added: Iterable[Quad]
) -> tuple[list[Quad], list[Quad]]:
    """Quads of graph:inferred to delete and to insert with a change of other graphs.

    `engine` is the store before the change; `removed` are quads that it has, `added` are new.
    """
    gone = {quad for quad in removed if _is_relevant(quad)}
    new = {quad for quad in added if _is_relevant(quad)}
    if not gone and not new:
        return [], []
    return _Inference(engine, gone, new).changes()


def _stated_of(engine: QuadStore, cls: Term) -> Iterator[_Node]:
    """The individuals that state a class, in whichever graph."""
    for quad in engine.quads_for_pattern(None, v.RDF_TYPE, cls, None):
        if quad.graph_name != v.INFERRED_GRAPH:
            yield quad.subject


def _is_relevant(quad: Quad) -> bool:
    predicate = quad.predicate
    return predicate == v.RDF_TYPE or predicate == _IS_A


class _Inference:
    """The types of the things that one change concerns."""

    def __init__(self, engine: QuadStore, removed: set[Quad], added: set[Quad]) -> None:
        self._engine, self._removed, self._added = engine, removed, added
        self._above: dict[Term, frozenset[Term]] = {}
        self._new: dict[_Node, list[Quad]] = {}
        for quad in added:
            self._new.setdefault(quad.subject, []).append(quad)

    def changes(self) -> tuple[list[Quad], list[Quad]]:
        """Quads to delete and to insert."""
        delete, insert = list[Quad](), list[Quad]()
        for subject in dict.fromkeys(self._concerned()):
            stated, before = self._types(subject)
            wanted = set[Term]().union(*map(self._superclasses, stated)) - stated
            if self._superclasses(subject):  # a class
                wanted = set()
            delete += (_inferred(subject, cls) for cls in before - wanted)
            insert += (_inferred(subject, cls) for cls in wanted - before)
        return delete, insert

    def _concerned(self) -> Iterator[_Node]:
        """Things whose stated types change, and those of classes whose superclasses change."""
        for quad in (*self._removed, *self._added):
            yield quad.subject
        for cls in {q.subject for q in (*self._removed, *self._added) if q.predicate == _IS_A}:
            for quad in self._engine.quads_for_pattern(None, v.RDF_TYPE, cls, None):
                yield quad.subject

    def _types(self, subject: _Node) -> tuple[set[Term], set[Term]]:
        """The types that are stated after the change, and those inferred before it."""
        stated = {q.object for q in self._new.get(subject, ()) if q.predicate == v.RDF_TYPE}
        inferred = set[Term]()
        for quad in self._engine.quads_for_pattern(subject, v.RDF_TYPE, None, None):
            if quad.graph_name == v.INFERRED_GRAPH:
                inferred.add(quad.object)
            elif quad not in self._removed:
                stated.add(quad.object)
        return stated, inferred

    def _superclasses(self, cls: Term) -> frozenset[Term]:
        """A class and its superclasses after the change; empty for other terms."""
        if not isinstance(cls, NamedNode):
            return frozenset()
        if cls not in self._above:
            above = {q.object for q in self._new.get(cls, ()) if q.predicate == _IS_A}
            stored = self._engine.quads_for_pattern(cls, _IS_A, None, v.COMMONSENSE_GRAPH)
            above.update(quad.object for quad in stored if quad not in self._removed)
            self._above[cls] = frozenset(above)
        return self._above[cls]


def _inferred(subject: _Node, cls: Term) -> Quad:
    return Quad(subject, v.RDF_TYPE, cls, v.INFERRED_GRAPH)

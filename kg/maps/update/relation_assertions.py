"""Relations in updates: here:on and here:inside become assertions, others are refused."""

from __future__ import annotations

import time
from typing import Final

from pyoxigraph import NamedNode

from kg.maps.facts.assertions import Assertions
from kg.maps.facts.objects_and_places import RecordCodec
from kg.maps.facts.relations import (
    NOTHING,
    PREDICATES,
    SINGLE,
    asserted_relations,
    perceived_value,
    relation_quads,
)
from kg.maps.update.change_draft import ChangeDraft, Subject
from kg.model import vocabulary as v
from kg.model.errors import ProtectedError
from kg.model.records import Assertion, Relation, RelationKind

_HAS_RELATION: Final = NamedNode(v.HAS_RELATION)
_BESIDE: Final = NamedNode(v.BESIDE)
_NODE: Final = NamedNode(v.SPATIAL_RELATION)


def check_computed_relations(pending: ChangeDraft, subject: Subject) -> None:
    """Raises ProtectedError if `pending` edits a relation that is computed from geometry."""
    was = {quad.object for quad in pending.before(subject, v.RDF_TYPE, None, v.MAP_GRAPH)}
    if not was:
        return  # a new node is written as a whole
    written = [quad for quad in pending.added if quad.subject == subject]
    if _NODE in was and written:
        raise _computed("a here:SpatialRelation")
    written += [quad for quad in pending.removed if quad.subject == subject]
    for quad in written:
        if quad.predicate == _BESIDE and _exists(pending, quad.object):
            raise _computed("here:beside")
        if quad.predicate == _HAS_RELATION and quad in pending.added:
            raise _computed("here:hasRelation")


def assert_relations(pending: ChangeDraft, facts: RecordCodec, subject: NamedNode, by: str) -> None:
    """Turn here:on and here:inside of `subject` in `pending` into assertions."""
    check_computed_relations(pending, subject)
    for kind in SINGLE:
        predicate = NamedNode(PREDICATES[kind])
        before = _objects(pending, subject, predicate, after=False)
        after = _objects(pending, subject, predicate, after=True)
        lost = {other for other in before - after if _exists(pending, NamedNode(other))}
        new = after - before
        if not new and not lost:
            continue
        if not before and _backed(pending, subject):
            continue  # an object of another map, with its relations
        _assert(pending, facts, subject, kind, min(new) if new else None, by)


def _assert(
    pending: ChangeDraft,
    facts: RecordCodec,
    subject: NamedNode,
    kind: RelationKind,
    value: str | None,
    by: str,
) -> None:
    """Assert that `subject` is on or inside `value`; None: on or inside nothing.

    If the deleted relation was an assertion, the perceived one is restored.
    """
    assertions = Assertions(facts.base)
    previous = assertions.of(pending.engine, subject.value).get(kind)
    record = next(iter(facts.some_objects(pending.engine, (subject.value,))), None)
    relations = () if record is None else record.relations or ()
    if previous is not None:
        relations = asserted_relations(relations, kind, previous.perceived, previous.strength)
        old = assertions.iri(subject.value, kind)
        stored = assertions.stored(pending.engine, subject.value)
        pending.change([q for q in stored if q.subject == NamedNode(old)], ())
    perceived, strength = perceived_value(relations, kind)
    if value is not None or previous is None:
        value = value or NOTHING
        now = time.time()
        since = None if record is None or perceived == value else now
        seen = None if record is None else perceived
        made = Assertion(subject.value, kind, value, by, now, seen, strength, since)
        pending.change((), assertions.quads(made))
        relations = asserted_relations(relations, kind, value, 1.0)
    _write(pending, subject, kind, tuple(r for r in relations if r.kind == kind))


def _write(
    pending: ChangeDraft, subject: NamedNode, kind: RelationKind, relations: tuple[Relation, ...]
) -> None:
    predicate = NamedNode(PREDICATES[kind])
    old = list(pending.after(subject, predicate, None, v.MAP_GRAPH))
    for quad in pending.after(subject, _HAS_RELATION, None, v.MAP_GRAPH):
        about = list(pending.after(quad.object, None, None, v.MAP_GRAPH))  # type: ignore[arg-type]
        if any(fact.object == predicate for fact in about):
            old += [quad, *about]
    pending.change(old, relation_quads(subject.value, relations))


def _objects(
    pending: ChangeDraft, subject: NamedNode, predicate: NamedNode, *, after: bool
) -> set[str]:
    read = pending.after if after else pending.before
    return {getattr(q.object, "value", "") for q in read(subject, predicate, None, v.MAP_GRAPH)}


def _backed(pending: ChangeDraft, subject: NamedNode) -> bool:
    """Whether an update adds an object together with the nodes of its relations."""
    new = next(pending.before(subject, v.RDF_TYPE, None, v.MAP_GRAPH), None) is None
    return new and next(pending.after(subject, _HAS_RELATION, None, v.MAP_GRAPH), None) is not None


def _exists(pending: ChangeDraft, thing: object) -> bool:
    if not isinstance(thing, NamedNode):
        return False
    return next(pending.after(thing, v.RDF_TYPE, None, v.MAP_GRAPH), None) is not None


def _computed(what: str) -> ProtectedError:
    return ProtectedError(
        f"an update may not write {what}: it is computed from the boxes of the objects; here:on "
        "and here:inside can be written, and positions asserted"
    )

"""Relations in updates: here:on and here:inside become assertions, others are refused."""

from __future__ import annotations

import time

from pyoxigraph import NamedNode

from kg.maps.facts.assertions import Assertions
from kg.maps.facts.object_relations import (
    NOTHING,
    PREDICATES,
    SINGLE,
    asserted_relations,
    perceived_value,
    relation_quads,
)
from kg.maps.facts.objects_and_places import RecordCodec
from kg.maps.update.change_draft import ChangeDraft
from kg.model import vocabulary as v
from kg.model.errors import ProtectedError
from kg.model.records import Assertion, Relation, RelationKind
from kg.rdf.quad_store import Subject


def check_computed_relations(pending: ChangeDraft, subject: Subject) -> None:
    """Raise ProtectedError if `pending` edits a relation that is computed from geometry."""
    types = {quad.object for quad in pending.before(subject, v.RDF_TYPE, None, v.MAP_GRAPH)}
    if not types:
        return  # a new node is written as a whole
    if NamedNode(v.SPATIAL_RELATION) in types and pending.added.about(subject):
        raise _computed("a here:SpatialRelation")
    for quad in pending.changed(subject):
        if quad.predicate.value == v.BESIDE and _exists(pending, quad.object):
            raise _computed("here:beside")
        if quad.predicate.value == v.HAS_RELATION and quad in pending.added:
            raise _computed("here:hasRelation")


def assert_relations(pending: ChangeDraft, facts: RecordCodec, subject: NamedNode, by: str) -> None:
    """Turn here:on and here:inside of `subject` in `pending` into assertions."""
    check_computed_relations(pending, subject)
    for kind in SINGLE:
        predicate = NamedNode(PREDICATES[kind])
        before, after = (
            {getattr(q.object, "value", "") for q in read(subject, predicate, None, v.MAP_GRAPH)}
            for read in (pending.before, pending.after)
        )
        lost = {other for other in before - after if _exists(pending, NamedNode(other))}
        new = after - before
        if not new and not lost:
            continue
        if not before and pending.is_new(subject) and pending.facts(subject, v.HAS_RELATION):
            continue  # an object of another map, written together with the nodes of its relations
        _assert(pending, facts, subject, kind, min(new) if new else None, by)


def _assert(
    pending: ChangeDraft,
    facts: RecordCodec,
    subject: NamedNode,
    kind: RelationKind,
    value: str | None,
    by: str,
) -> None:
    """Assert that `subject` is on (inside) `value`, or for None that it is on (inside) nothing.

    If the update deletes an asserted relation, the perceived relation takes effect again.
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
        estimate = None if record is None else perceived
        made = Assertion(subject.value, kind, value, by, now, estimate, strength, since)
        pending.change((), assertions.quads(made))
        relations = asserted_relations(relations, kind, value, 1.0)
    _write(pending, subject, kind, tuple(r for r in relations if r.kind == kind))


def _write(
    pending: ChangeDraft, subject: NamedNode, kind: RelationKind, relations: tuple[Relation, ...]
) -> None:
    predicate = NamedNode(PREDICATES[kind])
    old = list(pending.facts(subject, PREDICATES[kind]))
    for quad in pending.facts(subject, v.HAS_RELATION):
        about = list(pending.after(quad.object, None, None, v.MAP_GRAPH))  # type: ignore[arg-type]
        if any(fact.object == predicate for fact in about):
            old += [quad, *about]
    pending.change(old, relation_quads(subject.value, relations))


def _exists(pending: ChangeDraft, thing: object) -> bool:
    return isinstance(thing, NamedNode) and bool(pending.facts(thing, v.RDF_TYPE.value))


def _computed(what: str) -> ProtectedError:
    return ProtectedError(
        f"an update may not write {what}: it is computed from the boxes of the objects; here:on "
        "and here:inside can be written, and positions asserted"
    )

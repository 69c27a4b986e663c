"""Implicit assertions: an update of a perceived property becomes an assertion.

Otherwise the next frame would overwrite the value that a person wrote.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Final

from pyoxigraph import Literal, NamedNode, Quad

from kg.maps.facts.assertions import Assertions, PropertyAssertions, value_of
from kg.maps.facts.objects_and_places import RecordCodec
from kg.maps.facts.spatial_relations import (
    NOTHING,
    PREDICATES,
    SINGLE,
    asserted_relations,
    perceived_value,
    relation_quads,
)
from kg.maps.update.change_draft import ChangeDraft
from kg.model import vocabulary as v
from kg.model.errors import ProtectedError
from kg.model.records import Assertion, PlaceRecord, Relation, RelationKind, likeliest
from kg.rdf.literals import AXES, SIDES
from kg.rdf.quad_store import Subject

Read = Callable[..., Iterator[Quad]]

#: properties that an update asserts anew where they are asserted
_REASSERTED: Final = {
    "position": AXES,
    "extent": (*SIDES, v.YAW),
    "label": (v.RDFS_LABEL,),
}


def assert_perceived_properties(
    pending: ChangeDraft, facts: RecordCodec, subject: NamedNode, by: str
) -> None:
    """Add assertions by `by` for the perceived properties of `subject` that `pending` writes."""
    assertions = Assertions(facts.base)
    previous = assertions.of(pending.engine, subject.value)
    kind = "object" if categories(pending.after, facts, subject, "object") else "place"
    made = [_category(pending, facts, subject, kind, previous, by)]
    for prop, predicates in _REASSERTED.items():
        if prop in previous and pending.writes(subject, *predicates):
            made.append(_reasserted(pending, facts, subject, previous[prop], predicates, by))
    if "existence" in previous and pending.writes(subject, v.EXISTENCE):
        pending.change(_node(pending, assertions, previous["existence"]), ())
    for assertion in filter(None, made):
        before = previous.get(assertion.property)
        old = _node(pending, assertions, before) if before else ()
        pending.change(old, assertions.quads(assertion))
        if assertion.property == "category" and kind == "place":
            _set_beliefs(pending, facts, subject, {assertion.value: 1.0})


def categories(read: Read, facts: RecordCodec, subject: NamedNode, kind: str) -> set[str]:
    """Categories of a kind ("object" or "place") among the types of a subject."""
    types = {getattr(q.object, "value", "") for q in read(subject, v.RDF_TYPE, None, v.MAP_GRAPH)}
    known = {iri: facts.catalogue.by_iri(iri) for iri in types}
    return {
        iri
        for iri, found in known.items()
        if found and (found.kind == "place") == (kind == "place")
    }


def _category(
    pending: ChangeDraft,
    facts: RecordCodec,
    subject: NamedNode,
    kind: str,
    previous: PropertyAssertions,
    by: str,
) -> Assertion | None:
    before = categories(pending.before, facts, subject, kind)
    after = categories(pending.after, facts, subject, kind)
    if not after - before:
        old = previous.get("category")
        if kind == "place" and old is not None and old.value not in after:
            _restore_perceived(pending, facts, subject, old)
        return None
    if kind == "object" and not before:
        return None
    value = min(after - before)
    others = [Quad(subject, v.RDF_TYPE, NamedNode(c), v.MAP_GRAPH) for c in after - {value}]
    pending.change(others, ())
    made = Assertion(subject.value, "category", value, by, time.time())
    if (old := previous.get("category")) is not None:
        made = replace(old, value=value, by=by, stamp=made.stamp)
    elif kind == "object":
        strength = float(_one(pending.before, subject, v.EXISTENCE) or 0)
        made = replace(made, perceived=min(before), strength=strength)
        _relabel(pending, facts, subject, min(before), value)
        _remove_linked(pending, subject, v.HAS_LABEL_BELIEF)
    else:
        beliefs = _beliefs(pending, subject)
        top = likeliest(beliefs)
        strength = 0.0 if top is None else beliefs[top]
        made = replace(made, perceived=top, strength=strength, beliefs=beliefs)
    contradicts = made.perceived is not None and made.perceived != value
    return replace(made, since=(made.since or made.stamp) if contradicts else None)


def _reasserted(
    pending: ChangeDraft,
    facts: RecordCodec,
    subject: NamedNode,
    previous: Assertion,
    predicates: Sequence[str],
    by: str,
) -> Assertion | None:
    """The assertion of the values that an update writes in place of asserted ones."""
    values = [_one(pending.after, subject, predicate) for predicate in predicates]
    if predicates[-1] == v.YAW:
        values[-1] = values[-1] or "0.0"
    if None in values:
        return None  # the shapes report what is missing
    text = " ".join(map(str, values))
    value_of(previous.property, text, facts.catalogue, "object")  # the same as assertions take
    return replace(previous, value=text, by=by, stamp=time.time())


def _relabel(
    pending: ChangeDraft, facts: RecordCodec, subject: NamedNode, old: str, new: str
) -> None:
    """Update a label that consists of the category and the number."""
    label = NamedNode(v.RDFS_LABEL)
    before, after = (
        Quad(subject, label, Literal(facts.catalogue.title(category, subject.value)), v.MAP_GRAPH)
        for category in (old, new)
    )
    if before in pending.facts(subject, v.RDFS_LABEL):
        pending.change([before], [after])


def _restore_perceived(
    pending: ChangeDraft, facts: RecordCodec, subject: NamedNode, previous: Assertion
) -> None:
    """Restore the perceived category of a place whose asserted category was deleted."""
    pending.change(_node(pending, Assertions(facts.base), previous), ())
    _set_beliefs(pending, facts, subject, previous.beliefs)
    if previous.beliefs and previous.perceived is not None:
        pending.change((), [Quad(subject, v.RDF_TYPE, NamedNode(previous.perceived), v.MAP_GRAPH)])


def _set_beliefs(
    pending: ChangeDraft, facts: RecordCodec, subject: NamedNode, beliefs: Mapping[str, float]
) -> None:
    _remove_linked(pending, subject, v.HAS_BELIEF)
    record = PlaceRecord(subject.value, "", 0.0, 0.0, 0.0, 0.0, beliefs=beliefs)
    pending.change((), facts.of_beliefs(record))


def _remove_linked(pending: ChangeDraft, subject: NamedNode, link: str) -> None:
    """Remove the nodes that a property of `subject` points at, and the property."""
    old = list(pending.facts(subject, link))
    for quad in tuple(old):
        if isinstance(quad.object, NamedNode):
            old += pending.after(quad.object, None, None, v.MAP_GRAPH)
    pending.change(old, ())


def _beliefs(pending: ChangeDraft, subject: NamedNode) -> dict[str, float]:
    beliefs = {}
    for quad in pending.before(subject, NamedNode(v.HAS_BELIEF), None, v.MAP_GRAPH):
        if isinstance(quad.object, NamedNode):
            category = _one(pending.before, quad.object, v.OF_CATEGORY)
            share = _one(pending.before, quad.object, v.BELIEF)
            if category is not None and share is not None:
                beliefs[category] = float(share)
    return beliefs


def _node(pending: ChangeDraft, assertions: Assertions, previous: Assertion) -> list[Quad]:
    """All quads of a stored assertion."""
    node = assertions.iri(previous.subject, previous.property)
    return [
        quad
        for quad in assertions.stored(pending.engine, previous.subject)
        if isinstance(quad.subject, NamedNode)
        and (quad.subject.value == node or quad.subject.value.startswith(node + "/"))
    ]


def _one(read: Read, subject: NamedNode, predicate: str) -> str | None:
    for quad in read(subject, NamedNode(predicate), None, v.MAP_GRAPH):
        return str(getattr(quad.object, "value", quad.object))
    return None


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
        pending.change(_node(pending, assertions, previous), ())
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

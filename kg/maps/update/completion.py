"""Completion of updates: adds the facts that follow from an edit by a person.

People write "a cup at 1, 2" or delete object 17. The completion derives the other facts:

- An object with a class and a position gets z, label, cell, place, confidence, existence, count
  and times. The cell follows x and y.
- If all facts of a subject are removed, its observation, its beliefs, the assertions about it and
  the references to it are removed too.
- The number of an object that was added by hand is not assigned again.
- A category becomes an assertion, so that perception does not overwrite it; so does a position or
  label that was asserted before, and here:on and here:inside. Other relations are computed from
  geometry and cannot be written.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

from pyoxigraph import Literal, NamedNode, Quad

from kg.maps.facts.assertions import Assertions
from kg.maps.facts.objects_and_places import RecordCodec
from kg.maps.facts.spatial_relations import relation_nodes
from kg.maps.update.change_draft import ChangeDraft
from kg.maps.update.implicit_assertions import (
    assert_perceived_properties,
    assert_relations,
    categories,
    check_computed_relations,
)
from kg.maps.update.validation import is_place
from kg.model import vocabulary as v
from kg.model.areas import MAX_COORDINATE
from kg.model.errors import InvalidFactError
from kg.model.iris import MAX_NUMBER, observation_iri, whole_number
from kg.rdf.literals import area_of_polygon, cell_of, now
from kg.store.scheduling import check_facts

_OTHER_NUMBERS: Final = {v.XSD + name for name in ("decimal", "integer", "float")}
_EDGES: Final = (v.X_MIN, v.X_MAX, v.Y_MIN, v.Y_MAX)


def complete_change(pending: ChangeDraft, facts: RecordCodec, by: str | None) -> None:
    """Add to `pending` the facts that follow from it in the map of `facts`."""
    touched = dict.fromkeys(
        quad.subject
        for quad in (*pending.removed, *pending.added)
        if quad.graph_name == v.MAP_GRAPH and isinstance(quad.subject, NamedNode)
    )
    for subject in touched:
        check_facts(len(pending.added) + len(pending.removed))
        if next(pending.after(subject, None, None, v.MAP_GRAPH), None) is None:
            _remove_dependents(pending, facts, subject)
            continue
        if kinds := categories(pending.after, facts, subject, "object"):
            _complete_object(pending, facts, subject, min(kinds))
            assert_relations(pending, facts, subject, by or "somebody")
        elif is_place(pending.after, facts, subject):
            _complete_place(pending, subject)
        else:
            check_computed_relations(pending, subject)
        assert_perceived_properties(pending, facts, subject, by or "somebody")
    _advance_number(pending, facts, (s for s in touched if pending.added.about(s)))


def _remove_dependents(pending: ChangeDraft, facts: RecordCodec, removed: NamedNode) -> None:
    """Remove the nodes that depend on `removed`."""
    follow = [*pending.after(None, None, removed, v.MAP_GRAPH)]
    owned = {observation_iri(facts.base, removed.value)}
    owned.update(
        quad.object.value
        for quad in pending.removed.about(removed)
        if quad.predicate.value in (v.HAS_BELIEF, v.HAS_LABEL_BELIEF)
        and isinstance(quad.object, NamedNode)
    )
    nodes = relation_nodes(pending.engine, removed.value)
    owned.update(nodes)
    for node in nodes:
        follow += pending.after(None, None, NamedNode(node), v.MAP_GRAPH)
    for iri in owned:
        follow += pending.after(NamedNode(iri), None, None, v.MAP_GRAPH)
    assertions = Assertions(facts.base)
    follow += assertions.stored(pending.engine, removed.value)
    follow += assertions.naming(pending.engine, removed.value)
    pending.change(follow, ())


def _complete_object(
    pending: ChangeDraft, facts: RecordCodec, subject: NamedNode, category: str
) -> None:
    """Complete an object: numbers as doubles, the cell of its position, and missing facts."""
    _write_doubles(pending, subject, (v.X, v.Y, v.Z, v.CONFIDENCE, v.EXISTENCE))
    _assign_cell(pending, subject)
    if not pending.is_new(subject):
        return  # the shapes report missing facts
    moment = now()
    for predicate, value in (
        (v.Z, Literal(0.0)),
        (v.RDFS_LABEL, Literal(facts.catalogue.title(category, subject.value))),
        (v.CONFIDENCE, Literal(1.0)),
        (v.EXISTENCE, Literal(1.0)),
        (v.OBSERVATION_COUNT, Literal(1)),
        (v.LAST_SEEN, _literal(pending, subject, v.FIRST_SEEN) or moment),
        (v.FIRST_SEEN, _literal(pending, subject, v.LAST_SEEN) or moment),
    ):
        _set_default(pending, subject, predicate, value)


def _complete_place(pending: ChangeDraft, subject: NamedNode) -> None:
    """Complete a place: numbers as doubles, rectangle and centre of the outline, missing facts."""
    _write_doubles(pending, subject, _EDGES)
    _complete_outline(pending, subject)
    if pending.writes(subject, v.OUTLINE, *_EDGES):  # drawn by a person: mapping keeps it
        pending.change(pending.facts(subject, v.FROM_FLOOR), ())
    outlined = _literal(pending, subject, v.OUTLINE) is not None
    if pending.writes(subject, *_EDGES) and not outlined:
        xmin, xmax, ymin, ymax = (_coordinate(pending, subject, edge) for edge in _EDGES)
        for axis, low, high in ((v.X, xmin, xmax), (v.Y, ymin, ymax)):
            if low is not None and high is not None:
                _replace_number(pending, subject, axis, (low + high) / 2)
    if not pending.is_new(subject):
        return
    kinds = [
        Quad(subject, v.RDF_TYPE, NamedNode(kind), v.MAP_GRAPH) for kind in (v.PLACE, v.BOT_SPACE)
    ]
    pending.change((), kinds)
    name = " ".join(subject.value.rstrip("/").split("/")[-2:])
    _set_default(pending, subject, v.RDFS_LABEL, Literal(name))
    _set_default(pending, subject, v.VIEW_COUNT, Literal(0))


def _complete_outline(pending: ChangeDraft, subject: NamedNode) -> None:
    """Rectangle and centre of a new outline; a new rectangle replaces the outline.

    An outline that encloses nothing stays: the shapes report it, or readers ignore it.
    """
    if not pending.writes(subject, v.OUTLINE):
        if pending.writes(subject, *_EDGES):
            pending.change(pending.facts(subject, v.OUTLINE), ())
        return
    literal = _literal(pending, subject, v.OUTLINE)
    try:
        area = area_of_polygon(literal.value if literal else "")
    except ValueError:
        return
    sides = (area.xmin, area.xmax, area.ymin, area.ymax, *area.centre)
    for predicate, value in zip((*_EDGES, v.X, v.Y), sides, strict=True):
        _replace_number(pending, subject, predicate, value)


def _set_default(pending: ChangeDraft, subject: NamedNode, predicate: str, value: Literal) -> None:
    if _literal(pending, subject, predicate) is None:
        pending.change((), [Quad(subject, NamedNode(predicate), value, v.MAP_GRAPH)])


def _replace_number(pending: ChangeDraft, subject: NamedNode, predicate: str, value: float) -> None:
    new = Quad(subject, NamedNode(predicate), Literal(round(value, 2) + 0.0), v.MAP_GRAPH)
    pending.change(pending.facts(subject, predicate), [new])


def _assign_cell(pending: ChangeDraft, subject: NamedNode) -> None:
    x, y = _coordinate(pending, subject, v.X), _coordinate(pending, subject, v.Y)
    if x is None or y is None or not pending.writes(subject, v.X, v.Y):
        return
    cell = Quad(subject, NamedNode(v.IN_CELL), NamedNode(cell_of(x, y)), v.MAP_GRAPH)
    pending.change((q for q in pending.facts(subject, v.IN_CELL) if q != cell), [cell])


def _write_doubles(pending: ChangeDraft, subject: NamedNode, predicates: Iterable[str]) -> None:
    """Replace decimals, integers and floats by doubles."""
    for quad in [quad for predicate in predicates for quad in pending.facts(subject, predicate)]:
        value = quad.object
        if isinstance(value, Literal) and value.datatype.value in _OTHER_NUMBERS:
            number = Literal(float(value.value))
            pending.change([quad], [Quad(subject, quad.predicate, number, v.MAP_GRAPH)])


def _literal(pending: ChangeDraft, subject: NamedNode, predicate: str) -> Literal | None:
    values = (quad.object for quad in pending.facts(subject, predicate))
    return next((value for value in values if isinstance(value, Literal)), None)


def _coordinate(pending: ChangeDraft, subject: NamedNode, axis: str) -> float | None:
    literal = _literal(pending, subject, axis)
    try:
        number = float(literal.value) if literal else None
    except ValueError:
        return None
    return number if number is not None and abs(number) <= MAX_COORDINATE else None


def _number_of(facts: RecordCodec, subject: NamedNode) -> int:
    """The number in the IRI of an object of this map; 0 for other things."""
    local = subject.value.removeprefix(facts.base + "object/")
    if local == subject.value or not (local.isascii() and local.isdigit()):
        return 0
    number = whole_number(local)
    if number is None or number > MAX_NUMBER:
        raise InvalidFactError(
            f"no object has a number of {len(local)} digits; up to {len(str(MAX_NUMBER))} digits "
            "would work"
        )
    return number


def _advance_number(pending: ChangeDraft, facts: RecordCodec, touched: Iterable[NamedNode]) -> None:
    used = max((_number_of(facts, subject) for subject in touched), default=0)
    base, next_object = NamedNode(facts.base), NamedNode(v.NEXT_OBJECT)
    for quad in tuple(pending.after(base, next_object, None, v.DATASET_GRAPH)):
        if isinstance(quad.object, Literal) and int(quad.object.value) <= used:
            pending.change([quad], [Quad(base, next_object, Literal(used + 1), v.DATASET_GRAPH)])

"""Completion of updates: adds the facts that follow from an edit by a person.

People write "a cup at 1, 2" or "no object 17", not the derived facts:

- An object with a class and a position gets z, label, cell, place, confidence, existence, count
  and times. The cell follows x and y.
- If all facts of a subject are removed, its observation, its beliefs, the assertions about it and
  the references to it are removed too.
- The number of an object that was added by hand is not assigned again.
- A category, and a position or label that was asserted before, becomes an assertion, so that
  perception does not overwrite it. So do here:on and here:inside. Other relations are computed
  from geometry and cannot be written.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

from pyoxigraph import Literal, NamedNode, Quad

from kg.maps.facts.assertions import Assertions
from kg.maps.facts.objects_and_places import RecordCodec
from kg.maps.facts.relations import relation_nodes
from kg.maps.update.change_draft import ChangeDraft, Subject
from kg.maps.update.implicit_assertions import assert_perceived_properties
from kg.maps.update.implicit_assertions import categories as _categories
from kg.maps.update.relation_assertions import assert_relations, check_computed_relations
from kg.model import vocabulary as v
from kg.model.iris import observation_iri
from kg.rdf.datetimes import now
from kg.rdf.grid_cells import cell_of
from kg.rdf.wkt import area_of_polygon

_NUMERIC: Final = {v.XSD + name for name in ("decimal", "integer", "double", "float")}
_EDGES: Final = (v.X_MIN, v.X_MAX, v.Y_MIN, v.Y_MAX)
_OUTLINE: Final = NamedNode(v.OUTLINE)
_DOUBLES: Final = (v.X, v.Y, v.Z, v.CONFIDENCE, v.EXISTENCE)


def complete_change(pending: ChangeDraft, facts: RecordCodec, by: str | None) -> None:
    """Add to `pending` the facts that follow from it in the map of `facts`."""
    touched = dict.fromkeys(
        quad.subject
        for quad in (*pending.removed, *pending.added)
        if quad.graph_name == v.MAP_GRAPH and isinstance(quad.subject, NamedNode)
    )
    for subject in touched:
        if next(pending.after(subject, None, None, v.MAP_GRAPH), None) is None:
            _remove_dependents(pending, facts, subject)
            continue
        if _categories(pending.after, facts, subject, "object"):
            _complete(pending, facts, subject)
            assert_relations(pending, facts, subject, by or "somebody")
        elif _is_place(pending, facts, subject):
            _complete_place(pending, subject)
        else:
            check_computed_relations(pending, subject)
        assert_perceived_properties(pending, facts, subject, by or "somebody")
    _count_up(pending, facts, touched)


def _is_place(pending: ChangeDraft, facts: RecordCodec, subject: NamedNode) -> bool:
    kind = Quad(subject, v.RDF_TYPE, NamedNode(v.PLACE), v.MAP_GRAPH)
    return kind in pending.after(subject, v.RDF_TYPE, None, v.MAP_GRAPH) or bool(
        _categories(pending.after, facts, subject, "place")
    )


def _remove_dependents(pending: ChangeDraft, facts: RecordCodec, removed: NamedNode) -> None:
    """Remove the nodes that depend on `removed`."""
    follow = [*pending.after(None, None, removed, v.MAP_GRAPH)]
    owned = {observation_iri(facts.base, removed.value)}
    owned.update(
        quad.object.value
        for quad in pending.removed
        if quad.subject == removed
        and quad.predicate.value in (v.HAS_BELIEF, v.HAS_LABEL_BELIEF)
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


def _complete(pending: ChangeDraft, facts: RecordCodec, subject: NamedNode) -> None:
    """Complete an object: numbers as doubles, the cell of its position, and missing facts."""
    for predicate in _DOUBLES:
        for quad in tuple(pending.after(subject, NamedNode(predicate), None, v.MAP_GRAPH)):
            _as_double(pending, quad)
    _assign_cell(pending, subject)
    if not _is_new(pending, subject):
        return  # the shapes report what is missing
    for predicate, value in (
        (v.Z, Literal(0.0)),
        (v.RDFS_LABEL, Literal(_label(pending, facts, subject))),
        (v.CONFIDENCE, Literal(1.0)),
        (v.EXISTENCE, Literal(1.0)),
        (v.OBSERVATION_COUNT, Literal(1)),
        (v.LAST_SEEN, _only(pending, subject, v.FIRST_SEEN) or now()),
        (v.FIRST_SEEN, _only(pending, subject, v.LAST_SEEN) or now()),
    ):
        if _only(pending, subject, predicate) is None:
            pending.change((), [Quad(subject, NamedNode(predicate), value, v.MAP_GRAPH)])


def _complete_place(pending: ChangeDraft, subject: NamedNode) -> None:
    """Complete a place: numbers as doubles, rectangle and centre of the outline, missing facts."""
    for predicate in _EDGES:
        for quad in tuple(pending.after(subject, NamedNode(predicate), None, v.MAP_GRAPH)):
            _as_double(pending, quad)
    _complete_outline(pending, subject)
    edges = [_coordinate(pending, subject, edge) for edge in _EDGES]
    if _touched(pending, subject, (v.OUTLINE, *_EDGES)):  # drawn by a person: mapping keeps it
        pending.change(list(pending.after(subject, NamedNode(v.FROM_FLOOR), None, v.MAP_GRAPH)), ())
    outlined = _only(pending, subject, v.OUTLINE) is not None
    if _touched(pending, subject, _EDGES) and not outlined:
        for axis, least, most in ((v.X, edges[0], edges[1]), (v.Y, edges[2], edges[3])):
            if least is not None and most is not None:
                _replace_number(pending, subject, axis, (least + most) / 2)
    if not _is_new(pending, subject):
        return
    kinds = [
        Quad(subject, v.RDF_TYPE, NamedNode(kind), v.MAP_GRAPH) for kind in (v.PLACE, v.BOT_SPACE)
    ]
    pending.change((), kinds)
    name = " ".join(subject.value.rstrip("/").split("/")[-2:])
    for predicate, value in ((v.RDFS_LABEL, Literal(name)), (v.VIEW_COUNT, Literal(0))):
        if _only(pending, subject, predicate) is None:
            pending.change((), [Quad(subject, NamedNode(predicate), value, v.MAP_GRAPH)])


def _complete_outline(pending: ChangeDraft, subject: NamedNode) -> None:
    """Rectangle and centre of a new outline; a new rectangle replaces the outline.

    An outline that encloses nothing is left for the shapes to report, or to be read as none.
    """
    if not _touched(pending, subject, (v.OUTLINE,)):
        if _touched(pending, subject, _EDGES):
            pending.change(list(pending.after(subject, _OUTLINE, None, v.MAP_GRAPH)), ())
        return
    literal = _only(pending, subject, v.OUTLINE)
    try:
        area = area_of_polygon(literal.value) if literal is not None else None
    except ValueError:
        area = None
    if area is None:
        return
    sides = (area.xmin, area.xmax, area.ymin, area.ymax, *area.centre)
    for predicate, value in zip((*_EDGES, v.X, v.Y), sides, strict=True):
        _replace_number(pending, subject, predicate, value)


def _replace_number(pending: ChangeDraft, subject: NamedNode, predicate: str, value: float) -> None:
    old = list(pending.after(subject, NamedNode(predicate), None, v.MAP_GRAPH))
    number = Literal(round(value, 2) + 0.0)
    pending.change(old, [Quad(subject, NamedNode(predicate), number, v.MAP_GRAPH)])


def _assign_cell(pending: ChangeDraft, subject: NamedNode) -> None:
    x, y = _coordinate(pending, subject, v.X), _coordinate(pending, subject, v.Y)
    if x is None or y is None or not _touched(pending, subject, (v.X, v.Y)):
        return
    in_cell = NamedNode(v.IN_CELL)
    cell = Quad(subject, in_cell, NamedNode(cell_of(x, y)), v.MAP_GRAPH)
    old = [q for q in pending.after(subject, in_cell, None, v.MAP_GRAPH) if q != cell]
    pending.change(old, [cell])


def _is_new(pending: ChangeDraft, subject: NamedNode) -> bool:
    return next(pending.before(subject, v.RDF_TYPE, None, v.MAP_GRAPH), None) is None


def _touched(pending: ChangeDraft, subject: NamedNode, predicates: Iterable[str]) -> bool:
    return any(
        quad.subject == subject and quad.predicate.value in predicates
        for quad in (*pending.added, *pending.removed)
    )


def _as_double(pending: ChangeDraft, quad: Quad) -> None:
    value = quad.object
    if isinstance(value, Literal) and value.datatype.value in _NUMERIC - {v.XSD_DOUBLE.value}:
        number = Literal(float(value.value))
        pending.change([quad], [Quad(quad.subject, quad.predicate, number, v.MAP_GRAPH)])


def _only(pending: ChangeDraft, subject: NamedNode, predicate: str) -> Literal | None:
    for quad in pending.after(subject, NamedNode(predicate), None, v.MAP_GRAPH):
        if isinstance(quad.object, Literal):
            return quad.object
    return None


def _coordinate(pending: ChangeDraft, subject: NamedNode, axis: str) -> float | None:
    literal = _only(pending, subject, axis)
    try:
        number = float(literal.value) if literal else None
    except ValueError:
        return None
    return number if number is not None and abs(number) < 1e9 else None


def _label(pending: ChangeDraft, facts: RecordCodec, subject: NamedNode) -> str:
    for quad in pending.after(subject, v.RDF_TYPE, None, v.MAP_GRAPH):
        category = facts.catalogue.by_iri(getattr(quad.object, "value", ""))
        if category is not None:
            return f"{category.label} {subject.value.rstrip('/').rpartition('/')[2]}"
    return subject.value


def _count_up(pending: ChangeDraft, facts: RecordCodec, touched: Iterable[Subject]) -> None:
    used = 0
    for subject in touched:
        number = getattr(subject, "value", "").removeprefix(facts.base + "object/")
        if number.isascii() and number.isdigit():
            used = max(used, int(number))
    base, following = NamedNode(facts.base), NamedNode(v.NEXT_OBJECT)
    for quad in tuple(pending.after(base, following, None, v.DATASET_GRAPH)):
        if isinstance(quad.object, Literal) and int(quad.object.value) <= used:
            pending.change([quad], [Quad(base, following, Literal(used + 1), v.DATASET_GRAPH)])

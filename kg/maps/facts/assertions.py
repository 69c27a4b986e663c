"""Assertions: values stated by persons override the estimates of perception.

An assertion is in graph:assertions, the value in effect in graph:map. The writer also keeps
perception's present estimate with the assertion, so that a retraction restores the estimate
(docs/how-to/correct.md).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Final, get_args
from urllib.parse import quote, unquote

import numpy as np
from pyoxigraph import Literal, NamedNode, Quad

from kg.knowledge.ontology.catalogue import NAMED, Catalogue
from kg.maps.facts.spatial_relations import NOTHING, SINGLE, asserted_relations, perceived_value
from kg.maps.thing_names import asserted_category, check_label, checked_line
from kg.model import vocabulary as v
from kg.model.areas import MAX_COORDINATE, Area
from kg.model.errors import InvalidFactError
from kg.model.iris import agent_iri
from kg.model.records import Assertion, ObjectRecord, PlaceRecord, likeliest
from kg.rdf.literals import (
    area_of_polygon,
    date_time,
    first,
    iri_node,
    polygon_text,
    properties_of,
    stamp_of,
)
from kg.rdf.quad_store import QuadStore

#: Properties that can be asserted of objects, and of places.
PROPERTIES: Final[tuple[str, ...]] = get_args(v.ObjectProperty)
PLACE_PROPERTIES: Final[tuple[str, ...]] = get_args(v.PlaceProperty)
#: A further property: a name. Of an object its category is asserted, and made if need be; of a
#: place its label is.
NAME: Final = "name"
#: Positions farther apart than this contradict each other [m].
CONFLICT_DISTANCE: Final = 0.5
MIN_CONFIDENCE: Final = 0.01  # of an object that only an assertion keeps in the map

_OF: Final = NamedNode(v.ASSERTED_OF)
_VALUE: Final = NamedNode(v.ASSERTED_VALUE)


def kept_property(prop: str, iri: str) -> str:
    """The property of a thing, by its IRI or id, in which what is asserted of `prop` is kept."""
    if prop != NAME:
        return prop
    return "label" if iri.rpartition("/")[0].rpartition("/")[2] == "place" else "category"


PropertyAssertions = Mapping[str, Assertion]  # by property


@dataclass(frozen=True, slots=True)
class Assertions:
    """Reads and writes the assertions of the map with IRI `base`."""

    base: str

    def any(self, store: QuadStore) -> bool:
        """Whether the map has any assertion."""
        return next(store.quads_for_pattern(None, _OF, None, v.ASSERTIONS_GRAPH), None) is not None

    def of(self, store: QuadStore, subject: str) -> dict[str, Assertion]:
        """The assertions about a subject, by property."""
        node = iri_node(subject, "a thing")
        return {found.property: found for found in self._read_all(store, node)}

    def all(self, store: QuadStore) -> tuple[Assertion, ...]:
        """All assertions, by subject and property."""
        found = self._read_all(store, None)
        return tuple(sorted(found, key=lambda a: (len(a.subject), a.subject, a.property)))

    def iri(self, subject: str, prop: str) -> str:
        """IRI of the assertion of a property of a subject."""
        return f"{self.base}assertion/{self._local(subject)}/{prop}"

    def subject(self, iri: str) -> str | None:
        """Subject of the assertion with this IRI; None for another IRI."""
        rest = iri.removeprefix(f"{self.base}assertion/")
        if rest == iri or "/" not in rest:
            return None
        local = rest.split("/perceived/")[0].rpartition("/")[0]
        return unquote(local) if "%3A" in local else self.base + local

    def stored(self, store: QuadStore, subject: str) -> Iterator[Quad]:
        """All quads of graph:assertions about a subject."""
        for quad in store.quads_for_pattern(None, _OF, NamedNode(subject), v.ASSERTIONS_GRAPH):
            for fact in store.quads_for_pattern(quad.subject, None, None, v.ASSERTIONS_GRAPH):
                yield fact
                if fact.predicate.value == v.PERCEIVED_BELIEF and not isinstance(
                    fact.object, Literal
                ):
                    yield from store.quads_for_pattern(fact.object, None, None, v.ASSERTIONS_GRAPH)

    def naming(self, store: QuadStore, other: str) -> Iterator[Quad]:
        """All quads of assertions that an object is on or inside `other`."""
        for quad in store.quads_for_pattern(None, _VALUE, NamedNode(other), v.ASSERTIONS_GRAPH):
            yield from store.quads_for_pattern(quad.subject, None, None, v.ASSERTIONS_GRAPH)

    def quads(self, assertion: Assertion) -> list[Quad]:
        """Quads of an assertion and of its author."""
        node = self.iri(assertion.subject, assertion.property)
        if not is_unicode(assertion.by):
            raise InvalidFactError(f"the author's name must be Unicode text, got {assertion.by!r}")
        agent = agent_iri(self.base, assertion.by)
        facts: list[tuple[str, str, NamedNode | Literal]] = [
            (node, v.RDF_TYPE.value, NamedNode(v.ASSERTION)),
            (node, v.ASSERTED_OF, NamedNode(assertion.subject)),
            (node, v.ASSERTED_PROPERTY, Literal(assertion.property)),
            (node, v.ASSERTED_VALUE, _term(assertion.property, assertion.value)),
            (node, v.PROV_ATTRIBUTED_TO, NamedNode(agent)),
            (node, v.PROV_GENERATED_AT, date_time(assertion.stamp)),
        ]
        if assertion.perceived is not None:
            value = _term(assertion.property, assertion.perceived)
            facts.append((node, v.PERCEIVED_VALUE, value))
            strength = Literal(round(assertion.strength, 2) + 0.0)
            facts.append((node, v.PERCEIVED_STRENGTH, strength))
        if assertion.since is not None:
            facts.append((node, v.CONFLICT_SINCE, date_time(assertion.since)))
        for category, belief in sorted(assertion.beliefs.items()):
            held = f"{node}/perceived/{quote(category.removeprefix(v.HERE), safe='')}"
            facts += [
                (node, v.PERCEIVED_BELIEF, NamedNode(held)),
                (held, v.RDF_TYPE.value, NamedNode(v.PLACE_BELIEF)),
                (held, v.OF_CATEGORY, NamedNode(category)),
                (held, v.BELIEF, Literal(round(belief, 2) + 0.0)),
            ]
        quads = [Quad(NamedNode(s), NamedNode(p), o, v.ASSERTIONS_GRAPH) for s, p, o in facts]
        return [*quads, *agent_quads(self.base, assertion.by, v.ASSERTIONS_GRAPH)]

    def _local(self, subject: str) -> str:
        kept = subject.removeprefix(self.base)
        return quote(subject, safe="") if kept == subject else kept

    def _read_all(self, store: QuadStore, subject: NamedNode | None) -> Iterator[Assertion]:
        for quad in store.quads_for_pattern(None, _OF, subject, v.ASSERTIONS_GRAPH):
            if isinstance(quad.subject, NamedNode):
                yield self._read(store, quad.subject.value)

    def _read(self, store: QuadStore, node: str) -> Assertion:
        values = properties_of(store, node, v.ASSERTIONS_GRAPH)
        agent = first(values, v.PROV_ATTRIBUTED_TO, self.base)
        author = properties_of(store, agent, v.ASSERTIONS_GRAPH)
        held = values.get(v.PERCEIVED_BELIEF, ())
        beliefs = [properties_of(store, one, v.ASSERTIONS_GRAPH) for one in held]
        return Assertion(
            subject=first(values, v.ASSERTED_OF, ""),
            property=first(values, v.ASSERTED_PROPERTY, ""),
            value=first(values, v.ASSERTED_VALUE, ""),
            by=first(author, v.RDFS_LABEL, ""),
            stamp=stamp_of(values, v.PROV_GENERATED_AT),
            perceived=first(values, v.PERCEIVED_VALUE, "") or None,
            strength=float(first(values, v.PERCEIVED_STRENGTH, "0")),
            since=stamp_of(values, v.CONFLICT_SINCE) if v.CONFLICT_SINCE in values else None,
            beliefs={one[v.OF_CATEGORY][0]: float(one[v.BELIEF][0]) for one in beliefs},
        )


def agent_quads(base: str, name: str, graph: NamedNode) -> Iterator[Quad]:
    """Type and label of the author `name` (prov:Agent)."""
    node = NamedNode(agent_iri(base, name))
    yield Quad(node, v.RDF_TYPE, NamedNode(v.PROV_AGENT), graph)
    yield Quad(node, NamedNode(v.RDFS_LABEL), Literal(name), graph)


def value_of(prop: str, given: object, catalogue: Catalogue, kind: str) -> str:
    """Normalised value of an assertion about a `kind` ("object" or "place").

    `given` is a category's label or IRI; (x, y, z) [m] or "x y z"; the sides of a box and its yaw,
    (dx, dy, dz [m], yaw [rad]) or "dx dy dz yaw", whose yaw may be left out; present or absent; a
    label; an area in well-known text [m]; a note, which changes nothing else.
    Raises UnknownCategoryError, and InvalidFactError for an invalid property or value.
    """
    allowed = PROPERTIES if kind == "object" else PLACE_PROPERTIES
    if prop not in allowed:
        raise InvalidFactError(
            f"{prop!r} of {kind}s cannot be asserted; these can: {', '.join(allowed)}"
        )
    if prop == "category":
        return asserted_category(catalogue, str(given), kind).iri
    if prop == "position":
        return _position(given)
    if prop == "extent":
        return _extent(given)
    if prop == "area":
        return _area(given)
    text = str(given).strip()
    if prop == "existence" and text not in ("present", "absent"):
        raise InvalidFactError(f"existence must be present or absent, got {text[:100]!r}")
    if not text:
        raise InvalidFactError(f"a {prop} must have at least one character")
    if prop == "note":
        return checked_line(text, "a note", "closed for painting until Friday")
    if prop == "label":
        text = checked_line(text, "a label", "cup by the sink")
        check_label(text)
    return text


def is_unicode(text: str) -> bool:
    """Whether a text can be encoded, that is, has no unpaired surrogate."""
    try:
        text.encode()
    except UnicodeEncodeError:
        return False
    return True


def believed_object(record: ObjectRecord, assertions: PropertyAssertions) -> ObjectRecord:
    """The object with its assertions in place of perception's estimates."""
    if not assertions:
        return record
    for prop, assertion in assertions.items():
        record = _with_value(record, prop, assertion.value)
        if prop in SINGLE:
            record = _related(record, prop, assertion.value, 1.0)
        elif prop == "category":
            record = replace(record, labels={})
        elif prop == "existence" and assertion.value == "present":
            record = replace(record, existence=1.0)
        elif prop == "existence":
            record = replace(record, existence=0.0, labels={})
    return replace(record, confidence=max(record.confidence, MIN_CONFIDENCE))


def perceived_object(record: ObjectRecord, assertions: PropertyAssertions) -> ObjectRecord:
    """Perception's estimate of an object, from the map's record and its assertions."""
    for prop, assertion in assertions.items():
        if prop in SINGLE:
            record = _related(record, prop, assertion.perceived, assertion.strength)
        elif assertion.perceived is not None and prop == "existence":
            record = replace(record, existence=float(assertion.perceived))
        elif assertion.perceived is not None:
            record = _with_value(record, prop, assertion.perceived)
        elif prop == "extent":  # perception has no box
            record = replace(record, extent=None, yaw=0.0)
    return record


def _with_value(record: ObjectRecord, prop: str, text: str) -> ObjectRecord:
    """The object with the category, position or extent that `text` says."""
    if prop == "category":
        return replace(record, category=text)
    if prop == "position":
        return replace(record, p_map=point(text))
    if prop == "extent":
        *sides, yaw = point(text)
        return replace(record, extent=np.array(sides), yaw=float(yaw))
    return record


def _related(
    record: ObjectRecord, kind: str, target: str | None, probability: float
) -> ObjectRecord:
    if record.relations is None:
        return record
    relations = asserted_relations(record.relations, kind, target, probability)
    return replace(record, relations=relations)


def believed_place(record: PlaceRecord, assertions: PropertyAssertions) -> PlaceRecord:
    """As `believed_object`, of a place: an asserted category has belief 1."""
    if (category := assertions.get("category")) is not None:
        record = replace(record, beliefs={category.value: 1.0})
    if (label := assertions.get("label")) is not None:
        record = replace(record, label=label.value)
    if (area := assertions.get("area")) is not None:
        record = record.with_area(area_of_polygon(area.value))
    return record


def perceived_place(record: PlaceRecord, assertions: PropertyAssertions) -> PlaceRecord:
    """As `perceived_object`, of a place; an asserted area stays, as perception keeps it."""
    if (category := assertions.get("category")) is not None:
        record = replace(record, beliefs=category.beliefs)
    if (label := assertions.get("label")) is not None and label.perceived is not None:
        record = replace(record, label=label.perceived)
    return record


def compared(assertion: Assertion, record: ObjectRecord | PlaceRecord, now: float) -> Assertion:
    """The assertion with perception's present estimate; a conflict begins at `now` [s]."""
    if isinstance(record, PlaceRecord):
        return _about_place(assertion, record, now)
    return _about_object(assertion, record, now)


def _about_object(assertion: Assertion, record: ObjectRecord, now: float) -> Assertion:
    if assertion.property == "label":
        return assertion
    if assertion.property in SINGLE:
        if record.relations is None:
            return assertion
        perceived, strength = perceived_value(record.relations, assertion.property)
        return _compared(replace(assertion, perceived=perceived, strength=strength), now)
    box = None if record.extent is None else _number_text((*record.extent, record.yaw))
    estimate = {
        "category": record.category,
        "position": _position(record.p_map),
        "extent": box,
        "existence": f"{max(record.existence, 0.0):.2f}",
    }[assertion.property]
    strength = max(record.existence, 0.0)
    if assertion.property == "existence" and assertion.value == "present":
        strength = 1.0 - strength
    return _compared(replace(assertion, perceived=estimate, strength=strength), now)


def _about_place(assertion: Assertion, record: PlaceRecord, now: float) -> Assertion:
    if assertion.property in ("area", "note"):
        return assertion
    if assertion.property == "label":
        return replace(assertion, perceived=record.label)
    beliefs = record.beliefs
    top = likeliest(beliefs)
    strength = 0.0 if top is None else beliefs[top]
    updated = replace(assertion, perceived=top, strength=strength, beliefs=dict(beliefs))
    return _compared(updated, now)


def point(text: str) -> np.ndarray:
    """(3,) [m] from ``"x y z"``, or any other numbers from text."""
    return np.array([float(number) for number in text.split()], dtype=np.float64)


def _compared(assertion: Assertion, now: float) -> Assertion:
    if not _contradicts(assertion):
        return replace(assertion, since=None)
    return assertion if assertion.since is not None else replace(assertion, since=now)


def _contradicts(assertion: Assertion) -> bool:
    value, perceived = assertion.value, assertion.perceived
    if perceived is None:
        return False
    if assertion.property == "position":
        return bool(np.linalg.norm(point(value) - point(perceived)) > CONFLICT_DISTANCE)
    if assertion.property == "existence":
        return (float(perceived) > 0) == (value == "absent")
    if assertion.property == "extent":
        sides, seen = (np.sort(point(text)[:3]) for text in (value, perceived))
        return bool(np.abs(sides - seen).max() > CONFLICT_DISTANCE)
    if assertion.property == "category" and value.startswith(NAMED):
        return False  # no detector knows the names that people give
    return value != perceived and perceived != v.UNNAMED_THING


def _position(given: object) -> str:
    numbers = [round(number, 2) + 0.0 for number in _numbers(given)]
    if len(numbers) != 3 or not all(abs(number) <= MAX_COORDINATE for number in numbers):
        raise InvalidFactError(
            f"a position must be three finite numbers x y z [m], up to {MAX_COORDINATE:g}, "
            f"got {repr(given)[:100]}"
        )
    short = all(abs(number) < 1e4 for number in numbers)
    return " ".join(f"{number:g}" if short else f"{number}" for number in numbers)


def _extent(given: object) -> str:
    numbers = _numbers(given)
    *sides, yaw = numbers if len(numbers) == 4 else (*numbers, 0.0)
    whole = len(sides) == 3 and all(0 < side <= MAX_COORDINATE for side in sides)
    if not whole or not abs(yaw) <= math.pi:
        raise InvalidFactError(
            "an extent must be three lengths dx dy dz above 0 [m] and, where the box is turned, a "
            f"yaw of -3.14 to 3.14 [rad], as in 1.2 0.8 0.75 0.3; got {repr(given)[:100]}"
        )
    return _number_text((*sides, yaw))


def _numbers(given: object) -> list[float]:
    """The numbers of a sequence, or of text with commas or spaces; none where one is no number."""
    try:
        parts = given.replace(",", " ").split() if isinstance(given, str) else given
        return [float(number) for number in parts]  # type: ignore[attr-defined]
    except (TypeError, ValueError, OverflowError):
        return []


def _number_text(numbers: Iterable[float]) -> str:
    return " ".join(str(round(float(number), 2) + 0.0) for number in numbers)


def _area(given: object) -> str:
    text = f"{given}"
    try:
        return area_text(area_of_polygon(text))
    except ValueError as error:
        raise InvalidFactError(
            f"an area must be a polygon in metres, as in POLYGON ((0 0, 4 0, 4 3, 0 3, 0 0)): "
            f"{error}; got {text[:100]!r}"
        ) from error


def area_text(area: Area) -> str:
    """The area in well-known text [m], to the centimetre."""
    rings = (tuple((round(x, 2), round(y, 2)) for x, y in ring) for ring in area.rings)
    return polygon_text(tuple(rings))


def _term(prop: str, value: str) -> NamedNode | Literal:
    is_iri = prop == "category" or (prop in SINGLE and value != NOTHING)
    return NamedNode(value) if is_iri else Literal(value)

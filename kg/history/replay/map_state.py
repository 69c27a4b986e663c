"""Map state: what a page draws of the map at one moment, as plain values for JSON.

Times are ISO 8601, lengths metres in the map frame; IRIs of the map are without its base. A number
that is not finite is left out, and so is a thing without a position.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Final

from pyoxigraph import Literal, NamedNode, Quad

from kg.history.storage.log import HistoryLog
from kg.history.storage.log_reader import quads_of
from kg.model import vocabulary as v
from kg.model.place_names import place_titles
from kg.rdf.quad_store import QuadStore

State = dict[str, Any]
Row = dict[str, Any]

#: predicate -> field of a row
_TEXTS: Final = {
    v.RDFS_LABEL: "label",
    v.IN_PLACE: "place",
    v.LAST_SEEN: "seen",
    v.OUTLINE: "outline",
    v.LAST_VIEWED: "viewed",
    v.OF_CATEGORY: "category",
    v.FLOOR_CELLS: "cells",
    v.VIEW_TIMES: "views",
}
_NUMBERS: Final = {
    v.X: "x",
    v.Y: "y",
    v.Z: "z",
    v.HEADING: "heading",
    v.X_MIN: "xmin",
    v.X_MAX: "xmax",
    v.Y_MIN: "ymin",
    v.Y_MAX: "ymax",
    v.EXTENT_X: "dx",
    v.EXTENT_Y: "dy",
    v.EXTENT_Z: "dz",
    v.YAW: "yaw",
    v.DEVIATION: "deviation",
    v.EXISTENCE: "existence",
    v.OBSERVATION_COUNT: "count",
    v.BELIEF: "belief",
    v.VIEWED_SHARE: "share",
    v.STOREY: "storey",
    v.CELL_SIZE: "size",
}
_PREDICATES: Final = tuple({v.RDF_TYPE.value, v.HAS_BELIEF, *_TEXTS, *_NUMBERS})
_LINE_PREDICATES: Final = frozenset(f"<{name}>".encode() for name in _PREDICATES)
_MAP_GRAPH: Final = f" {v.MAP_GRAPH} .".encode()
_DIGITS: Final = 4  # of metres and probabilities

#: fields that a row of that kind needs
_NEEDED: Final = {
    "objects": ("class", "x", "y", "existence"),
    "things": ("x", "y", "z", "dx", "dy", "dz", "existence"),
    "places": ("xmin", "xmax", "ymin", "ymax"),
    "doors": ("x", "y"),
    "robot": ("x", "y", "heading"),
    "floor": ("x", "y", "size", "cells"),
}
_KINDS: Final = {
    v.UNNAMED_THING: "things",
    v.PLACE: "places",
    v.DOOR: "doors",
    v.ROBOT: "robot",
    v.FLOOR_TILE: "floor",
}


@dataclass(frozen=True, slots=True)
class Categories:
    """The categories of objects, and the labels of all categories."""

    engine: QuadStore
    objects: frozenset[str]

    @classmethod
    def of(cls, engine: QuadStore) -> Categories:
        """The categories in the graphs of ontology and common sense."""
        quads = engine.quads_for_pattern(
            None, NamedNode(v.IS_A), NamedNode(v.OBJECT), v.COMMONSENSE_GRAPH
        )
        names = frozenset(q.subject.value for q in quads if isinstance(q.subject, NamedNode))
        return cls(engine, names)

    def label(self, iri: str) -> str:
        """The label of a category, in English if it has one, or else the end of its IRI."""
        quads = self.engine.quads_for_pattern(
            NamedNode(iri), NamedNode(v.RDFS_LABEL), None, v.ONTOLOGY_GRAPH
        )
        labels = [q.object for q in quads if isinstance(q.object, Literal)]
        if not labels:
            return iri.rpartition("#")[2].rpartition("/")[2]
        return min((not _is_english(label), label.value) for label in labels)[1]


def _is_english(label: Literal) -> bool:
    """Whether a label has no language, or that of the shipped ontologies."""
    return (label.language or "en").lower().partition("-")[0] == "en"


def present_state(engine: QuadStore, categories: Categories, base: str) -> State:
    """The state of the facts in `engine`."""
    predicates = (NamedNode(name) for name in _PREDICATES)
    quads = (q for p in predicates for q in engine.quads_for_pattern(None, p, None, v.MAP_GRAPH))
    return _state(quads, categories, base)


def state_after(log: HistoryLog, sequence: int, categories: Categories, base: str) -> State:
    """The state right after a transaction; raises HistoryError if that moment is not kept.

    Only the facts that are drawn are parsed: no store is filled, and no observation read.
    """
    lines = (line for line in log.facts(sequence) if _is_drawn(line))
    return _state(quads_of(lines), categories, base)


def _is_drawn(line: bytes) -> bool:
    return line.split(b" ", 2)[1] in _LINE_PREDICATES and line.endswith(_MAP_GRAPH)


def _state(quads: Iterable[Quad], categories: Categories, base: str) -> State:
    rows, types, beliefs = dict[str, Row](), dict[str, list[str]](), dict[str, list[str]]()
    for quad in quads:
        predicate, subject, value = quad.predicate.value, str(quad.subject), quad.object
        if predicate == v.RDF_TYPE.value:
            types.setdefault(subject, []).append(getattr(value, "value", ""))
        elif predicate == v.HAS_BELIEF:
            beliefs.setdefault(subject, []).append(str(value))
        else:
            _read(rows.setdefault(subject, {}), predicate, getattr(value, "value", ""))
    state: State = {kind: [] for kind in _NEEDED}
    for subject in sorted(rows):
        row, kinds = rows[subject], types.get(subject, ())
        kind = next((_KINDS[name] for name in kinds if name in _KINDS), "objects")
        if kind == "objects":
            row["class"] = min((name for name in kinds if name in categories.objects), default=None)
        if kind == "places":
            row.setdefault("label", subject[1:-1].rpartition("/")[2])
            nodes = (rows.get(node, {}) for node in beliefs.get(subject, ()))
            held = (one for one in nodes if "category" in one and "belief" in one)
            pairs = ([one["category"], one["belief"]] for one in held)
            row["beliefs"] = sorted(pairs, key=lambda pair: (-pair[1], pair[0]))
        if "place" in row:
            row["place"] = row["place"].removeprefix(base)
        if all(row.get(name) is not None for name in _NEEDED[kind]):
            state[kind].append({"iri": subject[1:-1].removeprefix(base), **row})
    state["robot"] = next(iter(state["robot"]), None)
    named = [(place["label"], dict(place["beliefs"])) for place in state["places"]]
    for place, title in zip(state["places"], place_titles(named, categories.label), strict=True):
        place["title"] = title
    return state


def _read(row: Row, predicate: str, text: str) -> None:
    if predicate in _TEXTS:
        name = _TEXTS[predicate]
        row[name] = min(row.get(name, text), text)  # of several values always the same
        return
    try:
        number = float(text)
    except ValueError:
        return
    if math.isfinite(number):
        row[_NUMBERS[predicate]] = round(number, _DIGITS)

"""Map state: what a page draws of the map at one moment, as plain values for JSON.

Times are ISO 8601, lengths metres in the map frame; IRIs of the map are without its base. A number
that is not finite is left out, and so is a thing without a position.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from pyoxigraph import Literal, NamedNode, QueryResultsFormat, QuerySolutions, Store

from kg.history.storage.log import HistoryLog
from kg.history.storage.log_reader import quads_of
from kg.model import vocabulary as v
from kg.model.place_names import place_titles
from kg.rdf.literals import text_of, tsv_text
from kg.rdf.quad_store import QuadStore, subcategories

State = dict[str, Any]
Row = dict[str, Any]
_Fact = tuple[str, str]  # a subject as in N-Triples, and the IRI or text of its value

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
    """The categories of objects and places, and the labels of all categories."""

    engine: QuadStore
    objects: frozenset[str]
    places: frozenset[str] = frozenset()

    @classmethod
    def of(cls, engine: QuadStore) -> Categories:
        """The categories in the graphs of ontology and common sense."""
        objects, places = (subcategories(engine, kind) - {kind} for kind in (v.OBJECT, v.PLACE))
        return cls(engine, objects, places)

    def by_kind(self) -> dict[str, dict[str, str]]:
        """Label by IRI, of the categories of objects and those of places."""
        kinds = {"object": self.objects, "place": self.places}
        return {
            kind: {iri: self.label(iri) for iri in sorted(iris)} for kind, iris in kinds.items()
        }

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


def present_state(engine: Store, categories: Categories, base: str) -> State:
    """The state of the facts in `engine`."""
    return _state(((name, _stored(engine, name)) for name in _PREDICATES), categories, base)


def _stored(engine: Store, predicate: str) -> Iterator[_Fact]:
    """The facts of graph:map with a predicate, read as text: in half of the time of quads."""
    found = engine.query(f"SELECT ?s ?o {{ GRAPH {v.MAP_GRAPH} {{ ?s <{predicate}> ?o }} }}")
    assert isinstance(found, QuerySolutions)
    lines = (found.serialize(format=QueryResultsFormat.TSV) or b"").decode().split("\n")
    for line in lines[1:-1]:
        subject, _, cell = line.partition("\t")
        yield subject, tsv_text(cell)


def state_after(log: HistoryLog, sequence: int, categories: Categories, base: str) -> State:
    """The state right after a transaction; raises HistoryError if that moment is not kept.

    Only the facts that are drawn are parsed: no store is filled, and no observation read.
    """
    lines = (line for line in log.facts(sequence) if _is_drawn(line))
    facts = dict[str, list[_Fact]]()
    for quad in quads_of(lines):
        fact = str(quad.subject), text_of(quad.object)
        facts.setdefault(quad.predicate.value, []).append(fact)
    return _state(facts.items(), categories, base)


def _is_drawn(line: bytes) -> bool:
    return line.split(b" ", 2)[1] in _LINE_PREDICATES and line.endswith(_MAP_GRAPH)


def _state(
    facts: Iterable[tuple[str, Iterable[_Fact]]], categories: Categories, base: str
) -> State:
    """The state of the facts with each predicate, an IRI."""
    rows, types, beliefs = dict[str, Row](), dict[str, list[str]](), dict[str, list[str]]()
    for predicate, those in facts:
        if predicate in (v.RDF_TYPE.value, v.HAS_BELIEF):
            known = types if predicate == v.RDF_TYPE.value else beliefs
            for subject, text in those:
                known.setdefault(subject, []).append(text)
        elif predicate in _TEXTS:
            _read_texts(rows, _TEXTS[predicate], those)
        else:
            _read_numbers(rows, _NUMBERS[predicate], those)
    state: State = {kind: [] for kind in _NEEDED}
    for subject in sorted(rows):
        row, kinds = rows[subject], types.get(subject, ())
        kind = next((_KINDS[name] for name in kinds if name in _KINDS), "objects")
        if kind == "objects":
            row["class"] = min((name for name in kinds if name in categories.objects), default=None)
        if kind == "places":
            row.setdefault("label", subject[1:-1].rpartition("/")[2])
            row["beliefs"] = _beliefs(rows, beliefs.get(subject, ()))
        if "place" in row:
            row["place"] = row["place"].removeprefix(base)
        if all(row.get(name) is not None for name in _NEEDED[kind]):
            state[kind].append({"iri": subject[1:-1].removeprefix(base), **row})
    state["robot"] = next(iter(state["robot"]), None)
    _title(state["places"], categories)
    return state


def _title(places: Sequence[Row], categories: Categories) -> None:
    """Give places the names that sentences call them by."""
    named = [(place["iri"], place["label"], dict(place["beliefs"])) for place in places]
    for place, title in zip(places, place_titles(named, categories.label), strict=True):
        place["title"] = title


def _beliefs(rows: Mapping[str, Row], nodes: Iterable[str]) -> list[list[Any]]:
    """Categories with their beliefs, the strongest first."""
    those = (rows.get(f"<{node}>", {}) for node in nodes)
    pairs = (
        [one["category"], one["belief"]] for one in those if one.keys() >= {"category", "belief"}
    )
    return sorted(pairs, key=lambda pair: (-pair[1], pair[0]))


def _read_texts(rows: dict[str, Row], name: str, facts: Iterable[_Fact]) -> None:
    for subject, text in facts:
        row = rows.setdefault(subject, {})
        row[name] = min(row.get(name, text), text)  # of several values always the same


def _read_numbers(rows: dict[str, Row], name: str, facts: Iterable[_Fact]) -> None:
    for subject, text in facts:
        row = rows.setdefault(subject, {})
        try:
            number = float(text)
        except ValueError:
            continue
        if math.isfinite(number):
            row[name] = round(number, _DIGITS)

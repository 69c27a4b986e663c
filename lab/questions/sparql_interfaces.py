"""Questions asked by the shipped query files: in this process, and over HTTP."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from datetime import datetime
from typing import Any, Final

import requests

from lab.questions.graph_maps import AskedMap
from lab.questions.plain_map import NOT_KNOWN, ByLists

Row = Mapping[str, Any]

SEEN_IN: Final = re.compile(r"seen best in (\S+) of (\S+)")
_MOVED: Final = 0.3  # [m]


class SparqlInterface(ByLists):
    """Each family by a query file of `queries/`; there is none for plans."""

    def __init__(self, asked: AskedMap) -> None:
        self._map, self._since = asked.semantic_map, asked.since

    def rows(self, name: str, at: str | None = None, **parameters: Any) -> Sequence[Row]:
        """The answer of a query file, of a past moment if `at` is given."""
        if at is None:
            return self._map.query(name, **parameters).records()
        with self._map.at(at) as then:
            return then.query(name, **parameters).records()

    def nearest(self, category: str, to: str, to_room: str) -> list[float] | None:
        near = self._around(to, to_room, 100.0)
        first = next((row for row in near or () if row["category"] == category), None)
        return None if first is None else [first["x"], first["y"]]

    def within_radius(self, radius: float, of: str, of_room: str) -> list[str] | None:
        return categories(self._around(of, of_room, radius))

    def between(self, one: str, one_room: str, other: str, other_room: str) -> list[str] | None:
        ends = self._one(one, one_room), self._one(other, other_room)
        if ends[0] is None or ends[1] is None:
            return None
        return categories(self.rows("between", one=ends[0]["object"], other=ends[1]["object"]))

    def on_or_in(self, thing: str, thing_room: str) -> list[str] | None:
        carrier = self._one(thing, thing_room)
        if carrier is None:
            return None
        related = self.rows("related", object=carrier["object"])
        there = [row for row in related if (row["existence"] or 0.0) >= 0.5]
        return categories(row for row in there if row["relation"] in ("on", "inside"))

    def last_seen(self, category: str) -> float | None:
        first = next(iter(self.rows("last-seen", category=category)), None)
        return None if first is None else stamp(first["lastSeen"])

    def moved_since(self, room: str | None) -> list[str] | None:
        then = {row["object"]: row for row in self.rows("objects", at=self._since)}
        return categories(
            row
            for row in self.rows("objects")
            if row["object"] in then
            and sum((row[c] - then[row["object"]][c]) ** 2 for c in "xyz") >= _MOVED**2
            and room in (None, row["place"])
        )

    def past(self, category: str, room: str) -> int:
        then = self.rows("objects-by-category", at=self._since, category=category)
        return sum(row["place"] == room for row in then)

    def appeared_since(self, room: str | None) -> list[str] | None:
        return categories(self._new(self.rows("objects"), self._then(), room))

    def vanished_since(self, room: str | None) -> list[str] | None:
        return categories(self._new(self._then(), self.rows("objects"), room))

    def unanswerable(self, category: str, room: str) -> int | str:
        never = self.never_looked(category, room) == "never looked"
        return NOT_KNOWN if never else self.count_in_place(category, room)

    def _then(self) -> Sequence[Row]:
        return self.rows("objects", at=self._since)

    @staticmethod
    def _new(rows: Sequence[Row], others: Sequence[Row], room: str | None) -> list[Row]:
        known = {row["object"] for row in others}
        return [r for r in rows if r["object"] not in known and room in (None, r["place"])]

    def never_looked(self, category: str, room: str) -> str | None:
        rows = self.rows("status", category=category)
        return next((row["status"] for row in rows if row["placeLabel"] == room), None)

    def why(self, thing: str, thing_room: str) -> list[str] | None:
        one = self._one(thing, thing_room)
        if one is None:
            return None
        (row,) = self.rows("why-object", object=one["object"])
        return [row["recording"], row["frame"]]

    def _of(self, category: str, room: str | None = None) -> list[Row]:
        rows = self.rows("objects-by-category", category=category)
        return [row for row in rows if room in (None, row["place"])]

    def _one(self, category: str, room: str) -> Row | None:
        return next(iter(self._of(category, room)), None)

    def _around(self, category: str, room: str, radius: float) -> list[Row] | None:
        one = self._one(category, room)
        if one is None:
            return None
        near = self.rows("objects-within-radius", x=one["x"], y=one["y"], radius=radius)
        return [row for row in near if row["object"] != one["object"]]


class HttpInterface(SparqlInterface):
    """The same from `/queries`, over the SPARQL protocol; reasons by `/why`, plans by `/find`."""

    def __init__(self, asked: AskedMap, url: str) -> None:
        super().__init__(asked)
        self._url = url.rstrip("/")

    def rows(self, name: str, at: str | None = None, **parameters: Any) -> Sequence[Row]:
        query = self._get(f"/queries/{name}", parameters).text
        found = self._json("/sparql", query=query, **({"at": at} if at else {}))
        names = found["head"]["vars"]
        return [
            {n: _value(row[n]) if n in row else None for n in names}
            for row in found["results"]["bindings"]
        ]

    def why(self, thing: str, thing_room: str) -> list[str] | None:
        one = self._one(thing, thing_room)
        if one is None:
            return None
        found = SEEN_IN.search(str(self._json("/why", iri=one["object"])))
        return None if found is None else [found[2], found[1]]

    def plan(self, category: str) -> list[str]:
        rooms = {row["place"]: row["label"] for row in self.rows("places")}
        rooms |= {row["object"]: row["place"] for row in self.rows("objects", least=0.0)}
        steps = self._json("/find", object=category)["steps"]
        return in_order(rooms.get(step["why"][0]["iri"]) for step in steps if step["why"])

    def _json(self, path: str, **parameters: str) -> Any:
        return self._get(path, parameters).json()

    def _get(self, path: str, parameters: Mapping[str, Any]) -> requests.Response:
        headers = {"Accept": "application/sparql-results+json, application/json;q=0.9, */*;q=0.1"}
        found = requests.get(self._url + path, params=parameters, headers=headers, timeout=60)
        found.raise_for_status()
        return found


def categories(rows: Any) -> list[str] | None:
    """The categories of rows, each once; None for none."""
    return None if rows is None else sorted({row["category"] for row in rows})


def in_order(rooms: Any) -> list[str]:
    """Rooms each once, as first met."""
    return list(dict.fromkeys(room for room in rooms if room))


def stamp(time: datetime) -> float:
    """[s] since 1970."""
    return time.timestamp()


def _value(binding: Mapping[str, str]) -> Any:
    """A SPARQL JSON binding as a Python value."""
    text, kind = binding["value"], binding.get("datatype", "").rpartition("#")[2]
    if kind in ("double", "decimal", "float", "integer"):
        return float(text)
    return datetime.fromisoformat(text) if kind == "dateTime" else text

"""Answers on what the robot saw: last sightings, how sure things are and why, unseen rooms."""

from __future__ import annotations

from datetime import datetime
from typing import Final

from kg.history.timestamps import iso, span
from kg.model.errors import QueryParameterError
from planner.questions.counts import NAMED
from planner.questions.measures import Measures
from planner.questions.plain_answer import PlainAnswer
from planner.search.goals.known_objects import LISTED, KnownObject
from planner.search.goals.search_goals import times
from planner.search.goals.status import status

_VIEWED: Final = 0.05  # share of a place, below which nobody looked, as in `status.rq`


class SightingAnswers(Measures):
    """Answers from sightings and views."""

    def _last_seen(self) -> PlainAnswer:
        target, one = self._target(self._question.what)
        rows = [
            row
            for iri in target.queried
            for row in self._map.query("last-seen", category=iri).records()
        ]
        rows = [row for row in rows if one is None or row["object"] == one.iri]
        if not rows:
            never = f"{target.none} was ever seen for sure"
            return self._made("last-seen", [never], category=target.kind)
        row = max(rows, key=lambda row: str(row["lastSeen"]))
        seen = row["lastSeen"]
        assert isinstance(seen, datetime)
        place = f" in {self._titled(row['place'])}" if row["place"] else ""
        name, at = row["label"] or row["category"], iso(seen.timestamp())[:19]
        line = f"{self._ago(seen)}: {name}{place}, at {at}"
        return self._listed("last-seen", [line], rows, category=target.kind)

    def _recent(self) -> PlainAnswer:
        """The things that were seen last, the latest first."""
        name, where = self._question.where, ""
        place = self._place(name) if name else None
        if name and place is None:
            raise QueryParameterError(f"last sightings are listed by place, and {name!r} is none")
        rows = [r for r in self._map.query("objects").records() if r["lastSeen"] is not None]
        if place is not None:
            rows, where = [r for r in rows if r["place"] == self._label(place)], self._title(place)
        rows.sort(key=lambda row: str(row["lastSeen"]), reverse=True)
        lines = []
        for row in rows[:LISTED]:
            at = f" in {self._titled(row['place'])}" if row["place"] else ""
            lines.append(f"{self._ago(row['lastSeen'])}: {row['label']}{at}")
        none = f"Nothing is known to be in {where}" if where else "The map has no objects"
        return self._listed("objects", lines or [none], rows)

    def _ago(self, seen: object) -> str:
        assert isinstance(seen, datetime)
        return f"{span(max(self._now - seen.timestamp(), 0.0))} ago"

    def _certainty(self) -> PlainAnswer:
        """How probable it is that things exist, and that they are still where they were seen."""
        target, one = self._target(self._question.what)
        where, there = self._there()
        known = [k for k in self._known(target, one) if there(k)]
        lines = [
            f"{k.label} {k.where.strip()}: it exists with probability {k.believed:.2f}, was seen "
            f"{times(k.observations)}, and is still there with probability "
            f"{k.still_there(self._now):.2f}"
            for k in known[:LISTED]
        ]
        if not lines:
            place = self._place(self._question.where) if self._question.where else None
            proof = f": {status(self._map, target.iri, place).proof}" if target.iri else ""
            lines = [f"{target.none} is known to be{where or ' in the map'}{proof}"]
        return self._of_category(target, lines)

    def _why(self) -> PlainAnswer:
        """The observations that explain things, the surest things first."""
        target, one = self._target(self._question.what)
        where, there = self._there()
        known = [k for k in self._known(target, one) if there(k)][:LISTED]
        lines = [line for k in known for line in self._explained(k)]
        lines = lines or [f"{target.none} is known to be{where or ' in the map'}"]
        if len(known) != 1:
            return self._made("", lines)
        return self._made("why-object", lines, object=known[0].iri.removeprefix(self._map.base))

    def _explained(self, one: KnownObject) -> list[str]:
        rows = self._map.query("why-object", object=one.iri).records()
        said = f", and {one.stated.by} said what it is" if one.stated else ""
        if not rows:
            return [f"{one.label} has no observation in the map{said}"]
        row, short = rows[0], one.iri.removeprefix(self._map.base)
        return [
            f"{one.label} {one.where.strip()} was seen {times(one.observations)}, best in "
            f"{row['frame']} of {row['recording']} by {row['model']} with score {row['score']}"
            f"{said}; `hereabouts why MAP {short}` has more"
        ]

    def _unseen(self) -> PlainAnswer:
        """The places that were never viewed; else those that were viewed least."""
        shares = sorted(
            (0.0 if place.viewed is None else place.viewed.share, self._title(place.iri))
            for place in self._map.places()
        )
        never = [title for share, title in shares if share < _VIEWED]
        least = ", ".join(f"{title} ({share:.0%} viewed)" for share, title in shares[:NAMED])
        if not shares:
            line = "The map has no places"
        elif never:
            line = f"Never viewed: {', '.join(never)}"
        else:
            line = f"Each place was viewed, at least in part; the least first: {least}"
        return self._made("places", [line])

"""Answers on things: sizes, distances, what is around them, and what the robot saw of them."""

from __future__ import annotations

import math
from datetime import datetime
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from kg.history.timestamps import span, spoken
from kg.knowledge.words.meaning import understand
from kg.model.errors import QueryParameterError, UnknownCategoryError
from kg.model.records import ObjectRecord
from kg.model.shares import chance, percent
from planner.freespace.planning_map import number
from planner.questions.named_things import NAMED, NamedThings, Spot, sized
from planner.questions.patterns import ROBOT, PlainAnswer
from planner.search.goals.known_objects import LISTED, KnownObject
from planner.search.goals.place_names import listed, place_category
from planner.search.goals.search_goals import times
from planner.search.goals.status import status
from planner.search.goals.target_words import alike_here
from planner.search.plans.answer_sentences import answer_lines
from planner.settings import SPEED

_SPOT: Final = 0.05  # [m] around a position where its thing is looked up
NEAR: Final = 2.0  # [m] in a straight line
_BESIDE: Final = 1.0  # [m] up to which one thing surely is next to another
_BELOW: Final = 0.2  # [m] by which a thing's centre is below the top of what it is under
_VIEWED: Final = 0.05  # share of a place, below which nobody looked, as in `status.rq`
_HEIGHTS: Final = ("taller", "higher")  # words that compare heights alone


class ThingAnswers(NamedThings):
    """Answers from boxes and positions, which hold what was seen of things, and from sightings."""

    def _size(self) -> PlainAnswer:
        return self._made("", [self._sized(one) for one in self._boxed(self._question.what)])

    def _compare(self) -> PlainAnswer:
        """Sizes of two things, and which part was seen to be larger if it is so each way."""
        pair = [self._boxed(words)[0] for words in (self._question.what, self._question.other)]
        lines, word = [self._sized(one) for one in pair], self._question.event
        first, second = (self._lengths(record) for _, record in pair)
        more, less = bool(np.all(first > second)), bool(np.all(first < second))
        if more or less:
            larger, _ = pair[more == (word == "smaller")]
            lines.append(f"So the part of {larger.label} that was seen is {word}")
        else:
            lines.append(f"Neither of the parts that were seen is {word} in every direction")
        return self._made("", lines)

    def _lengths(self, record: ObjectRecord) -> NDArray[np.float64]:
        """The lengths [m] of a box that count: all three, or the height; nan if not known."""
        if record.extent is None:
            return np.full(3, np.nan)
        sides = [*sorted(record.extent[:2]), record.extent[2]]
        return np.array(sides[2:] if self._question.event in _HEIGHTS else sides)

    def _boxed(self, words: str) -> list[tuple[KnownObject, ObjectRecord]]:
        """The things that words name with their boxes; at least one."""
        named = self._named(words)[:LISTED]
        return [(one, record) for one in named for record in self._record(one)]

    def _record(self, one: KnownObject) -> list[ObjectRecord]:
        """The record of a thing, with what persons asserted of it."""
        x, y = (float(value) for value in one.p_map[:2])
        near = self._map.objects(near=(x, y), radius=_SPOT)
        return [record for record in near if record.iri == one.iri]

    def _sized(self, thing: tuple[KnownObject, ObjectRecord]) -> str:
        one, record = thing
        z = float(record.p_map[2])
        floor = max((h for h in self._floors if h <= z), default=min(self._floors))
        return sized(one.label, record.extent, z - floor)

    @cached_property
    def _floors(self) -> set[float]:
        """Heights [m] of the floors of all storeys; 0 where none is known."""
        return {number(row, "z") for row in self._map.query("goals-floor").records()} or {0.0}

    def _near(self, within: float = NEAR) -> PlainAnswer:
        """Things of a kind near others; with the robot, the nearest at any distance."""
        target, one = self._target(self._question.what)
        spots = self._spots(self._question.other)
        within = math.inf if self._question.other == ROBOT else within
        found = sorted(
            (math.dist(thing.p_map, spot), label, thing.iri, thing)
            for thing in (self._sure(target) if one is None else [one])
            for label, spot in spots
        )
        lines, seen = list[str](), set[str]()
        for metres, label, iri, thing in found:
            if iri not in seen and len(lines) < LISTED and metres <= within:
                seen.add(iri)
                where = f" {thing.where.strip()}" if label not in thing.where else ""
                lines.append(f"{thing.label}{where} is {metres:.1f} m from {label}")
        beside = sum(metres <= _BESIDE for metres, *_ in found)
        whether = self._question.whether(beside, len(lines))
        if lines and whether:
            lines[0] = whether + lines[0]
        if not lines:
            some = "" if math.isinf(within) else f" within {within:g} m of {self._question.other}"
            none = f"{target.none} is known{some}"
            lines = [f"{whether}{none[:1].lower()}{none[1:]}" if whether else none]
            lines += [f"The nearest is {d:.1f} m away: {t.label}" for d, _, _, t in found[:1]]
        return self._made("", lines)

    def _distance(self) -> PlainAnswer:
        """Straight distances between things; the way where an end of it is a place."""
        ends = self._question.what, self._question.other
        if any(words != ROBOT and self._is_room(words) for words in ends):
            return self._route(*ends)
        return self._near(math.inf)

    def _is_room(self, words: str) -> bool:
        try:
            return self._place(words) is not None
        except QueryParameterError:  # several have that name, or none
            return place_category(self._map.catalogue, words) is not None

    def _around(self) -> PlainAnswer:
        (label, (x, y)), *others = self._spots(self._question.other)
        rows = [
            row
            for row in self._map.query("objects-within-radius", x=x, y=y, radius=NEAR).records()
            if row["label"] != label
        ]
        named = [f"{row['label']} ({number(row, 'distance'):.1f} m)" for row in rows[:NAMED]]
        found = listed(named, len(rows[NAMED:])) or "nothing"
        line = f"Within {NEAR:g} m of {label}: {found}"
        more = [f"The map has {len(others)} more of that name"] if others else []
        at = {"x": f"{x:.2f}", "y": f"{y:.2f}"}
        return self._listed("objects-within-radius", [line, *more], rows, **at)

    def _under(self) -> PlainAnswer:
        """Things inside the box of another from above, well below its top, and not held by it."""
        lines = list[str]()
        target, only = self._target(self._question.what) if self._question.what else (None, None)
        wanted = None if target is None else {k.iri for k in self._known(target, only)}
        for one, record in self._boxed(self._question.other):
            others = {one.iri, *(str(row["object"]) for row in self._held(one))}
            below = {t.iri for t in self._over(record) if _is_under(t, record)} - others
            below = below if wanted is None else below & wanted
            rows = self._map.query("objects").records() if below else ()
            found = ", ".join(str(row["label"]) for row in rows if row["object"] in below)
            if record.extent is None:
                lines.append(f"The size of {one.label} is not known, so nor is what is under it")
            elif target is None or found:
                found = found or "nothing is known to be there"
                yes = "" if target is None else "Yes: "
                lines.append(f"{yes}Under the part of {one.label} that was seen: {found}")
        if target is not None and not lines:
            lines = [f"{target.none} is known to be under {self._all_of(self._question.other)}"]
            lines += answer_lines(self._known(target, only), self._now, target)
        return self._made("", lines)

    def _over(self, record: ObjectRecord) -> tuple[ObjectRecord, ...]:
        """The things within the circle around a box, seen from above."""
        if record.extent is None:
            return ()
        x, y = (float(value) for value in record.p_map[:2])
        return self._map.objects(near=(x, y), radius=math.hypot(*record.extent[:2]) / 2)

    def _between(self) -> PlainAnswer:
        """Things on the floor's strip between two things, of several the two closest."""
        firsts, others = (self._named(w) for w in (self._question.what, self._question.other))
        at, iris = np.array([o.p_map for o in others]), np.array([o.iri for o in others])
        nearest = [
            np.where(iris == first.iri, math.inf, np.hypot(*(at - first.p_map).T))
            for first in firsts
        ]
        row = int(np.argmin([metres.min() for metres in nearest]))
        one, other = firsts[row], others[int(np.argmin(nearest[row]))]
        if one.iri == other.iri:
            raise QueryParameterError(f"{one.label} is both ends, so nothing is between")
        rows = self._map.query("between", one=one.iri, other=other.iri).records()
        named = [f"{row['label']} ({number(row, 'distance'):.1f} m)" for row in rows[:NAMED]]
        found = listed(named, len(rows[NAMED:])) or "nothing is known to be there"
        line = f"From {one.label} to {other.label}: {found}"
        ends = {"one": one, "other": other}
        short = {name: end.iri.removeprefix(self._map.base) for name, end in ends.items()}
        return self._listed("between", [line], rows, **short)

    def _largest(self) -> PlainAnswer:
        """The places by area, the largest or the smallest first."""
        sign = 1 if self._question.event.startswith("small") else -1
        places = sorted(self._map.places(), key=lambda place: sign * place.area.area)
        sizes = [f"{self._title(place.iri)} ({place.area.area:.1f} m2)" for place in places]
        if not sizes:
            return self._made("places", ["The map has no places"])
        rest = f"; then {', '.join(sizes[1:NAMED])}" if len(sizes) > 1 else ""
        name = "smallest" if sign == 1 else "largest"
        return self._made("places", [f"The {name} is {sizes[0]}{rest}"])

    def _route(self, where: str = "", start_at: str = "") -> PlainAnswer:
        """Length of the way over the known floor, and the places that it goes through."""
        from planner.search.plans.route import route

        (begin, start), *_ = self._ends(start_at or self._question.start or ROBOT)
        ends = self._ends(where or self._question.where)
        end, goal = min(ends, key=lambda spot: math.dist(spot[1], start))
        found = route(self._map, start, goal)
        if found is None:
            raise QueryParameterError("the map has no floor and no places, so no way is known")
        if not math.isfinite(found.metres):
            return self._made("", [f"No way from {begin} to {end} is known", *found.notes])
        entered = [crossing.places[1] for crossing in found.crossings]
        if entered and entered[-1].contains(*goal):
            entered.pop()
        through = ", then ".join(self._title(place.iri) for place in entered)
        by = f", through {through}" if through else "" if found.crossings else ", in the same place"
        seconds = found.metres / SPEED
        line = f"From {begin} to {end}: {found.metres:.1f} m{by}; the robot needs {seconds:.0f} s"
        return self._made("", [line, *found.notes])

    def _ends(self, words: str) -> list[Spot]:
        """Positions of the place, or of the things, that words name; at least one."""
        place = None if words == ROBOT else self._place(words)
        if place is None:
            return self._spots(words)
        centre = next(p.area.centre for p in self._map.places() if p.iri == place)
        return [(self._title(place), centre)]

    def _last_seen(self) -> PlainAnswer:
        """The last sighting of a kind of thing, and since when the thing that was seen is known."""
        target, one = self._target(self._question.what)
        where, there = self._there()
        known = {k.iri: k for k in self._known(target, one) if there(k)}
        rows = [
            row
            for iri in target.queried
            for row in self._map.query("last-seen", category=iri).records()
            if row["object"] in known or not (one or where)
        ]
        if not rows:
            never = f"is known to be{where}" if where else "was ever seen for sure"
            return self._made("last-seen", [f"{target.none} {never}"], category=target.kind)
        row = max(rows, key=lambda row: str(row["lastSeen"]))
        seen = row["lastSeen"]
        assert isinstance(seen, datetime)
        place = f" in {self._titled(row['place'])}" if row["place"] else ""
        name, at = row["label"] or row["category"], spoken(seen.timestamp())
        lines = [f"{name} was last seen {self._ago(seen)} ({at}){place}"]
        still = known.get(str(row["object"]))
        for record in self._record(still) if still else ():
            first, ago = record.first_seen, span(max(self._now - record.first_seen, 0.0))
            lines.append(f"It was first seen {ago} ago ({spoken(first)})")
        return self._listed("last-seen", lines, rows, category=target.kind)

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
            f"{k.label} {k.where.strip()} was seen {times(k.observations)}: {chance(k.believed)} "
            f"sure that it exists, and {chance(k.still_there(self._now))} that it is still there"
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
        row = rows[0]
        return [
            f"{one.label} {one.where.strip()} was seen {times(one.observations)}; at best the "
            f"detector was {percent(number(row, 'score'))} sure, in {row['frame']} of "
            f"{row['recording']}{said}"
        ]

    def _alike(self) -> PlainAnswer:
        """Which things and views look like a text; by the map's encoder, or else by classes."""
        text = " ".join((*self._question.qualities, self._question.what))
        try:
            synset = understand(self._map.catalogue, text).synset
        except UnknownCategoryError:
            synset = ""
        found = alike_here(self._map, text, synset)
        if found is None:
            raise QueryParameterError(
                f"what looks like '{text}' is not known here; a map in a folder, made with "
                "--encoder, would tell it"
            )
        return self._made("", found.sentences(f"'{text}'"))

    def _unseen(self) -> PlainAnswer:
        """The places that were never viewed; else those that were viewed least."""
        shares = sorted(
            (0.0 if place.viewed is None else place.viewed.share, self._title(place.iri))
            for place in self._map.places()
        )
        never = [title for share, title in shares if share < _VIEWED]
        least = ", ".join(f"{title} ({percent(share)})" for share, title in shares[:LISTED])
        if not shares:
            line = "The map has no places"
        elif never:
            line = f"Never viewed: {', '.join(never)}"
        else:
            line = f"Every room was viewed at least in part; least of all {least}"
        return self._made("places", [line])


def _is_under(thing: ObjectRecord, other: ObjectRecord) -> bool:
    if other.extent is None or thing.p_map[2] > other.p_map[2] + other.extent[2] / 2 - _BELOW:
        return False
    dx, dy = thing.p_map[:2] - other.p_map[:2]
    cos, sin = math.cos(other.yaw), math.sin(other.yaw)
    along, across = cos * dx + sin * dy, cos * dy - sin * dx
    return bool(abs(along) <= other.extent[0] / 2 and abs(across) <= other.extent[1] / 2)

"""Answers to plain questions by their kind: the shipped query, its rows, and sentences."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from datetime import datetime
from typing import Final

from kg.history.timestamps import iso
from kg.maps.semantic_map import SemanticMap
from kg.model.errors import (
    QueryParameterError,
    UndetectableError,
)
from planner.freespace.planning_map import Row, number
from planner.questions.counts import NAMED, counted_kinds, counted_unnamed, sized
from planner.questions.moments import read_since, since
from planner.questions.patterns import EVENTS, Kind, Question
from planner.questions.plain_answer import PlainAnswer
from planner.questions.recognition import is_known_word
from planner.questions.rooms import about_rooms
from planner.search.goals.candidate_queries import span
from planner.search.goals.known_objects import LISTED, KnownObject, known_object, known_objects
from planner.search.goals.place_names import object_named, place_named, plain_place
from planner.search.goals.status import Value, status
from planner.search.goals.targets import Target, resolve
from planner.search.plans.answer_sentences import PROBABLY, answer_lines, find_sentences

_NEAR: Final = 2.0  # [m] in a straight line
_YES: Final[Mapping[Value, str]] = {
    "present": "Yes",
    "gone": "Not any more",
    "looked, none seen": "Probably not",
    "hidden": "Perhaps, though none is sure",
    "never looked": "Unknown",
}


class Answerer:
    """Answers a question about a map at a moment `now` [s since 1970]."""

    def __init__(self, semantic_map: SemanticMap, question: Question, now: float) -> None:
        self._map, self._question, self._now = semantic_map, question, now

    def answer(self) -> PlainAnswer:
        """The answer; raises UnknownCategoryError and QueryParameterError for unknown names."""
        kinds: Mapping[Kind, Callable[[], PlainAnswer]] = {
            "where": self._where,
            "in place": self._in_place,
            "changed": self._changed,
            "status": self._status,
            "count": self._count,
            "near": self._near,
            "around": self._around,
            "on": self._on,
            "last seen": self._last_seen,
            "places": self._places,
            "objects": self._objects,
            "robot": self._robot,
            "departed": self._departed,
            "distance": lambda: self._near(math.inf),
            "size": self._size,
        }
        rooms = about_rooms(self._map, self._question, self._now)
        return self._made("places", rooms) if rooms else kinds[self._question.kind]()

    def _where(self) -> PlainAnswer:
        target, one = self._target(self._question.what)
        if one is not None:
            lines = answer_lines([one], self._now)
            return self._made("whereabouts", lines, object=one.iri.removeprefix(self._map.base))
        lines = find_sentences(self._map, target, self._now)
        lines = [target.note, *lines] if target.note else lines
        return self._of_category(target, lines)

    def _in_place(self) -> PlainAnswer:
        name = self._question.where
        try:
            place = place_named(self._map, name)
        except QueryParameterError:
            if is_known_word(self._map, name):
                return self._on(name)
            raise
        rows = self._map.query("objects-in-place", place=place).records()
        label = self._label_of(place)
        unnamed = counted_unnamed(self._map, place)
        line = f"In {label}: {counted_kinds(rows)}" if rows else f"No object is known in {label}"
        if unnamed:
            line += f", and {unnamed}" if rows else f", but {unnamed}"
        return self._listed("objects-in-place", [line], rows, place=label)

    def _changed(self) -> PlainAnswer:
        moment = since(self._question.when, self._now)
        found = read_since(self._map, moment, self._map.history.compare)
        wanted = EVENTS.get(self._question.event, ())
        changes = [one for one in found.changes if not wanted or one.kind in wanted]
        lines = []
        for kind in ("appeared", "gone", "moved", "relabelled"):
            some = [f"{c.category} {c.iri.rpartition('/')[2]}" for c in changes if c.kind == kind]
            if some:
                rest = f" and {len(some) - NAMED} more" if len(some) > NAMED else ""
                lines.append(f"{kind.capitalize()}: {', '.join(some[:NAMED])}{rest}")
        lines = lines or ["Nothing changed" if not wanted else "Nothing did"]
        lines.append(f"Since {found.times[0][:19]}, by the times when the map was written")
        rows = tuple((c.kind, c.iri, c.category, *c.sides) for c in changes)
        columns = ("change", "thing", "category", "before", "after")
        return PlainAnswer("changed", "departed", {}, tuple(lines), columns, rows)

    def _status(self) -> PlainAnswer:
        target, one = self._target(self._question.what)
        if self._question.other or (one is None and target.iri is None):
            return self._any_of(target, one)
        place = place_named(self._map, self._question.where) if self._question.where else None
        if one is not None:
            found = status(self._map, one.iri)
            if place is not None and found.value == "present" and one.place != place:
                where = one.where.strip()
                return self._made("status", [f"No: {one.label} is {where}"], category=one.category)
        else:
            assert target.iri is not None
            found = status(self._map, target.iri, place)
        lines = [target.note] if target.note and one is None else []
        known = [one] if one is not None else known_objects(self._map, target)
        known = [k for k in known if place in (None, k.place)]
        sure = [k for k in known if k.sure]
        if found.value == "present" and not self._any_still_there(sure):
            lines.append("It was there, and has probably been moved since:")
            lines += answer_lines(sure, self._now, target)
        else:
            lines.append(f"{_YES[found.value]} ({found.value}): {found.proof}")
        if one is None and found.value != "present":
            lines += answer_lines([k for k in known if k.doubted], self._now, target)
        return self._made("status", lines, category=target.label)

    def _any_of(self, target: Target, one: KnownObject | None) -> PlainAnswer:
        """Presence of something of several categories, or on another thing."""
        where, there = self._there()
        sure = self._sure(target) if one is None else [one]
        known = [found for found in sure if there(found)]
        if known:
            yes = "Yes" if self._any_still_there(known) else "Not for sure any more"
            return self._of_category(target, [f"{yes}:", *answer_lines(known, self._now, target)])
        others = answer_lines(sure, self._now, target) if where else []
        none = f"No {target.label} is known to be{where}" if where else "None is known"
        return self._of_category(target, [none, *others])

    def _any_still_there(self, known: Sequence[KnownObject]) -> bool:
        """Whether one of some objects is probably where it was seen."""
        return any(one.still_there(self._now) >= PROBABLY for one in known)

    def _there(self) -> tuple[str, Callable[[KnownObject], bool]]:
        """The place or carrier that the question names, in words, and a test for things there."""
        question = self._question
        if question.other:
            carriers = self._carriers(question.other)
            held = {str(row["object"]) for one in carriers for row in self._held(one)}
            name = carriers[0].label if len(carriers) == 1 else f"the {question.other}"
            return f" on {name}", lambda one: one.iri in held
        if question.where:
            place = place_named(self._map, question.where)
            return f" in {self._label_of(place)}", lambda one: one.place == place
        return "", lambda one: True

    def _count(self) -> PlainAnswer:
        target, _ = self._target(self._question.what)
        where, there = self._there()
        known = [one for one in known_objects(self._map, target, located=0) if there(one)]
        sure = [one for one in known if one.sure]
        rest = len(known) - len(sure)
        doubted = f", and {rest} more that may be some" if rest else ""
        return self._of_category(target, [f"{target.label}: {len(sure)}{where}{doubted}"])

    def _size(self) -> PlainAnswer:
        target, _ = self._target(self._question.what)
        sure = self._named(self._question.what)
        records = {one.iri: one for one in self._map.objects()}
        lines = [sized(one.label, records[one.iri].extent) for one in sure[:LISTED]]
        return self._of_category(target, lines)

    def _near(self, within: float = _NEAR) -> PlainAnswer:
        target, _ = self._target(self._question.what)
        spots = self._spots(self._question.other)
        found = sorted(
            (math.dist(one.p_map, spot), label, one.iri, one)
            for one in self._sure(target)
            for label, spot in spots
        )
        lines, seen = list[str](), set[str]()
        for metres, label, iri, one in found:
            if iri not in seen and len(lines) < LISTED and metres <= within:
                seen.add(iri)
                lines.append(f"{one.label}, {metres:.1f} m from {label}, {one.where}")
        if not lines:
            some = "" if math.isinf(within) else f" within {within:g} m of {self._question.other}"
            lines = [f"No {target.label} is known{some}"]
            lines += [f"The nearest is {d:.1f} m away: {one.label}" for d, _, _, one in found[:1]]
        return self._of_category(target, lines)

    def _around(self) -> PlainAnswer:
        (label, (x, y)), *others = self._spots(self._question.other)
        rows = [
            row
            for row in self._map.query("objects-within-radius", x=x, y=y, radius=_NEAR).records()
            if row["label"] != label
        ]
        named = [f"{row['label']} ({number(row, 'distance'):.1f} m)" for row in rows[:NAMED]]
        rest = f" and {len(rest_rows)} more" if (rest_rows := rows[NAMED:]) else ""
        line = f"Within {_NEAR:g} m of {label}: {', '.join(named) or 'nothing'}{rest}"
        more = [f"The map has {len(others)} more of that name"] if others else []
        at = {"x": f"{x:.2f}", "y": f"{y:.2f}"}
        return self._listed("objects-within-radius", [line, *more], rows, **at)

    def _on(self, name: str = "") -> PlainAnswer:
        carriers = self._carriers(name or self._question.other)
        lines = list[str]()
        for carrier in carriers[:LISTED]:
            if held := [str(row["label"]) for row in self._held(carrier)]:
                lines.append(f"On or in {carrier.label} {carrier.where}: {', '.join(held)}".strip())
        lines = lines or [f"nothing is known to be on or in {carriers[0].label}"]
        first = carriers[0].iri.removeprefix(self._map.base)
        return self._made("related", lines, object=first)

    def _carriers(self, words: str) -> list[KnownObject]:
        """The things that words name, on which others may be; at least one."""
        try:
            return self._named(words)
        except UndetectableError:
            raise QueryParameterError(
                f"no detector here can see {words}, so nothing is known to be on it"
            ) from None

    def _named(self, words: str) -> list[KnownObject]:
        """The things that words name; at least one."""
        target, one = self._target(words)
        found = [one] if one is not None else self._sure(target)
        if not found:
            raise QueryParameterError(f"no {target.label} is in the map for sure")
        return found

    def _held(self, carrier: KnownObject) -> list[Row]:
        rows = self._map.query("related", object=carrier.iri).records()
        return [row for row in rows if row["relation"] in ("on", "inside")]

    def _last_seen(self) -> PlainAnswer:
        target, one = self._target(self._question.what)
        rows = [
            row
            for iri in target.queried
            for row in self._map.query("last-seen", category=iri).records()
        ]
        rows = [row for row in rows if one is None or row["object"] == one.iri]
        if not rows:
            never = f"No {target.label} was ever seen for sure"
            return self._made("last-seen", [never], category=target.label)
        row = max(rows, key=lambda row: str(row["lastSeen"]))
        seen = row["lastSeen"]
        assert isinstance(seen, datetime)
        ago = span(max(self._now - seen.timestamp(), 0.0))
        place = f" in {row['place']}" if row["place"] else ""
        name, at = row["label"] or row["category"], iso(seen.timestamp())[:19]
        line = f"{ago} ago: {name}{place}, at {at}"
        return self._listed("last-seen", [line], rows, category=target.label)

    def _places(self) -> PlainAnswer:
        rows = self._map.query("places").records()
        kinds = [f" ({plain_place(str(r['category']))})" if r["category"] else "" for r in rows]
        named = [f"{row['label']}{kind}" for row, kind in zip(rows, kinds, strict=True)]
        count = f"{len(rows)} place{'s' if len(rows) > 1 else ''}"
        line = f"{count}: {', '.join(named)}" if rows else "The map has no places"
        return self._listed("places", [line], rows)

    def _objects(self) -> PlainAnswer:
        rows = self._map.query("objects").records()
        unnamed = counted_unnamed(self._map)
        more = f", and {unnamed}" if unnamed else ""
        count = f"The map has {len(rows)} object{'' if len(rows) == 1 else 's'}"
        line = f"{count}: {counted_kinds(rows)}{more}" if rows else f"{count}{more}"
        return self._listed("objects", [line], rows)

    def _robot(self) -> PlainAnswer:
        rows = self._map.query("robot").records()
        if not rows:
            return self._made("robot", ["The map has no pose of a robot"])
        x, y, place = number(rows[0], "x"), number(rows[0], "y"), rows[0]["place"]
        where = f"in {place} " if place else ""
        return self._listed("robot", [f"The robot is {where}at ({x:.1f}, {y:.1f})"], rows)

    def _departed(self) -> PlainAnswer:
        rows = self._map.query("departed").records()
        named = [str(row["label"] or row["category"]) for row in rows[:NAMED]]
        gone = f"Gone from their spots: {', '.join(named)}"
        line = gone if rows else "Nothing is known to be gone"
        return self._listed("departed", [line], rows)

    def _target(self, words: str) -> tuple[Target, KnownObject | None]:
        """The target that words name; and the object, if they are its label."""
        iri = object_named(self._map, words)
        for record in self._map.perceived.objects((iri,)) if iri else ():
            label = self._map.catalogue.label(record.category)
            target, one = known_object(self._map, iri, label)
            if one is not None:
                return target, one
        (target,) = resolve(self._map, (words,))
        return target, None

    def _sure(self, target: Target) -> list[KnownObject]:
        return [one for one in known_objects(self._map, target) if one.sure]

    def _spots(self, words: str) -> list[tuple[str, tuple[float, float]]]:
        """Labels and positions [m] of the things, or doors, that words name; at least one."""
        if words.split()[-1] in ("door", "doors", "doorway"):
            doors = [(f"door {d.iri.rpartition('/')[2]}", (d.x, d.y)) for d in self._map.doors()]
            if not doors:
                raise QueryParameterError("the map has no doors")
            return doors
        things = self._named(words)
        return [(t.label, (float(t.p_map[0]), float(t.p_map[1]))) for t in things]

    def _label_of(self, place: str) -> str:
        return next((p.label for p in self._map.places() if p.iri == place), place)

    def _of_category(self, target: Target, lines: Sequence[str]) -> PlainAnswer:
        """An answer about things of a target; no query has those of several categories."""
        if target.iri is None:
            return PlainAnswer(self._question.kind, "", {}, tuple(lines))
        return self._made("objects-by-category", lines, category=target.label)

    def _made(self, query: str, lines: Sequence[str], **parameters: str) -> PlainAnswer:
        return PlainAnswer(self._question.kind, query, parameters, tuple(lines))

    def _listed(
        self, query: str, lines: Sequence[str], rows: Sequence[Row], **parameters: str
    ) -> PlainAnswer:
        columns = tuple(rows[0]) if rows else ()
        table = tuple(tuple(row.values()) for row in rows)
        return PlainAnswer(self._question.kind, query, parameters, tuple(lines), columns, table)

"""Answers to plain questions: the shipped query of each kind, its rows, and sentences."""

from __future__ import annotations

import math
import re
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from datetime import datetime
from typing import Final

from kg.history.timestamps import iso
from kg.maps.query.query_files import shipped_queries
from kg.maps.semantic_map import SemanticMap
from kg.model.errors import (
    QueryParameterError,
    UndetectableError,
    UnknownCategoryError,
    UnknownQueryError,
)
from planner.freespace.planning_map import Row, number
from planner.questions.counts import NAMED, counted_kinds, counted_unnamed
from planner.questions.moments import read_since, since
from planner.questions.patterns import EVENTS, MAX_LENGTH, Kind, Question, parsed
from planner.questions.plain_answer import PlainAnswer
from planner.questions.rooms import about_rooms
from planner.search.goals.candidate_queries import span
from planner.search.goals.known_objects import LISTED, KnownObject, known_objects
from planner.search.goals.place_names import object_named, place_named, plain_place
from planner.search.goals.status import Status, Value, status
from planner.search.goals.target_words import any_meaning
from planner.search.goals.targets import Target, resolve
from planner.search.plans.answer_sentences import answer_lines, find_sentences
from planner.search.plans.report import empty_answer, find_answer

_SPARQL: Final = re.compile(
    r"(?:\s|#[^\n]*\n)*(?:select|ask|construct|describe|prefix|base|insert|delete)\b", re.IGNORECASE
)
_NEAR: Final = 2.0  # [m] over the floor
_YES: Final[Mapping[Value, str]] = {
    "present": "Yes",
    "gone": "Not any more",
    "looked, none seen": "Probably not",
    "hidden": "Not seen, but it may be hidden",
    "never looked": "Unknown, since nobody looked",
}


def is_plain(text: str) -> bool:
    """Whether a text is to be read as a plain question, rather than as SPARQL or a query's name."""
    if text.endswith(".rq") or "{" in text or _SPARQL.match(text):
        return False
    return text not in {query.name for query in shipped_queries()}


def answer_question(semantic_map: SemanticMap, text: str, now: float | None = None) -> PlainAnswer:
    """The answer to a question in English, at `now` [s since 1970], by default the clock's time.

    Raises:
        UnknownQueryError: the question is not understood; the message has questions that are.
        UnknownCategoryError: a word in it is unknown.
        QueryParameterError: no place, or no thing, has a name in it.
    """
    question = _parsed(semantic_map, text)
    if question is None:
        raise UnknownQueryError(_not_understood(text))
    answerer = _Answerer(semantic_map, question, time.time() if now is None else now)
    try:
        answer = answerer.answer()
    except UndetectableError as error:
        return PlainAnswer(question.kind, "", {}, (str(error),))
    return replace(answer, lines=(*question.notes, *answer.lines))


def _parsed(semantic_map: SemanticMap, text: str) -> Question | None:
    catalogue = semantic_map.catalogue
    return parsed(text, lambda name: catalogue.get(name) is not None)


def _not_understood(text: str) -> str:
    shown = " ".join(text.split())
    shown = f"{shown[:60]!r}{' ...' if len(shown) > 60 else ''}" if shown else "an empty text"
    limit = f" of at most {MAX_LENGTH} characters" if len(text) > MAX_LENGTH else ""
    examples = " / ".join(q.asked[0] for q in shipped_queries() if q.asked)
    return f"not understood: {shown}; questions{limit} that are: {examples}"


def answer_box(semantic_map: SemanticMap, wanted: Sequence[str]) -> dict[str, object]:
    """Answer of the page's box, as `find --json` has it: a plan for things, or sentences alone.

    Raises as `answer_question` and `find_answer`.
    """
    question = _parsed(semantic_map, wanted[0]) if len(wanted) == 1 else None
    if question is None:
        return find_answer(semantic_map, wanted)
    now = time.time()
    rooms = about_rooms(semantic_map, question, now)
    if question.kind == "where" and not rooms and not object_named(semantic_map, question.what):
        found = find_answer(semantic_map, [question.what])
        return {**found, "answer": [*question.notes, *_texts(found["answer"])]}
    answer = answer_question(semantic_map, wanted[0], now)
    return {
        **empty_answer(semantic_map, (), now),
        "target": wanted[0],
        "answer": list(answer.lines),
    }


def _texts(value: object) -> list[str]:
    return [str(one) for one in value] if isinstance(value, list) else []


class _Answerer:
    def __init__(self, semantic_map: SemanticMap, question: Question, now: float) -> None:
        self._map, self._question, self._now = semantic_map, question, now

    def answer(self) -> PlainAnswer:
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
            if self._known_word(name):
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
        lines.append(f"Since {found.times[0]}, by the time of writing")
        rows = tuple((c.kind, c.iri, c.category, *c.sides) for c in changes)
        columns = ("change", "thing", "category", "before", "after")
        return PlainAnswer("changed", "departed", {}, tuple(lines), columns, rows)

    def _status(self) -> PlainAnswer:
        target, one = self._target(self._question.what)
        place = place_named(self._map, self._question.where) if self._question.where else None
        if one is not None:
            found = status(self._map, one.iri)
            if place is not None and found.value == "present" and one.place != place:
                where = one.where.strip()
                return self._made("status", [f"No: {one.label} is {where}"], category=one.category)
        elif target.iri is None:
            return self._any_of(target, place)
        else:
            found = status(self._map, target.iri, None if place is None else place)
        lines = [target.note] if target.note and one is None else []
        return self._made("status", [*lines, _yes(found)], category=target.label)

    def _any_of(self, target: Target, place: str | None) -> PlainAnswer:
        """Presence of something of several categories."""
        known = [one for one in self._sure(target) if place in (None, one.place)]
        lines = ["Yes:", *answer_lines(known, self._now, target)] if known else ["None is known"]
        return self._of_category(target, lines)

    def _count(self) -> PlainAnswer:
        target, _ = self._target(self._question.what)
        place = place_named(self._map, self._question.where) if self._question.where else None
        every = known_objects(self._map, target, located=0)
        known = [one for one in every if place in (None, one.place)]
        sure, named = [one for one in known if one.sure], target.label
        where = f" in {self._label_of(place)}" if place else ""
        rest = len(known) - len(sure)
        doubted = f", and {rest} more that may be some" if rest else ""
        lines = [f"{named}: {len(sure)}{where}{doubted}"]
        return self._of_category(target, lines)

    def _near(self) -> PlainAnswer:
        target, _ = self._target(self._question.what)
        spots = self._spots(self._question.other)
        found = sorted(
            (math.dist(one.p_map, spot), label, one.iri, one)
            for one in self._sure(target)
            for label, spot in spots
        )
        lines, seen = list[str](), set[str]()
        for metres, label, iri, one in found:
            if iri not in seen and len(lines) < LISTED and metres <= _NEAR:
                seen.add(iri)
                lines.append(f"{one.label}, {metres:.1f} m from {label}, {one.where}")
        if not lines:
            lines = [f"No {target.label} is known within {_NEAR:g} m of {self._question.other}"]
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
        more = [f"There are {len(others)} others of that name"] if others else []
        at = {"x": f"{x:.2f}", "y": f"{y:.2f}"}
        return self._listed("objects-within-radius", [line, *more], rows, **at)

    def _on(self, name: str = "") -> PlainAnswer:
        target, one = self._target(name or self._question.other)
        carriers = [one] if one is not None else self._sure(target)
        lines = list[str]()
        for carrier in carriers[:LISTED]:
            rows = self._map.query("related", object=carrier.iri).records()
            held = [str(row["label"]) for row in rows if row["relation"] in ("on", "inside")]
            if held:
                lines.append(f"On or in {carrier.label} {carrier.where}: {', '.join(held)}".strip())
        if not lines:
            none = f"nothing is known to be on or in {carriers[0].label}" if carriers else ""
            lines = [none or f"no {target.label} is in the map"]
        first = carriers[0].iri.removeprefix(self._map.base) if carriers else ""
        return self._made("related", lines, object=first)

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
        count = f"{len(rows)} object{'' if len(rows) == 1 else 's'}"
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
            (target,) = resolve(self._map, (label,))
            known = known_objects(self._map, target)
            one = next((one for one in known if one.iri == iri), None)
            if one is not None:
                return target, one
        (target,) = resolve(self._map, (words,))
        return target, None

    def _known_word(self, words: str) -> bool:
        """Whether words name things; typing errors, as in a room that is unknown, do not count."""
        if object_named(self._map, words):
            return True
        try:
            return any_meaning(self._map.catalogue, words).how != "spelling"
        except UnknownCategoryError:
            return False

    def _sure(self, target: Target) -> list[KnownObject]:
        return [one for one in known_objects(self._map, target) if one.sure]

    def _spots(self, words: str) -> list[tuple[str, tuple[float, float]]]:
        """Labels and positions [m] of the things, or doors, that words name; at least one."""
        if words.split()[-1] in ("door", "doors", "doorway"):
            doors = [(f"door {d.iri.rpartition('/')[2]}", (d.x, d.y)) for d in self._map.doors()]
            if not doors:
                raise QueryParameterError("the map has no doors")
            return doors
        target, one = self._target(words)
        things = [one] if one is not None else self._sure(target)
        if not things:
            raise QueryParameterError(f"no {target.label} is in the map for sure")
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


def _yes(found: Status) -> str:
    return f"{_YES[found.value]} ({found.value}): {found.proof}"

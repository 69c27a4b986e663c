"""Answers to plain questions by their kind: the shipped query, its rows, and sentences."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Final

from kg.history.reports.comparison import PRESENT, ObjectChange
from kg.history.timestamps import moment, span, spoken
from kg.maps.semantic_map import SemanticMap
from kg.model.errors import QueryParameterError
from planner.freespace.planning_map import number, time_or_none
from planner.questions.moments import since
from planner.questions.named_things import NAMED, counted, counted_kinds
from planner.questions.patterns import EVENTS, Kind, PlainAnswer
from planner.questions.rooms import about_rooms
from planner.questions.thing_answers import ThingAnswers
from planner.search.goals.known_objects import LISTED, KnownObject, known_objects
from planner.search.goals.place_names import (
    counted_unnamed,
    listed,
    notes_of,
    spoken_places,
    titled_places,
)
from planner.search.goals.search_goals import plural, with_article
from planner.search.goals.status import Value, status, was_there
from planner.search.goals.targets import Target
from planner.search.plans.answer_sentences import PROBABLY, answer_lines, find_sentences

_YES: Final[Mapping[Value, str]] = {
    "present": "Yes",
    "gone": "Not any more",
    "looked, none seen": "Probably not",
    "hidden": "None is known",
    "never looked": "Unknown",
}
_ALL: Final = ("thing", "things", "object", "objects", "items")

_ROOMS: Final = {
    "appeared": "New rooms",
    "gone": "Rooms that are gone",
    "relabelled": "Rooms with another name",
    "reshaped": "Rooms with another shape",
}


class Answerer(ThingAnswers):
    """Answers a question of any kind."""

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
            "distance": self._distance,
            "size": self._size,
            "compare": self._compare,
            "most": self._most,
            "under": self._under,
            "recent": self._recent,
            "largest": self._largest,
            "route": self._route,
            "between": self._between,
            "certainty": self._certainty,
            "unseen": self._unseen,
            "why": self._why,
            "alike": self._alike,
            "help": lambda: self._made("", example_questions(self._map)),
        }
        rooms = about_rooms(self._map, self._question, self._now)
        listed = "places" if self._question.kind in ("where", "status", "count") else ""
        return self._made(listed, rooms) if rooms else kinds[self._question.kind]()

    def _where(self) -> PlainAnswer:
        target, one = self._target(self._question.what)
        if one is not None:
            lines = answer_lines([one], self._now)
            return self._made("whereabouts", lines, object=one.iri.removeprefix(self._map.base))
        if self._question.where:
            return self._any_of(target, None)
        lines = find_sentences(self._map, target, self._now)
        lines = [target.note, *lines] if target.note else lines
        return self._of_category(target, lines)

    def _in_place(self) -> PlainAnswer:
        name = self._question.where
        if not name:
            return self._objects()
        place = self._place(name)
        if place is None:
            return self._on(name)
        rows = self._map.query("objects-in-place", place=place).records()
        title, unnamed = self._title(place), counted_unnamed(self._map, place)
        line = f"{counted(rows)} in {title}: {counted_kinds(rows, self._map.catalogue)}"
        line += f", and {unnamed}" if unnamed else ""
        none = f"{unnamed} in {title}" if unnamed else f"Nothing is known to be in {title}"
        line = line if rows else none
        notes = [f"Note by {by}: {text}" for text, by in notes_of(self._map, place)]
        return self._listed("objects-in-place", [line, *notes], rows, place=self._label(place))

    def _changed(self) -> PlainAnswer:
        begin = since(self._question.when, self._now)
        found = self._map.history.compare(begin)
        what = self._question.what
        target, one = self._target(what) if what else (None, None)
        where, base = self._question.where, self._map.base
        place = self._place(where) if where else None
        if where and place is None:
            raise QueryParameterError(f"changes are listed by place, and {where!r} is none")
        wanted = ("moved", "gone") if what else EVENTS.get(self._question.event, ())
        changes = [
            change
            for change in found.changes
            if (not wanted or change.kind in wanted)
            and (target is None or change.category in target.kinds.values())
            and (one is None or f"{base}{change.iri}" == one.iri)
            and (place is None or f"{base}{change.place}" == place)
        ]
        lines = []
        rows_now = self._map.query("objects", least=0.0).records()
        titles = {str(row["object"]): str(row["label"] or "") for row in rows_now}
        for kind in ("appeared", "gone", "moved", "relabelled"):
            of_kind = [change for change in changes if change.kind == kind]
            moved = " from {} to {}" if kind == "moved" and target is not None else ""
            some = [
                (titles.get(f"{base}{c.iri}") or self._title_of(c)) + moved.format(*c.sides)
                for c in of_kind
            ]
            lines += _named(kind.capitalize(), some)
        rooms = [
            room
            for room in found.rooms
            if target is None and place in (None, f"{base}{room.iri}") and not wanted
        ]
        for kind, words in _ROOMS.items():
            of_rooms = [room for room in rooms if room.kind == kind]
            named = kind == "relabelled"
            some = [f"{r.before}, now {r.title}" if named else r.title for r in of_rooms]
            lines += _named(words, some)
        event = f"is known to have {' or '.join(wanted)}" if wanted else "changed"
        event += f" in {self._title(place)}" if place else ""
        since_then = f"since {spoken(moment(found.times[0]))}"
        none = f"{target.none if target else 'Nothing'} {event} {since_then}"
        lines = [f"{since_then.capitalize()}:", *lines] if lines else [none]
        if target is not None:
            lines += answer_lines([one] if one else self._sure(target), self._now, target)
        rows = (
            *((c.kind, c.iri, c.category, *c.sides) for c in changes),
            *((room.kind, room.iri, room.title, room.before, room.after) for room in rooms),
        )
        columns = ("change", "thing", "category", "before", "after")
        return PlainAnswer("changed", "", {}, tuple(lines), columns, rows)

    def _title_of(self, change: ObjectChange) -> str:
        """Title of a thing that is no longer in the map: its category and its number."""
        catalogue = self._map.catalogue
        known = catalogue.get(change.category, "object")
        return change.category if known is None else catalogue.title(known.iri, change.iri)

    def _status(self) -> PlainAnswer:
        target, one = self._target(self._question.what)
        if self._question.of_all and one is None and (every := self._sure(target)):
            return self._each(target, every)
        where = self._question.where
        place = self._place(where) if where else None
        is_on = bool(self._question.other) or (bool(where) and place is None)
        if is_on or (one is None and target.iri is None):
            return self._any_of(target, one)
        if one is not None:
            found = status(self._map, one.iri)
            if place is not None and found.value == "present" and one.place != place:
                lines = [f"No: {one.label} is {one.where.strip()}"]
                return self._made("status", lines, category=one.category)
        else:
            assert target.iri is not None
            found = status(self._map, target.iri, place)
        lines = [target.note] if target.note and one is None else []
        known = self._known(target, one)
        known = [k for k in known if place in (None, k.place)]
        sure = [k for k in known if k.sure]
        if found.value == "present" and sure:
            lines += self._yes(sure, target)
        else:
            doubted = [k for k in known if k.doubted and one is None]
            perhaps = bool(doubted) and found.value == "hidden"
            begin = "Perhaps, though none is sure" if perhaps else _YES[found.value]
            elsewhere = self._sure(target) if place is not None and one is None else []
            lines.append(f"{begin}: {found.proof}")
            lines += answer_lines(doubted or elsewhere, self._now, target)
        return self._made("status", lines, category=target.kind)

    def _each(self, target: Target, known: Sequence[KnownObject]) -> PlainAnswer:
        """Whether all known things of a target are where the question says."""
        where, there = self._there()
        others = [one for one in known if not there(one)]
        count = f"{len(known) - len(others)} of {len(known)} {plural(target.label)}"
        line = f"{'No' if others else 'Yes'}: {count} are{where}"
        return self._of_category(target, [line, *answer_lines(others, self._now, target)])

    def _any_of(self, target: Target, one: KnownObject | None) -> PlainAnswer:
        """Presence of something of several categories, or in a place, or on another thing."""
        where, there = self._there()
        sure = self._sure(target) if one is None else [one]
        known = [found for found in sure if there(found)]
        if known and self._question.kind == "where":
            return self._of_category(target, answer_lines(known, self._now, target))
        if known:
            return self._of_category(target, self._yes(known, target))
        others = answer_lines(sure, self._now, target) if where else []
        none = f"{target.none} is known to be{where}" if where else "None is known"
        return self._of_category(target, [none, *others])

    def _yes(self, known: Sequence[KnownObject], target: Target) -> list[str]:
        """That known things are there, or were."""
        lines = answer_lines(known, self._now, target)
        if not self._any_still_there(known):
            return ["It was there, and has probably been moved since:", *lines]
        if len(lines) > 1:
            return ["Yes:", *lines]
        return [f"Yes, {lines[0][:1].lower()}{lines[0][1:]}"]

    def _any_still_there(self, known: Sequence[KnownObject]) -> bool:
        """Whether one of some objects is probably where it was seen."""
        return any(one.still_there(self._now) >= PROBABLY for one in known)

    def _count(self) -> PlainAnswer:
        target, _ = self._target(self._question.what)
        where, there = self._there()
        known = [one for one in known_objects(self._map, target) if there(one)]
        sure = [one for one in known if one.sure]
        rest = len(known) - len(sure)
        doubted = f", and perhaps {rest} more" if rest else ""
        whether = self._question.whether(len(sure), len(known))
        kinds = target.label if len(sure) == 1 else plural(target.label)
        line = f"{whether}{len(sure)} {kinds}{where}{doubted}"
        answer = self._of_category(target, [line])
        return replace(answer, things=tuple(one.iri for one in sure))

    def _most(self) -> PlainAnswer:
        """The places with the most things of a kind, and how many each has."""
        if self._question.what in _ALL:
            label, records = "object", self._map.objects()
            places = Counter(one.place for one in records if one.existence >= PRESENT)
        else:
            target, _ = self._target(self._question.what)
            label, places = target.label, Counter(one.place for one in self._sure(target))
        titles = spoken_places(self._map)
        counts = [(titles[p], n) for p, n in places.most_common() if p in titles]
        if not counts:
            return self._made("objects", [f"No {label} is known in any place"])
        top = [title for title, n in counts if n == counts[0][1]]
        each, rest = " each" if len(top) > 1 else "", counts[len(top) :]
        lines = [f"Most are in {', '.join(top)}: {counts[0][1]}{each} of {places.total()}"]
        lines += [f"Others: {', '.join(f'{n} in {title}' for title, n in rest)}"] if rest else []
        return self._made("objects", lines)

    def _on(self, name: str = "") -> PlainAnswer:
        carriers = self._carriers(name or self._question.other)
        lines = list[str]()
        for carrier in carriers[:LISTED]:
            if held := [str(row["label"]) for row in self._held(carrier)]:
                lines.append(f"On or in {carrier.label} {carrier.where}: {', '.join(held)}".strip())
        lines = lines or [f"Nothing is known to be on or in {carriers[0].label}"]
        if len(carriers) > 1:
            return self._made("", lines)
        return self._made("related", lines, object=carriers[0].iri.removeprefix(self._map.base))

    def _places(self) -> PlainAnswer:
        rows = self._map.query("places").records()
        count = f"{len(rows)} place{'s' if len(rows) > 1 else ''}"
        named = ", ".join(title for _, title in titled_places(self._map))
        line = f"{count}: {named}" if rows else "The map has no places"
        return self._listed("places", [line], rows)

    def _objects(self) -> PlainAnswer:
        rows = self._map.query("objects").records()
        unnamed = counted_unnamed(self._map)
        more = f", and {unnamed}" if unnamed else ""
        line = f"The map has {counted(rows)}: {counted_kinds(rows, self._map.catalogue)}{more}"
        line = line if rows else f"The map has {unnamed or 'no objects'}"
        return self._listed("objects", [line], rows)

    def _robot(self) -> PlainAnswer:
        rows = self._map.query("robot").records()
        if not rows:
            return self._made("robot", ["The map has no pose of a robot"])
        x, y, place = number(rows[0], "x"), number(rows[0], "y"), rows[0]["place"]
        where = f"in {self._titled(place)} " if place else ""
        seen = time_or_none(rows[0], "lastSeen")
        ago = f", as of {span(max(self._now - seen.timestamp(), 0.0))} ago" if seen else ""
        line = f"The robot is {where}at ({x:.1f}, {y:.1f}){ago}"
        return self._listed("robot", [line], rows)

    def _departed(self) -> PlainAnswer:
        real = {left.iri for left in self._map.departed() if was_there(left)}
        left = self._map.query("departed").records()
        rows = [row for row in left if row["object"] in real]
        named = [str(row["label"] or row["category"]) for row in rows[:NAMED]]
        gone = f"Gone from their spots: {', '.join(named)}"
        line = gone if rows else "Nothing is known to be gone"
        return self._listed("departed" if len(rows) == len(left) else "", [line], rows)


def _named(what: str, names: Sequence[str]) -> list[str]:
    """``Moved: cup 2, chair 3 and 4 more``; no line for no names."""
    return [f"{what}: {listed(names[:NAMED], len(names[NAMED:]))}"] if names else []


def example_questions(semantic_map: SemanticMap) -> list[str]:
    """Questions about the surest thing of a map, another one in its place, and the map itself."""
    things, asked = semantic_map.query("objects").records(), list[str]()
    if things:
        kind, place = str(things[0]["category"]), things[0]["place"]
        beside = [str(row["category"]) for row in things if row["place"] == place]
        other = next((one for one in beside if one != kind), kind)
        several = plural(kind)
        asked = [f"where is the {kind}?", f"what is next to the {kind}?"]
        asked += [f"when did you last see the {other}?", f"how many {several} are there?"]
        spoken = spoken_places(semantic_map)
        rooms = {one.label: spoken[one.iri] for one in semantic_map.places()}
        if room := rooms.get(str(place), "").partition(" (")[0]:
            asked.append(f"is there {with_article(other)} in {room}?")
    if semantic_map.places():
        asked += ["which rooms are there?", "which room is the largest?"]
    asked += ["where are you?"] if semantic_map.query("robot").records() else []
    return [*asked, "what changed since yesterday?", "list all objects"]

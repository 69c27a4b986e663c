"""Answers to plain questions about rooms, places and doors, which are things of a map, too."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import Final

from kg.history.timestamps import span, spoken
from kg.maps.semantic_map import SemanticMap
from kg.model.errors import QueryParameterError
from kg.model.place_names import NUMBERED, plain_place
from kg.model.records import DoorRecord, PlaceRecord, likeliest
from kg.model.shares import percent
from planner.questions.patterns import Kind, Question
from planner.search.goals.place_names import (
    listed_places,
    notes_of,
    place_category,
    places_called,
    spoken_places,
)
from planner.search.goals.search_goals import plural, times, with_article

_LISTED: Final = 8  # places, or doors, in an answer
_WALL: Final = 0.3  # [m] greatest distance of places on both sides of a wall, ...
_MIN_SHARED: Final = 0.5  # ... and least length [m] of that wall
_PERHAPS: Final = 0.2  # least belief in a category of a place that is named as a possibility
#: names of all that a map has, unless a place is called so
WHOLE: Final = ("house", "home", "flat", "apartment", "building", "map", "wohnung", "haus")
_DOORS: Final = ("door", "doors", "doorway", "doorways", "tür", "türen")
#: rooms of a home that no category of places is
WITHOUT_CATEGORY: Final = frozenset(
    (
        *("garage", "balcony", "hall", "wc", "gym", "sauna", "conservatory", "guest room"),
        *("lab", "laboratory", "workshop"),
        *("laundry room", "utility room", "storage room", "store room", "boiler room"),
    )
)


@dataclass(frozen=True, slots=True)
class _Rooms:
    """Places that words name: one by its label, or all of a category."""

    name: str  # of the category, or the label of the one place
    sure: tuple[PlaceRecord, ...]
    perhaps: tuple[tuple[PlaceRecord, float], ...] = ()  # with beliefs, the highest first


def about_rooms(semantic_map: SemanticMap, question: Question, now: float) -> list[str]:
    """Sentences on the rooms, places or doors that a question is about; none for other things.

    Args:
        semantic_map: The map.
        question: The question.
        now: Moment that ages count to [s since 1970].

    Raises QueryParameterError for a place that does not exist, and for things near a room.
    """
    return _Answerer(semantic_map, question, now).lines()


class _Answerer:
    def __init__(self, semantic_map: SemanticMap, question: Question, now: float) -> None:
        self._map, self._question, self._now = semantic_map, question, now
        self._places = {place.iri: place for place in semantic_map.places()}
        self._spoken = spoken_places(semantic_map)

    def lines(self) -> list[str]:
        question = self._question
        kinds: Mapping[Kind, Callable[[_Rooms], list[str]]] = {
            "where": self._where,
            "status": self._status,
            "count": self._count,
            "last seen": self._viewed,
            "near": self._next_to,
            "around": self._next_to,
            "size": self._areas,
            "why": self._reasons,
            "certainty": self._reasons,
            "compare": self._compared,
        }
        if question.kind == "size" and question.what in WHOLE:
            whole = sum(place.area.area for place in self._places.values())
            return [f"The {len(self._places)} places of the map have {whole:.1f} m2 together"]
        if question.kind not in kinds or (question.of_all and question.kind == "status"):
            return []
        if question.what in _DOORS and question.kind in ("where", "status", "count"):
            return self._doors()
        rooms = self._named(question.what or question.other)
        if rooms is None and question.kind == "near" and self._named(question.other):
            raise QueryParameterError(
                f"what is near counts from things and doors, and {question.other!r} is a place; "
                f"'what is in the {question.other}' would work"
            )
        return [] if rooms is None else kinds[question.kind](rooms)

    def _named(self, words: str) -> _Rooms | None:
        with suppress(QueryParameterError):  # several things may have one label
            if words and (one := self._places.get(self._map.resolve("thing", words))):
                return _Rooms(one.label, (one,))
        if words in ("room", "rooms", "place", "places", "zimmer", "räume"):
            return _Rooms("room", tuple(self._places.values()))
        category = place_category(self._map.catalogue, words)
        if category is None:
            return self._called(words)
        sure = places_called(self._map, words)
        wider = self._map.places(category.iri, min_belief=_PERHAPS)
        others = [(p, p.beliefs.get(category.iri, _PERHAPS)) for p in wider if p not in sure]
        others.sort(key=lambda pair: -pair[1])
        return _Rooms(plain_place(category.label), sure, tuple(others))

    def _called(self, words: str) -> _Rooms | None:
        """The one place of a number or a name in answers; None for names of things."""
        try:
            one = self._places[self._map.resolve("place", words)]
        except QueryParameterError:
            if NUMBERED.fullmatch(words):
                raise
            return _Rooms(words, ()) if words in WITHOUT_CATEGORY else None
        return _Rooms(one.label, (one,))

    def _where(self, rooms: _Rooms) -> list[str]:
        lines = [_capital(self._described(place)) for place in rooms.sure[:_LISTED]]
        if rest := len(rooms.sure) - len(lines):
            lines.append(f"and {rest} more")
        return [*lines, *self._perhaps(rooms)] or [self._none(rooms)]

    def _areas(self, rooms: _Rooms) -> list[str]:
        lines = [
            f"{_capital(self._name(place))} has {place.area.area:.1f} m2, and is "
            f"{place.xmax - place.xmin:.1f} x {place.ymax - place.ymin:.1f} m at its widest"
            for place in rooms.sure[:_LISTED]
        ]
        return lines or [self._none(rooms)]

    def _reasons(self, rooms: _Rooms) -> list[str]:
        """Kinds of places, and the number of views and things that tell of them."""
        lines = list[str]()
        for place in rooms.sure[:_LISTED]:
            kind, things = _kind(self._map, place) or "no kind", len(place.evidence_objects)
            lines.append(
                f"{_capital(self._name(place))} is believed to be {kind}: it was viewed "
                f"{times(place.views)}, and {things or 'no'} thing{'s' * (things != 1)} in it tell "
                "of its kind"
            )
        return [*lines, *self._perhaps(rooms)] or [self._none(rooms)]

    def _status(self, rooms: _Rooms) -> list[str]:
        if not self._question.where:
            lines = self._where(rooms)
            if len(rooms.sure) == 1:
                return [f"Yes: {self._described(rooms.sure[0])}", *lines[1:]]
            return ["Yes:", *lines] if rooms.sure else lines
        place = self._places[self._map.resolve("place", self._question.where)]
        if place in rooms.sure:
            return [f"Yes: {self._described(place)}"]
        kind = _kind(self._map, place)
        believed = f"{place.label} is believed to be {kind}" if kind else "its kind is not known"
        perhaps = [p for one, p in rooms.perhaps if one == place]
        other = f", and {with_article(rooms.name)} with {percent(perhaps[0])}" if perhaps else ""
        return [f"No: {believed}{other}"]

    def _count(self, rooms: _Rooms) -> list[str]:
        named = [self._name(place) for place in rooms.sure[:_LISTED]]
        sure = len(rooms.sure)
        whether = self._question.whether(sure, sure + len(rooms.perhaps))
        kind = rooms.name if sure == 1 else plural(rooms.name)
        line = f"{whether}{sure or 'no'} {kind}" + f": {', '.join(named)}" * bool(named)
        return [_capital(line), *self._perhaps(rooms)]

    def _viewed(self, rooms: _Rooms) -> list[str]:
        seen = [(p.viewed.last, p) for p in rooms.sure if p.viewed is not None]
        if not seen:
            named = self._name(rooms.sure[0]) if rooms.sure else ""
            return [f"When {named} was last viewed is not kept" if named else self._none(rooms)]
        last, place = max(seen, key=lambda pair: pair[0])
        ago = span(max(self._now - last, 0.0))
        return [f"{_capital(self._name(place))} was last viewed {ago} ago ({spoken(last)})"]

    def _next_to(self, rooms: _Rooms) -> list[str]:
        """The places beside those that are named; of two kinds of places: whether they are."""
        others = self._named(self._question.other)
        if others is None:
            return []
        beside = [line for place in others.sure[:_LISTED] for line in self._beside(place)]
        beside = beside or [self._none(others)]
        if self._question.kind == "around" or rooms.name == "room":
            return beside
        if not rooms.sure:
            return [self._none(rooms)]
        pairs = [(one, other) for one in rooms.sure for other in others.sure if one != other]
        doorless = ", with no known door" if self._map.doors() else ""
        lines = [
            f"Yes: {self._name(one)} is next to {self._name(other)}"
            + ("" if _has_door(one, other) else doorless)
            for one, other in pairs
            if _touch(one, other)
        ]
        return lines or ["Not as far as the map knows", *beside]

    def _compared(self, rooms: _Rooms) -> list[str]:
        """The areas of two places, the larger one first."""
        others = self._named(self._question.other)
        if others is None or self._question.event not in ("bigger", "larger", "smaller"):
            return []
        pair = sorted((*rooms.sure, *others.sure), key=lambda place: -place.area.area)
        areas = [f"{self._name(place)} has {place.area.area:.1f} m2" for place in pair[:_LISTED]]
        missing = [self._none(one) for one in (rooms, others) if not one.sure]
        return [*missing, _capital(", ".join(areas))] if areas else missing

    def _doors(self) -> list[str]:
        """The doors of the map, or of a place."""
        doors = self._map.doors()
        if not doors:
            return [self._no_doors()]
        where = self._question.where and self._map.resolve("place", self._question.where)
        found = [door for door in doors if not where or where in door.places]
        of = f" of {self._places[where].label}" if where else ""
        count = f"{len(found)} door{'' if len(found) == 1 else 's'}{of}"
        if self._question.kind == "count":
            return [f"{self._question.whether(len(found), len(found))}{count}"]
        shown = [self._door(door) for door in found[:_LISTED]]
        rest = [f"and {len(found) - _LISTED} more"] if len(found) > _LISTED else []
        if self._question.kind == "status":
            shown = [f"Yes, {count}:", *shown] if found else [f"No door{of} is known"]
        return [*shown, *rest]

    def _no_doors(self) -> str:
        """That no door is known, and why."""
        if any(place.from_floor for place in self._places.values()):
            return "No door is known: doors are where the seen floor goes from place to place"
        return "Doors are not known: they are found with rooms, and the rooms of this map are given"

    def _door(self, door: DoorRecord) -> str:
        first, second = (self._places[iri].label for iri in door.places)
        return f"Between {first} and {second}, at ({door.x:.1f}, {door.y:.1f}), {door.width:.1f} m"

    def _described(self, place: PlaceRecord) -> str:
        """``the kitchen (place 6, 51 % sure) is next to the hall, at (2.1, 7.2), 13 m2``."""
        (x, y), name = place.area.centre, self._name(place)
        kind, top = _kind(self._map, place), likeliest(place.beliefs)
        if top is None or name.startswith(place.label):
            head = f"{place.label} is" + f" believed to be {kind}:" * bool(kind)
        else:
            head = f"{name} ({place.label}, {percent(place.beliefs[top])} sure) is"
        others = self._others(place)
        near = [p for p in others if _has_door(place, p)] or [p for p in others if _touch(place, p)]
        beside = " and ".join(self._name(one) for one in near[:_LISTED])
        beside = f"next to {beside}, " if near else ""
        line = f"{head} {beside}at ({x:.1f}, {y:.1f}), {place.area.area:.0f} m2"
        return line + "".join(
            f"; note by {by}: {text}" for text, by in notes_of(self._map, place.iri)
        )

    def _beside(self, place: PlaceRecord) -> list[str]:
        """The places next to one: those that a door leads to, and those behind a wall."""
        others = [one for one in self._others(place) if _touch(place, one)]
        name, doors = self._name(place), [self._name(p) for p in others if _has_door(place, p)]
        walls = [self._name(one) for one in others if not _has_door(place, one)]
        lines = [f"Next to {name}: {', '.join(doors)}"] if doors else []
        lines += [f"Next to {name}, with no known door: {', '.join(walls)}"] if walls else []
        return lines or [f"Next to {name}: no place is known"]

    def _others(self, place: PlaceRecord) -> list[PlaceRecord]:
        return [one for one in self._places.values() if one != place]

    def _name(self, place: PlaceRecord) -> str:
        return self._spoken.get(place.iri, place.label)

    def _perhaps(self, rooms: _Rooms) -> list[str]:
        named = ", ".join(f"{place.label} ({percent(p)})" for place, p in rooms.perhaps[:_LISTED])
        return [f"Perhaps {with_article(rooms.name)}: {named}"] if named else []

    def _none(self, rooms: _Rooms) -> str:
        known = listed_places(self._map)
        has = f"; the map has {known}" if known else ""
        return f"No place of this map is believed to be {with_article(rooms.name)}{has}"


def _has_door(one: PlaceRecord, other: PlaceRecord) -> bool:
    return other.iri in one.adjacent


def _touch(one: PlaceRecord, other: PlaceRecord) -> bool:
    """Whether places are next to each other: by a door, or along a wall."""
    shared = one.area.polygon.buffer(_WALL).intersection(other.area.polygon)
    return _has_door(one, other) or float(shared.area) >= _WALL * _MIN_SHARED


def _kind(semantic_map: SemanticMap, place: PlaceRecord) -> str:
    """``a kitchen (0.51)``: the most believed category of a place; "" where nothing is believed."""
    top = likeliest(place.beliefs)
    if top is None:
        return ""
    label = plain_place(semantic_map.catalogue.label(top))
    return f"{with_article(label)} ({percent(place.beliefs[top])})"


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]

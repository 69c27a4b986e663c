"""Answers to plain questions about rooms, places and doors, which are things of a map, too."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

from kg.history.timestamps import iso
from kg.maps.semantic_map import SemanticMap
from kg.model.errors import QueryParameterError
from kg.model.records import DoorRecord, PlaceRecord
from planner.questions.patterns import Kind, Question
from planner.search.goals.candidate_queries import span
from planner.search.goals.place_names import place_category, place_named, plain_place
from planner.search.goals.search_goals import with_article

_LISTED: Final = 8  # places, or doors, in an answer
_PERHAPS: Final = 0.2  # least belief in a category of a place that is named as a possibility
_DOORS: Final = ("door", "doors", "doorway", "doorways")
#: rooms of a home that no category of places is
_WITHOUT_CATEGORY: Final = frozenset(
    (
        *("garage", "balcony", "hall", "wc", "gym", "sauna", "conservatory", "guest room"),
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

    Raises QueryParameterError for a place that does not exist, and for a distance from a room.
    """
    return _Answerer(semantic_map, question, now).lines()


class _Answerer:
    def __init__(self, semantic_map: SemanticMap, question: Question, now: float) -> None:
        self._map, self._question, self._now = semantic_map, question, now
        self._places = {place.iri: place for place in semantic_map.places()}

    def lines(self) -> list[str]:
        question = self._question
        kinds: Mapping[Kind, Callable[[_Rooms], list[str]]] = {
            "where": self._where,
            "status": self._status,
            "count": self._count,
            "last seen": self._viewed,
            "near": self._next_to,
            "around": self._next_to,
            "size": self._where,
            "distance": self._no_distance,
        }
        if question.kind not in kinds:
            return []
        if question.what in _DOORS and question.kind in ("where", "status", "count"):
            return self._doors()
        rooms = self._named(question.what or question.other)
        if rooms is None and question.kind in ("near", "distance"):
            rooms = self._named(question.other)
            return [] if rooms is None else self._no_distance(rooms)
        return [] if rooms is None else kinds[question.kind](rooms)

    def _named(self, words: str) -> _Rooms | None:
        try:
            one = self._places.get(self._map.resolve("place", words) if words else "")
        except QueryParameterError:
            if re.fullmatch(r"place \d+", words):
                raise
            one = None
        if one is not None:
            return _Rooms(one.label, (one,))
        if words in ("room", "rooms", "place", "places"):
            return _Rooms("room", tuple(self._places.values()))
        category = place_category(self._map.catalogue, words)
        if category is None:
            return _Rooms(words, ()) if words in _WITHOUT_CATEGORY else None
        sure = self._map.places(category.iri)
        wider = self._map.places(category.iri, min_belief=_PERHAPS)
        others = [(p, p.beliefs.get(category.iri, _PERHAPS)) for p in wider if p not in sure]
        others.sort(key=lambda pair: -pair[1])
        return _Rooms(plain_place(category.label), sure, tuple(others))

    def _no_distance(self, rooms: _Rooms) -> list[str]:
        raise QueryParameterError(
            f"distances count from things and doors, and {rooms.name!r} is a place; "
            f"'what is in the {rooms.name}' would work"
        )

    def _where(self, rooms: _Rooms) -> list[str]:
        lines = [_capital(self._described(place)) for place in rooms.sure[:_LISTED]]
        if rest := len(rooms.sure) - len(lines):
            lines.append(f"and {rest} more: `hereabouts ask MAP places`")
        return [*lines, *self._perhaps(rooms)] or [self._none(rooms)]

    def _status(self, rooms: _Rooms) -> list[str]:
        if not self._question.where:
            lines = self._where(rooms)
            if len(rooms.sure) == 1:
                return [f"Yes: {self._described(rooms.sure[0])}", *lines[1:]]
            return ["Yes:", *lines] if rooms.sure else lines
        place = self._places[place_named(self._map, self._question.where)]
        if place in rooms.sure:
            return [f"Yes: {self._described(place)}"]
        kind = _kind(self._map, place)
        believed = f"{place.label} is believed to be {kind}" if kind else "its kind is not known"
        perhaps = [p for one, p in rooms.perhaps if one == place]
        other = f", and {with_article(rooms.name)} with {perhaps[0]:.2f}" if perhaps else ""
        return [f"No: {believed}{other}"]

    def _count(self, rooms: _Rooms) -> list[str]:
        named = ", ".join(place.label for place in rooms.sure[:_LISTED])
        line = f"{rooms.name}: {len(rooms.sure)}{f' ({named})' if named else ''}"
        return [line, *self._perhaps(rooms)]

    def _viewed(self, rooms: _Rooms) -> list[str]:
        seen = [(p.viewed.last, p) for p in rooms.sure if p.viewed is not None]
        if not seen:
            return [f"It is not kept when {rooms.name} was last viewed"]
        last, place = max(seen, key=lambda pair: pair[0])
        ago = span(max(self._now - last, 0.0))
        return [f"{ago} ago: {place.label}{_in_brackets(self._map, place)}, at {iso(last)[:19]}"]

    def _next_to(self, rooms: _Rooms) -> list[str]:
        """The places beside those that are named, through a door; two kinds: whether they are."""
        others = self._named(self._question.other)
        if others is None:
            return []
        if self._question.kind == "around":
            return [self._beside(place) for place in others.sure[:_LISTED]] or [self._none(others)]
        pairs = [
            f"Yes: {one.label}{_in_brackets(self._map, one)} is next to "
            f"{other.label}{_in_brackets(self._map, other)}"
            for one in rooms.sure
            for other in others.sure
            if other.iri in one.adjacent
        ]
        beside = [self._beside(place) for place in others.sure[:_LISTED]] or [self._none(others)]
        if not rooms.sure:
            return [self._none(rooms)]
        return pairs or [f"No {rooms.name} is known to be there", *beside]

    def _doors(self) -> list[str]:
        """The doors of the map, or of a place."""
        doors = self._map.doors()
        if not doors:
            return ["No door is known: doors are where the seen floor goes from place to place"]
        where = self._question.where and place_named(self._map, self._question.where)
        found = [door for door in doors if not where or where in door.places]
        of = f" of {self._places[where].label}" if where else ""
        count = f"{len(found)} door{'' if len(found) == 1 else 's'}{of}"
        if self._question.kind == "count":
            return [count]
        shown = [self._door(door) for door in found[:_LISTED]]
        rest = [f"and {len(found) - _LISTED} more"] if len(found) > _LISTED else []
        if self._question.kind == "status":
            shown = [f"Yes, {count}:", *shown] if found else [f"No door{of} is known"]
        return [*shown, *rest]

    def _door(self, door: DoorRecord) -> str:
        first, second = (self._places[iri].label for iri in door.places)
        return f"Between {first} and {second}, at ({door.x:.1f}, {door.y:.1f}), {door.width:.1f} m"

    def _described(self, place: PlaceRecord) -> str:
        """``place 6 is believed to be a kitchen (0.51): at (2.1, 7.2), 13 m2, next to place 5``."""
        x, y = place.area.centre
        kind = _kind(self._map, place)
        believed = f" is believed to be {kind}:" if kind else " is"
        line = f"{place.label}{believed} at ({x:.1f}, {y:.1f}), {place.area.area:.0f} m2"
        beside = self._neighbours(place)
        return f"{line}, next to {beside}" if beside else line

    def _beside(self, place: PlaceRecord) -> str:
        name = f"{place.label}{_in_brackets(self._map, place)}"
        return f"Next to {name}: {self._neighbours(place) or 'no door to it is known'}"

    def _neighbours(self, place: PlaceRecord) -> str:
        known = [self._places[iri] for iri in place.adjacent if iri in self._places]
        return ", ".join(f"{one.label}{_in_brackets(self._map, one)}" for one in known)

    def _perhaps(self, rooms: _Rooms) -> list[str]:
        named = ", ".join(f"{place.label} ({p:.2f})" for place, p in rooms.perhaps[:_LISTED])
        return [f"Perhaps {with_article(rooms.name)}: {named}"] if named else []

    def _none(self, rooms: _Rooms) -> str:
        others = [
            f"{place.label}{_in_brackets(self._map, place)}" for place in self._places.values()
        ]
        rest = f" and {len(others) - _LISTED} more" if len(others) > _LISTED else ""
        known = f"; there are {', '.join(others[:_LISTED])}{rest}" if others else ""
        return f"No place of this map is believed to be {with_article(rooms.name)}{known}"


def _kind(semantic_map: SemanticMap, place: PlaceRecord) -> str:
    """``a kitchen (0.51)``: the most believed category of a place; "" where nothing is believed."""
    top = max(place.beliefs, key=lambda iri: (place.beliefs[iri], iri), default="")
    if not top:
        return ""
    label = plain_place(semantic_map.catalogue.label(top))
    return f"{with_article(label)} ({place.beliefs[top]:.2f})"


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]


def _in_brackets(semantic_map: SemanticMap, place: PlaceRecord) -> str:
    """`` (kitchen)``; "" where the label of the place has it already."""
    top = max(place.beliefs, key=lambda iri: (place.beliefs[iri], iri), default="")
    label = plain_place(semantic_map.catalogue.label(top)) if top else ""
    return f" ({label})" if label and label.casefold() not in place.label.casefold() else ""

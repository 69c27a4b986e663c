"""Things and places that the words of a question name, and answers made of their sentences."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from kg.knowledge.ontology.catalogue import Catalogue
from kg.maps.semantic_map import SemanticMap
from kg.model.errors import QueryParameterError, UndetectableError
from planner.freespace.planning_map import Row, number
from planner.questions.patterns import ROBOT, PlainAnswer, Question
from planner.questions.recognition import is_known_word, target_named
from planner.search.goals.known_objects import KnownObject, known_objects
from planner.search.goals.place_names import listed, spoken_places
from planner.search.goals.search_goals import plural, with_article
from planner.search.goals.targets import Target

NAMED: Final = 8  # kinds of things, things, or places, in a sentence
Spot = tuple[str, tuple[float, float]]  # label and position [m]


class NamedThings:
    """Meaning of the words of a question about a map, at a moment `now` [s since 1970]."""

    def __init__(self, semantic_map: SemanticMap, question: Question, now: float) -> None:
        self._map, self._question, self._now = semantic_map, question, now

    def _target(self, words: str) -> tuple[Target, KnownObject | None]:
        """The target that words name; and the object, if they are its label."""
        target = target_named(self._map, words)
        known = known_objects(self._map, target) if target.thing else ()
        return target, known[0] if known else None

    def _known(self, target: Target, one: KnownObject | None) -> Sequence[KnownObject]:
        """The one object of a target, or all that are known."""
        return known_objects(self._map, target) if one is None else (one,)

    def _sure(self, target: Target) -> list[KnownObject]:
        return [one for one in known_objects(self._map, target) if one.sure]

    def _named(self, words: str) -> list[KnownObject]:
        """The things that words name; at least one."""
        target, one = self._target(words)
        found = [one] if one is not None else self._sure(target)
        if not found:
            raise QueryParameterError(f"no {target.label} is in the map for sure")
        return found

    def _carriers(self, words: str) -> list[KnownObject]:
        """The things that words name, on which others may be; at least one."""
        try:
            return self._named(words)
        except UndetectableError:
            raise QueryParameterError(
                f"no detector here can see {words}, so nothing is known to be on it"
            ) from None

    def _held(self, carrier: KnownObject) -> list[Row]:
        rows = self._map.query("related", object=carrier.iri).records()
        return [row for row in rows if row["relation"] in ("on", "inside")]

    def _spots(self, words: str) -> list[Spot]:
        """The things, or doors, that words name, or the robot; at least one."""
        if words == ROBOT:
            poses = self._map.query("robot").records()
            if not poses:
                raise QueryParameterError("the map has no pose of a robot to count from")
            return [("the robot", (number(poses[0], "x"), number(poses[0], "y")))]
        if words.split()[-1] in ("door", "doors", "doorway"):
            doors = [(f"door {d.iri.rpartition('/')[2]}", (d.x, d.y)) for d in self._map.doors()]
            if not doors:
                raise QueryParameterError("doors are not known in this map")
            return doors
        things = self._named(words)
        return [(t.label, (float(t.p_map[0]), float(t.p_map[1]))) for t in things]

    def _place(self, words: str) -> str | None:
        """IRI of the place that words name; None where they name things instead."""
        try:
            return self._map.resolve("place", words)
        except QueryParameterError:
            if is_known_word(self._map, words):
                return None
            raise

    def _there(self) -> tuple[str, Callable[[KnownObject], bool]]:
        """The place or carrier that the question names, in words, and a test for things there."""
        carrier, where = self._question.other, self._question.where
        place = self._place(where) if where else None
        if place is not None:
            return f" in {self._title(place)}", lambda one: one.place == place
        if not carrier and not where:
            return "", lambda one: True
        carriers = self._carriers(carrier or where)
        held = {str(row["object"]) for one in carriers for row in self._held(one)}
        name = carriers[0].label if len(carriers) == 1 else self._all_of(carrier or where)
        return f" on {name}" if carrier else f" on or in {name}", lambda one: one.iri in held

    def _all_of(self, words: str) -> str:
        """Words for several things: ``the tables``; a name that a person gave as it is."""
        return words if self._map.catalogue.is_given_name(words) else f"the {words}"

    def _title(self, iri: str) -> str:
        """``the kitchen``, or ``place 6 (bedroom)`` where there are several."""
        return spoken_places(self._map).get(iri, iri)

    def _label(self, iri: str) -> str:
        """``place 6``: the label of a place."""
        return next((p.label for p in self._map.places() if p.iri == iri), iri)

    def _titled(self, label: object) -> str:
        """The same by a label; places that share one have the first of their categories."""
        found = {p.label: p.iri for p in reversed(self._map.places())}
        return self._title(found.get(str(label), str(label)))

    def _of_category(self, target: Target, lines: Sequence[str]) -> PlainAnswer:
        """An answer about things of a target; no query has those of several categories."""
        if target.iri is None:
            return self._made("", lines)
        return self._made("objects-by-category", lines, category=target.kind)

    def _made(self, query: str, lines: Sequence[str], **parameters: str) -> PlainAnswer:
        """An answer in sentences; `query` has their facts, "" if none has."""
        return PlainAnswer(self._question.kind, query, parameters, tuple(lines))

    def _listed(
        self, query: str, lines: Sequence[str], rows: Sequence[Row], **parameters: str
    ) -> PlainAnswer:
        columns = tuple(rows[0]) if rows else ()
        table = tuple(tuple(row.values()) for row in rows)
        return PlainAnswer(self._question.kind, query, parameters, tuple(lines), columns, table)


def counted_kinds(rows: Iterable[Row], catalogue: Catalogue) -> str:
    """``a bed, 3 books``: objects by category, the most frequent first."""
    counts = Counter(str(row["category"]) for row in rows).most_common()
    named = [
        with_article(kind, catalogue) if n == 1 else f"{n} {plural(kind)}"
        for kind, n in counts[:NAMED]
    ]
    return listed(named, sum(n for _, n in counts[NAMED:]))


def counted(rows: Sequence[Row]) -> str:
    """``1 object``, ``3 objects``."""
    return f"{len(rows)} object{'' if len(rows) == 1 else 's'}"


def sized(label: str, extent: NDArray[np.float64] | None, above_floor: float) -> str:
    """Height of a thing's top, and its box, (3,) [m] of what was seen, centred `above_floor`."""
    if extent is None:
        return f"The size of {label} is not known"
    wide, deep, high = max(extent[:2]), min(extent[:2]), extent[2]
    return (
        f"The top of {label} is {above_floor + high / 2:.2f} m above the floor; the part that was "
        f"seen is {wide:.2f} m wide, {deep:.2f} m deep and {high:.2f} m high"
    )

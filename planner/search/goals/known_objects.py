"""Known objects: objects of the map that are the target, the surest first, before any plan.

Those of other maps of the same server, without a known way to the frame of a plan, are apart.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from functools import cache, partial
from typing import Final

import numpy as np
from numpy.typing import NDArray

from kg.maps.facts.coordinate_frames import apart_from, frames_in, maps_in
from kg.maps.semantic_map import SemanticMap
from kg.model.errors import QueryParameterError
from kg.model.records import RobotRecord
from mapping.persistence import holds, learned_half_life, listed_half_life
from planner.freespace.planning_map import Row, number, text_or_none, time_or_none
from planner.search.goals.place_names import StatedCategory, spoken_places, stated_categories
from planner.search.goals.search_goals import label_of, whereabouts
from planner.search.goals.targets import Target, resolve
from planner.settings import BELIEF

_MIN_EXISTENCE: Final = 0.05  # existence below which an object is no answer
LISTED: Final = 5  # objects that an answer in words lists
_SURE: Final = 0.5  # existence of an object that counts as sure


@dataclass(frozen=True, slots=True, eq=False)
class KnownObject:
    """An object of the map that is the target, or may be."""

    iri: str
    label: str
    category: str
    located: Callable[[], str]  # gives `where`
    p_map: NDArray[np.float64]  # (2,) [m]
    existence: float
    last_seen: datetime | None
    observations: int
    frame: str | None  # of its best observation
    found_by: str | None  # IRI of a search that found it
    own: str | None = None  # its most probable category, where that is not the target
    may_be: tuple[tuple[str, float], ...] = ()  # other categories, with their probabilities
    place: str | None = None  # IRI
    z: float | None = None  # [m]
    stated: StatedCategory | None = None  # by a person
    half_life: float = math.inf  # [s] after which half of such objects were moved

    @property
    def where(self) -> str:
        """Relations and place in words, read from the map once they are asked for."""
        return self.located()

    def kept(self, now: float) -> float:
        """Probability that it was not moved between its last sighting and `now` [s since 1970]."""
        last = now if self.last_seen is None else self.last_seen.timestamp()
        return holds(self.half_life, now - last)

    @property
    def believed(self) -> float:
        """Probability that it exists, which is high where a search found it."""
        found = self.found_by is not None and self.own is None and self.existence >= _SURE
        return max(self.existence, BELIEF.found) if found else self.existence

    def still_there(self, now: float) -> float:
        """Probability that it exists, and was not moved until `now` [s since 1970]."""
        return self.believed * self.kept(now)

    @property
    def sure(self) -> bool:
        """Whether the object more probably exists than not, or a search found it."""
        return self.existence >= _SURE or self.found_by is not None

    @property
    def doubted(self) -> bool:
        """Whether the object was detected as the target, and more probably does not exist."""
        return not self.sure and self.own is None


def known_objects(semantic_map: SemanticMap, target: Target) -> tuple[KnownObject, ...]:
    """Objects of the target's kinds that exist with at least 0.05, the surest first."""
    rows = remembered_rows(semantic_map, target)
    spoken = cache(partial(spoken_places, semantic_map))

    @cache
    def where(iri: str) -> str:
        return whereabouts(semantic_map, iri, spoken())

    return known_among(semantic_map, target, rows, stated_categories(semantic_map), where)


def remembered_rows(semantic_map: SemanticMap, target: Target) -> list[Sequence[Row]]:
    """Rows of `goals-remembered`, for each category of a target that is queried."""
    return [
        semantic_map.query("goals-remembered", category=iri).records() for iri in target.queried
    ]


def map_time(semantic_map: SemanticMap) -> float:
    """[s] the latest time stamp in the map, of an observation or of a robot pose."""
    return latest_of(semantic_map.query("goals-last-seen").records(), semantic_map.robot())


def latest_of(last_seen: Iterable[Row], robot: RobotRecord | None) -> float:
    """As `map_time`, from rows of `goals-last-seen` and the robot."""
    stamps = [0.0 if robot is None else robot.stamp]
    return max(
        stamps
        + [t.timestamp() for row in last_seen if (t := time_or_none(row, "lastSeen")) is not None]
    )


def kinds_half_lives(target: Target, rows: Iterable[Row]) -> dict[str, float]:
    """[s] half-life of each kind of a target, learned from its objects (rows of the map)."""
    stays: dict[str, list[float]] = {kind: [] for kind in target.kinds}
    for row in rows:
        first, last = time_or_none(row, "firstSeen"), time_or_none(row, "lastSeen")
        if first is not None and last is not None and row["own"] is None:
            stays[str(row["kind"])].append((last - first).total_seconds())
    return {
        kind: learned_half_life(listed_half_life(label, target.above[kind]), stays[kind])
        for kind, label in target.kinds.items()
    }


def known_among(
    semantic_map: SemanticMap,
    target: Target,
    groups: Sequence[Sequence[Row]],
    stated: Mapping[str, StatedCategory],
    where: Callable[[str], str],
) -> tuple[KnownObject, ...]:
    """As `known_objects`, from `remembered_rows` and the categories that people gave.

    `where` gives the whereabouts of an object in words, by its IRI.
    """
    others = dict[str, list[tuple[str, float]]]()
    any_rows = any(groups)
    for other in semantic_map.query("may-be", least=0.0).records() if any_rows else ():
        alternative = str(other["other"]), number(other, "probability")
        others.setdefault(str(other["object"]), []).append(alternative)
    best: dict[str, tuple[Row, float]] = {}  # each object by its most probable reading
    for rows in groups:
        half_lives = kinds_half_lives(target, rows)
        for row in rows:
            iri, existence = str(row["iri"]), number(row, "existence")
            if existence < _MIN_EXISTENCE or target.thing not in (None, iri):
                continue
            if iri not in best or number(best[iri][0], "existence") < existence:
                best[iri] = row, half_lives[str(row["kind"])]
    titles = _other_maps(semantic_map) if any_rows else {}

    def located(iri: str) -> Callable[[], str]:
        return lambda: where(iri) + _of_map(iri, titles)

    found = (
        KnownObject(
            iri=iri,
            label=label_of(row),
            category=str(row["category"]),
            located=located(iri),
            p_map=np.array([number(row, "x"), number(row, "y")]),
            existence=number(row, "existence"),
            last_seen=time_or_none(row, "lastSeen"),
            observations=0 if row["observations"] is None else int(number(row, "observations")),
            frame=text_or_none(row, "frame"),
            found_by=text_or_none(row, "foundBy"),
            own=text_or_none(row, "own"),
            place=text_or_none(row, "place"),
            may_be=tuple(others.get(iri, ())),
            z=None if row["z"] is None else number(row, "z"),
            half_life=half_life,
            stated=stated.get(iri),
        )
        for iri, (row, half_life) in best.items()
    )
    return tuple(
        sorted(
            found,
            key=lambda one: (not one.sure, one.category in target.second, -one.existence, one.iri),
        )
    )


def known_object(
    semantic_map: SemanticMap, iri: str, category: str
) -> tuple[Target, KnownObject | None]:
    """The target that a category's label names, and the one of its objects with an IRI."""
    (target,) = resolve(semantic_map, (category,))
    known = known_objects(semantic_map, target)
    return target, next((one for one in known if one.iri == iri), None)


def _other_maps(semantic_map: SemanticMap) -> dict[str, str]:
    """Titles of the other maps of a merged one, by IRI; empty for most maps."""
    if len(maps_in(semantic_map.engine)) <= 1:
        return {}
    others = frames_in(semantic_map.engine)
    return {frame.map: frame.title for frame in others if frame.map != semantic_map.base}


def _of_map(iri: str, titles: Mapping[str, str]) -> str:
    """The map of a thing in words; "" for the map of the search."""
    return next((f" of the map {titles[base]}" for base in titles if iri.startswith(base)), "")


def known_json(target: Target, known: Sequence[KnownObject], now: float) -> list[dict[str, object]]:
    """The `known` objects of a target as plain values at `now` [s since 1970]; lengths to 1 mm."""
    return [
        {
            "target": target.label,
            "iri": one.iri,
            "label": one.label,
            "category": one.category,
            "where": one.where,
            "x": round(float(one.p_map[0]), 3),
            "y": round(float(one.p_map[1]), 3),
            "z": None if one.z is None else round(one.z, 3),
            "own_category": one.own or one.category,
            "existence": round(one.existence, 6),
            "still_there": round(one.still_there(now), 6),
            "may_be": [{"category": other, "probability": p} for other, p in one.may_be],
            "last_seen": None if one.last_seen is None else one.last_seen.isoformat(),
            "observations": one.observations,
            "frame": one.frame,
            "found_by": one.found_by,
            **(
                {"named_by": one.stated.by, "detected_as": one.stated.detected_as or None}
                if one.stated
                else {}
            ),
        }
        for one in known
    ]


def known_elsewhere(
    opened: SemanticMap, here: SemanticMap, targets: Sequence[str]
) -> Iterator[tuple[str, KnownObject]]:
    """Title of a map without a known way to the frame of `here`, and a target that is in it.

    Args:
        opened: All maps of a server, or one.
        here: The map in whose frame a search is planned.
        targets: Texts that name targets.
    """
    if len(maps_in(opened.engine)) <= 1:
        return
    for frame in apart_from(opened.engine, here.base):
        other = opened.in_one_frame(frame.map)
        for target in _resolved(other, targets):
            for known in known_objects(other, target):
                if known.iri.startswith(frame.map):
                    yield frame.title, known


def _resolved(other: SemanticMap, targets: Sequence[str]) -> tuple[Target, ...]:
    """The targets in another map; those that are the label of one thing are of the first alone."""
    try:
        return resolve(other, targets)
    except QueryParameterError:
        return ()


def elsewhere_lines(
    opened: SemanticMap, here: SemanticMap, targets: Sequence[str], address: str
) -> Iterator[str]:
    """The targets in other frames in sentences, with the command that plans a search there."""
    home, words = here.description.title, " ".join(targets)
    for title, known in known_elsewhere(opened, here, targets):
        x, y = (float(value) for value in known.p_map)
        yield (
            f"{known.label} is in the map {title}, {known.where} at ({x:.1f}, {y:.1f}) of its own "
            f"frame; no way from the map {home} to it is known "
            f"(hereabouts find {address} {words} --in-map {title})"
        )

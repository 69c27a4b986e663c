"""Known objects: objects of the map that are the target, the surest first, before any plan.

Those of other maps of the same server, without a known way to the frame of a plan, are apart.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from typing import Final

import numpy as np
from numpy.typing import NDArray

from kg.maps.facts.coordinate_frames import apart_from, frames_in, maps_in
from kg.maps.semantic_map import SemanticMap
from kg.model.errors import QueryParameterError
from mapping.persistence import holds
from planner.freespace.planning_map import number, text_or_none, time_or_none
from planner.search.goals.candidate_queries import kinds_half_lives
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
    where: str  # relations and place in words
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


def known_objects(
    semantic_map: SemanticMap, target: Target, *, located: int | None = None
) -> tuple[KnownObject, ...]:
    """Objects of the target's kinds that exist with at least 0.05, the surest first.

    `where` is computed for the first `located` objects (None: for all); it is "" for the others.
    """
    spoken = spoken_places(semantic_map)
    others = dict[str, list[tuple[str, float]]]()
    for row in semantic_map.query("may-be", least=0.0).records():
        alternative = str(row["other"]), number(row, "probability")
        others.setdefault(str(row["object"]), []).append(alternative)
    found: dict[str, KnownObject] = {}
    stated = stated_categories(semantic_map)
    for category in target.queried:
        rows = semantic_map.query("goals-remembered", category=category).records()
        half_lives = kinds_half_lives(target, rows)
        for row in rows:
            iri, existence = str(row["iri"]), number(row, "existence")
            if existence < _MIN_EXISTENCE or target.thing not in (None, iri):
                continue
            if iri in found and found[iri].existence >= existence:
                continue  # another reading of it is as probable
            found[iri] = KnownObject(
                iri=iri,
                label=label_of(row),
                category=str(row["category"]),
                where="",
                p_map=np.array([number(row, "x"), number(row, "y")]),
                existence=existence,
                last_seen=time_or_none(row, "lastSeen"),
                observations=0 if row["observations"] is None else int(number(row, "observations")),
                frame=text_or_none(row, "frame"),
                found_by=text_or_none(row, "foundBy"),
                own=text_or_none(row, "own"),
                place=text_or_none(row, "place"),
                may_be=tuple(others.get(iri, ())),
                z=None if row["z"] is None else number(row, "z"),
                half_life=half_lives[str(row["kind"])],
                stated=stated.get(iri),
            )
    titles = _other_maps(semantic_map)
    known = sorted(
        found.values(),
        key=lambda one: (not one.sure, one.category in target.second, -one.existence, one.iri),
    )
    wanted = len(known) if located is None else located
    return tuple(
        replace(
            one,
            where=whereabouts(semantic_map, one.iri, spoken) + _of_map(one.iri, titles)
            if n < wanted
            else "",
        )
        for n, one in enumerate(known)
    )


def known_object(
    semantic_map: SemanticMap, iri: str, category: str, *, located: int | None = None
) -> tuple[Target, KnownObject | None]:
    """The target that a category's label names, and the one of its objects with an IRI."""
    (target,) = resolve(semantic_map, (category,))
    known = known_objects(semantic_map, target, located=located)
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


def known_json(
    semantic_map: SemanticMap, targets: Sequence[Target], now: float
) -> list[dict[str, object]]:
    """Known objects of all targets as plain values at `now` [s since 1970]; lengths to 1 mm."""
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
        for target in targets
        for one in known_objects(semantic_map, target)
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

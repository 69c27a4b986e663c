"""Search facts: what a search knows of a map, read once: targets, places, rows, robot, floor."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial

import numpy as np
from numpy.typing import NDArray

from kg.knowledge.ontology.catalogue import Catalogue
from kg.knowledge.placement.table import PlacementTable
from kg.maps.facts.occupancy import tiles_of_rows
from kg.maps.room_statistics import placement_table
from kg.maps.semantic_map import SemanticMap
from kg.model.records import RobotRecord
from mapping.objects.track_store import seen_from
from mapping.occupancy.mapped_floor import MappedFloor, mapped_floor
from planner.freespace.planning_map import Place, Row, all_places, number
from planner.search.goals.known_objects import (
    KnownObject,
    known_among,
    latest_of,
    remembered_rows,
)
from planner.search.goals.place_names import spoken_places, stated_categories
from planner.search.goals.search_goals import whereabouts
from planner.search.goals.targets import Target, resolve

_SEEN_FROM = 150  # remembered objects whose cameras are read


@dataclass(frozen=True, slots=True, eq=False)
class TargetFacts:
    """The facts of a map and its ontology on one target."""

    target: Target
    known: tuple[KnownObject, ...]  # the surest first
    remembered: tuple[Row, ...] = ()  # of `goals-remembered`, with `detectedAs`
    beside: tuple[tuple[str, Row], ...] = ()  # category that was queried, row of `goals-beside`
    expected: tuple[Row, ...] = ()  # of `goals-expected`


@dataclass(frozen=True, slots=True, eq=False)
class SearchFacts:
    """The facts of a map that a search uses."""

    of_targets: tuple[TargetFacts, ...]
    places: tuple[Place, ...]
    table: PlacementTable
    catalogue: Catalogue
    now: float  # [s since 1970]
    latest: float = 0.0  # [s since 1970] time stamp in the map
    robot: RobotRecord | None = None
    floor: MappedFloor | None = None  # of the storey where the robot is
    base: str = ""  # IRI of the map
    where: Callable[[str], str] = lambda iri: ""  # whereabouts of an object in words, by IRI
    #: (n, 3, 4) poses of cameras that showed an object, by IRI
    seen_from: Mapping[str, NDArray[np.float64]] | None = None

    @property
    def targets(self) -> tuple[Target, ...]:
        """The targets of the search."""
        return tuple(one.target for one in self.of_targets)


def read_facts(
    semantic_map: SemanticMap, words: Sequence[str], now: float | None = None
) -> SearchFacts:
    """The facts for a search for `words` at `now`, by default the latest time in the map.

    Raises UnknownCategoryError for words that name no target.
    """
    targets, robot = resolve(semantic_map, words), semantic_map.robot()
    spoken = spoken_places(semantic_map)
    where = cache(partial(whereabouts, semantic_map, spoken=spoken))
    of_targets = tuple(_of_target(semantic_map, target, spoken, where) for target in targets)
    rows = [row for one in of_targets for row in one.remembered]
    rows.sort(key=lambda row: -number(row, "existence"))
    iris = list(dict.fromkeys(str(row["iri"]) for row in rows))[:_SEEN_FROM]
    store, last_seen = semantic_map.store, semantic_map.query("goals-last-seen").records()
    latest = latest_of(last_seen, robot)
    return SearchFacts(
        of_targets,
        all_places(semantic_map, last_seen),
        placement_table(semantic_map),
        semantic_map.catalogue,
        latest if now is None else now,
        latest,
        robot,
        read_floor(semantic_map, robot),
        semantic_map.base,
        where,
        seen_from(store.path, iris, live=store.live),
    )


def read_floor(semantic_map: SemanticMap, robot: RobotRecord | None) -> MappedFloor | None:
    """The observed floor of the storey where the robot is."""
    height = None if robot is None else float(robot.p_map[2])
    return mapped_floor(tiles_of_rows(semantic_map.query("goals-floor").records()), height)


def _of_target(
    semantic_map: SemanticMap,
    target: Target,
    spoken: Mapping[str, str],
    where: Callable[[str], str],
) -> TargetFacts:
    stated, groups = stated_categories(semantic_map), remembered_rows(semantic_map, target)
    detected = {iri: one.detected_as for iri, one in stated.items()}

    def rows(query: str) -> list[tuple[str, Row]]:
        return [
            (iri, _as_spoken(row, spoken))
            for iri in target.queried
            for row in semantic_map.query(query, category=iri).records()
        ]

    return TargetFacts(
        target,
        known_among(semantic_map, target, groups, stated, where),
        tuple(
            {**_as_spoken(row, spoken), "detectedAs": detected.get(str(row["iri"]))}
            for rows_of_kind in groups
            for row in rows_of_kind
        ),
        tuple(rows("goals-beside")),
        tuple(row for _, row in rows("goals-expected")),
    )


def _as_spoken(row: Row, spoken: Mapping[str, str]) -> Row:
    """A row whose place is called as sentences call it."""
    if "placeLabel" not in row:
        return row
    return {**row, "placeLabel": spoken.get(str(row["place"]), row["placeLabel"])}

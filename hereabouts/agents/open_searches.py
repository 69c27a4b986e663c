"""Searches of agents in progress: proposed looks, reports, and remaining probability.

A bounded number of searches is kept in memory until the process ends; the map is not written.
"""

from __future__ import annotations

import secrets
from collections import OrderedDict
from collections.abc import Sequence
from typing import Final

import numpy as np

from kg.maps.semantic_map import SemanticMap
from kg.model.errors import QueryParameterError, UnknownCategoryError
from kg.model.records import LookRecord, ObstacleRecord
from planner.execution.protocol import Hello, RobotPose
from planner.execution.viewpoint_adapter import NextView, ViewpointAdapter
from planner.execution.wanted_targets import WantedTargets
from planner.search.goals.candidate_queries import map_time
from planner.search.goals.targets import resolve

MAX_SEARCHES: Final = 8  # the latest used ones are kept
MAX_REPORTS: Final = 500  # of one search


class OpenSearch:
    """One search: looks that find nothing lower the belief; changes by others are read."""

    def __init__(self, semantic_map: SemanticMap, words: Sequence[str]) -> None:
        self._map, self._targets = semantic_map, WantedTargets(resolve(semantic_map, words))
        self.name = secrets.token_hex(6)
        self._sequence = semantic_map.sequence
        self._adapter = ViewpointAdapter(semantic_map, words, Hello(), map_time(semantic_map))
        self._looks, self._obstacles = list[LookRecord](), list[ObstacleRecord]()
        self.proposed: NextView | None = None  # the look to report

    @property
    def wanted(self) -> list[str]:
        """The words of the objects that are not found yet."""
        return [target.text for target in self._targets.wanted]

    @property
    def left(self) -> float:
        """Probability that a wanted object is still there."""
        return self._adapter.left if self.wanted else 0.0

    @property
    def looks(self) -> int:
        """The number of looks that were reported."""
        return len(self._looks)

    def off_floor(self, pose: RobotPose) -> str:
        """A line about a pose off the floor, or ""; QueryParameterError for one far away."""
        return self._adapter.off_floor(pose)

    def next(self, pose: RobotPose) -> NextView | None:
        """The next look from `pose`; None if all is found or no look is worth the way."""
        sequence = self._map.sequence
        if sequence != self._sequence:
            self._adapter.rebuild(self._looks, self._obstacles, self._targets.found)
            self._sequence = sequence
        over = not self.wanted or len(self._looks) + len(self._obstacles) >= MAX_REPORTS
        self.proposed = None if over else self._adapter.next(pose)
        return self.proposed

    def report(self, found: Sequence[tuple[str, float, float]], *, reached: bool) -> None:
        """Report the proposed look: found words with x, y [m], or none.

        Without `reached` the robot could not get there. Raises QueryParameterError, and changes
        nothing, if no look was proposed or a found word is not wanted.
        """
        look = self.proposed
        if look is None:
            raise QueryParameterError("there is no look to report; ask next_look for one first")
        spots = {self._text_of(what): np.array([x, y]) for what, x, y in found}
        self.proposed = None
        for text, p_map in spots.items():
            self._targets.add_found(text, p_map)
            self._adapter.found(text, p_map)
        (self._looked if reached else self._blocked)(look)

    def _text_of(self, what: str) -> str:
        """The text of the target that the word `what` names."""
        try:
            kinds = resolve(self._map, [what])[0].kinds.keys()
        except UnknownCategoryError:
            kinds = {}.keys()
        for target in self._targets.all:
            if what == target.text or kinds & target.kinds.keys():
                return target.text
        raise QueryParameterError(f"{what!r} is not wanted; report {' or '.join(self.wanted)}")

    def _looked(self, look: NextView) -> None:
        number = len(self._looks) + 1
        record = LookRecord(
            iri=f"{self.name}/look/{number}",
            search=self.name,
            number=number,
            stamp=0.0,
            position=(look.x, look.y),
            heading=look.middle,
            extent=look.extent,
            categories=(),
        )
        self._looks.append(record)
        self._adapter.missed(RobotPose(look.x, look.y, look.heading), look.middle, look.extent)

    def _blocked(self, look: NextView) -> None:
        number = len(self._obstacles) + 1
        name, at = f"{self.name}/obstacle/{number}", (look.x, look.y)
        self._obstacles.append(ObstacleRecord(name, self.name, number, 0.0, at, "reported"))
        self._adapter.blocked(look.x, look.y, None)


class OpenSearches:
    """The latest searches by name; above the maximum, the least recently used one is dropped."""

    def __init__(self, max_searches: int = MAX_SEARCHES) -> None:
        self._max = max_searches
        self._searches: OrderedDict[str, OpenSearch] = OrderedDict()

    def add(self, search: OpenSearch) -> OpenSearch:
        """Keep a new search."""
        self._searches[search.name] = search
        while len(self._searches) > self._max:
            self._searches.popitem(last=False)
        return search

    def get(self, name: str) -> OpenSearch:
        """The search of that name; raises QueryParameterError if there is none."""
        try:
            self._searches.move_to_end(name)
        except KeyError:
            raise QueryParameterError(
                f"no search {name!r}: it was never begun, or dropped for later ones; next_look "
                "with `what` begins one"
            ) from None
        return self._searches[name]

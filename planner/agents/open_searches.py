"""Searches of agents under way: what was proposed, what was reported, what is left.

They are kept in memory, a bounded number of them, and die with the process: the map hears of a
search only what its writers write.
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
from planner.search.goals.candidate_queries import map_time
from planner.search.goals.targets import resolve

MAX_SEARCHES: Final = 8  # searches kept, the latest used ones
MAX_REPORTS: Final = 500  # of one search


class OpenSearch:
    """One search: looks in vain lower the belief, and what others write is taken up."""

    def __init__(self, semantic_map: SemanticMap, words: Sequence[str]) -> None:
        self._map, self._targets = semantic_map, resolve(semantic_map, words)
        self.name = secrets.token_hex(6)
        self._sequence = semantic_map.sequence
        self._adapter = ViewpointAdapter(semantic_map, words, Hello(), map_time(semantic_map))
        self._looks, self._obstacles = list[LookRecord](), list[ObstacleRecord]()
        self._found: dict[str, np.ndarray] = {}
        self.proposed: NextView | None = None  # the look that is to be reported

    @property
    def wanted(self) -> list[str]:
        """The words of the objects that are not found yet."""
        return [target.text for target in self._targets if target.text not in self._found]

    @property
    def left(self) -> float:
        """Probability that anything still wanted is there to be found."""
        return self._adapter.left if self.wanted else 0.0

    @property
    def looks(self) -> int:
        """The number of looks that were reported."""
        return len(self._looks)

    def next(self, pose: RobotPose) -> NextView | None:
        """The look to take next from `pose`; None where all is found or none is worth its way."""
        sequence = self._map.sequence
        if sequence != self._sequence:
            self._adapter.rebuild(self._looks, self._obstacles, tuple(self._found.items()))
            self._sequence = sequence
        over = not self.wanted or len(self._looks) + len(self._obstacles) >= MAX_REPORTS
        self.proposed = None if over else self._adapter.next(pose)
        return self.proposed

    def report(self, found: Sequence[tuple[str, float, float]], *, reached: bool) -> None:
        """Learn what the proposed look showed: words with x, y [m], or nothing of what is wanted.

        Without `reached` the robot could not get there. Raises QueryParameterError, having learnt
        nothing, where no look was proposed or this search does not want what was found.
        """
        look = self.proposed
        if look is None:
            raise QueryParameterError("no look is to be reported; ask next_look for one first")
        spots = {self._text_of(what): np.array([x, y]) for what, x, y in found}
        self.proposed = None
        for text, p_map in spots.items():
            self._found[text] = p_map
            self._adapter.found(text, p_map)
        (self._looked if reached else self._blocked)(look)

    def _text_of(self, what: str) -> str:
        """The text of the target that `what`, in any word for it, is one of."""
        try:
            kinds = resolve(self._map, [what])[0].kinds.keys()
        except UnknownCategoryError:
            kinds = {}.keys()
        for target in self._targets:
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
    """The latest searches by name; the least recently used one goes where there are too many."""

    def __init__(self, most: int = MAX_SEARCHES) -> None:
        self._most = most
        self._searches: OrderedDict[str, OpenSearch] = OrderedDict()

    def add(self, search: OpenSearch) -> OpenSearch:
        """Keep a new search."""
        self._searches[search.name] = search
        while len(self._searches) > self._most:
            self._searches.popitem(last=False)
        return search

    def get(self, name: str) -> OpenSearch:
        """The search of that name; raises QueryParameterError where there is none."""
        try:
            self._searches.move_to_end(name)
        except KeyError:
            raise QueryParameterError(
                f"no search {name!r}: it was never begun, or dropped for later ones; next_look "
                "with `what` begins one"
            ) from None
        return self._searches[name]

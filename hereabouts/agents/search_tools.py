"""Tools that plan a search on a map, and the searches in progress.

A search has proposed looks, reports, and a remaining probability. A bounded number of searches is
kept in memory until the process ends; the map is not written.
"""

from __future__ import annotations

import math
import secrets
import threading
import time
from collections import OrderedDict
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Annotated, Any, Final

import numpy as np
from pydantic import BeforeValidator, Field

from hereabouts.agents import answers as a
from hereabouts.agents.list_tools import Limit, Metres, Skip, Word
from hereabouts.agents.map_context import MapContext
from hereabouts.agents.map_tools import known_thing
from hereabouts.agents.plain_values import LABEL, escaped, for_agents
from kg.maps.map_extent import check_positions
from kg.maps.semantic_map import SemanticMap
from kg.model.errors import PoolBusyError, QueryParameterError, UnknownCategoryError
from kg.model.records import LookRecord, ObstacleRecord
from planner.execution.protocol import Hello, RobotPose
from planner.execution.viewpoint_adapter import NextView, ViewpointAdapter
from planner.execution.wanted_targets import WantedTargets
from planner.search.goals.known_objects import known_objects, map_time
from planner.search.goals.targets import resolve
from planner.search.plans.find import find
from planner.search.plans.report import worthwhile
from planner.search.plans.view_plan import Start, ViewStep, robot_start

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


Wanted = Annotated[
    list[Word],
    BeforeValidator(lambda what: [what] if isinstance(what, str) else what),
    Field(min_length=1, max_length=5, description='cup, or "something to sit on"'),
]
SearchName = Annotated[str, Field(max_length=40, description="as next_look named it")]
Degrees = Annotated[float, Field(ge=-360, le=360, description="0 along x")]

_MAX_WAITING: Final = 8  # plans that are made or wait; one is made at a time
_KNOWN: Final = 3  # objects listed
_REASONS: Final = 3  # of each look


class SearchTools:
    """The planning tools of one map. Every method is a tool; its docstring is what agents read."""

    def __init__(self, context: MapContext) -> None:
        self._context = context
        self._planning = threading.Lock()
        self._waiting = threading.BoundedSemaphore(_MAX_WAITING)
        self._searches = OpenSearches()

    def find_plan(
        self,
        what: Wanted,
        x: Metres | None = None,
        y: Metres | None = None,
        heading_degrees: Degrees = 0.0,
        limit: Limit = 10,
        skip: Skip = 0,
    ) -> a.PlanAnswer:
        """A search plan: where to stand and look, in which order, why, and how long it takes.

        It starts at x, y, or where the robot is. What no detector can see is only answered.
        """
        map_state, semantic_map, now = (
            self._context.state(),
            self._context.semantic_map,
            time.time(),
        )
        start = start_of(semantic_map, x, y, heading_degrees)
        with self._turn():
            answer = find(semantic_map, *what, start=start, now=now)
        found, seen = answer.plan, [text for text in what if text not in answer.undetectable]
        targets = resolve(semantic_map, seen)
        known = [one for target in targets for one in known_objects(semantic_map, target)[:_KNOWN]]
        steps = () if found is None else found.steps
        worth = worthwhile(steps)
        seconds = None if found is None else found.expected_seconds
        return a.PlanAnswer(
            map=map_state,
            untrusted_answer=for_agents(answer.lines[:_KNOWN]),
            known=[known_thing(one, now) for one in known[:_KNOWN]],
            present=None if found is None else found.present,
            probability=None if found is None else found.probability,
            expected_seconds=None if seconds is None or not math.isfinite(seconds) else seconds,
            further_looks=len(steps) - worth or None,
            note=(found.note or None) if found is not None else None,
            looks=[_look(step) for step in steps[:worth][skip : skip + limit]],
            total=worth,
            skip=skip,
        )

    @contextmanager
    def _turn(self) -> Iterator[None]:
        """Make one plan at a time; only few wait, since each holds a thread of the server."""
        if not self._waiting.acquire(blocking=False):
            raise PoolBusyError("other plans are being made; try again in a minute")
        try:
            with self._planning:
                yield
        finally:
            self._waiting.release()

    def next_look(
        self,
        what: Wanted | None = None,
        search: SearchName | None = None,
        x: Metres | None = None,
        y: Metres | None = None,
        heading_degrees: Degrees = 0.0,
    ) -> a.NextLook:
        """The one look to take now, from x, y (or where the robot is). `what` begins a search.

        Go there, look, call report_look, then ask again with `search`, which the answer names.
        """
        state = self._context.state()
        pose = RobotPose(*start_of(self._context.semantic_map, x, y, heading_degrees))
        with self._turn():
            if (what is None) == (search is None):
                raise QueryParameterError("give `what` to begin a search, or `search` to go on")
            if search is not None:
                open_search = self._searches.get(search)
            else:
                begun = OpenSearch(self._context.semantic_map, what or ())
                open_search = self._searches.add(begun)
            off = open_search.off_floor(pose)
            proposed = open_search.next(pose)
            return a.NextLook(
                **self._progress(state, open_search, give_up=proposed is None),
                look=None if proposed is None else a.ProposedLook.model_validate(proposed),
                note=off or None,
            )

    def report_look(
        self,
        search: SearchName,
        found: Annotated[
            list[a.ReportedThing], Field(max_length=20, description="empty: no wanted object")
        ] = [],  # noqa: B006 a default of the tool's schema, never changed
        reached: Annotated[bool, Field(description="false: the robot could not get there")] = True,
    ) -> a.SearchProgress:
        """Report the look that next_look proposed: the objects that it showed, or none.

        The map is not written.
        """
        state = self._context.state()
        with self._turn():
            open_search = self._searches.get(search)
            spots = [(one.x, one.y) for one in found]
            check_positions(self._context.semantic_map.engine, spots, "find", QueryParameterError)
            open_search.report([(one.what, one.x, one.y) for one in found], reached=reached)
            return a.SearchProgress(**self._progress(state, open_search))

    @staticmethod
    def _progress(
        state: a.MapState, search: OpenSearch, *, give_up: bool = False
    ) -> dict[str, Any]:
        over = "given up" if give_up else "searching"
        return {
            "map": state,
            "search": search.name,
            "state": over if search.wanted else "found",
            "untrusted_wanted": search.wanted,
            "looks_reported": search.looks,
            "left": search.left,
        }


def start_of(
    semantic_map: SemanticMap, x: float | None, y: float | None, degrees: float = 0.0
) -> Start:
    """A start at x, y [m], or where the robot is; raises QueryParameterError for one without the
    other.
    """
    if (x is None) != (y is None):
        raise QueryParameterError("give both x and y, or neither to start where the robot is")
    if x is None or y is None:
        return robot_start(semantic_map.robot())
    return x, y, math.radians(degrees)


def _look(step: ViewStep) -> a.Look:
    facts = step.why[0].candidate.facts if step.why else ()
    return a.Look(
        x=float(step.p_map[0]),
        y=float(step.p_map[1]),
        heading=step.heading,
        extent=step.extent,
        place=step.place or None,
        probability=step.probability,
        seconds=step.seconds,
        metres=step.metres,
        left=step.left,
        reasons=[reason.candidate.iri for reason in step.why[:_REASONS]],
        untrusted_why=escaped(facts[0], LABEL) if facts else None,
    )

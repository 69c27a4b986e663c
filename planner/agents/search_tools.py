"""Tools that plan a search on a map."""

from __future__ import annotations

import math
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Annotated, Any, Final

from pydantic import Field

from kg.model.errors import PoolBusyError, QueryParameterError
from planner.agents import answers as a
from planner.agents.map_context import MapContext
from planner.agents.map_tools import Limit, Metres, Word, known_things
from planner.agents.open_searches import OpenSearch, OpenSearches
from planner.execution.protocol import RobotPose
from planner.execution.viewpoint_adapter import NextView
from planner.search.goals.known_objects import known_objects
from planner.search.goals.targets import resolve
from planner.search.plans.view_plan import Start, ViewStep, planned, robot_start

Wanted = Annotated[
    list[Word], Field(min_length=1, max_length=5, description='cup, or "something to sit on"')
]
SearchName = Annotated[str, Field(max_length=40, description="as next_look named it")]
Degrees = Annotated[float, Field(ge=-360, le=360, description="0 along x")]

_MAX_WAITING: Final = 8  # plans that are made or wait; one is made at a time
_KNOWN: Final = 5  # objects listed of each target
_REASONS: Final = 3  # of each look
_FACTS: Final = 6  # of each reason


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
    ) -> a.PlanAnswer:
        """A search plan: where to stand, where to look, in which order, why, and how long it takes.

        It starts at x, y, or where the robot is. Takes about a second.
        """
        identity, context = self._context.identity(), self._context
        start = self._start(x, y, heading_degrees)
        with self._turn():
            found = planned(context.semantic_map, what, start)
        known = [
            one
            for target in resolve(context.semantic_map, what)
            for one in known_things(
                known_objects(context.semantic_map, target, located=_KNOWN), _KNOWN
            )[0]
        ]
        steps = () if found is None else found.steps
        seconds = None if found is None else found.expected_seconds
        return a.PlanAnswer(
            map=identity,
            known=known,
            present=0.0 if found is None else round(found.present, 6),
            probability=0.0 if found is None else round(found.probability, 6),
            expected_seconds=None
            if seconds is None or not math.isfinite(seconds)
            else round(seconds, 3),
            looks=[_look(step) for step in steps[:limit]],
            left_out=max(len(steps) - limit, 0),
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
        """The one look to take now, from x, y (or from where the robot is). `what` begins a search.

        Go there, look, call report_look, then ask again with `search`, which the answer names: each
        look without a find counts, and so do changes of the map by others.
        """
        identity = self._context.identity()
        pose = RobotPose(*self._start(x, y, heading_degrees))
        with self._turn():
            if (what is None) == (search is None):
                raise QueryParameterError("give `what` to begin a search, or `search` to go on")
            if search is not None:
                open_search = self._searches.get(search)
            else:
                begun = OpenSearch(self._context.semantic_map, what or ())
                open_search = self._searches.add(begun)
            proposed = open_search.next(pose)
            return a.NextLook(
                **self._progress(identity, open_search, give_up=proposed is None),
                look=None if proposed is None else _proposed(proposed),
            )

    def report_look(
        self,
        search: SearchName,
        found: Annotated[
            list[a.FoundThing], Field(max_length=20, description="empty: no wanted object")
        ] = [],  # noqa: B006 a default of the tool's schema, never changed
        reached: Annotated[bool, Field(description="false: the robot could not get there")] = True,
    ) -> a.SearchProgress:
        """Report the look that next_look proposed: the objects that it showed, or none.

        The search goes on from it; the map is not written (assert_fact does, where there is it).
        """
        identity = self._context.identity()
        with self._turn():
            open_search = self._searches.get(search)
            open_search.report([(one.what, one.x, one.y) for one in found], reached=reached)
            return a.SearchProgress(**self._progress(identity, open_search))

    def _start(self, x: float | None, y: float | None, degrees: float) -> Start:
        if (x is None) != (y is None):
            raise QueryParameterError("give both x and y, or neither to start where the robot is")
        if x is None or y is None:
            return robot_start(self._context.semantic_map)
        return x, y, math.radians(degrees)

    @staticmethod
    def _progress(
        identity: a.MapIdentity, search: OpenSearch, *, give_up: bool = False
    ) -> dict[str, Any]:
        over = "given up" if give_up else "searching"
        return {
            "map": identity,
            "search": search.name,
            "state": over if search.wanted else "found",
            "untrusted_wanted": search.wanted,
            "looks_reported": search.looks,
            "left": round(search.left, 6),
        }


def _proposed(view: NextView) -> a.ProposedLook:
    return a.ProposedLook(
        x=round(view.x, 3),
        y=round(view.y, 3),
        heading=round(view.middle, 4),
        extent=round(view.extent, 4),
        untrusted_place=view.place or None,
        probability=round(view.probability, 6),
        seconds=round(view.seconds, 3),
        left_if_in_vain=round(view.left, 6),
        untrusted_reasons=list(view.why),
    )


def _look(step: ViewStep) -> a.Look:
    return a.Look(
        x=round(float(step.p_map[0]), 3),
        y=round(float(step.p_map[1]), 3),
        heading=round(step.heading, 4),
        extent=round(step.extent, 4),
        place=step.place or None,
        probability=round(step.probability, 6),
        seconds=round(step.seconds, 3),
        metres=round(step.metres, 3),
        left=round(step.left, 6),
        reasons=[
            a.Reason(
                iri=reason.candidate.iri,
                kind=reason.candidate.kind,
                probability=round(reason.probability, 6),
                untrusted_facts=list(reason.candidate.facts[:_FACTS]),
            )
            for reason in step.why[:_REASONS]
        ],
    )

"""Tools that plan a search on a map."""

from __future__ import annotations

import math
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Annotated, Final

from pydantic import Field

from kg.errors import PoolBusyError, QueryParameterError
from planner.agents import answers as a
from planner.agents.map_context import MapContext
from planner.agents.map_tools import Limit, Metres, Word, known_things
from planner.goals.known_objects import known_objects
from planner.goals.targets import resolve
from planner.plans.find_answer import planned
from planner.plans.view_plan import ViewStep

Wanted = Annotated[
    list[Word], Field(min_length=1, max_length=5, description='cup, or "something to sit on"')
]
Degrees = Annotated[float, Field(ge=-360, le=360, description="0 along x")]

_WAITING: Final = 8  # plans that are made or wait, one being made at a time
_KNOWN: Final = 5  # objects listed of each target
_REASONS: Final = 3  # of each look
_FACTS: Final = 6  # of each reason


class SearchTools:
    """The planning tools of one map. Every method is a tool; its docstring is what agents read."""

    def __init__(self, context: MapContext) -> None:
        self._context = context
        self._planning = threading.Lock()
        self._waiting = threading.BoundedSemaphore(_WAITING)

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
        if (x is None) != (y is None):
            raise QueryParameterError("give both x and y, or neither to start where the robot is")
        start = None if x is None or y is None else (x, y, math.radians(heading_degrees))
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
        """One plan is made at a time, and few wait: each holds one of the server's threads."""
        if not self._waiting.acquire(blocking=False):
            raise PoolBusyError("other plans are being made; try again in a minute")
        try:
            with self._planning:
                yield
        finally:
            self._waiting.release()

    def next_look(
        self,
        what: Wanted,
        x: Metres | None = None,
        y: Metres | None = None,
        heading_degrees: Degrees = 0.0,
    ) -> a.PlanAnswer:
        """The first look of the best plan from x, y (or from where the robot is): where to go now.

        What is viewed while the map is being mapped counts. A look that the map does not hear of is
        proposed again: then follow the order of `find_plan`.
        """
        return self.find_plan(what, x, y, heading_degrees, 1)


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

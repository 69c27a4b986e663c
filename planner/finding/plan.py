"""Where to look first, why, and how long it will take: a plan of looks for a hunt."""

from __future__ import annotations

import math
import time
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from planner.finding.alternatives import Alternative, alternatives
from planner.finding.candidates import Candidate
from planner.finding.hunt import Hunt, Reason
from planner.finding.playing import Played, Player
from planner.finding.settings import ENOUGH, MOST_LOOKS, TRIALS
from planner.viewing.tour import Standing


@dataclass(frozen=True, slots=True, eq=False)
class FindStep:
    """One look of a plan."""

    look: int  # number in the hunt's looks
    p_map: NDArray[np.float64]  # (2,) [m] where to stand
    heading: float  # [rad] the middle of what is looked at
    extent: float  # [rad] seen in one sweep
    place: str  # IRI of the place it is in; "" for none
    place_name: str
    why: tuple[Reason, ...]  # the weightiest first
    probability: float  # to find it here and not before; of several targets, finds expected here
    seconds: float  # [s] since the start of the search when this look is over
    metres: float  # [m] driven until then
    cost: float  # [s] this step takes: the way, the turn, the look
    left: float  # probability that it is there after all if this look fails too


@dataclass(frozen=True, slots=True, eq=False)
class VisitedCandidate:
    """A candidate, and when the plan gets to it."""

    candidate: Candidate
    metres: float | None  # [m] driven until then; None where no look of the plan shows it
    seconds: float | None


@dataclass(frozen=True, slots=True, eq=False)
class FindPlan:
    """A search: looks in order with what each brings, and how good the order is."""

    targets: tuple[str, ...]
    start: NDArray[np.float64]  # (2,) [m]
    steps: tuple[FindStep, ...]
    goals: tuple[VisitedCandidate, ...]  # in visiting order
    expected_seconds: float | None  # given that it is found; None where there is no step
    lower_bound: float | None  # [s] no looks that find as much can expect less
    probability: float  # to find it along the plan; of several targets, finds expected
    present: float  # probability that any of it is on this floor, before the first look
    alternatives: tuple[Alternative, ...] = ()

    @property
    def gap(self) -> float | None:
        """By how much of the expected time another plan could be faster at most."""
        if not self.expected_seconds or self.lower_bound is None:
            return None
        return 1.0 - self.lower_bound / self.expected_seconds


def plan(
    hunt: Hunt,
    start: Standing | ArrayLike,
    *,
    heading: float = 0.0,
    budget: float | None = None,
    seed: int = 0,
    time_limit: float = 0.3,
    trials: int = TRIALS,
    compare: bool = True,
) -> FindPlan:
    """Looks that find what `hunt` still wants in little expected time, from `start` on.

    `start` is where the robot stands, or a position (2,) [m] where it faces `heading` [rad]; from
    off the floor it drives to it in a straight line first. `budget` [s] ends the plan. Built by the
    ratio rule, then improved by seeded `trials`, as far as `time_limit` [s] lets them: infinite,
    the plan is the same on every machine. With `compare` other ways to search are rated beside it.
    The hunt stays as it is.
    """
    begin, at, before = _begin(hunt, start, heading)
    player = Player(hunt, at, before / hunt.looks.motion.speed)
    limit = math.inf if budget is None else budget
    order = player.construct(ENOUGH, MOST_LOOKS, limit) if hunt.wanted else []
    order = player.improve(order, trials, time.monotonic() + time_limit, seed)
    played = player.play(order)
    steps = _steps(hunt, played, before)
    found = float(played.gains.sum())
    return FindPlan(
        targets=tuple(hunt.targets[i].label for i in hunt.wanted),
        start=begin,
        steps=steps,
        goals=_visited(hunt, steps),
        expected_seconds=played.expected_seconds if steps else None,
        lower_bound=player.lower_bound(played) if steps else None,
        probability=found,
        present=hunt.left,
        alternatives=alternatives(player, played) if steps and compare else (),
    )


def _begin(
    hunt: Hunt, start: Standing | ArrayLike, heading: float
) -> tuple[NDArray[np.float64], Standing, float]:
    """Position [m], standing, and metres to drive before the floor is reached."""
    if isinstance(start, Standing):
        return hunt.space.centres([start.cell])[0], start, 0.0
    p_map = np.asarray(start, np.float64)[:2]
    at = hunt.standing(p_map, heading)
    off = float(np.linalg.norm(hunt.space.centres([at.cell])[0] - p_map))
    return p_map, at, off if off > 2 * hunt.space.cell else 0.0


def _steps(hunt: Hunt, played: Played, before: float) -> tuple[FindStep, ...]:
    looks, memory, steps = hunt.looks, hunt.memory, list[FindStep]()
    hunt_memory = memory.copy()
    previous = 0.0
    try:
        hunt.memory = hunt_memory
        for i, look in enumerate(played.looks):
            why = hunt.why(look, played.unseen[i])
            hunt_memory.note(look)
            steps.append(
                FindStep(
                    look=look,
                    p_map=hunt.space.centres([looks.stands[looks.stand[look]]])[0],
                    heading=float(looks.heading[look]),
                    extent=float(looks.extent[look]),
                    place=hunt.place_of(look),
                    place_name=hunt.place_name(look),
                    why=why,
                    probability=float(played.gains[i]),
                    seconds=float(played.arrivals[i]),
                    metres=float(played.metres[i]) + before,
                    cost=float(played.arrivals[i]) - previous,
                    left=hunt.prospects.left(played.unseen[i + 1], hunt.wanted),
                )
            )
            previous = float(played.arrivals[i])
    finally:
        hunt.memory = memory
    return tuple(steps)


def _visited(hunt: Hunt, steps: Iterable[FindStep]) -> tuple[VisitedCandidate, ...]:
    """Every candidate with some probability, in the order the steps get to see it."""
    wanted = set(hunt.wanted)
    open_ = [VisitedCandidate(c, None, None) for c in hunt.candidates if c.target in wanted]
    open_ = [v for v in open_ if v.candidate.probability > 0]
    open_.sort(key=lambda v: (-v.candidate.probability, v.candidate.iri))
    cells, done = hunt.looks.cells, list[VisitedCandidate]()
    at = {id(v): int(np.searchsorted(cells, hunt.space.nearest(v.candidate.p_map))) for v in open_}
    for step in steps:
        chance = hunt.looks.chance[step.look]
        for one in list(open_):
            if _gets_to(step, one.candidate, float(chance[min(at[id(one)], len(cells) - 1)])):
                open_.remove(one)
                done.append(replace(one, metres=step.metres, seconds=step.seconds))
    return (*done, *open_)


def _gets_to(step: FindStep, candidate: Candidate, chance: float) -> bool:
    if candidate.kind in ("place", "frontier"):
        return step.place == candidate.iri
    return chance > 0

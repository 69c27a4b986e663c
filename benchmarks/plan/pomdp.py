"""Search problems that a general POMDP solver can express too, planned by both.

    pip install pomdp-py
    python -m benchmarks.plan.pomdp [--seconds S] [--seeds N] [--json]

One thing is in one of n rooms of a made-up building (`generated_worlds`); a look at the
room it is in shows it with the recall. As a POMDP: the state is where the thing and where the robot
is, actions are looks at rooms, the reward is minus their seconds, and a find ends it. pomdp-py's
POUCT (Silver and Veness 2010, on an exact belief) plans every look anew for S seconds; its rollouts
choose among the rooms looked at least. Ours is `benchmarks.ordering`: `solve` where looks never
miss, `plan_with_misses` where they do. While nothing is found both are sequences of rooms, whose
expected seconds are worked out exactly, over the soonest 0.95 of all finds.
"""

from __future__ import annotations

import argparse
import json
import random
import sys
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from statistics import fmean
from typing import Any

import numpy as np
import pomdp_py

from benchmarks.ordering import OrderingProblem
from benchmarks.ordering.solver import solve
from benchmarks.plan.generated_worlds import problem as made_up
from benchmarks.plan.imperfect_detection import plan_with_misses, update_after_miss

SIZES = (5, 8, 12)
RECALLS = (1.0, 0.7)
ENOUGH = 0.95
_FOUND = -1  # where the thing is once it is found
_START = -1  # where the robot is at first


@dataclass(frozen=True, slots=True)
class PomdpRow:
    """Both ways on problems of one kind, means over seeds."""

    rooms: int
    recall: float
    ours_seconds: float  # expected until found
    pomdp_seconds: float
    ours_planning_s: float  # for the whole plan
    pomdp_planning_s: float


def main() -> None:
    """Print the table as Markdown, or JSON."""
    parser = argparse.ArgumentParser(description="benchmarks.ordering beside pomdp-py's POUCT")
    parser.add_argument("--seconds", type=float, default=1.0, help="POUCT's, for every look")
    parser.add_argument("--seeds", type=int, default=4, help="problems of each kind")
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    lines = [
        compared(rooms, recall, given.seeds, given.seconds) for recall in RECALLS for rooms in SIZES
    ]
    told = json.dumps([asdict(line) for line in lines], indent=1) if given.json else _table(lines)
    sys.stdout.write(f"{told}\n")


def _table(lines: Sequence[PomdpRow]) -> str:
    rows = [
        "| rooms | recall | ours, E [s] | POUCT, E [s] | ratio | ours planned in | POUCT in |",
        "|---|---|---|---|---|---|---|",
    ]
    rows += [
        f"| {line.rooms} | {line.recall:g} | {line.ours_seconds:.1f} | {line.pomdp_seconds:.1f} "
        f"| {line.pomdp_seconds / line.ours_seconds:.3f} | {1000 * line.ours_planning_s:.1f} ms "
        f"| {line.pomdp_planning_s:.1f} s |"
        for line in lines
    ]
    return "\n".join(rows)


def compared(rooms: int, recall: float, seeds: int, seconds: float) -> PomdpRow:
    """Both ways on `seeds` problems of `rooms` rooms."""
    scores = []
    for seed in range(seeds):
        problem = made_up(rooms, seed)
        began = time.perf_counter()
        ours = _ours(problem, recall)
        planned = time.perf_counter()
        theirs = _pouct(problem, recall, seconds, seed)
        ended = time.perf_counter()
        expected = [expected_seconds(problem, recall, order) for order in (ours, theirs)]
        scores.append((*expected, planned - began, ended - planned))
    return PomdpRow(rooms, recall, *(fmean(column) for column in zip(*scores, strict=True)))


def expected_seconds(problem: OrderingProblem, recall: float, order: Sequence[int]) -> float:
    """[s] until found by looks in `order` that miss independently, over the soonest `ENOUGH`."""
    p, at, seconds = np.asarray(problem.p, np.float64).copy(), _START, 0.0
    found = weighted = 0.0
    for room in order:
        seconds += _leg(problem, at, room)
        gain = min(recall * float(p[room]), ENOUGH - found)
        found, weighted = found + gain, weighted + gain * seconds
        p[room] *= 1.0 - recall
        at = room
    if found < ENOUGH - 1e-9:
        raise ValueError(f"the looks find {found:.3f}, less than {ENOUGH}")
    return weighted / found


def _leg(problem: OrderingProblem, at: int, room: int) -> float:
    """[s] to go to `room` from where the robot is, and look."""
    travel = problem.t0[room] if at == _START else 0.0 if at == room else problem.T[at, room]
    return float(travel + problem.explore[room])


def _ours(problem: OrderingProblem, recall: float) -> list[int]:
    if recall == 1:
        return list(solve(problem).order)
    return [s.site for s in plan_with_misses(problem, recall, epsilon=(1 - ENOUGH) / 2).stops]


def _pouct(problem: OrderingProblem, recall: float, seconds: float, seed: int) -> list[int]:
    """Rooms in the order POUCT looks at them while nothing is found."""
    random.seed(seed)
    np.random.seed(seed)  # the solver draws from it
    size = len(problem.p)
    p, at, found, order = np.asarray(problem.p, np.float64), _START, 0.0, list[int]()
    scale = float(problem.T.mean() + problem.explore.mean()) * size
    while found < ENOUGH:
        model = _Model(recall)
        belief = pomdp_py.Histogram(
            {pomdp_py.SimpleState((room, at)): float(p[room]) for room in range(size)}
        )
        policy = _Policy(size, order)
        agent = pomdp_py.Agent(belief, policy, model, _Seen(), _Minus(problem))
        planner = pomdp_py.POUCT(
            max_depth=size if recall == 1 else 2 * size,
            discount_factor=1.0,
            planning_time=seconds,
            exploration_const=scale / 2,
            rollout_policy=policy,
        )
        room = _room(planner.plan(agent))
        found += (1.0 - found) * recall * float(p[room])
        order.append(room)
        at = room
        if found < ENOUGH:
            p = update_after_miss(p, room, recall)
    return order


class _Model(pomdp_py.TransitionModel):  # type: ignore[misc]
    def __init__(self, recall: float) -> None:
        self._recall = recall

    def sample(self, state: Any, action: Any) -> Any:
        where, _ = state.data
        room = _room(action)
        if where == room and random.random() < self._recall:
            where = _FOUND
        return pomdp_py.SimpleState((where, room))


class _Seen(pomdp_py.ObservationModel):  # type: ignore[misc]
    def sample(self, next_state: Any, action: Any) -> Any:
        return pomdp_py.SimpleObservation(next_state.data[0] == _FOUND)


class _Minus(pomdp_py.RewardModel):  # type: ignore[misc]
    def __init__(self, problem: OrderingProblem) -> None:
        self._problem = problem

    def sample(self, state: Any, action: Any, next_state: Any) -> float:
        where, at = state.data
        return 0.0 if where == _FOUND else -_leg(self._problem, at, _room(action))


class _Policy(pomdp_py.RolloutPolicy):  # type: ignore[misc]
    """Any room at any time; in rollouts one of those that were looked at least."""

    def __init__(self, size: int, looked: Sequence[int]) -> None:
        self._actions = [pomdp_py.SimpleAction(str(room)) for room in range(size)]
        self._looked = Counter(looked)

    def get_all_actions(self, state: Any = None, history: Any = None) -> list[Any]:
        return self._actions

    def rollout(self, state: Any, history: Any = None) -> Any:
        looked = self._looked.copy()
        looked.update(_room(action) for action, _ in history or ())
        least = min(looked[_room(action)] for action in self._actions)
        return random.choice([a for a in self._actions if looked[_room(a)] == least])


def _room(action: Any) -> int:
    return int(action.name)


if __name__ == "__main__":
    main()

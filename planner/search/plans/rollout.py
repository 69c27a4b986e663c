"""Rollout of a sequence of views in a planning state, and local search for better sequences."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planner.search.plans.search_state import PlanningState
from planner.search.viewpoints.next_best_view import RobotState
from planner.settings import ENOUGH, MAX_VIEWS

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Rollout:
    """Views in order, with times, and with gains given that all earlier views failed."""

    views: tuple[int, ...]
    arrivals: Floats  # (n,) [s] when each view is over
    metres: Floats  # (n,) [m] driven until then
    found: Floats  # (n + 1, targets) probability that each target was found before view i
    unseen: Floats  # (n + 1, c) probability that an object in a cell was missed before view i

    @property
    def gains(self) -> Floats:
        """(n,) expected number of targets first found at each view."""
        return np.asarray(np.diff(self.found.sum(axis=1)), np.float64)

    @property
    def chances(self) -> Floats:
        """(n,) probability that any target is first found at each view."""
        return np.asarray(1.0 - np.prod(1.0 - np.diff(self.found, axis=0), axis=1), np.float64)

    @property
    def expected_seconds(self) -> float:
        """[s] until found, given that it is; of several targets the mean over all finds."""
        total = float(self.gains.sum())
        return float(self.arrivals @ self.gains) / total if total > 0 else 0.0

    def until(self, found: float) -> float:
        """[s] mean time of the finds up to the probability `found`."""
        before = np.concatenate([[0.0], np.cumsum(self.gains)[:-1]])
        counted = np.clip(found - before, 0.0, self.gains)
        total = float(counted.sum())
        return float(self.arrivals @ counted) / total if total > 0 else 0.0


class PlanEvaluator:
    """Evaluates and improves sequences of views from a planning state and a robot state."""

    def __init__(self, state: PlanningState, at: RobotState, before: float = 0.0) -> None:
        self.state, self.at, self._before = state, at, before
        count = len(state.targets)
        self._wanted = np.isin(np.arange(count), state.wanted)
        self._missing = state.target_belief.still_missing(state.unseen, count)
        self.limit = self._p_found(np.where(state.next_best_view.seeable, 0.0, state.unseen))

    def _p_found(self, unseen: Floats) -> Floats:
        """(targets,) probability to have been found since the plan began."""
        count = len(self.state.targets)
        missing = self.state.target_belief.still_missing(unseen, count) / self._missing
        return np.where(self._wanted, 1.0 - np.minimum(missing, 1.0), 0.0)

    def play(self, order: Sequence[int]) -> Rollout:
        """Rollout of the views `order`."""
        state, at, revisits = self.state, self.at, self.state.revisits.copy()
        seconds, metres = np.zeros(len(order)), np.zeros(len(order))
        unseen = np.empty((len(order) + 1, len(state.unseen)))
        unseen[0] = state.unseen
        found = [self._p_found(unseen[0])]
        for i, view in enumerate(order):
            seconds[i] = self.cost(at, view)
            viewpoint = state.views.viewpoint[view]
            metres[i] = state.next_best_view.metres_to(at)[viewpoint]
            unseen[i + 1] = unseen[i] * (1.0 - revisits.chance(view))
            revisits.add(view)
            at = state.next_best_view.after(at, view)
            found.append(self._p_found(unseen[i + 1]))
        arrivals = self._before + np.cumsum(seconds)
        return Rollout(tuple(order), arrivals, np.cumsum(metres), np.array(found), unseen)

    def cost(self, at: RobotState, view: int) -> float:
        """[s] to drive, to turn and to take the view."""
        return float(self.state.next_best_view.costs(at, np.array([view]))[0])

    def construct(self, budget: float) -> list[int]:
        """Greedy sequence by the ratio rule with lookahead (`NextBestView.best`)."""
        state, at, revisits = self.state, self.at, self.state.revisits.copy()
        unseen, spent, order = state.unseen.copy(), self._before, list[int]()
        goal = ENOUGH * float(self.limit.sum())
        while len(order) < MAX_VIEWS and float(self._p_found(unseen).sum()) < goal:
            view = state.choose(at, unseen, revisits)
            if view is None or (spent := spent + self.cost(at, view)) > budget:
                break
            unseen = unseen * (1.0 - revisits.chance(view))
            revisits.add(view)
            at = state.next_best_view.after(at, view)
            order.append(view)
        return order

    def improve(self, order: list[int], trials: int, deadline: float, seed: int) -> list[int]:
        """`order` after seeded trials: a view moved, a stretch reversed, two views swapped.

        A first view that probably shows a known thing stays the first one.
        A trial is kept if its expected time is lower. `deadline` is a value of `time.monotonic`.
        """
        if len(order) < 3:
            return order
        first = self.play(order)
        rng, best = np.random.default_rng(seed), self._score(first)
        kept = int(self.state.known.any() and first.chances[0] >= self.state.settings.likely)
        for _ in range(trials):
            if time.monotonic() > deadline:
                break
            trial = [*order[:kept], *_varied(order[kept:], rng)]
            score = self._score(self.play(trial))
            if score < best - 1e-9:
                order, best = trial, score
        return order

    def _score(self, rollout: Rollout) -> float:
        """[s] expected time; a target that is not found costs the time of all views."""
        lost = float(self.limit.sum() - rollout.gains.sum())
        return float(rollout.arrivals @ rollout.gains + lost * rollout.arrivals[-1])


def _varied(order: list[int], rng: np.random.Generator) -> list[int]:
    trial = list(order)
    i = int(rng.integers(len(order)))
    j = int(np.clip(i + rng.integers(1, 7), 0, len(order) - 1))
    kind = int(rng.integers(3))
    if kind == 0:
        trial.insert(i, trial.pop(j))
    elif kind == 1:
        trial[i : j + 1] = trial[i : j + 1][::-1]
    else:
        trial[i], trial[j] = trial[j], trial[i]
    return trial

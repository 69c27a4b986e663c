"""Rollout of a sequence of views in a planning state, and local search for better sequences."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planner.search.plans.search_state import PlanningState
from planner.search.viewpoints.next_best_view import RevisitModel, RobotState
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
    searched: Floats  # (n + 1, k) weight of each instance that was shown before view i
    robots: tuple[RobotState, ...]  # (n + 1,) before each view, and after the last one

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


class PlanEvaluator:
    """Evaluates and improves sequences of views from a planning state and a robot state."""

    def __init__(self, state: PlanningState, at: RobotState, before: float = 0.0) -> None:
        self.state, self.at, self._before = state, at, before
        self._count, belief = len(state.targets), state.target_belief
        self._wanted = np.isin(np.arange(self._count), state.wanted)
        self._by_cell = np.ascontiguousarray(belief.weight.T)  # (c, k)
        searched = belief.searched(state.unseen)
        self._missing = belief.missing_after(searched, self._count)
        all_shown = belief.searched(np.where(state.next_best_view.seeable, 0.0, state.unseen))
        self.limit = self._p_found(all_shown)
        self._empty = Rollout(
            (),
            np.zeros(0),
            np.zeros(0),
            self._p_found(searched)[None],
            state.unseen[None],
            searched[None],
            (at,),
        )

    def _p_found(self, searched: Floats) -> Floats:
        """(targets,) probability to have been found since the plan began."""
        missing = self.state.target_belief.missing_after(searched, self._count) / self._missing
        return np.where(self._wanted, 1.0 - np.minimum(missing, 1.0), 0.0)

    def _show(self, view: int, unseen: Floats, searched: Floats, revisits: RevisitModel) -> None:
        """Take a view: update `unseen` (c,) and `searched` (k,) in place, and `revisits`."""
        cells, _ = self.state.views.chance.shown(view)
        chance = revisits.chance(view)[cells]
        left = unseen[cells] * (1.0 - chance)
        searched += (unseen[cells] - left) @ self._by_cell[cells]
        unseen[cells] = left
        revisits.add(view)

    def play(self, order: Sequence[int], known: Rollout | None = None) -> Rollout:
        """Rollout of the views `order`; `known` may have its first views already."""
        state, known = self.state, known or self._empty
        same = 0
        while same < min(len(order), len(known.views)) and order[same] == known.views[same]:
            same += 1
        revisits, at = state.revisits.copy(), known.robots[same]
        for view in order[:same]:
            revisits.add(view)
        more = len(order) - same
        arrivals = np.concatenate([known.arrivals[:same], np.zeros(more)])
        metres = np.concatenate([known.metres[:same], np.zeros(more)])
        unseen, searched, found = (
            np.concatenate([rows[: same + 1], np.empty((more, rows.shape[1]))])
            for rows in (known.unseen, known.searched, known.found)
        )
        robots = [*known.robots[: same + 1]]
        for i in range(same, len(order)):
            view = order[i]
            arrivals[i] = (arrivals[i - 1] if i else self._before) + self.cost(at, view)
            viewpoint = state.views.viewpoint[view]
            metres[i] = state.next_best_view.metres_to(at)[viewpoint]
            metres[i] += metres[i - 1] if i else 0.0
            unseen[i + 1], searched[i + 1] = unseen[i], searched[i]
            self._show(view, unseen[i + 1], searched[i + 1], revisits)
            at = state.next_best_view.after(at, view)
            robots.append(at)
            found[i + 1] = self._p_found(searched[i + 1])
        return Rollout(tuple(order), arrivals, metres, found, unseen, searched, tuple(robots))

    def cost(self, at: RobotState, view: int) -> float:
        """[s] to drive, to turn and to take the view."""
        return float(self.state.next_best_view.costs(at, np.array([view]))[0])

    def construct(self, budget: float) -> list[int]:
        """Greedy sequence by the ratio rule with lookahead (`NextBestView.best`)."""
        state, at, revisits = self.state, self.at, self.state.revisits.copy()
        unseen, searched = state.unseen.copy(), self._empty.searched[0].copy()
        spent, order = self._before, list[int]()
        goal = ENOUGH * float(self.limit.sum())
        while len(order) < MAX_VIEWS and float(self._p_found(searched).sum()) < goal:
            view = state.choose(at, unseen, revisits)
            if view is None or (spent := spent + self.cost(at, view)) > budget:
                break
            self._show(view, unseen, searched, revisits)
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
        played = first = self.play(order)
        rng, best = np.random.default_rng(seed), self._score(first)
        kept = int(self.state.known.any() and first.chances[0] >= self.state.settings.likely)
        for _ in range(trials):
            if time.monotonic() > deadline:
                break
            trial = [*order[:kept], *_varied(order[kept:], rng)]
            tried = self.play(trial, played)
            if (score := self._score(tried)) < best - 1e-9:
                order, best, played = trial, score, tried
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

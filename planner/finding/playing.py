"""What a sequence of looks is expected to bring in a hunt, exactly; and better sequences."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planner.finding.bound import seconds_times_found
from planner.finding.hunt import Hunt
from planner.viewing.tour import Standing

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Played:
    """Looks in order, and what comes of them while all before were in vain."""

    looks: tuple[int, ...]
    arrivals: Floats  # (n,) [s] when each look is over
    metres: Floats  # (n,) [m] driven until then
    gains: Floats  # (n,) targets first found at each look, expected; of one target a probability
    unseen: Floats  # (n + 1, c) chance that a thing in a cell was missed, before look i
    found: Floats  # (targets,) probability that each target is found

    @property
    def expected_seconds(self) -> float:
        """[s] until found, given that it is; of several targets the mean over all finds."""
        total = float(self.gains.sum())
        return float(self.arrivals @ self.gains) / total if total > 0 else 0.0

    def until(self, found: float) -> float:
        """[s] expected of the first `found` of all that the looks find."""
        before = np.concatenate([[0.0], np.cumsum(self.gains)[:-1]])
        counted = np.clip(found - before, 0.0, self.gains)
        total = float(counted.sum())
        return float(self.arrivals @ counted) / total if total > 0 else 0.0


class Player:
    """Plays looks in a hunt as it now stands, from one place."""

    def __init__(self, hunt: Hunt, at: Standing, before: float = 0.0) -> None:
        self.hunt, self.at, self._before = hunt, at, before
        count = len(hunt.targets)
        self._wanted = np.isin(np.arange(count), hunt.wanted)
        self._missing = hunt.prospects.still_missing(hunt.unseen, count)
        self.most = self._still(np.where(hunt.tourist.seeable, 0.0, hunt.unseen))

    def _still(self, unseen: Floats) -> Floats:
        """(targets,) probability to have been found by now, since the plan began."""
        count = len(self.hunt.targets)
        missing = self.hunt.prospects.still_missing(unseen, count) / self._missing
        return np.where(self._wanted, 1.0 - np.minimum(missing, 1.0), 0.0)

    def play(self, order: Sequence[int]) -> Played:
        """What `order` brings."""
        hunt, at, memory = self.hunt, self.at, self.hunt.memory.copy()
        seconds, metres = np.zeros(len(order)), np.zeros(len(order))
        unseen = np.empty((len(order) + 1, len(hunt.unseen)))
        unseen[0] = hunt.unseen
        found = [self._still(unseen[0])]
        for i, look in enumerate(order):
            seconds[i] = self.cost(at, look)
            metres[i] = self._way(at, look)
            unseen[i + 1] = unseen[i] * (1.0 - memory.chance(look))
            memory.note(look)
            at = hunt.tourist.after(at, look)
            found.append(self._still(unseen[i + 1]))
        gains = np.diff([float(one.sum()) for one in found])
        arrivals = self._before + np.cumsum(seconds)
        return Played(tuple(order), arrivals, np.cumsum(metres), gains, unseen, found[-1])

    def cost(self, at: Standing, look: int) -> float:
        """[s] to drive, turn and look."""
        return float(self.hunt.tourist.costs(at, np.array([look]))[0])

    def _way(self, at: Standing, look: int) -> float:
        looks = self.hunt.looks
        stand = int(looks.stand[look])
        if at.stand is None:
            return float(looks.metres_from(at.cell)[stand])
        return float(looks.metres[at.stand, stand])

    def construct(self, enough: float, most: int, budget: float) -> list[int]:
        """Always the look of the best rate, looks ahead counted (`Tourist.best`)."""
        hunt, at, memory = self.hunt, self.at, self.hunt.memory.copy()
        unseen, spent, order = hunt.unseen.copy(), self._before, list[int]()
        goal = enough * float(self.most.sum())
        while len(order) < most and float(self._still(unseen).sum()) < goal:
            look = hunt.choose(at, unseen, memory)
            if look is None or (spent := spent + self.cost(at, look)) > budget:
                break
            unseen = unseen * (1.0 - memory.chance(look))
            memory.note(look)
            at = hunt.tourist.after(at, look)
            order.append(look)
        return order

    def improve(self, order: list[int], trials: int, deadline: float, seed: int) -> list[int]:
        """`order` after seeded trials: a look moved, a stretch reversed, two looks swapped.

        Another order must not find less nor take longer as a whole; `deadline` is of
        `time.monotonic`.
        """
        if len(order) < 3:
            return order
        rng, best = np.random.default_rng(seed), self._score(self.play(order))
        for _ in range(trials):
            if time.monotonic() > deadline:
                break
            trial = _varied(order, rng)
            score = self._score(self.play(trial))
            if score < best - 1e-9:
                order, best = trial, score
        return order

    def _score(self, played: Played) -> float:
        """[s] expected, where what is not found costs all the looks."""
        lost = float(self.most.sum() - played.gains.sum())
        return float(played.arrivals @ played.gains + lost * played.arrivals[-1])

    def lower_bound(self, played: Played) -> float:
        """[s] below which no looks that find as much of each target can expect to go."""
        hunt, total = self.hunt, float(played.found.sum())
        if total <= 0:
            return 0.0
        left = hunt.prospects.weight * hunt.unseen / hunt.prospects.missed(hunt.unseen)[:, None]
        bounds = (
            seconds_times_found(
                hunt.looks,
                self.at,
                left[hunt.prospects.target == target],
                float(played.found[target]),
                self._before,
            )
            for target in hunt.wanted
        )
        return min(sum(bounds) / total, played.expected_seconds)


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

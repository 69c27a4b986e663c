"""Tours of looks that find soon: the ratio rule with looks ahead, local search, a lower bound.

The objective is the expected time until found, given that it is there to be found. A step's worth
is probability gained a second; so that a far room is judged by all that it offers and not by the
first look in it, each candidate is followed greedily through its room and rated by the best prefix.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planner.viewing.belief import CellBelief
from planner.viewing.looks import Looks
from planner.viewing.sensor import angle_between


@dataclass(frozen=True, slots=True)
class Standing:
    """Where the robot is: a floor cell, its heading [rad], and the position it stands at."""

    cell: int
    heading: float = 0.0
    stand: int | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Tour:
    """Looks in order, and what they are expected to bring."""

    looks: tuple[int, ...]  # numbers in `Looks`
    arrivals: NDArray[np.float64]  # (n,) [s] when each look is over
    gains: NDArray[np.float64]  # (n,) probability to find it at that look and not before
    metres: NDArray[np.float64]  # (n,) [m] driven until then
    expected_seconds: float  # given that it is found on the tour
    found: float  # probability that the tour finds it
    lower_bound: float  # [s] no tour that finds as much can expect less

    @property
    def gap(self) -> float:
        """How far the expectation may be above the best one: 0.1 is ten per cent."""
        bound = self.lower_bound
        return (self.expected_seconds - bound) / bound if bound > 0 else 0.0


class Memory:
    """What has been looked at from where: a second look from there is worth less.

    Looks from one square of `SQUARE` metres are looks from the same place.
    """

    def __init__(self, looks: Looks) -> None:
        self._looks = looks
        self._seen: dict[int, NDArray[np.bool_]] = {}  # by square: cells that were shown

    def note(self, look: int) -> None:
        """Remember that `look` was taken."""
        self.note_from(self._looks.stands[self._looks.stand[look]], self._looks.chance[look])

    def note_from(self, cell: int, chance: NDArray[np.float32]) -> None:
        """Remember a look from floor cell `cell` that showed cells with `chance` (c,)."""
        square = self._looks.square(cell)
        shown = chance > 0
        self._seen[square] = self._seen[square] | shown if square in self._seen else shown

    def chance(self, look: int) -> NDArray[np.float32]:
        """(c,) chance of `look` to detect what all looks before it have missed."""
        return self.of(self._looks.stands[self._looks.stand[look]], self._looks.chance[look])

    def of(self, cell: int, chance: NDArray[np.float32]) -> NDArray[np.float32]:
        """(c,) what is left of `chance` (c,), of a look from floor cell `cell`."""
        seen = self._seen.get(self._looks.square(cell))
        less = np.array(chance)
        if seen is not None:
            less[seen] *= np.float32(1 - self._looks.sensor.rho)
        return less

    def gains(self, weight: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n,) probability that each look finds it, for what is left of the belief."""
        looks = self._looks
        left = weight.astype(np.float32)
        gains = looks.chance @ left
        for square, seen in self._seen.items():
            rows = looks.from_square.get(square)
            if rows is not None:
                less = np.where(seen, left * np.float32(1 - looks.sensor.rho), left)
                gains[rows] = looks.chance[rows] @ less
        return np.asarray(gains, np.float64)


class Tourist:
    """Chooses looks in one building for one belief after another."""

    def __init__(
        self, looks: Looks, *, ahead: int = 3, among: NDArray[np.intp] | None = None
    ) -> None:
        self.looks = looks
        self._ahead = ahead
        self._everything = np.arange(len(looks.stand)) if among is None else among
        rooms = looks.space.room.reshape(-1)[looks.stands][looks.stand][self._everything]
        self._of_room = [self._everything[rooms == room] for room in np.unique(rooms)]
        self._shown = [(looks.chance[rows] > 0).any(axis=0) for rows in self._of_room]
        self.seeable = (looks.chance > 0).any(axis=0)  # (c,) cells that some look shows

    def costs(self, at: Standing, among: NDArray[np.intp]) -> NDArray[np.float64]:
        """(k,) [s] to drive, turn and look, for each of the looks `among`."""
        looks = self.looks
        stand = looks.stand[among]
        if at.stand is None:
            metres = looks.metres_from(at.cell)[stand]
        else:
            metres = looks.metres[at.stand, stand]
        here = looks.space.centres([at.cell])[0]
        towards = looks.space.centres(looks.stands[stand]) - here
        moved = metres > looks.space.cell / 2
        heading = np.where(moved, np.arctan2(towards[:, 1], towards[:, 0]), at.heading)
        first, last = looks.starts(among)
        turn = np.minimum(angle_between(heading, first), angle_between(heading, last))
        turn = np.where(looks.extent[among] >= 2 * np.pi - 1e-9, 0.0, turn)
        motion = looks.motion
        return metres / motion.speed + turn / motion.turn_rate + looks.seconds[among]

    def after(self, at: Standing, look: int) -> Standing:
        """Where the robot is once `look` is over."""
        looks = self.looks
        stand = int(looks.stand[look])
        cell = int(looks.stands[stand])
        if looks.extent[look] >= 2 * np.pi - 1e-9:
            return Standing(cell, at.heading, stand)
        ends = np.array([float(end[0]) for end in looks.starts([look])])
        came = at.heading
        if cell != at.cell:
            dx, dy = looks.space.centres([cell])[0] - looks.space.centres([at.cell])[0]
            came = float(np.arctan2(dy, dx))
        near = int(np.argmin(angle_between(came, ends)))
        return Standing(cell, float(ends[1 - near]), stand)

    def best(
        self, at: Standing, weight: NDArray[np.float64], memory: Memory | None = None
    ) -> int | None:
        """The look to take next, or None where no look can show anything.

        `weight` (c,) is the belief that is left, in any scale.
        """
        gains = (memory or Memory(self.looks)).gains(weight)
        costs = np.full(len(self.looks.stand), np.inf)
        costs[self._everything] = self.costs(at, self._everything)
        rate = gains / costs
        best = int(np.argmax(rate))
        rated = float(rate[best])
        if not rated > 0:
            return None
        for among, shown in zip(self._of_room, self._shown, strict=True):
            most = float(weight[shown].sum()) * self.looks.sensor.recall
            if most <= rated * float(costs[among].min()):
                continue  # nothing in this room can be worth the way
            look = int(among[np.argmax(rate[among])])
            worth = self._follow(at, weight, among, look, memory)
            if worth > rated + 1e-15:
                best, rated = look, worth
        return best

    def _follow(
        self,
        at: Standing,
        weight: NDArray[np.float64],
        among: NDArray[np.intp],
        look: int,
        memory: Memory | None,
    ) -> float:
        """The rate of the best prefix of a greedy walk through one room that begins with `look`."""
        left, seconds, gained, worth = weight, 0.0, 0.0, 0.0
        # what was looked at from the same positions before is worth as little on the way as now
        chance = self.looks.chance[among]
        if memory is not None:
            chance = np.stack([memory.chance(int(one)) for one in among])
        for step in range(self._ahead + 1):
            seconds += float(self.costs(at, np.array([look]))[0])
            seen = chance[np.searchsorted(among, look)] * left
            gained += float(seen.sum())
            worth = max(worth, gained / seconds)
            if step == self._ahead:
                break
            left, at = left - seen, self.after(at, look)
            ratio = (chance @ left.astype(np.float32)) / self.costs(at, among)
            look = int(among[np.argmax(ratio)])
        return worth

    def tour(
        self,
        at: Standing,
        belief: CellBelief,
        *,
        enough: float = 0.99,
        most: int = 200,
        budget: float = np.inf,
        time_limit: float = 0.3,
        seed: int = 0,
    ) -> Tour:
        """A tour until `enough` of what can be found is found, `most` looks or `budget` [s].

        Built by the ratio rule, then improved for `time_limit` seconds by moving, swapping and
        dropping looks (seeded; stops early only between steps).
        """
        deadline = time.monotonic() + time_limit
        order = self._construct(at, belief, enough, most, budget)
        order = self._improved(at, belief, order, deadline, np.random.default_rng(seed))
        return self.rated(at, belief, order)

    def _construct(
        self, at: Standing, belief: CellBelief, enough: float, most: int, budget: float
    ) -> list[int]:
        left, seconds = belief.weight.copy(), 0.0
        order: list[int] = []
        memory, seeable = Memory(self.looks), float(belief.weight[self.seeable].sum())
        while len(order) < most and float(left[self.seeable].sum()) > (1 - enough) * seeable:
            look = self.best(at, left, memory)
            if look is None:
                break
            seconds += float(self.costs(at, np.array([look]))[0])
            if seconds > budget:
                break
            left = left * (1 - memory.chance(look))
            memory.note(look)
            at = self.after(at, look)
            order.append(look)
        return order

    def rated(self, at: Standing, belief: CellBelief, order: Sequence[int]) -> Tour:
        """The tour that takes `order`, with what it is expected to bring."""
        arrivals, gains, metres = self._play(at, belief, order)
        found = float(gains.sum())
        expected = float(arrivals @ gains / found) if found > 0 else 0.0
        bound = lower_bound(self.looks, at, belief, found) if found > 0 else 0.0
        return Tour(tuple(order), arrivals, gains, metres, expected, found, min(bound, expected))

    def _play(
        self, at: Standing, belief: CellBelief, order: Sequence[int]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        n = len(order)
        seconds, gains, metres = np.zeros(n), np.zeros(n), np.zeros(n)
        left, memory = belief.weight.copy(), Memory(self.looks)
        for i, look in enumerate(order):
            seconds[i] = self.costs(at, np.array([look]))[0]
            stand = int(self.looks.stand[look])
            metres[i] = (
                self.looks.metres_from(at.cell)[stand]
                if at.stand is None
                else self.looks.metres[at.stand, stand]
            )
            seen = memory.chance(look) * left
            gains[i] = seen.sum()
            left -= seen
            memory.note(look)
            at = self.after(at, look)
        return np.cumsum(seconds), gains, np.cumsum(metres)

    def _improved(
        self,
        at: Standing,
        belief: CellBelief,
        order: list[int],
        deadline: float,
        rng: np.random.Generator,
    ) -> list[int]:
        """Local search: a random look moved, a stretch reversed, or two looks swapped."""
        if len(order) < 3:
            return order
        best = self._score(at, belief, order)
        while time.monotonic() < deadline:
            i, j = sorted(int(k) for k in rng.choice(len(order), 2, replace=False))
            trial = list(order)
            kind = int(rng.integers(3))
            if kind == 0:
                trial.insert(i, trial.pop(j))
            elif kind == 1:
                trial[i : j + 1] = trial[i : j + 1][::-1]
            else:
                trial[i], trial[j] = trial[j], trial[i]
            score = self._score(at, belief, trial)
            if score < best - 1e-9:
                order, best = trial, score
        return order

    def _score(self, at: Standing, belief: CellBelief, order: Sequence[int]) -> float:
        """Expected seconds where what is never found costs the whole tour."""
        arrivals, gains, _ = self._play(at, belief, order)
        lost = float(belief.weight.sum() - gains.sum())
        return float(arrivals @ gains + lost * arrivals[-1])


def lower_bound(looks: Looks, at: Standing, belief: CellBelief, found: float) -> float:
    """[s] that no tour finding probability `found` can go below, in expectation.

    Two relaxations, the larger counts. (1) Nothing in a cell is found before one has driven to the
    nearest position that shows it and looked: the `found` soonest shares of belief, each at its
    cell's own earliest time. (2) No second of looking brings more than the best look does now, as
    what is left only shrinks: mass m by time t at most t times that rate.
    """
    reached = looks.metres_from(at.cell)[looks.stand] / looks.motion.speed
    ready = reached + looks.motion.picture
    earliest = np.full(len(looks.cells), np.inf)
    for stand in range(len(looks.stands)):
        rows = looks.stand == stand
        shown = (looks.chance[rows] > 0).any(axis=0)
        earliest[shown] = np.minimum(earliest[shown], ready[rows][0])
    order = np.argsort(earliest, kind="stable")
    best = looks.chance.max(axis=0)[order]
    mass = np.where(best > 0, belief.weight[order], 0.0)
    taken = np.clip(found - np.concatenate([[0.0], np.cumsum(mass)[:-1]]), 0.0, mass)
    soonest = np.where(taken > 0, earliest[order], 0.0)
    by_distance = float(taken @ soonest) / found
    rate = float((looks.chance @ belief.weight.astype(np.float32) / looks.seconds).max())
    by_rate = found / (2 * rate) if rate > 0 else 0.0
    return max(by_distance, by_rate)

"""How soon a target can be expected at best, whatever the looks: a bound that holds for all plans.

A plan is a sequence of visits to positions. Three things limit what has been found by time t.

- *Distance.* Of the positions visited let `a` be the furthest from the start, and L the longest of
  the ways over another one to `a`. Then L was driven at least, and what was found is at most what
  endless looking finds from all positions that are no further than `a` and over which the way to
  `a` is no longer than L (`RevisitModel`: the looks of one position have a limit).
- *Visits.* Each visit but the first is preceded by a leg, no shorter than that to the nearest other
  position (e seconds). In tau seconds of a visit the camera turns at most (tau - one picture) x
  turn rate, so that it sees at most the best arc of its field of view and that angle.
- *Saturation.* A cell is worth no more than its weight w, however often it is seen. So for any
  prices 0 <= pi <= w of cells, visits find at most sum u (w - pi), where u is what endless looking
  finds of a cell, and the rate at which the best visit earns prices, times the time there was.

Driving counts once: a share lambda of it as distance, the rest as legs. For each `a` and L the
least holds of the bounds that lambdas and prices give, and over all of them the greatest. Prices
come from looking at the best rate again and again while what is seen loses its price (Garg,
Koenemann, SIAM J. Comput. 37, 2007). Of a plan that finds with probability F, F E[t | found] is the
integral of F - P(found by t).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planner.viewpoints.candidate_views import CandidateViews
from planner.viewpoints.next_best_view import RobotState

Floats = NDArray[np.float64]
Indices = NDArray[np.intp]

_TIMES: int = 600  # of the integral; each interval is taken at its least
_BINS: int = 96  # of bearings about a position
_ROUNDS: int = 48  # prices tried, for each lambda, and ...
_LEVELS: int = 8  # ... lengths of the way over another position to the furthest, at most
_MANY: int = 60  # positions; of more of them fewer of both are tried
_LAMBDAS: tuple[float, ...] = (0.0, 0.5, 1.0)
_MARGIN: float = 1 + 1e-5  # for what single precision rounds down


def seconds_times_found(
    views: CandidateViews, at: RobotState, weight: Floats, found: float, before: float = 0.0
) -> float:
    """[s] a lower bound on F E[t | found] of one target for `found` = F, from its (k, c) `weight`.

    `before` [s] pass before the first move.
    """
    if found <= 0 or not len(weight):
        return 0.0
    near = _Near.of(views, at)
    if not len(near.travel):
        return 0.0
    caps = near.caps(weight)
    # P(any instance) is at most what is expected, and at most 1 - exp(-sum of h x expected), where
    # h is the slope of the chord of -log(1 - q) up to the most that can be known of an instance
    most = np.minimum(weight @ near.most * _MARGIN, 1 - 1e-9)
    slope = np.where(most > 1e-12, -np.log1p(-most) / np.maximum(most, 1e-12), 1.0)
    kinds = [(weight.sum(axis=0), False)]
    if len(weight) > 1:
        kinds.append((slope @ weight, True))
    lines = [
        line
        for worth, exponential in kinds
        for share in _LAMBDAS
        for line in near.lines(worth * _MARGIN, share, exponential=exponential)
    ]
    last = _over(found, near, caps, lines)
    if last <= 0:
        return found * before
    times = np.linspace(0.0, last, _TIMES + 1)[1:]
    best = np.zeros(_TIMES)
    for i in range(len(near.travel)):
        if near.travel[i] < last:
            np.maximum(best, _by(times, i, near, caps, lines), out=best)
    left = np.maximum(found - best, 0.0)
    return float(found * before + left.sum() * last / _TIMES)


@dataclass(frozen=True, slots=True, eq=False)
class _Line:
    """For each case: found at most base + rate x (t - begin) by t >= begin."""

    begin: Floats  # (n,) [s]
    base: Floats  # (n,)
    rate: Floats  # (n,) [1/s]
    exponential: bool  # it bounds -log(1 - P) in place of P

    def seconds(self, found: float, i: int) -> float:
        """[s] before which less than `found` is found."""
        goal = -np.log(max(1.0 - found, 1e-12)) if self.exponential else found
        if self.base[i] >= goal:
            return 0.0
        return float(self.begin[i] + (goal - self.base[i]) / max(self.rate[i], 1e-300))


def _over(found: float, near: _Near, caps: Floats, lines: list[_Line]) -> float:
    """[s] the least time by which `found` is not ruled out."""
    reaching = np.flatnonzero(caps >= found - 1e-12)
    over = [
        max(float(near.travel[i]), *(line.seconds(found, int(i)) for line in lines))
        for i in reaching
    ]
    least = min(over, default=np.inf)
    return least if least < 1e12 else float(near.travel.max())


def _by(times: Floats, i: int, near: _Near, caps: Floats, lines: list[_Line]) -> Floats:
    """(n,) most that is found by `times` (n,) in the i-th case."""
    begin = np.array([line.begin[i] for line in lines])[:, None]
    base = np.array([line.base[i] for line in lines])[:, None]
    rate = np.array([line.rate[i] for line in lines])[:, None]
    most = base + rate * np.maximum(times - begin, 0.0)
    exponential = np.array([line.exponential for line in lines])
    most[exponential] = -np.expm1(-most[exponential])
    after = times >= near.travel[i]
    return np.where(after, np.minimum(most.min(axis=0), caps[i]), 0.0)


@dataclass(frozen=True, slots=True, eq=False)
class _Near:
    """The cases of which positions are visited, and what is seen from positions.

    Positions count from the nearest; those that cannot be reached are left out.
    """

    travel: Floats  # (n,) [s] driven at least in each case
    visited: NDArray[np.bool_]  # (n, s) positions visited at most
    seeable: Floats  # (n, c) found at most of what lies in a cell
    most: Floats  # (c,) ... in any case
    leg: Floats  # (s,) [s] no leg to a position is shorter, but the first
    spare: float  # [s] by which the first leg may be shorter than that
    row: Indices  # (m,) pairs of a position, a bin of bearing and a cell seen: the position,
    bin: Indices  # (m,) ... the bin,
    cell: Indices  # (m,) ... the cell,
    shown: Floats  # (m,) ... and the most that looks from there alone find of what lies in it
    arcs: NDArray[np.intp]  # (k,) bins that a visit sees at most
    spent: Floats  # (k,) [s] it takes at least

    @staticmethod
    def of(views: CandidateViews, at: RobotState) -> _Near:
        """The positions of `views` as seen from `at`."""
        speed = views.motion.speed
        reached = views.metres_from(at.cell) / speed
        if at.viewpoint is not None:
            reached = views.metres[at.viewpoint] / speed
        order = np.argsort(reached, kind="stable")
        order = order[np.isfinite(reached[order])]
        between = views.metres[np.ix_(order, order)] / speed
        alone = between + np.where(np.eye(len(order)) > 0, np.inf, 0.0)
        leg = alone.min(axis=1, initial=np.inf)
        leg = np.where(np.isfinite(leg), leg, 0.0)
        missed = np.empty((len(order), len(views.cells)))
        pairs: list[tuple[Indices, Indices, Indices, Floats]] = []
        for i, viewpoint in enumerate(order):
            shown = 1.0 - _endlessly(
                views.chance[views.viewpoint == viewpoint].max(axis=0), 1 - views.sensor.rho
            )
            missed[i] = 1.0 - shown
            cell = np.flatnonzero(shown)
            off = views.space.centres(views.cells[cell]) - views.space.centres(
                views.viewpoints[[viewpoint]]
            )
            bearing = np.arctan2(off[:, 1], off[:, 0])
            at_bin = np.floor((bearing + np.pi) / (2 * np.pi) * _BINS).astype(np.intp) % _BINS
            pairs.append((np.full(len(cell), i), at_bin, cell, shown[cell]))
        arcs, spent = _arcs(views)
        travel, visited = _cases(reached[order], between)
        with np.errstate(divide="ignore"):
            log = np.maximum(np.log(missed), -60.0)
        return _Near(
            travel=travel,
            visited=visited,
            seeable=1.0 - np.exp(visited.astype(np.float64) @ log),
            most=1.0 - np.exp(log.sum(axis=0)),
            leg=leg,
            spare=float(np.maximum(leg - reached[order], 0.0).max(initial=0.0)),
            row=np.concatenate([p[0] for p in pairs]) if pairs else np.zeros(0, np.intp),
            bin=np.concatenate([p[1] for p in pairs]) if pairs else np.zeros(0, np.intp),
            cell=np.concatenate([p[2] for p in pairs]) if pairs else np.zeros(0, np.intp),
            shown=np.concatenate([p[3] for p in pairs]) if pairs else np.zeros(0),
            arcs=arcs,
            spent=spent,
        )

    def caps(self, weight: Floats) -> Floats:
        """(n,) most that can be found in each case."""
        each = np.minimum(self.seeable @ weight.T * _MARGIN, 1.0)
        return np.asarray(1.0 - np.prod(1.0 - each, axis=1))

    def lines(self, worth: Floats, share: float, *, exponential: bool) -> list[_Line]:
        """Bounds from prices of cells worth `worth` (c,), a `share` of driving being distance."""
        cost = (1 - share) * self.leg[:, None] + self.spent
        begin = share * self.travel - (1 - share) * self.spare
        most, seen, found = self.most, np.zeros(len(worth)), list[_Line]()
        for _ in range(_fewer(_ROUNDS, len(self.leg))):
            with np.errstate(divide="ignore", invalid="ignore"):
                price = worth * np.where(most > 0, np.exp(-seen / most), 0.0)
            arcs, first = self._best_arcs(price)
            rate = arcs / np.maximum(cost, 1e-9)
            base = self.seeable @ (worth - price)
            best = np.where(self.visited, rate.max(axis=1), 0.0).max(axis=1)
            found.append(_Line(begin, base, best, exponential))
            i, k = np.unravel_index(int(np.argmax(rate)), rate.shape)
            inside = (self.row == i) & ((self.bin - first[i, k]) % _BINS < self.arcs[k])
            cells, gain = self.cell[inside], self.shown[inside]
            if not len(cells):
                break
            step = 0.5 / float((gain / most[cells]).max())
            seen[cells] += step * gain
        return found

    def _best_arcs(self, price: Floats) -> tuple[Floats, Indices]:
        """(s, k) most that an arc of each width shows from each position, and its first bin."""
        count = len(self.leg)
        value = np.bincount(
            self.row * _BINS + self.bin,
            self.shown * price[self.cell],
            minlength=count * _BINS,
        ).reshape(count, _BINS)
        total = np.zeros((count, 2 * _BINS + 1))
        np.cumsum(np.concatenate([value, value], axis=1), axis=1, out=total[:, 1:])
        most = np.empty((count, len(self.arcs)))
        first = np.empty((count, len(self.arcs)), np.intp)
        for k, width in enumerate(self.arcs):
            arc = total[:, width : width + _BINS] - total[:, :_BINS]
            first[:, k] = arc.argmax(axis=1)
            most[:, k] = arc.max(axis=1)
        return most, first


def _cases(reached: Floats, between: Floats) -> tuple[Floats, NDArray[np.bool_]]:
    """Seconds (n,) driven at least, and the positions (n, s) visited at most, of each case.

    A case is a furthest position, and a range of lengths of the longest way over another one to it.
    """
    travel, visited = list[float](), list[NDArray[np.bool_]]()
    shares = np.linspace(0, 1, _fewer(_LEVELS, len(reached)) + 1)[1:]
    for i, far in enumerate(reached):
        over = reached[: i + 1] + between[: i + 1, i]
        over[i] = far
        levels = np.unique(np.quantile(over, shares, method="higher"))
        at_least = far
        for level in levels:
            case = np.zeros(len(reached), np.bool_)
            case[: i + 1] = over <= level
            case[i] = True
            travel.append(float(at_least))
            visited.append(case)
            beyond = over[over > level]
            at_least = max(far, beyond.min(initial=np.inf))
    return np.array(travel), np.array(visited).reshape(-1, len(reached))


def _fewer(most: int, positions: int) -> int:
    return max(most * _MANY // max(positions, _MANY), 2)


def _arcs(views: CandidateViews) -> tuple[Indices, Floats]:
    """Widths (k,) in bins of what a visit sees, and the seconds (k,) that each takes at least.

    An arc of angle W touches at most W / bin + 2 bins. Seeing n bins takes at least as long as the
    narrowest arc that can touch so many.
    """
    bin_, view = 2 * np.pi / _BINS, views.sensor.field_of_view
    narrowest = min(int(view / bin_ + 1e-6) + 2, _BINS)
    arcs = np.unique(np.append(np.arange(narrowest, _BINS, 4), _BINS)).astype(np.intp)
    # between two of these widths: the wider one, as early as just beyond the narrower one
    beyond = np.concatenate([[0.0], np.maximum((arcs[:-1] - 1) * bin_ - view, 0.0)])
    return arcs, views.motion.picture + beyond / views.motion.turn_rate


def _endlessly(chance: NDArray[np.float32], rest: float) -> Floats:
    """(c,) chance that any number of looks of `chance` each misses, each worth `rest` of the last.

    At most: looks are counted until what is left of them no longer matters.
    """
    if rest >= 1:
        return np.where(chance > 0, 0.0, 1.0)
    missed, each = np.ones(len(chance)), chance.astype(np.float64)
    while each.max(initial=0.0) > 1e-9:
        missed *= 1.0 - np.minimum(each, 1.0)
        each = each * rest
    return missed

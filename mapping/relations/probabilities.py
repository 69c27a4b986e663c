"""Probabilities of on, inside and beside, from boxes and their uncertainty.

The support or container of an object is a choice among its candidates and none of them (mostly the
floor), by a conditional logit (McFadden 1974), so that the probabilities sum to at most one. The
utility of a candidate is a weighted sum of three terms: the log-probability that the object's
centre lies over the candidate's footprint, the log-probability that its underside lies at the
candidate's surface (inside: that its centre lies between bottom and top), and the log-ratio of
their sizes. The probability of "beside" is that of a small gap between footprints at one level.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from kg.model.areas import along, upright_bounds
from kg.model.records import ObjectRecord

SHOWN = 0.5  # existence from which on an object takes part in relations


@dataclass(frozen=True, slots=True, eq=False)
class Box:
    """An object's box: two corners along the map's axes, turned by `yaw` about their middle."""

    low: Floats  # (3,) [m]
    high: Floats  # (3,) [m]
    deviation: float  # [m] standard deviation of each coordinate of its position
    category: str  # IRI
    length: float = 0.02  # [m] longest side, or the usual one of its category where that is more
    yaw: float = 0.0  # [rad]

    @property
    def sides(self) -> tuple[Floats, Floats]:
        """Corners (3,) [m] along the map's axes of the box that holds it."""
        half = upright_bounds(self.high - self.low, self.yaw) / 2
        middle = (self.low + self.high) / 2
        return middle - half, middle + half

    def differs(self, other: Box | None, by: float) -> bool:
        """Whether any side lies more than `by` [m] elsewhere, or the category is another."""
        return (
            other is None
            or self.category != other.category
            or bool(np.abs(self.low - other.low).max() > by)
            or bool(np.abs(self.high - other.high).max() > by)
            or abs(self.yaw - other.yaw) * float((self.high - self.low)[:2].max()) > 2 * by
        )


@dataclass(frozen=True, slots=True, eq=False)
class Boxes:
    """n boxes, each turned by its yaw about its middle."""

    low: Floats  # (n, 3) [m]
    high: Floats  # (n, 3) [m]
    deviation: Floats  # (n,) [m]
    length: Floats  # (n,) [m] longest sides, or usual ones where these are more
    yaw: Floats  # (n,) [rad]

    @classmethod
    def of(cls, boxes: Sequence[Box]) -> Boxes:
        """The arrays of `boxes`."""
        return cls(
            np.array([box.low for box in boxes]).reshape(-1, 3),
            np.array([box.high for box in boxes]).reshape(-1, 3),
            np.array([box.deviation for box in boxes], np.float64),
            np.array([box.length for box in boxes], np.float64),
            np.array([box.yaw for box in boxes], np.float64),
        )

    @property
    def middle(self) -> Floats:
        """(n, 3) [m]."""
        return (self.low + self.high) / 2

    def seen_from(self, others: Boxes) -> Floats:
        """(n, m, 2) [m] middles of these n boxes from above, in the axes of m others."""
        return along(self.middle[:, None] - others.middle[None], others.yaw)[..., :2]

    def reach_along(self, others: Boxes) -> Floats:
        """(n, m, 2) [m] half lengths of these n boxes along the axes of m others."""
        half = (self.high - self.low)[:, None] / 2
        return upright_bounds(half, self.yaw[:, None] - others.yaw)[..., :2]

    @property
    def longest(self) -> Floats:
        """(n,) [m] longest side of each, at least 2 cm."""
        return np.asarray(np.maximum((self.high - self.low).max(axis=1), 0.02))


class BoxIndex(dict[str, Box]):
    """Boxes by IRI, changed by `put` alone, with a search for near ones."""

    def __init__(self) -> None:
        super().__init__()
        self._rows: dict[str, int] = {}
        self._iris: list[str] = []  # by row
        self._sides = np.full((64, 6), np.nan)  # [m] low and high corners by row

    def put(self, iri: str, box: Box | None) -> None:
        """Set or, with None, remove the box of an object."""
        if box is None:
            if self.pop(iri, None) is not None:
                row = self._rows.pop(iri)
                last = self._iris.pop()
                if last != iri:  # the last one takes its row
                    self._iris[row], self._rows[last] = last, row
                    self._sides[row] = self._sides[len(self._iris)]
            return
        if iri not in self._rows:
            self._rows[iri] = len(self._iris)
            self._iris.append(iri)
            if len(self._iris) > len(self._sides):
                self._sides = np.concatenate([self._sides, np.full_like(self._sides, np.nan)])
        self[iri] = box
        self._sides[self._rows[iri]] = np.concatenate(box.sides)

    def within(self, boxes: Sequence[Box], reach: float) -> dict[str, None]:
        """IRIs of the boxes within `reach` [m] of the hull of `boxes`, as an ordered set."""
        low = np.min([box.sides[0] for box in boxes], axis=0) - reach
        high = np.max([box.sides[1] for box in boxes], axis=0) + reach
        sides = self._sides[: len(self._iris)]
        near = (sides[:, :3] <= high).all(axis=1) & (sides[:, 3:] >= low).all(axis=1)
        return {self._iris[row]: None for row in np.nonzero(near)[0].tolist()}


def box_of(record: ObjectRecord, usual: float) -> Box | None:
    """Box of an object that is believed to be there; None without an extent.

    `usual` [m] is the length that things of its category usually have.
    """
    if record.existence < SHOWN or record.extent is None:
        return None
    deviation = record.deviation or 0.0
    if not np.isfinite([*record.p_map, *record.extent, deviation, record.yaw]).all():
        return None  # written by an update from outside
    half = record.extent / 2
    return Box(
        low=record.p_map - half,
        high=record.p_map + half,
        deviation=deviation,
        category=record.category,
        length=max(float(record.extent.max()), usual, 0.02),
        yaw=record.yaw,
    )


Floats = NDArray[np.float64]
_MIN_PROBABILITY: Final = 1e-9  # probabilities below count as this


@dataclass(frozen=True, slots=True)
class RelationSettings:
    """Parameters of the formulas.

    The parameters of supports maximise the likelihood of the supports in simulated houses, and are
    rounded; those of containers and neighbours are chosen (`docs/explanation/relations.md`).
    """

    constant: float = 2.0  # of a candidate's utility
    over: float = 2.4  # weight of the log-probability that its centre lies over the footprint
    size: float = 0.85  # weight of the logarithm of the ratio of sizes
    largest_ratio: float = 3.0  # logarithms of ratios of sizes count no more than this
    edge: float = 0.20  # [m] standard deviation of a footprint's sides, at most; of small a quarter
    height: float = 0.15  # [m] standard deviation of an underside over a surface
    clutter: float = 0.10  # [m] that things on a surface raise the top of its box
    backless: float = 0.6  # share of things to sit or lie on whose box ends at the surface
    enclosed: float = 6.0  # utility of a container that encloses the centre
    rim: float = 0.03  # [m] standard deviation of bottom and top of a container
    roomier: float = 1.25  # ratio of lengths from which on a thing fits into a container
    gap: float = 0.30  # [m] between the footprints of two things beside one another, at most
    gap_noise: float = 0.10  # [m] standard deviation of a gap
    step: float = 0.20  # [m] between the undersides of two things at one level, at most
    step_noise: float = 0.08  # [m] standard deviation of a step
    alike: float = 4.0  # ratio of sizes, above which things are not beside one another


@dataclass(frozen=True, slots=True, eq=False)
class Carriers:
    """m things that others may be on or inside."""

    boxes: Boxes
    supports: NDArray[np.bool_]  # (m,) whether things may be on it
    contains: NDArray[np.bool_]  # (m,) ... inside it
    back: Floats  # (m,) [m] height of a backrest or headboard above the surface


def support_probabilities(
    things: Boxes, carriers: Carriers, allowed: NDArray[np.bool_], settings: RelationSettings
) -> tuple[Floats, Floats]:
    """Probabilities (n, m) that each of n things is on, and inside, each of m carriers.

    A row of both sums to at most 1; the rest is the floor, a wall, or an unmapped object.
    `allowed` (n, m) is False where a thing and a carrier are the same.
    """
    s, boxes = settings, carriers.boxes
    over = s.over * _log(_over(things, carriers, s))
    ratio = np.log(boxes.length[None, :] / things.length[:, None])
    sized = s.size * np.clip(ratio, -s.largest_ratio, s.largest_ratio)
    low, high = boxes.low[None, :, 2], boxes.high[None, :, 2]
    drop = things.low[:, None, 2] - high + s.clutter
    at_top, at_seat = _peak(drop / s.height), _peak((drop + carriers.back) / s.height)
    at = np.where(carriers.back > 0, s.backless * at_top + (1 - s.backless) * at_seat, at_top)
    on = np.where(allowed & carriers.supports, s.constant + sized + over + _log(at), -np.inf)
    middle = (things.low + things.high)[:, None, 2] / 2
    within = _log(_between(middle, low, high, np.hypot(s.rim, things.deviation)[:, None]))
    fits = allowed & carriers.contains & (ratio > math.log(s.roomier))
    inside = np.where(fits, s.enclosed + over + within, -np.inf)
    chosen = np.exp(np.minimum(np.concatenate([on, inside], axis=1), 50.0))
    shares = chosen / (1 + chosen.sum(axis=1, keepdims=True))
    return shares[:, : len(carriers.back)], shares[:, len(carriers.back) :]


def beside_probabilities(boxes: Boxes, settings: RelationSettings) -> Floats:
    """Probability (n, n), symmetric, that two things are beside one another; 0 on the diagonal."""
    s = settings
    gap, step, alike = _apart(boxes, s)
    variance = boxes.deviation**2
    both = variance[:, None] + variance[None, :]
    near = _normal((s.gap - gap) / np.sqrt(s.gap_noise**2 + both))
    level = _normal((s.step - step) / np.sqrt(s.step_noise**2 + both))
    return np.where(alike, near * level, 0.0)


def truly_beside(boxes: Boxes, settings: RelationSettings) -> NDArray[np.bool_]:
    """(n, n) whether two objects are beside each other, taking their boxes as exact."""
    gap, step, alike = _apart(boxes, settings)
    return np.asarray(alike & (gap <= settings.gap) & (step <= settings.step))


def _apart(boxes: Boxes, s: RelationSettings) -> tuple[Floats, Floats, NDArray[np.bool_]]:
    """Gaps between footprints, steps between undersides (n, n) [m], and which sizes compare.

    A gap is measured along the axes of either footprint, and the larger one counts.
    """
    reach = boxes.reach_along(boxes)
    own = np.diagonal(reach).T[None, :, :]  # half sides along their own axes
    apart = np.abs(boxes.seen_from(boxes)) - reach - own
    gap = np.hypot(*np.moveaxis(np.maximum(apart, 0.0), 2, 0))
    gap = np.maximum(gap, gap.T)
    step = np.abs(boxes.low[:, None, 2] - boxes.low[None, :, 2])
    ratio = boxes.longest[:, None] / boxes.longest[None, :]
    alike = np.maximum(ratio, ratio.T) <= s.alike
    np.fill_diagonal(alike, False)
    return gap, step, alike


def _over(things: Boxes, carriers: Carriers, s: RelationSettings) -> Floats:
    """(n, m): probability that the centre of each thing lies over each carrier's footprint."""
    boxes = carriers.boxes
    edge = np.minimum(s.edge, boxes.length / 4)
    noise = np.hypot(edge[None, :], things.deviation[:, None])
    half = (boxes.high - boxes.low)[None, :, :2] / 2
    shares = _between(things.seen_from(boxes), -half, half, noise[..., None])
    return np.asarray(shares.prod(axis=2))


def _between(value: Floats, low: Floats | float, high: Floats | float, noise: Floats) -> Floats:
    """Probability that a normal `value` with standard deviation `noise` lies between two bounds."""
    return np.maximum(_normal((high - value) / noise) - _normal((low - value) / noise), 0.0)


def _peak(x: Floats) -> Floats:
    """Density of the standard normal distribution, 1 at its mode."""
    return np.exp(-0.5 * np.clip(x, -8.0, 8.0) ** 2)


def _log(probability: Floats) -> Floats:
    return np.log(np.maximum(probability, _MIN_PROBABILITY))


def _normal(x: Floats) -> Floats:
    """Cumulative standard normal distribution, by its logistic approximation (error below 0.01).

    Bowling et al., A logistic approximation to the cumulative normal distribution, 2009.
    """
    x = np.clip(x, -8.0, 8.0)
    return 1 / (1 + np.exp(-1.5976 * x - 0.07056 * x**3))

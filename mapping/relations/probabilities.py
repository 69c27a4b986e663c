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
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mapping.relations.boxes import Boxes

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

"""Moved things: pairs of a thing that left one spot and a thing that appeared at another.

The probability that the new thing n is the old thing o weighs each pair by its labels, sizes,
places and times against two alternatives: n has another origin (it is new, or was missed so far),
and o went elsewhere. Pairs are assigned at greatest total probability. A pair holds where n is
probably any of the things that left, and o any of the things that appeared: after an exchange of
two equal cups, each of the new ones may be either of the old ones.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mapping.objects.association import assign
from mapping.objects.existence import category_probabilities
from mapping.objects.settings import ObjectSettings
from mapping.objects.tracks import Track

#: prior probability that a thing left within [s] after it was last seen
Departed = Callable[[Track, float], float]
#: likelihood ratio, by their looks, of the second thing being the first and being another one;
#: the rest are further things of the category that were known before
LookRatio = Callable[[Track, Track, Sequence[Track]], float]
_UNLIKELY = 0.02  # weight below which looks are not compared


@dataclass(frozen=True, slots=True, eq=False)
class Absentee:
    """A thing that is perhaps not where it was last seen."""

    track: Track
    left: float  # probability that it left, by the views of its spot since
    looked: bool  # whether its spot was viewed; only such things are found elsewhere


def moved_things(
    absent: Sequence[Absentee],
    appeared: Sequence[Track],
    departed: Departed,
    now: float,
    count: Callable[[str], int],
    settings: ObjectSettings,
    looks: LookRatio | None = None,
) -> list[tuple[Track, Track]]:
    """Pairs (thing that left, thing that appeared) that are one thing.

    `now` [s] is the present, `count` gives the number of things of a category in the map, `looks`
    compares pictures where there are any.
    """
    if not absent or not appeared:
        return []
    weights: NDArray[np.float64] = np.zeros((len(absent), len(appeared)))
    for row, one in enumerate(absent):
        for column, n in enumerate(appeared):
            plain = weight(one, n, departed, now, count, settings)
            if looks is not None and plain >= _UNLIKELY:
                plain *= looks(one.track, n, _rivals(one.track, n, absent))
            weights[row, column] = plain
    by_thing, by_origin = weights.sum(axis=0), weights.sum(axis=1)
    probability = weights / (1 + by_thing[None, :] + by_origin[:, None] - weights)
    cost = np.where(probability > 0, 1 - probability, np.inf)
    least = settings.moved / (1 - settings.moved)  # odds
    return [
        (absent[row].track, appeared[column])
        for row, column in assign(cost).items()
        if absent[row].looked and min(by_thing[column], by_origin[row]) >= least
    ]


def weight(
    one: Absentee,
    n: Track,
    departed: Departed,
    now: float,
    count: Callable[[str], int],
    s: ObjectSettings,
) -> float:
    """Likelihood ratio of `n` being that thing and being one of another origin."""
    o = one.track
    distance = float(np.linalg.norm(o.p_map - n.p_map))
    if n.first_seen <= o.last_seen or o is n:
        return 0.0
    if distance > 0.5 + s.speed * (n.first_seen - o.last_seen):
        return 0.0
    labels, others = _labels(o), _labels(n)
    alike = 0.0
    for category in sorted(labels.keys() & others.keys()):  # sums follow the order
        expected = s.same_label + s.unexplained * count(category)
        alike += labels[category] * others[category] / expected
    stretch = math.log(n.size / o.size) ** 2 / 2
    narrow, wide = s.same_size, s.other_size
    size = wide / narrow * math.exp(stretch / wide**2 - stretch / narrow**2)
    if distance < _gate(o, n, s):  # it stood there all the time
        return s.returned * o.peak * alike * max(size, s.any_size)
    place = math.exp(-distance / s.short_way)
    time = departed(o, n.first_seen - o.last_seen)
    if one.looked:  # it left, or was never there
        time = one.left * time / (departed(o, now - o.last_seen) + s.mistaken)
    return time * o.peak * alike * max(size, s.any_size) * place


def _rivals(o: Track, n: Track, absent: Sequence[Absentee]) -> list[Track]:
    """Things of the category of `o`, beside it, that were known before `n`."""
    tracks = (one.track for one in absent if one.track is not o and one.track is not n)
    return [t for t in tracks if t.category == o.category and t.first_seen < n.first_seen]


def in_one_spot(o: Track, n: Track, settings: ObjectSettings) -> bool:
    """Whether `n` stands in the spot of `o` and may have the same category."""
    near = float(np.linalg.norm(o.p_map - n.p_map)) < _gate(o, n, settings)
    return near and not o.plausible.isdisjoint(n.plausible)


def _gate(o: Track, n: Track, s: ObjectSettings) -> float:
    sizes = min(o.size, s.largest) + min(n.size, s.largest)
    return s.stale_gate * (s.gate + s.gate_size * sizes)


def _labels(track: Track) -> dict[str, float]:
    """Probability of each category of a thing that exists."""
    probabilities = category_probabilities(track.log_odds)
    total = sum(probabilities.values()) or 1.0
    return {category: p / total for category, p in probabilities.items() if p > 0.02 * total}

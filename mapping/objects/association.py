"""Data association of one frame's sightings with tracks: gates, costs, optimal assignment."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from mapping.frames.sighting import ThingSighting
from mapping.objects.settings import ObjectSettings
from mapping.objects.tracks import Track

Floats = NDArray[np.float64]
#: position (3,) [m] and categories of a track as people assert them; None where they do not
Asserted = Callable[[Track], tuple[Floats | None, str | None]]

_SLACK = 0.05  # [m] added to each footprint, since it covers only the visible side
_OTHER = 1.0  # cost of unequal categories, above that of any equal ones


def associate(
    sightings: Sequence[ThingSighting],
    tracks: Sequence[Track],
    asserted: Asserted,
    settings: ObjectSettings,
) -> dict[int, int]:
    """Index of a sighting -> index of its track, each at most once, at least total cost.

    A pair of one category needs a distance below a gate, which grows with both sizes and with
    depth, or overlapping footprints. A pair of two categories needs the same spot and about the
    same size.
    """
    if not sightings or not tracks:
        return {}
    cost = np.full((len(sightings), len(tracks)), np.inf)
    positions = np.array([track.p_map for track in tracks])
    lows, highs = np.array([t.low for t in tracks]), np.array([t.high for t in tracks])
    offers = [asserted(track) for track in tracks]
    categories = [track.plausible | {offer[1]} for track, offer in zip(tracks, offers, strict=True)]
    for row, sighting in enumerate(sightings):
        distances = np.linalg.norm(positions - sighting.p_map, axis=1)
        for column, (p_asserted, _) in enumerate(offers):
            if p_asserted is not None:
                distance = float(np.linalg.norm(p_asserted - sighting.p_map))
                distances[column] = min(distances[column], distance)
        near = distances < settings.gate + 2 * settings.gate_size * settings.largest
        near |= boxes_touch(sighting.low, sighting.high, lows, highs)
        for column in map(int, np.nonzero(near)[0]):
            shared = not categories[column].isdisjoint(sighting.categories)
            cost[row, column] = _cost(
                sighting, tracks[column], float(distances[column]), shared, settings
            )
    return assign(cost)


def _cost(
    sighting: ThingSighting, track: Track, distance: float, shared: bool, s: ObjectSettings
) -> float:
    """Cost of taking `sighting` for `track`, whose position is `distance` [m] away.

    `shared`: whether they have a category in common.
    """
    a, b = min(sighting.size, s.largest), min(track.size, s.largest)
    blur = s.gate_depth * (sighting.depth or 1.0) ** 2
    replaced = track.stale and max(a, b) < s.small
    if shared:
        gate = s.gate + s.gate_size * (a + b) + blur
        if replaced:
            return distance / gate if distance < s.stale_gate * gate else np.inf
        if distance < gate:
            return distance / gate
        common = shared_footprint(sighting.low, sighting.high, track.low, track.high)
        return 1.0 if common > s.overlap else np.inf
    alike = not sighting.cut and 0.5 < sighting.size / track.size < 2
    gate = (s.other_gate * min(a, b) + blur) * (s.stale_gate if replaced else 1.0)
    return _OTHER + distance if alike and distance < gate else np.inf


def boxes_touch(low: Floats, high: Floats, lows: Floats, highs: Floats) -> NDArray[np.bool_]:
    """(n,) whether boxes, corners (n, 3) [m], touch a box, corners (3,), up to the slack."""
    below, above = lows - 2 * _SLACK, highs + 2 * _SLACK
    return np.asarray(((below < high) & (low < above)).all(axis=1))


def shared_footprint(low: Floats, high: Floats, other_low: Floats, other_high: Floats) -> float:
    """Share of the smaller footprint that two boxes, corners (3,) [m], have in common.

    0 where one stands clear above the other.
    """
    if min(high[2], other_high[2]) < max(low[2], other_low[2]) - 2 * _SLACK:
        return 0.0
    common = np.minimum(high, other_high)[:2] - np.maximum(low, other_low)[:2] + _SLACK
    areas = ((high - low)[:2] + _SLACK).prod(), ((other_high - other_low)[:2] + _SLACK).prod()
    return float(np.clip(common, 0, None).prod() / max(min(areas), 1e-6))


def assign(cost: NDArray[np.float64]) -> dict[int, int]:
    """Row -> column of least total cost; pairs of infinite cost are never made.

    `cost` (n, m), inf where a pair is impossible. As many pairs as possible are made first.
    """
    possible = np.isfinite(cost)
    rows, columns = np.nonzero(possible.any(axis=1))[0], np.nonzero(possible.any(axis=0))[0]
    if len(rows) == 0:
        return {}
    part = cost[np.ix_(rows, columns)]
    forbidden = 1.0 + 2 * float(part[np.isfinite(part)].sum())
    filled = np.where(np.isfinite(part), part, forbidden)
    flipped = filled.shape[0] > filled.shape[1]
    pairs = _shortest_augmenting_paths(filled.T if flipped else filled)
    found = [(c, r) if flipped else (r, c) for r, c in pairs]
    return {int(rows[r]): int(columns[c]) for r, c in found if np.isfinite(part[r, c])}


def _shortest_augmenting_paths(cost: NDArray[np.float64]) -> list[tuple[int, int]]:
    """Pairs (row, column) for a finite `cost` (n, m) with n <= m."""
    n, m = cost.shape
    row_price, column_price = np.zeros(n + 1), np.zeros(m + 1)
    owner = np.zeros(m + 1, dtype=np.intp)  # row of each column, both from 1; 0: none
    for row in range(1, n + 1):
        owner[0], column = row, 0
        least, used = np.full(m + 1, np.inf), np.zeros(m + 1, dtype=bool)
        before = np.zeros(m + 1, dtype=np.intp)
        while owner[column] != 0:
            used[column] = True
            current = owner[column]
            reduced = cost[current - 1] - row_price[current] - column_price[1:]
            better = ~used[1:] & (reduced < least[1:])
            least[1:][better], before[1:][better] = reduced[better], column
            column = int(np.argmin(np.where(used, np.inf, least)[1:])) + 1
            step = least[column]
            row_price[owner[used]] += step
            column_price[used] -= step
            least[~used] -= step
        while column != 0:
            owner[column] = owner[before[column]]
            column = int(before[column])
    return [(int(owner[c]) - 1, c - 1) for c in range(1, m + 1) if owner[c] != 0]

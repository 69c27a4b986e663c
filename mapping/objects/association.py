"""Data association of one frame's sightings with tracks: gates, costs, optimal assignment."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from mapping.objects.assignment import assign
from mapping.objects.settings import ObjectSettings
from mapping.objects.tracks import Track
from mapping.sighting import ThingSighting

Floats = NDArray[np.float64]
#: position (3,) [m] and categories of a track as people assert them; None where they do not
Asserted = Callable[[Track], tuple[Floats | None, str | None]]

_SLACK = 0.05  # [m] added to each footprint, which are surfaces seen from one side
_OTHER = 1.0  # cost of unequal categories, above that of any equal ones


def associate(
    sightings: Sequence[ThingSighting],
    tracks: Sequence[Track],
    asserted: Asserted,
    settings: ObjectSettings,
) -> dict[int, int]:
    """Index of a sighting -> index of its track, each at most once, at least total cost.

    An equal category passes a gate that grows with both sizes and with depth, or overlapping
    footprints; another category only what is in the same spot and of about the same size.
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
    """Which boxes, corners (n, 3) [m], touch a box, corners (3,), but for the slack."""
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

"""Merging of tracks that turn out to be one thing."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mapping.objects.association import boxes_touch, shared_footprint
from mapping.objects.settings import ObjectSettings
from mapping.objects.tracks import SEEN_TOGETHER, Track
from mapping.objects.usual_sizes import UNUSUAL, SizeOf, UsualSize

_LARGE = 1.2  # [m] usual size from which things are seen in parts
_PARTS = 0.1  # greatest shared footprint of two large things of one category
_TOLERANCE = 1.15  # of the usual size
_LIKELY = 0.5  # existence


def duplicates(
    touched: Sequence[Track], tracks: Sequence[Track], usual: SizeOf, settings: ObjectSettings
) -> list[tuple[Track, Track]]:
    """Pairs (kept, absorbed) of tracks that are one thing, each with one of the `touched` tracks.

    Objects of the map absorb candidates; tracks that were once likely absorb others; older tracks
    absorb younger ones.
    """
    if not touched or len(tracks) < 2:
        return []
    positions = np.array([track.p_map for track in tracks])
    lows, highs = np.array([t.low for t in tracks]), np.array([t.high for t in tracks])
    found, gone = list[tuple[Track, Track]](), set[int]()
    for track in touched:
        if id(track) in gone:
            continue
        distances = np.linalg.norm(positions - track.p_map, axis=1)
        # parts of one thing lie up to 2 m apart
        near = (distances < 2.0) | boxes_touch(track.low, track.high, lows, highs)
        for index in np.nonzero(near)[0]:
            other = tracks[int(index)]
            if other is track or id(other) in gone or id(track) in gone:
                continue
            if other.category != track.category and distances[index] >= 0.3 * settings.largest:
                continue
            if same_thing(track, other, usual, settings):
                kept, absorbed = sorted((track, other), key=_seniority)
                found.append((kept, absorbed))
                gone.add(id(absorbed))
    return found


def _seniority(track: Track) -> tuple[bool, bool, float]:
    """Sort key: objects of the map first, then tracks that were once likely, then older ones."""
    return track.iri is None, track.peak < _LIKELY, track.first_seen


def same_thing(a: Track, b: Track, usual: SizeOf, s: ObjectSettings) -> bool:
    """Whether two tracks are one thing."""
    distance = float(np.linalg.norm(a.p_map - b.p_map))
    sizes = min(a.size, s.largest), min(b.size, s.largest)
    apart = a.together.get(b.number, 0) >= SEEN_TOGETHER
    if a.category != b.category:
        return not apart and distance < 0.3 * min(sizes)
    expected = usual(a.category) or UNUSUAL
    if distance < max(s.separation * expected.width, 0.1 * max(sizes)):
        return True
    shared = shared_footprint(a.low, a.high, b.low, b.high)
    max_shared = _PARTS if expected.longest >= _LARGE else s.interpenetration
    if max(sizes) > UNUSUAL.longest and shared > max_shared:
        return True
    if apart:
        return False
    near = distance < 0.1 + s.same_place * sum(sizes) / 2
    return near or shared > s.overlap or _parts_of_one(a, b, expected)


def _parts_of_one(a: Track, b: Track, expected: UsualSize) -> bool:
    """Whether both are parts of one large thing: their common box is no larger than one of them.

    Beds, tables and couches are seen in parts, cut by the image's border.
    """
    if expected.longest < _LARGE:
        return False
    low, high = np.minimum(a.low, b.low), np.maximum(a.high, b.high)
    return float((high - low)[:2].max()) < _TOLERANCE * expected.longest

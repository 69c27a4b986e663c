"""Extent grower: which things get a new box, from the surface and from their views, and when."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

import numpy as np
from numpy.typing import NDArray

from kg.model.areas import OrientedBox
from kg.model.records import ObjectRecord
from mapping.objects.extents.box_fit import BoxViews, fitted_box
from mapping.objects.extents.surface_growth import REACH, Voxels, Walls, grown_box
from mapping.objects.tracks import Track

Floats = NDArray[np.float64]

_SHOWN: Final = 0.5  # existence from which on a thing gets a box
_FIRST: Final = 2  # distinct views with which a thing gets its first box
_AGAIN: Final = 3  # times as many views, until it gets the next one
_AROUND: Final = 0.15  # [m] around its sightings in which the surface is looked at
_SAME: Final = 0.85  # overlap with its former box from which on it keeps that


class ExtentGrower:
    """Fits boxes to tracks: at most one a frame, and all that changed at the end."""

    def __init__(self, voxels: Voxels) -> None:
        self._voxels = voxels

    def grow_one(self, seen: Iterable[Track]) -> Track | None:
        """A new box for the track among those just `seen` that has waited longest for one."""
        due = [t for t in seen if _has_box(t) and t.shown >= max(_AGAIN * t.grown, _FIRST)]
        longest = max(due, key=lambda t: (t.shown / max(t.grown, 1), -t.number), default=None)
        if longest is not None:
            self._grow(longest)
        return longest

    def grow_rest(self, tracks: Iterable[Track]) -> list[Track]:
        """New boxes for all with views since their last one; all whose box is not yet written."""
        unwritten = list[Track]()
        for track in tracks:
            if _has_box(track) and track.shown > track.grown:
                self._grow(track)
            if track.box is not None and not _is_written(track.outline, track.written):
                unwritten.append(track)
        return unwritten

    def _grow(self, track: Track) -> None:
        track.grown, track.changed = track.shown, True
        low, high = np.min(track.lows, 0) - _AROUND, np.max(track.highs, 0) + _AROUND
        views = BoxViews.of(track.views.values())
        walls = Walls.of(*self._voxels(low - REACH, high + REACH))
        yaw = None if walls is None else walls.yaw
        with np.errstate(all="ignore"):  # views of a foreign file may be anything
            grown = grown_box(self._voxels, low, high, views, yaw)
            parallel = grown is not None and grown.yaw == yaw
            box = None if grown is None else fitted_box(grown, views, parallel)
            if box is not None and grown is not None and walls is not None and parallel:
                box = walls.kept_before(box, grown)
        if box is None or not _within(box, low, high):
            return
        if track.box is None or track.box.overlap(box) < _SAME:
            track.box = box


def _has_box(track: Track) -> bool:
    return track.iri is not None and track.existence >= _SHOWN and bool(track.lows)


def _is_written(box: OrientedBox, record: ObjectRecord | None) -> bool:
    """Whether a record has the box, to the centimetre."""
    if record is None or record.extent is None:
        return False
    held = (*record.p_map, *record.extent, record.yaw)
    return bool(np.allclose(held, (*box.centre, *box.extent, box.yaw), atol=0.01))


def _within(box: OrientedBox, low: Floats, high: Floats) -> bool:
    """Whether a box's centre lies where the thing was seen, and it is at most twice as large."""
    inside = (low <= box.centre) & (box.centre <= high)
    return bool(inside.all() and np.linalg.norm(box.extent) < 2 * np.linalg.norm(high - low))

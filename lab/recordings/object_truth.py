"""Complete truth of a simulated recording, in the format of `lab.maps.complete_truth`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np

from lab.houses.house_changes import HouseChange
from lab.houses.small_things import SurfaceSampler
from planner.simulation.camera import CameraModel, TrueView
from planner.simulation.house import House, Item

MIN_FRAMES: Final = 3  # frames that show a thing well; a thing with fewer is ignored
MIN_PIXELS: Final = 120.0  # of a thing that is shown well, in an image 320 wide
MIN_SHARE: Final = 0.5  # of a thing that is shown well, not occluded and inside the image

#: Labels of COCO that are right for furnishings as well.
ALSO: Final[Mapping[str, tuple[str, ...]]] = {
    "coffee table": ("dining table", "bench"),
    "desk": ("dining table",),
    "counter": ("dining table",),
    "sideboard": ("dining table",),
    "low board": ("dining table", "bench"),
    "vanity": ("dining table",),
}


class VisibilityRecord:
    """Frames that show each object well."""

    def __init__(self, house: House, model: CameraModel) -> None:
        self.frames: dict[str, list[str]] = {item.name: [] for item in house.objects}
        self._house = house
        self._min_pixels = MIN_PIXELS * (model.width / 320) ** 2

    def add(self, frame_id: str, view: TrueView) -> None:
        """Count one frame."""
        numbers, counts = np.unique(view.instance, return_counts=True)
        for i, visible in zip(numbers.tolist(), counts.tolist(), strict=True):
            if i < 0 or visible < self._min_pixels:
                continue
            share = min(visible / max(view.silhouette[i], 1.0), 1.0) * view.inside[i]
            if share >= MIN_SHARE:
                self.frames[self._house.objects[i].name].append(frame_id)


def object_truth(
    house: House,
    seen: Mapping[str, Sequence[str]],
    complete_for: Sequence[str],
    before: House | None = None,
    change: HouseChange | None = None,
) -> dict[str, Any]:
    """The truth as JSON: each thing by its name, at the end of the recording, in the house's frame.

    `seen` has the frames that show each object well. Given the house `before` the session and its
    `change`, each entry has whether the thing moved, and "vanished" lists the things that are gone.
    """
    objects = {item.name: _object(item, house, seen[item.name]) for item in house.objects}
    objects |= {item.name: _furnishing(item, house) for item in house.furnishings}
    truth: dict[str, Any] = {
        "frame": "world = the house: x east, y north, z up [m], floor at z = 0",
        "up": [0.0, 0.0, 1.0],
        "note": f"simulated; things seen well in fewer than {MIN_FRAMES} frames are ignored, "
        "furnishings without a COCO name too; positions are middles of bounding boxes",
        "complete_for": list(complete_for),
        "incomplete_for": [],
    }
    if before is not None and change is not None:
        _add_changes(objects, before, change)
        truth["vanished"] = {
            item.name: {"cls": item.label, "position": _rounded(item.centre())}
            for item in change.vanished
        }
    return truth | {"objects": objects}


def _object(item: Item, house: House, frames: Sequence[str]) -> dict[str, Any]:
    wide_chair = item.label == "chair" and item.scale[0] > 1.2
    return {
        "cls": item.label,
        "also": ["couch"] if wide_chair else [],
        "ignore": len(frames) < MIN_FRAMES,
        **_where(item, house),
        "frames": list(frames),
    }


def _furnishing(item: Item, house: House) -> dict[str, Any]:
    return {
        "cls": "not coco",
        "also": list(ALSO.get(item.label, ())),
        "ignore": True,
        **_where(item, house),
        "what": item.label,
    }


def _where(item: Item, house: House) -> dict[str, Any]:
    lo, hi = item.bounds()
    room = house.room_at(item.x, item.y)
    return {
        "position": _rounded((lo + hi) / 2),
        "extent": _rounded(hi - lo),
        "reach": None,
        "room": None if room is None else room.part_of or room.name,
        "on": supporting(item, house),
    }


def supporting(item: Item, house: House) -> str:
    """Name of the furniture that `item` stands on; else "floor" or "wall"."""
    if item.z == 0:
        return "floor"
    sampler = SurfaceSampler([*house.objects, *house.furnishings])
    for s in sampler.surfaces:
        over = np.all(s.lo - 0.1 <= (item.x, item.y)) and np.all(s.hi + 0.1 >= (item.x, item.y))
        if over and abs(s.z - item.z) < 0.02:
            return sampler.items[s.support].name
    return "wall"


def _add_changes(objects: dict[str, dict[str, Any]], before: House, change: HouseChange) -> None:
    old = {item.name: item for item in before.objects}
    for name, entry in objects.items():
        entry["moved"] = name in change.moved
        entry["carried"] = name in change.carried
        entry["new"] = name in change.new
        if name in change.moved:
            entry["before"] = _rounded(old[name].centre())


def _rounded(values: Any) -> list[float]:
    return [round(float(v), 4) for v in values]

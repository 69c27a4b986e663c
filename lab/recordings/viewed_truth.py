"""Truth of what a robot saw of a simulated house, place by place.

The truth of a (category, place) pair:

- *present*: a thing of the category was seen well in three frames or more and still stands there,
  as far as was seen: it was not looked at since in vain.
- *gone*: one was seen so and left: its spot was looked at since, in three frames or more, and it
  was not seen well elsewhere.
- otherwise the floor and the tops of furniture decide, sampled every 0.1 m and looked at by ray
  casting from the true poses, from within 4 m: *never looked* where less than 5 % of them were
  viewed. A thing of the category is out of view at a sample where none within half its longest
  side was viewed. *Looked, none seen* where this is so at 10 % of the samples at most and no such
  thing stands there, else *hidden*.
- pairs count neither way where what stands there was seen, but well in fewer than three frames, or
  has several right names (a desk is a dining table to COCO).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import cache
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from lab.recordings.object_truth import MIN_FRAMES, VisibilityRecord, object_truth
from perception.frames import Frame
from planner.search.goals.status import NONE_SEEN, Value
from planner.simulation.camera import SimulatedCamera, TrueView
from planner.simulation.house import OBJECTS, House, HouseRoom
from planner.simulation.house_robot import SimulatedTour

SPACING: Final = 0.1  # [m] between samples of floor and tops
REACH: Final = (0.4, 4.0)  # [m] depth from which on, and up to which, a sample is viewed
TOLERANCE: Final = 0.1  # [m] of depth, by which what is seen may be before a sample
HIGHEST: Final = 1.2  # [m] top that the camera, 1.25 m high, looks onto
WALL: Final = 0.05  # [m] half of a wall's thickness
HARDLY_SEEN: Final = 0.05  # share of a place, below which nobody looked
HIDDEN: Final = 0.1  # share out of view from which on one is hidden
SHOWN: Final = 16  # pixels from which on a thing was seen at all

Floats = NDArray[np.float64]


@cache
def longest_side(category: str) -> float:
    """[m] longest side of the box around a thing of a category, as simulated houses have it."""
    parts = OBJECTS[category]
    centre = np.array([[p.x, p.y, p.z + p.height / 2] for p in parts])
    half = np.array([[p.width, p.depth, p.height] for p in parts]) / 2
    return float(((centre + half).max(axis=0) - (centre - half).min(axis=0)).max())


def surfaces(house: House) -> Floats:
    """(n, 3) [m] samples of each room as seen from above: floor, or the top of what stands there.

    Tops that are out of the camera's sight are left out.
    """
    parts = []
    for room in house.rooms:
        sides = (room.xmin, room.xmax), (room.ymin, room.ymax)
        x, y = (np.arange(low + WALL + SPACING / 2, high - WALL, SPACING) for low, high in sides)
        parts.append(np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2))
    xy = np.concatenate(parts)
    z = np.zeros(len(xy))
    for item in (*house.furnishings, *house.objects):
        for solid in item.solids():
            z[_in_any([(solid.lo, solid.hi)], xy) & (z < solid.hi[2])] = solid.hi[2]
    return np.column_stack([xy, z])[z < HIGHEST]


def _in_any(boxes: Iterable[tuple[Floats, Floats]], points: Floats) -> NDArray[np.bool_]:
    """(n,) whether points (n, k) lie in any box of corners (k or more,), cut to k dimensions."""
    found, k = np.zeros(len(points), np.bool_), points.shape[1]
    for lo, hi in boxes:
        found |= np.all((points > lo[:k]) & (points < hi[:k]), axis=1)
    return found


class TourPart:
    """The first part of a tour through a house, and what it truly shows; a `Recording`."""

    T_map_world = np.eye(4)

    def __init__(self, camera: SimulatedCamera, tour: SimulatedTour, part: float, points: Floats):
        self.name, self._tour, self.camera = tour.name, tour, camera
        self._length = max(1, round(part * len(tour)))
        self.points = points  # (n, 3) [m]
        self.frames_of = np.zeros(len(points), np.intp)  # frames that show each point
        self._well = VisibilityRecord(camera.house, camera.model)
        self.shown: dict[str, float] = {}  # name of a thing -> [s] when it was last seen at all

    def __len__(self) -> int:
        return self._length

    def frames(self, start: int = 0) -> Iterator[Frame]:
        """Frames of the part; each is looked at as it is read."""
        for _, frame in zip(range(start, len(self)), self._tour.frames(start), strict=False):
            view = self.camera.view(frame.T_map_cam, frame.stamp)
            self._well.add(frame.id, view)
            self.frames_of[self._in_view(view)] += 1
            numbers, pixels = np.unique(view.instance, return_counts=True)
            things = numbers[(pixels >= SHOWN) & (numbers >= 0)]
            self.shown |= {self.camera.house.objects[i].name: frame.stamp for i in things}
            yield frame

    def _in_view(self, view: TrueView) -> NDArray[np.intp]:
        """Numbers of the points that a view shows."""
        T, model = view.T_map_cam, self.camera.model
        p_cam = (self.points - T[:3, 3]) @ T[:3, :3]
        z = p_cam[:, 2]
        at = np.flatnonzero((z >= REACH[0]) & (z <= REACH[1]))
        u, v = (np.rint(p_cam[at, k] / z[at] * model.focal + model.K[k, 2]) for k in (0, 1))
        inside = (u >= 0) & (u < model.width) & (v >= 0) & (v < model.height)
        at, u, v = at[inside], u[inside].astype(np.intp), v[inside].astype(np.intp)
        return np.asarray(at[view.depth[v, u] >= z[at] - TOLERANCE])

    def truth(self) -> dict[str, dict[str, Any]]:
        """Entries of the things' truth, by name (`lab.recordings.object_truth`)."""
        found = object_truth(self.camera.house, self._well.frames, sorted(OBJECTS))["objects"]
        return {name: entry | {"shown": name in self.shown} for name, entry in found.items()}


class HouseTruth:
    """True status of each category in each place after sessions in a house."""

    def __init__(self) -> None:
        self.known: dict[str, dict[str, Any]] = {}  # seen well and there since, as far as was seen
        self.left: dict[str, dict[str, Any]] = {}  # known before, and their spots were seen empty
        self.doubtful = list[dict[str, Any]]()
        self.now: dict[str, dict[str, Any]] = {}
        self._viewed = np.zeros(0, np.bool_)
        self._points: Floats = np.empty((0, 3))

    def add(self, session: TourPart, surface_points: int) -> None:
        """Count a session; its points after the first ones are the spots of what was `known`."""
        viewed = session.frames_of[:surface_points] > 0
        self._points = session.points[:surface_points]
        self._viewed = viewed if not len(self._viewed) else self._viewed | viewed
        self.now = session.truth()
        spots = zip(tuple(self.known), session.frames_of[surface_points:], strict=True)
        self.doubtful = []
        for name, frames in spots:
            there = self.now.get(name, {}).get("position") == self.known[name]["position"]
            if frames and not there:
                gone = self.known.pop(name)
                if frames < MIN_FRAMES:
                    self.doubtful.append(gone)
                else:
                    self.left[name] = gone
        for name, entry in self.now.items():
            if not entry["ignore"]:
                self.known[name] = entry
                self.left.pop(name, None)
            elif name not in self.known and entry.get("shown", True):
                self.doubtful.append(entry)

    def spots(self) -> Floats:
        """(n, 3) [m] where what is known was."""
        return np.array([e["position"] for e in self.known.values()], np.float64).reshape(-1, 3)

    def _samples(self, room: HouseRoom) -> tuple[Floats, NDArray[np.bool_]]:
        """(n, 2) [m] samples of a room's floor and tops, and (n,) whether each was viewed."""
        corners = np.array([[room.xmin, room.ymin], [room.xmax, room.ymax]])
        inside = _in_any([(corners[0], corners[1])], self._points[:, :2])
        return self._points[inside, :2], self._viewed[inside]

    def share(self, room: HouseRoom) -> float:
        """Share of a room's floor and tops that was viewed."""
        _, viewed = self._samples(room)
        return float(viewed.mean()) if len(viewed) else 0.0

    def out_of_view(self, category: str, room: HouseRoom) -> float:
        """Share of a room's samples where a thing of the category would be out of view."""
        xy, viewed = self._samples(room)
        if not viewed.any():
            return 1.0
        unseen = xy[~viewed][:, None] - xy[viewed][None]
        away = np.hypot(unseen[..., 0], unseen[..., 1]).min(axis=1, initial=np.inf)
        return float((away > longest_side(category) / 2).sum() / len(xy))

    def value(self, category: str, room: HouseRoom) -> Value | None:
        """The truth of one pair; None where it counts neither way."""
        if _any_is(self.known.values(), category, room):
            return "present"
        if _any_is(self.doubtful, category, room, also=True):
            return None
        if _any_is(self.left.values(), category, room):
            return "gone"
        if self.share(room) < HARDLY_SEEN:
            return "never looked"
        there = _any_is(self.now.values(), category, room)
        hidden = there or self.out_of_view(category, room) >= HIDDEN
        return "hidden" if hidden else NONE_SEEN


def _any_is(
    entries: Iterable[dict[str, Any]], category: str, room: HouseRoom, *, also: bool = False
) -> bool:
    return any(
        (e["cls"] == category or (also and category in e["also"]))
        and room.contains(*e["position"][:2])
        for e in entries
    )

"""Views of a recording from which things are seen: one image of each viewpoint, coded."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mapping.frames.projection import to_camera
from mapping.objects.tracks import Viewpoint, viewpoint
from perception.annotate import encode_jpeg
from perception.frames import Frame

MAX_VIEWS: Final = 300  # that are kept; the oldest are dropped
_STEP: Final = 8  # [px] between kept values of depth
_NEAR: Final = 0.3  # [m] from which on a camera sees things
_BEHIND: Final = 0.1  # [m], and a share, by which a point may lie behind the measured depth
_POINTS: Final = 60  # of a thing that are looked for
_MIN_SHARE: Final = 0.5  # share of these that a view must show

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class SeenView:
    """A frame from one viewpoint."""

    frame: str
    stamp: float  # [s]
    T_map_cam: Floats  # (4, 4)
    K: Floats  # (3, 3)
    depth: NDArray[np.float32]  # (h, w) [m], every eighth pixel
    size: tuple[int, int]  # [px] width and height of the image
    jpeg: bytes  # of the whole image; empty where no pictures are kept
    people: NDArray[np.float32]  # (n, 4) xyxy [px]

    def shows(self, points: Floats) -> tuple[float, tuple[float, float, float, float]] | None:
        """Share of `points` (n, 3) [m] in the open in the image, and their box xyxy [px]."""
        p = to_camera(self.T_map_cam, points)
        if p[:, 2].min() < _NEAR:
            return None
        u = p[:, 0] / p[:, 2] * self.K[0, 0] + self.K[0, 2]
        v = p[:, 1] / p[:, 2] * self.K[1, 1] + self.K[1, 2]
        inside = (u >= 0) & (v >= 0) & (u < self.size[0]) & (v < self.size[1])
        if inside.mean() < _MIN_SHARE:
            return None
        rows, columns = self.depth.shape
        row = np.clip(v[inside] / _STEP, 0, rows - 1).astype(np.intp)
        column = np.clip(u[inside] / _STEP, 0, columns - 1).astype(np.intp)
        behind = p[inside, 2] - self.depth[row, column]
        seen = (behind < _BEHIND * np.maximum(p[inside, 2], 1.0)).sum() / len(points)
        u, v = np.clip(u, 0, self.size[0] - 1), np.clip(v, 0, self.size[1] - 1)
        box = float(u.min()), float(v.min()), float(u.max()), float(v.max())
        return float(seen), box


class RecentViews:
    """Views of one recording, one of each viewpoint."""

    def __init__(self, pictures: bool) -> None:
        self._pictures = pictures
        self._views = dict[Viewpoint, SeenView]()

    def add(self, frame: Frame, people: NDArray[np.float32]) -> bool:
        """Keep a frame, if none is kept from there; whether it is kept."""
        key = viewpoint(frame.T_map_cam)
        if key in self._views:
            return False
        height, width = frame.depth.shape
        jpeg = encode_jpeg(frame.rgb, 85) if self._pictures else b""
        depth = np.nan_to_num(frame.depth[::_STEP, ::_STEP], nan=np.inf)
        depth = np.where(depth > 0, depth, np.inf).astype(np.float32)
        self._views[key] = SeenView(
            frame.id, frame.stamp, frame.T_map_cam, frame.K, depth, (width, height), jpeg, people
        )
        if len(self._views) > MAX_VIEWS:
            del self._views[next(iter(self._views))]
        return True

    def number(self, points: Floats) -> int:
        """Number of the views that show most of `points` (n, 3) [m]."""
        some = points[:: max(1, len(points) // _POINTS)]
        shown = (view.shows(some) for view in self._views.values())
        return sum(one is not None and one[0] >= _MIN_SHARE for one in shown)

    def best(self, points: Floats) -> tuple[SeenView, float, tuple[float, ...]] | None:
        """The view that shows most of `points` (n, 3) [m], large, with the share and the box."""
        some = points[:: max(1, len(points) // _POINTS)]
        found = None
        for view in self._views.values():
            shown = view.shows(some)
            if shown is None or shown[0] < _MIN_SHARE:
                continue
            share, box = shown
            worth = share * ((box[2] - box[0]) * (box[3] - box[1])) ** 0.25
            if found is None or worth > found[0]:
                found = worth, view, share, box
        return None if found is None else found[1:]

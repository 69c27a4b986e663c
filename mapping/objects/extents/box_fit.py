"""Box fit: the upright box whose outlines agree with the boxes of a thing's detections.

A few damped Gauss-Newton steps from the box that was grown from the surface. Its faces hold the
sides that cameras saw; the outlines tell how far it reaches on the sides that none saw, at least up
to the border of an image that cuts it. After
Yang and Scherer, CubeSLAM (IEEE Transactions on Robotics 35, 2019), with the surface's box in place
of vanishing points. Huber's weights (1964) bound the influence of each edge and face.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from kg.model.areas import OrientedBox, along, along_nearest_axes
from mapping.frames.sighting import ThingSighting
from perception.frames import Frame

MAX_VIEWS: Final = 16  # kept of each thing
#: pose (3, 4), focal lengths and principal point, width and height of the image, box, depth
NUMBERS: Final = 23
_NEAREST: Final = 0.1  # [m] depth at which a point behind the camera is taken to be


Row = NDArray[np.float32]  # (NUMBERS,) one view, as it is stored


def view_row(frame: Frame, sighting: ThingSighting) -> Row | None:
    """The view of a sighting; None where it has no box or depth."""
    if sighting.box is None or sighting.depth is None:
        return None
    K, (height, width) = frame.K, frame.depth.shape
    camera = (K[0, 0], K[1, 1], K[0, 2], K[1, 2], width, height)
    numbers = (*frame.T_map_cam[:3].ravel(), *camera, *sighting.box, sighting.depth)
    return np.array(numbers, np.float32)


def pose_of(row: Row) -> Floats:
    """Pose T_map_cam (3, 4) of a view."""
    return row[:12].reshape(3, 4).astype(np.float64)


@dataclass(frozen=True, slots=True, eq=False)
class BoxViews:
    """Views of one thing, n of them."""

    poses: Floats  # (n, 3, 4) T_map_cam
    focal: Floats  # (n, 2) [px]
    middle: Floats  # (n, 2) [px] principal point
    size: Floats  # (n, 2) [px] width and height of the image
    boxes: Floats  # (n, 4) xyxy [px]
    depth: Floats  # (n,) [m] of the thing, along the optical axis

    @classmethod
    def of(cls, rows: Collection[Row]) -> BoxViews:
        """The arrays of `rows`."""
        r = np.array([*rows], np.float64).reshape(-1, NUMBERS)
        poses = r[:, :12].reshape(-1, 3, 4)
        return cls(poses, r[:, 12:14], r[:, 14:16], r[:, 16:18], r[:, 18:22], r[:, 22])

    def __len__(self) -> int:
        return len(self.depth)

    @property
    def cameras(self) -> Floats:
        """(n, 3) [m] positions."""
        return self.poses[:, :, 3]

    @property
    def sides(self) -> Floats:
        """(n, 2) [px] width and height of the boxes, at least 1."""
        return np.maximum(self.boxes[:, 2:] - self.boxes[:, :2], 1.0)

    def project(self, points: Floats) -> tuple[Floats, Floats]:
        """Pixels (..., n, m, 2) and depths (..., n, m) [m] of points (..., m, 3) in all views."""
        turn = self.poses[:, :, :3]
        origin = np.einsum("ni,nij->nj", self.cameras, turn)
        p_cam = points[..., None, :, :] @ turn - origin[:, None, :]
        depth = p_cam[..., 2]
        scale = self.focal[:, None, :] / np.maximum(depth, _NEAREST)[..., None]
        return p_cam[..., :2] * scale + self.middle[:, None, :], depth


_STEPS: Final = 5
_CLOSE: Final = 0.003  # [m or rad] step that ends the fit
_MAX_STEP: Final = 0.2  # [m or rad] of a step
_DELTA: Final = 0.005  # [m or rad] of a numeric derivative
_EDGE: Final = (0.05, 1.5)  # standard deviation of an edge: share of the box's side, and [px]
_BORDER: Final = 4.0  # [px] an edge this near the image's border is that border
_SEEN: Final = 0.05  # [m] standard deviation of a face that cameras saw, ...
_HIDDEN: Final = 0.3  # [m] ... and of another one
_LOOKS: Final = 0.15  # share of the cameras in front of a face that was seen
_TURN: Final = 0.1  # [rad] standard deviation of the surface's orientation, ...
_PARALLEL: Final = 0.02  # [rad] ... and of that of a thing that is parallel to walls
_WEIGHT: Final = 1.0  # of the outlines of all views together, against that of one face
_MIN_SIDE: Final = 0.02  # [m]
#: (16, 3) corners of a box of side 1 with chamfered edges: between a box and a cylinder
_CORNERS: Final = np.array(
    [
        (x, y, z)
        for a, b in ((0.5, 0.25), (0.25, 0.5))
        for x in (-a, a)
        for y in (-b, b)
        for z in (-0.5, 0.5)
    ]
)

Floats = NDArray[np.float64]


def fitted_box(grown: OrientedBox, views: BoxViews, parallel: bool = False) -> OrientedBox | None:
    """`grown` moved, resized and turned to agree with the views; None without a solution.

    A box that is `parallel` to walls is hardly turned.
    """
    fit = _Fit(grown, views, _PARALLEL if parallel else _TURN)
    state = np.array([*grown.centre, *grown.extent, grown.yaw])
    for _ in range(_STEPS):
        states = np.concatenate([state[None], state + np.eye(7) * _DELTA])
        residuals = fit.residuals(states)
        if not np.isfinite(residuals).all():
            return None
        weighted = residuals / np.sqrt(np.maximum(np.abs(residuals[0]), 1.0))
        slope = (weighted[1:] - weighted[0]).T / _DELTA
        step = np.linalg.solve(slope.T @ slope + np.eye(7), -slope.T @ weighted[0])
        state = state + np.clip(step, -_MAX_STEP, _MAX_STEP)
        state[3:6] = np.maximum(state[3:6], _MIN_SIDE)
        if np.abs(step).max() < _CLOSE:
            break
    x, y, yaw = along_nearest_axes(state[3], state[4], state[6])
    return OrientedBox(state[:3], np.array([x, y, state[5]]), float(yaw))


class _Fit:
    """Residuals of a box against the views of a thing and the box grown from the surface."""

    def __init__(self, grown: OrientedBox, views: BoxViews, turn: float) -> None:
        self._grown, self._views, self._turn = grown, views, turn
        relative = along(views.cameras - grown.centre, grown.yaw)
        before = np.stack([relative < -grown.extent / 2 - 0.1, relative > grown.extent / 2 + 0.1])
        seen = before.mean(1) > _LOOKS
        self._faces = np.where(seen, _SEEN, _HIDDEN)  # (2, 3) [m]
        share, pixels = _EDGE
        deviation = share * np.tile(views.sides, 2) + pixels
        self._edges = np.sqrt(_WEIGHT / len(views)) / deviation  # (n, 4)
        self._limits = ends = np.tile(views.size - 1, 2)
        inside = np.where(views.boxes < _BORDER, 0.0, views.boxes)
        self._boxes = np.where(inside > ends + 1 - _BORDER, ends, inside)  # (n, 4)

    def residuals(self, states: Floats) -> Floats:
        """(m, 4 n + 7) differences in standard deviations, of m boxes: centre, sides, yaw."""
        m, grown = len(states), self._grown
        offset = along(states[:, :3] - grown.centre, grown.yaw)
        change = (states[:, 3:6] - grown.extent) / 2
        faces = np.stack([offset - change, offset + change], 1) / self._faces
        turn = (states[:, 6:] - grown.yaw) / self._turn
        outlines = np.clip(self._outlines(states), 0.0, self._limits)
        edges = (outlines - self._boxes) * self._edges
        return np.concatenate([edges.reshape(m, -1), faces.reshape(m, -1), turn], 1)

    def _outlines(self, states: Floats) -> Floats:
        """(m, n, 4) xyxy [px] of m boxes in n views."""
        corners = along(_CORNERS * states[:, None, 3:6], -states[:, 6:]) + states[:, None, :3]
        pixels, _ = self._views.project(corners)
        return np.concatenate([pixels.min(2), pixels.max(2)], 2)

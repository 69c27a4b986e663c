"""Box views: the boxes in which detections showed a thing, with the pose of the camera."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mapping.frames.sighting import ThingSighting
from perception.frames import Frame

MAX_VIEWS: Final = 16  # kept of each thing
#: pose (3, 4), focal lengths and principal point, width and height of the image, box, depth
NUMBERS: Final = 23
_NEAREST: Final = 0.1  # [m] depth at which a point behind the camera is taken to be

Floats = NDArray[np.float64]
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

"""Cameras of ROS messages: sensor_msgs/CameraInfo as intrinsics."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from kg.model.errors import RecordingError
from perception.camera.intrinsics import FISHEYE, FISHEYE_COEFFICIENTS, Intrinsics

#: distortion models with OpenCV's coefficients (sensor_msgs/distortion_models.h)
MODELS: Final = ("plumb_bob", "rational_polynomial", "")
COEFFICIENTS: Final = (0, 4, 5, 8, 12, 14)


def intrinsics_of(message: Any, where: str, *, rectified: bool = False) -> Intrinsics:
    """Intrinsics of a CameraInfo of ROS 1 or ROS 2.

    `rectified` says that the images are undistorted already (image_rect): they follow P instead of
    K and D. A region of interest is taken into account; binning follows from the images' size.
    Raises RecordingError, beginning with `where`, for a camera that is not calibrated or a model of
    distortion that OpenCV does not have.
    """
    if not is_calibrated(message):
        raise RecordingError(f"{where} is not calibrated (K is 0); --intrinsics FILE would work")
    K = np.asarray(_field(message, "k"), np.float64)
    P = np.asarray(_field(message, "p"), np.float64).reshape(-1)
    matrix = P.reshape(3, 4)[:, :3] if rectified and len(P) == 12 and P[0] else K.reshape(3, 3)
    fisheye = not rectified and str(message.distortion_model) in FISHEYE
    dist = () if rectified else _distortion(message, fisheye, where)
    roi = message.roi
    cropped = int(roi.width) > 0 and int(roi.height) > 0
    left, top = (int(roi.x_offset), int(roi.y_offset)) if cropped else (0, 0)
    width = int(roi.width if cropped else message.width) or None
    height = int(roi.height if cropped else message.height) or None
    return Intrinsics(
        float(matrix[0, 0]),
        float(matrix[1, 1]),
        float(matrix[0, 2]) - left,
        float(matrix[1, 2]) - top,
        width,
        height,
        dist,
        source=where,
        fisheye=fisheye,
    )


def is_calibrated(message: Any) -> bool:
    """Whether a CameraInfo has a camera matrix."""
    K = np.asarray(_field(message, "k"), np.float64).reshape(-1)
    return len(K) == 9 and bool(K[0])


def view_of(message: Any) -> NDArray[np.float64]:
    """(2,) tangents of the field of view of a calibrated CameraInfo, across and down."""
    K = np.asarray(_field(message, "k"), np.float64).reshape(3, 3)
    return np.array([message.width / K[0, 0], message.height / K[1, 1]])


def _distortion(message: Any, fisheye: bool, where: str) -> tuple[float, ...]:
    dist = tuple(float(x) for x in _field(message, "d"))
    if fisheye and (len(dist) == FISHEYE_COEFFICIENTS or not any(dist[FISHEYE_COEFFICIENTS:])):
        # some drivers fill up to five; none at all is the bare equidistant projection
        return (*dist, *(0.0,) * FISHEYE_COEFFICIENTS)[:FISHEYE_COEFFICIENTS]
    if not any(dist):
        return ()
    model = str(message.distortion_model)
    if model not in MODELS or len(dist) not in COEFFICIENTS:
        raise RecordingError(
            f"{where}: distortion {model!r} with {len(dist)} coefficients is not undone here; "
            "rectified images (image_rect) would work"
        )
    return dist


def _field(message: Any, name: str) -> Any:
    """A field that ROS 1 calls by a capital letter."""
    return getattr(message, name) if hasattr(message, name) else getattr(message, name.upper())

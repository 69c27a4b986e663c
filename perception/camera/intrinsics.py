"""Camera intrinsics with OpenCV distortion: read, checked against the images, scaled."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from kg.model.errors import RecordingError
from kg.model.regular_files import read_text
from perception.number_tables import all_numbers

JSON_NAMES = (
    "intrinsics.json",
    "camera_intrinsic.json",
    "camera_intrinsics.json",
    "camera-intrinsics.json",
    "intrinsic.json",
    "cam_params.json",
)
TEXT_NAMES = ("intrinsics.txt", "K.txt", "camera-intrinsics.txt", "intrinsic/intrinsic_color.txt")
_SHORT = {"w": "width", "h": "height", "scale": "depth_scale"}  # of NICE-SLAM
WIDEST, NARROWEST = 160.0, 1.0  # [deg] field of view that a pinhole camera can have
ASPECT_TOLERANCE = 0.01  # relative; a crop or a wrong camera is off by far more
FISHEYE = ("equidistant", "fisheye", "kannala_brandt4")  # names of one model of distortion
FISHEYE_COEFFICIENTS = 4


@dataclass(frozen=True, slots=True)
class Intrinsics:
    """A pinhole or fisheye camera; pixel (0, 0) is the centre of the top left pixel."""

    fx: float  # [px]
    fy: float
    cx: float
    cy: float
    width: int | None = None  # [px] of the images the numbers hold for; None = as the images are
    height: int | None = None
    dist: tuple[float, ...] = ()  # k1 k2 p1 p2 [k3 [k4 k5 k6]], OpenCV's order; fisheye: k1 to k4
    depth_scale: float | None = None  # depth units a metre, where the file says
    source: str = "intrinsics"  # where they come from, for messages
    fisheye: bool = False  # equidistant projection (Kannala and Brandt, PAMI 2006)

    @property
    def distorted(self) -> bool:
        """Whether its images are others than a pinhole camera's."""
        return self.fisheye or any(self.dist)

    @property
    def K(self) -> NDArray[np.float64]:  # noqa: N802 - the symbol
        """(3, 3) matrix [px]."""
        return np.array([[self.fx, 0, self.cx], [0, self.fy, self.cy], [0, 0, 1.0]])

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) [px] of the images; only of fitted intrinsics."""
        if self.width is None or self.height is None:
            raise ValueError("intrinsics of images whose size is not known yet; fit them first")
        return self.width, self.height

    def fitted(self, width: int, height: int) -> Intrinsics:
        """The same camera for images of `width` x `height` [px].

        Raises RecordingError where a number is not finite, the focal length is not positive or
        gives no field of view that a camera has, the declared size has another aspect than the
        images, or the principal point lies outside the image.
        """
        numbers = (self.fx, self.fy, self.cx, self.cy, *self.dist)
        if not np.isfinite(numbers).all():
            raise RecordingError(f"{self.source}: fx, fy, cx, cy and dist must be finite numbers")
        if min(self.fx, self.fy) <= 0:
            raise RecordingError(
                f"{self.source}: focal lengths must be positive, got fx {self.fx:g}, fy {self.fy:g}"
            )
        declared = (
            width if self.width is None else self.width,
            height if self.height is None else self.height,
        )
        if min(declared) <= 0:
            raise RecordingError(
                f"{self.source}: the image size must be positive, got {declared[0]}x{declared[1]}"
            )
        sx, sy = width / declared[0], height / declared[1]
        if abs(sx / sy - 1) > ASPECT_TOLERANCE:
            raise RecordingError(
                f"{self.source}: made for {declared[0]}x{declared[1]} images, these are "
                f"{width}x{height}: another aspect, so another camera or a crop"
            )
        cx, cy = (self.cx + 0.5) * sx - 0.5, (self.cy + 0.5) * sy - 0.5
        if not (0 <= cx < width and 0 <= cy < height):
            raise RecordingError(
                f"{self.source}: the principal point ({cx:g}, {cy:g}) lies outside the "
                f"{width}x{height} images"
            )
        fx, fy = self.fx * sx, self.fy * sy
        for name, focal, pixels in (("fx", fx, width), ("fy", fy, height)):
            view = float(np.degrees(2 * np.arctan(pixels / (2 * focal))))
            if not NARROWEST <= view <= WIDEST:
                raise RecordingError(
                    f"{self.source}: {name} {focal:g} px over {pixels} px is a field of view of "
                    f"{view:.3g} degrees; focal lengths are in pixels of the colour images"
                )
        return replace(self, fx=fx, fy=fy, cx=cx, cy=cy, width=width, height=height)


def intrinsics_from_matrix(K: NDArray[np.float64], source: str) -> Intrinsics:
    """Intrinsics from a (3, 3) matrix; raises RecordingError if it is no pinhole matrix."""
    if K.shape != (3, 3):
        raise RecordingError(f"{source}: K must be a 3x3 matrix, got shape {K.shape}")
    if not np.isfinite(K).all():
        raise RecordingError(f"{source}: K holds a number that is not finite")
    if not np.allclose([K[1, 0], K[2, 0], K[2, 1], K[2, 2] - 1], 0, atol=1e-6):
        raise RecordingError(f"{source}: K must be [fx 0 cx; 0 fy cy; 0 0 1], got {K.tolist()}")
    fx, fy, cx, cy = (float(x) for x in (K[0, 0], K[1, 1], K[0, 2], K[1, 2]))
    return Intrinsics(fx, fy, cx, cy, source=source)


def load_intrinsics(path: Path) -> Intrinsics:
    """Intrinsics from a file.

    JSON: fx fy cx cy, optionally width height dist distortion_model depth_scale; or Open3D's
    `intrinsic_matrix` (nine numbers, column by column), or NICE-SLAM's `camera`. Text: a 3x3 or 4x4
    matrix, or `fx fy cx cy [depth_factor [width height]]`. Raises RecordingError for anything else.
    """
    if path.suffix == ".json":
        return _from_json(path)
    numbers = all_numbers(path)
    if numbers.size == 16:
        numbers = numbers.reshape(4, 4)[:3, :3].ravel()
    if numbers.size == 9:
        return intrinsics_from_matrix(numbers.reshape(3, 3), str(path))
    if numbers.size not in (4, 5, 7):
        raise RecordingError(
            f"{path}: expected a 3x3 matrix or fx fy cx cy [depth_factor [width height]], "
            f"got {numbers.size} numbers"
        )
    fx, fy, cx, cy = (float(x) for x in numbers[:4])
    scale = float(numbers[4]) if numbers.size > 4 else None
    width, height = (int(x) for x in numbers[5:7]) if numbers.size == 7 else (None, None)
    return Intrinsics(fx, fy, cx, cy, width, height, depth_scale=scale, source=str(path))


def _from_json(path: Path) -> Intrinsics:
    wanted = "JSON with fx, fy, cx, cy (and width, height, dist, depth_scale), or intrinsic_matrix"
    try:
        card = json.loads(read_text(path))
    except OSError as error:
        raise RecordingError(f"cannot read {path}: {error.strerror}") from error
    except (ValueError, RecursionError) as error:
        raise RecordingError(f"{path}: expected {wanted}: {error}") from error
    if not isinstance(card, dict):
        raise RecordingError(f"{path}: expected {wanted}")
    inner = card.get("camera")
    if isinstance(inner, dict):
        card = inner | {_SHORT[key]: value for key, value in inner.items() if key in _SHORT}
    # programs write null for what they do not know
    card = {key: value for key, value in card.items() if value is not None}
    try:
        if "intrinsic_matrix" in card:
            m = [float(x) for x in card["intrinsic_matrix"]]
            fx, fy, cx, cy = m[0], m[4], m[6], m[7]
        else:
            fx, fy, cx, cy = (float(card[key]) for key in ("fx", "fy", "cx", "cy"))
        sized = "width" in card
        width, height = (int(card["width"]), int(card["height"])) if sized else (None, None)
        scale = float(card["depth_scale"]) if "depth_scale" in card else None
        dist = tuple(float(x) for x in card.get("dist", ()))
    except KeyError as error:
        raise RecordingError(f"{path}: expected {wanted}; {error.args[0]} is missing") from error
    except (ValueError, TypeError, IndexError, OverflowError) as error:
        raise RecordingError(f"{path}: expected {wanted}: {error}") from error
    fisheye = card.get("distortion_model") in FISHEYE
    if fisheye and len(dist) != FISHEYE_COEFFICIENTS:
        raise RecordingError(f"{path}: dist of a fisheye holds 4 coefficients, got {len(dist)}")
    if len(dist) not in (0, 4, 5, 8):
        raise RecordingError(f"{path}: dist holds 4, 5 or 8 coefficients, got {len(dist)}")
    return Intrinsics(fx, fy, cx, cy, width, height, dist, scale, str(path), fisheye)


def find_intrinsics(folder: Path) -> Intrinsics | None:
    """Intrinsics from the first file of a known name in `folder`, or None."""
    for name in (*JSON_NAMES, *TEXT_NAMES):
        if (folder / name).is_file():
            return load_intrinsics(folder / name)
    return None

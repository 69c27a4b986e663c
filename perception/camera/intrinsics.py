"""Camera intrinsics with OpenCV distortion: read, checked against the images, scaled.

Rectification undoes the lens distortion, and resamples or registers depth to the image of colour.
"""

from __future__ import annotations

import contextlib
import itertools
import json
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from kg.model.errors import RecordingError
from kg.model.regular_files import read_text
from perception.number_tables import all_numbers, check_pointer, floats

JSON_NAMES = (
    "intrinsics.json",
    "camera_intrinsic.json",
    "camera_intrinsics.json",
    "camera-intrinsics.json",
    "intrinsic.json",
    "cam_params.json",
)
YAML = (".yaml", ".yml")
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
            raise RecordingError(
                f"{self.source}: fx, fy, cx, cy and dist must be finite numbers; --intrinsics FILE "
                "of such would work"
            )
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
    `intrinsic_matrix` (nine numbers, column by column), or NICE-SLAM's `camera`. YAML: as ROS'
    camera_calibration, OpenCV and ORB-SLAM write it. Text: a 3x3 or 4x4
    matrix, or `fx fy cx cy [depth_factor [width height]]`. Raises RecordingError for anything else.
    """
    if path.suffix == ".json":
        return _from_json(path)
    if path.suffix in YAML:
        return _from_yaml(path)
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


def yaml_matrix(path: Path, key: str) -> NDArray[np.float64] | None:
    """Numbers (n,) of the `data` of a matrix in a YAML file; None where there is no such matrix."""
    return _matrix_in(_yaml(path), key, path)


def _matrix_in(text: str, key: str, path: Path) -> NDArray[np.float64] | None:
    found = re.search(rf"^{key}\s*:.*?data\s*:\s*\[([^\]]*)\]", text, re.M | re.S)
    return (
        None if found is None else np.array(floats(found[1].replace(",", " ").split(), str(path)))
    )


def _yaml(path: Path) -> str:
    try:
        return read_text(path)
    except OSError as error:
        raise RecordingError(f"cannot read {path}: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise RecordingError(f"{path} is not a text file") from error


def _from_yaml(path: Path) -> Intrinsics:
    """The camera of a YAML file: `camera_matrix` of ROS and OpenCV, `Camera.fx` of ORB-SLAM."""
    text = _yaml(path)

    def number(names: str) -> float | None:
        found = re.search(
            rf"^\s*(?:{names})\s*:\s*(-?[\d.]+(?:[eE][-+]?\d+)?)\s*(?:#.*)?$", text, re.M
        )
        try:
            one = None if found is None else float(found[1])
        except ValueError as error:
            raise RecordingError(f"{path}: {found and found[1]} is no number") from error
        return one if one is None or abs(one) < 1e9 else None

    width, height = (
        None if (side := number(rf"image_{name}|Camera1?\.{name}")) is None else int(side)
        for name in ("width", "height")
    )
    K = _matrix_in(text, "camera_matrix", path)
    if K is not None and K.size == 9:
        camera = intrinsics_from_matrix(K.reshape(3, 3), str(path))
        dist = _matrix_in(text, "distortion_coefficients", path)
        coefficients = () if dist is None else tuple(float(x) for x in dist)
        model = re.search(r"^distortion_model\s*:\s*(\S+)", text, re.M)
        fisheye = model is not None and model[1] in FISHEYE
    else:
        fx, fy, cx, cy = (number(rf"Camera1?\.{name}|{name}") for name in ("fx", "fy", "cx", "cy"))
        if fx is None or fy is None or cx is None or cy is None:
            raise RecordingError(
                f"{path}: expected camera_matrix, or Camera.fx, Camera.fy, Camera.cx and Camera.cy"
            )
        camera = Intrinsics(fx, fy, cx, cy, source=str(path))
        names = ("k1", "k2", "p1", "p2", "k3")
        coefficients = tuple(number(rf"Camera1?\.{name}") or 0.0 for name in names)
        fisheye = "KannalaBrandt" in text
    coefficients = coefficients if any(coefficients) else ()
    if fisheye:
        coefficients = (*coefficients, *(0.0,) * FISHEYE_COEFFICIENTS)[:FISHEYE_COEFFICIENTS]
    factor = number(r"(?:RGBD\.)?DepthMapFactor")
    return replace(
        camera,
        width=width,
        height=height,
        dist=coefficients,
        depth_scale=factor or None,
        fisheye=fisheye,
    )


def _from_json(path: Path) -> Intrinsics:
    wanted = "JSON with fx, fy, cx, cy (and width, height, dist, depth_scale), or intrinsic_matrix"
    try:
        text = read_text(path)
        check_pointer(text[:100].encode(), path)
        card = json.loads(text)
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
    for path in sorted(one for one in folder.glob("*.y*ml") if one.suffix in YAML):
        with contextlib.suppress(RecordingError):  # files of other things
            return load_intrinsics(path)
    return None


@dataclass(frozen=True, slots=True)
class Rectifier:
    """Rectification of one camera's colour and depth onto colour's undistorted pixel grid.

    Depth of another size than colour is resampled to colour's (nearest, since averaging across an
    edge invents points in mid air); the two must have one aspect, as registered images have.
    """

    camera: Intrinsics  # fitted to the colour image
    maps: tuple[NDArray[np.float32], NDArray[np.float32]] | None  # (H, W) source column and row

    @classmethod
    def for_camera(cls, camera: Intrinsics) -> Rectifier:
        """A rectifier for intrinsics fitted to the colour image."""
        if not camera.distorted:
            return cls(camera, None)
        model = cv2.fisheye if camera.fisheye else cv2
        columns, lines = model.initUndistortRectifyMap(
            camera.K, np.array(camera.dist), np.eye(3), camera.K, camera.size, cv2.CV_32FC1
        )
        return cls(camera, (columns.astype(np.float32), lines.astype(np.float32)))

    def colour(self, rgb: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """(H, W, 3) with distortion undone, bilinear; black where the camera saw nothing."""
        if self.maps is None:
            return rgb
        return cv2.remap(rgb, *self.maps, cv2.INTER_LINEAR).astype(np.uint8, copy=False)

    def undistorted(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Points (n, 2) [px] of the camera's own image in the undistorted one."""
        if self.maps is None:
            return points
        model = cv2.fisheye if self.camera.fisheye else cv2
        K, dist = self.camera.K, np.array(self.camera.dist)
        found = model.undistortPoints(points.reshape(-1, 1, 2), K, dist, P=K)
        return np.asarray(found, np.float64).reshape(-1, 2)

    def depth(self, depth: NDArray[np.float32]) -> NDArray[np.float32]:
        """(H, W) [m] at the colour image's size with distortion undone, nearest."""
        size = self.camera.size
        if depth.shape[::-1] != size:
            depth = cv2.resize(depth, size, interpolation=cv2.INTER_NEAREST_EXACT).astype(
                np.float32, copy=False
            )
        if self.maps is None:
            return depth
        return cv2.remap(
            depth, *self.maps, cv2.INTER_NEAREST, borderMode=cv2.BORDER_CONSTANT, borderValue=np.nan
        ).astype(np.float32, copy=False)


def register_depth(
    depth: NDArray[np.float32],
    K_depth: NDArray[np.float64],
    K_colour: NDArray[np.float64],
    T_colour_depth: NDArray[np.float64],
    size: tuple[int, int],
) -> NDArray[np.float32]:
    """Depth as the colour camera sees it, (H, W) [m], nan = no return.

    `depth` (h, w) [m] of the depth camera, `T_colour_depth` (4, 4) takes its coordinates to the
    colour camera's, `size` is (W, H) [px] of the colour image. Where two surfaces fall on one pixel
    the nearer wins; each point covers the pixels its own pixel spreads over (2 x 2 at most).
    """
    M = K_colour @ T_colour_depth[:3, :3] @ np.linalg.inv(K_depth)
    b = K_colour @ T_colour_depth[:3, 3]
    v, u = np.nonzero(depth > 0)
    z = depth[v, u].astype(np.float64)
    x, y, z = (z * (m[0] * u + m[1] * v + m[2]) + t for m, t in zip(M, b, strict=True))
    ahead = z > 0
    column, row, z = x[ahead] / z[ahead], y[ahead] / z[ahead], z[ahead].astype(np.float32)
    magnified = np.linalg.norm(K_colour[0, 0]) > K_depth[0, 0]  # one pixel covers several
    steps: Sequence[np.ufunc] = (np.floor, np.ceil) if magnified else (np.rint,)
    columns, rows = (
        [np.clip(step(at), -1, end).astype(np.int32) for step in steps]
        for at, end in zip((column, row), size, strict=True)
    )
    seen = np.full(size[0] * size[1], np.inf, np.float32)
    for c, r in itertools.product(columns, rows):
        inside = (c >= 0) & (c < size[0]) & (r >= 0) & (r < size[1])
        np.minimum.at(seen, (r * size[0] + c)[inside], z[inside])
    seen[np.isinf(seen)] = np.nan
    return seen.reshape(size[1], size[0])

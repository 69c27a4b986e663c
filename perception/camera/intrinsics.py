"""Camera intrinsics with OpenCV distortion: read, checked against the images, scaled.

Rectification undoes the lens distortion, and resamples or registers depth to the image of colour.
"""

from __future__ import annotations

import itertools
import json
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from kg.model.errors import RecordingError
from perception.number_tables import POINTER, all_numbers, floats, text_of

JSON_NAMES = (
    "intrinsics.json",
    "camera_intrinsic.json",
    "camera_intrinsics.json",
    "camera-intrinsics.json",
    "intrinsic.json",
    "cam_params.json",
)
YAML = (".yaml", ".yml")
TEXT_NAMES = (
    "intrinsics.txt",
    "K.txt",
    "camera-intrinsics.txt",
    "intrinsic/intrinsic_color.txt",
    "calibration.txt",  # of ETH3D's SLAM benchmark
)
#: what programs call the numbers of a camera
_NAMES: Final = {
    "fx": ("fx", "fl_x"),
    "fy": ("fy", "fl_y"),
    "cx": ("cx", "ppx"),
    "cy": ("cy", "ppy"),
    "matrix": ("camera_matrix", "intrinsic_matrix", "intrinsics", "intrinsic", "k", "cam_k"),
    "size": ("resolution", "image_size"),
    "width": ("width", "image_width", "w"),
    "height": ("height", "image_height", "h"),
    "dist": ("dist", "distortion", "distortion_coefficients", "distortion_coeffs", "dist_coeffs",
             "dist_coeff", "coeffs", "d"),
    "model": ("distortion_model", "camera_model", "model", "type"),
    "depth_scale": ("depth_scale", "depthmapfactor", "png_depth_scale", "depth_factor"),
}  # fmt: skip
_PAIR: Final = re.compile(r"\s*(?:-\s+)?([A-Za-z_][\w.]*)\s*:(?:\s+(.*))?$")
_Fields = dict[str, Any]
METRES_A_UNIT: Final = 0.1  # below which a depth scale is the metres of a unit
WIDEST, NARROWEST = 160.0, 1.0  # [deg] field of view that a pinhole camera can have
ASPECT_TOLERANCE = 0.01  # relative; a crop or a wrong camera is off by far more
_FISHEYE: Final = ("equi", "fisheye", "kannala")  # in names of one model of distortion
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
        fx, fy = self.fx * sx, self.fy * sy
        if problem := pinhole_problem(fx, fy, cx, cy, width, height):
            raise RecordingError(
                f"{self.source}: {problem}; --intrinsics FILE of the colour camera would work"
            )
        return replace(self, fx=fx, fy=fy, cx=cx, cy=cy, width=width, height=height)


def pinhole_problem(fx: float, fy: float, cx: float, cy: float, width: int, height: int) -> str:
    """Why no pinhole camera has these intrinsics [px] for images of that size; "" where one may."""
    if not np.isfinite((fx, fy, cx, cy)).all() or min(fx, fy) <= 0:
        return f"focal lengths must be positive, and all numbers finite, got fx {fx:g}, fy {fy:g}"
    if not (0 <= cx < width and 0 <= cy < height):
        return f"the principal point ({cx:g}, {cy:g}) lies outside the {width}x{height} images"
    for name, focal, pixels in (("fx", fx, width), ("fy", fy, height)):
        view = float(np.degrees(2 * np.arctan(pixels / (2 * focal))))
        if not NARROWEST <= view <= WIDEST:
            return (
                f"{name} {focal:g} px over {pixels} px is a field of view of {view:.3g} degrees; "
                "focal lengths are in pixels of the colour images"
            )
    return ""


def is_fisheye(model: str) -> bool:
    """Whether a model of distortion is that of a fisheye, by any of its names."""
    name = model.lower()
    return any(part in name for part in _FISHEYE) and "equirect" not in name


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

    JSON and YAML: fx fy cx cy or a matrix, optionally width height dist distortion_model
    depth_scale, by the names that programs give them (`_NAMES`). Text: a 3x3 or 4x4
    matrix, or `fx fy cx cy [depth_factor [width height]]`. Raises RecordingError for anything else.
    """
    if path.suffix in (".json", *YAML):
        return _from_card(path)
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
    """Numbers (n,) of a matrix in a YAML file; None where there is no such matrix."""
    found = _yaml_fields(text_of(path), path).get(key)
    return np.array(found, np.float64) if isinstance(found, list) else None


def _yaml_fields(text: str, path: Path) -> _Fields:
    """Numbers, lists of numbers and words of a YAML file by their names, without what is around.

    The last part of a name counts, as `fx` of `Camera.fx`; `data` is that of the name before. Of
    names that come again the first counts. Raises RecordingError for several cameras.
    """
    found: _Fields = {}
    name = ""
    one_line = re.sub(r"\[[^\[\]]*\]", lambda m: m[0].replace("\n", " "), text)
    for line in re.sub(r"(?m)(^|\s)#.*$", "", one_line).splitlines():
        item, pair = re.match(r"\s*-\s+([-+.\deE]*\d)\s*$", line), _PAIR.match(line)
        listed = found.get(name)
        if item and (listed is None or isinstance(listed, list)):
            found[name] = [*(listed or []), *floats([item[1]], str(path))]
        if pair is None or pair[1].lower().startswith("camera2."):
            continue
        key, value = pair[1].rpartition(".")[2].lower(), (pair[2] or "").strip()
        numbers = re.search(r"\[([^\[\]]*)\]", value)
        if not value or value.startswith("!"):
            name = key
        elif numbers:
            words = [_word(one) for one in numbers[1].replace(",", " ").split()]
            _put(found, name if key == "data" else key, words, path)
        else:
            _put(found, key, _word(value), path)
    return found


def _word(value: str) -> float | str:
    try:
        return float(value)
    except ValueError:
        return value.strip("\"'")


def _put(found: _Fields, name: str, value: Any, path: Path) -> None:
    if found.setdefault(name, value) != value and name in ("fx", "camera_matrix", "intrinsics"):
        raise RecordingError(f"{path} has several cameras; a file of colour's alone would work")


def _json_fields(card: dict[str, Any], path: Path) -> _Fields:
    """Values of a JSON object by their names; where it has no camera, those of the objects in it.

    Raises RecordingError for several cameras.
    """
    # programs write null for what they do not know
    given = {key.lower(): value for key, value in card.items() if value is not None}
    groups = {key: value for key, value in given.items() if isinstance(value, dict)}
    found = {key: value for key, value in given.items() if key not in groups}
    found |= {key: group["data"] for key, group in groups.items() if "data" in group}
    if not any(name in found for key in ("fx", "matrix") for name in _NAMES[key]):
        for key, group in groups.items():
            for name, value in _json_fields(group, path).items():
                scale = key == "camera" and name == "scale"  # of NICE-SLAM
                _put(found, "depth_scale" if scale else name, value, path)
    return found


def _camera_of(found: _Fields, path: Path) -> Intrinsics:
    """The camera of values by the names that programs give them; raises RecordingError."""

    def first(key: str) -> Any:
        return next((found[name] for name in _NAMES[key] if name in found), None)

    def numbers(key: str) -> list[float]:
        value = first(key)
        return [] if value is None else [float(x) for x in np.ravel(np.array(value, np.float64))]

    matrix, size, dist = numbers("matrix"), numbers("size"), numbers("dist")
    if len(matrix) in (9, 16):
        K = np.array(matrix).reshape(round(len(matrix) ** 0.5), -1)[:3, :3]
        K = K.T if K[2, 0] > 0 == K[0, 2] else K  # Open3D's, column by column
        camera = intrinsics_from_matrix(K, str(path))
    else:
        four = matrix if len(matrix) == 4 else [numbers(key) for key in ("fx", "fy", "cx", "cy")]
        missing = [key for key, x in zip(("fx", "fy", "cx", "cy"), four, strict=True) if x == []]
        if missing:
            raise KeyError(missing[0])
        fx, fy, cx, cy = (float(np.array(x).item()) for x in four)
        camera = Intrinsics(fx, fy, cx, cy, source=str(path))
    width, height = size if len(size) == 2 else (first("width"), first("height"))
    word = " ".join(str(found[name]) for name in _NAMES["model"] if name in found).lower()
    fisheye = is_fisheye(word)
    if not dist:
        names = ("k1", "k2", "k3", "k4") if fisheye else ("k1", "k2", "p1", "p2", "k3")
        dist = [float(found.get(name, 0.0)) for name in names]
    if fisheye and len(dist) != FISHEYE_COEFFICIENTS:
        raise RecordingError(f"{path}: dist of a fisheye holds 4 coefficients, got {len(dist)}")
    if any(dist) and len(dist) not in (4, 5, 8):
        raise RecordingError(f"{path}: dist holds 4, 5 or 8 coefficients, got {len(dist)}")
    scale = next(iter(numbers("depth_scale")), None)
    return replace(
        camera,
        width=None if width is None else int(width),
        height=None if height is None else int(height),
        dist=tuple(dist) if any(dist) else (),
        depth_scale=1 / scale if scale and 0 < scale < METRES_A_UNIT else scale,
        fisheye=fisheye,
    )


def _from_card(path: Path) -> Intrinsics:
    """The camera of a JSON or YAML file, by the names of `_NAMES`."""
    yaml = path.suffix in YAML
    names = "fx, fy, cx, cy (and width, height, dist, depth_scale), or a matrix"
    wanted = f"expected {'YAML' if yaml else 'JSON'} with {names} such as camera_matrix"
    text = text_of(path)
    try:
        found = _yaml_fields(text, path) if yaml else _json_fields(json.loads(text), path)
        return _camera_of({k: v for k, v in found.items() if not (yaml and v == 0)}, path)
    except KeyError as error:
        raise RecordingError(f"{path}: {wanted}; {error.args[0]} is missing") from error
    except (ValueError, TypeError, AttributeError, OverflowError, RecursionError) as error:
        raise RecordingError(f"{path}: {wanted}: {error}") from error


def find_intrinsics(folder: Path) -> Intrinsics | None:
    """Intrinsics from the first file of a known name in `folder`, or None."""
    for name in (*JSON_NAMES, *TEXT_NAMES):
        if (folder / name).is_file():
            return load_intrinsics(folder / name)
    for path in sorted(one for one in folder.glob("*.y*ml") if one.suffix in YAML):
        try:
            return load_intrinsics(path)
        except RecordingError as error:  # files of other things
            if POINTER in str(error):
                raise
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

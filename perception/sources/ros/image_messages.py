"""ROS messages of cameras as arrays: Image, CompressedImage, RVL's depth, CameraInfo.

Encodings: sensor_msgs/image_encodings.h. Depth is 16-bit in millimetres or 32-bit floats in metres,
as REP 118 has it. compressedDepth (compressed_depth_image_transport) is a PNG, or width, height and
RVL, behind a header of 12 bytes; floats are kept as quantised inverse depth. Bayer mosaics become
colour by bilinear interpolation.
"""

from __future__ import annotations

import re
import struct
from dataclasses import dataclass
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from kg.model.errors import RecordingError
from perception.camera.image_decoding import MAX_PIXELS, decode_image
from perception.camera.intrinsics import FISHEYE_COEFFICIENTS, Intrinsics, is_fisheye

GROUPS: Final = 11  # of a number of 32 bits
#: [bytes] a pixel: 6 groups for its difference, 2 for the lengths of runs as short as it
MAX_BYTES_PER_PIXEL: Final = 4


def decode_rvl(data: NDArray[np.uint8], pixels: int, where: str) -> NDArray[np.uint16]:
    """(pixels,) depth of a stream (n,) of bytes.

    Raises RecordingError, beginning with `where`, where it does not hold as many.
    """
    numbers = _numbers(data[: MAX_BYTES_PER_PIXEL * (pixels + 2)], where)
    runs: list[tuple[int, int, int]] = []  # of pixels that are not 0: first, count, first's number
    place, filled = 0, 0
    while filled < pixels and place + 2 <= len(numbers):
        zeros, count = int(numbers[place]), int(numbers[place + 1])
        runs.append((filled + zeros, count, place + 2))
        filled += zeros + count
        place += 2 + count
    if filled > pixels:
        raise RecordingError(f"{where}: RVL depth does not end with its {pixels} pixels")
    if filled < pixels or place > len(numbers):
        raise RecordingError(f"{where}: RVL depth is cut short before its {pixels} pixels")
    first, counts, at = np.array(runs, np.int64).reshape(-1, 3).T
    along = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    coded = numbers[np.repeat(at, counts) + along]
    depth = np.zeros(pixels, np.uint16)
    depth[np.repeat(first, counts) + along] = np.cumsum((coded >> 1) ^ -(coded & 1)) & 0xFFFF
    return depth


def _numbers(data: NDArray[np.uint8], where: str) -> NDArray[np.int64]:
    """All numbers of a stream; zeros may follow that fill its last word."""
    pairs = data[: len(data) // 4 * 4].reshape(-1, 4)[:, ::-1].ravel()
    groups = np.stack([pairs >> 4, pairs & 15], axis=1).ravel()
    ends = np.flatnonzero(groups < 8)
    if not len(ends):
        return np.zeros(0, np.int64)
    starts = np.concatenate([[0], ends[:-1] + 1])
    lengths = ends - starts + 1
    if lengths.max() > GROUPS:
        raise RecordingError(f"{where}: RVL depth holds a number of more than 32 bits")
    digits = np.arange(ends[-1] + 1) - np.repeat(starts, lengths)
    bits = (groups[: ends[-1] + 1] & 7).astype(np.int64) << 3 * digits
    numbers: NDArray[np.int64] = np.add.reduceat(bits, starts)
    return numbers


#: by the colours of the first two rows' first two pixels; OpenCV calls a mosaic by its second row
_MOSAICS: Final = {
    "bayer_rggb": cv2.COLOR_BayerBG2RGB,
    "bayer_bggr": cv2.COLOR_BayerRG2RGB,
    "bayer_gbrg": cv2.COLOR_BayerGR2RGB,
    "bayer_grbg": cv2.COLOR_BayerGB2RGB,
}
#: luminance of all pixels, then colour of each square of four
_PLANAR: Final = {
    "nv12": cv2.COLOR_YUV2RGB_NV12,
    "nv21": cv2.COLOR_YUV2RGB_NV21,
    "i420": cv2.COLOR_YUV2RGB_I420,
}
#: encodings of colour: type, channels, and what makes RGB of them
_COLOUR: Final[dict[str, tuple[type, int, int | None]]] = {
    "rgb8": (np.uint8, 3, None),
    "bgr8": (np.uint8, 3, cv2.COLOR_BGR2RGB),
    "8UC3": (np.uint8, 3, cv2.COLOR_BGR2RGB),
    "rgba8": (np.uint8, 4, cv2.COLOR_RGBA2RGB),
    "bgra8": (np.uint8, 4, cv2.COLOR_BGRA2RGB),
    "8UC4": (np.uint8, 4, cv2.COLOR_BGRA2RGB),
    "rgb16": (np.uint16, 3, None),
    "bgr16": (np.uint16, 3, cv2.COLOR_BGR2RGB),
    "mono8": (np.uint8, 1, cv2.COLOR_GRAY2RGB),
    "8UC1": (np.uint8, 1, cv2.COLOR_GRAY2RGB),
    "yuv422": (np.uint8, 2, cv2.COLOR_YUV2RGB_UYVY),
    "uyvy": (np.uint8, 2, cv2.COLOR_YUV2RGB_UYVY),
    "yuv422_yuy2": (np.uint8, 2, cv2.COLOR_YUV2RGB_YUY2),
    "yuyv": (np.uint8, 2, cv2.COLOR_YUV2RGB_YUY2),
    **{name: (np.uint8, 1, code) for name, code in _PLANAR.items()},
    **{
        f"{mosaic}{8 * np.dtype(type_).itemsize}": (type_, 1, code)
        for mosaic, code in _MOSAICS.items()
        for type_ in (np.uint8, np.uint16)
    },
}
_DEPTH: Final[dict[str, type]] = {
    "16UC1": np.uint16, "mono16": np.uint16, "16SC1": np.int16, "32FC1": np.float32
}  # fmt: skip
_DEPTH_HEADER: Final = struct.Struct("<iff")  # format, then the two parameters of the quantisation
_SIZE: Final = struct.Struct("<II")  # width, height of RVL depth
_VIDEO: Final = re.compile("h\\.?26[45]|hevc|avc|av1|vp[89]|theora|mpeg")
_PNG: Final = b"\x89PNG"
_RVL: Final = b"DEPTHRVL"


@dataclass(frozen=True, slots=True)
class ImageKind:
    """Content of a message, by its fields."""

    encoding: str  # where it is raw or compressedDepth; "" where only its bytes say it
    compression: str  # "" (raw), "jpeg", "png", "rvl", "compressedDepth", "video"
    size: tuple[int, int] | None  # (W, H) [px]; None where only its bytes say it

    @property
    def is_depth(self) -> bool:
        """Whether it may be depth."""
        return self.compression == "compressedDepth" or self.encoding in _DEPTH


def image_kind(message: Any) -> ImageKind:
    """Kind of a sensor_msgs/Image or CompressedImage."""
    if hasattr(message, "encoding"):
        return ImageKind(_encoding(message), "", (int(message.width), int(message.height)))
    # "bgr8; jpeg compressed bgr8", "16UC1; compressedDepth png", "png", "jpeg"
    given = str(message.format)
    encoding = given.split(";")[0].strip() if ";" in given else ""
    if "compressedDepth" in given:
        return ImageKind(encoding, "compressedDepth", None)
    if _VIDEO.search(given.lower()):
        return ImageKind("", "video", None)
    lossless = next((kind for kind in ("png", "rvl") if kind in given.lower()), "jpeg")
    return ImageKind(encoding, lossless, None)


def colour_image(message: Any, where: str) -> NDArray[np.uint8]:
    """(H, W, 3) RGB of an Image or CompressedImage; grey images thrice.

    Raises RecordingError, beginning with `where`, for an encoding that is no colour or fields that
    contradict each other.
    """
    if not hasattr(message, "encoding"):
        flags = cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION
        return np.ascontiguousarray(decode_image(_bytes(message), flags, where)[:, :, ::-1]).astype(
            np.uint8, copy=False
        )
    encoding = _encoding(message)
    if encoding not in _COLOUR:
        raise RecordingError(
            f"{where}: encoding {encoding!r} is not read as colour; known are {', '.join(_COLOUR)}"
        )
    type_, channels, conversion = _COLOUR[encoding]
    image = _raw_image(message, type_, channels, where)
    if image.dtype == np.uint16:
        image = (image >> 8).astype(np.uint8)
    try:
        rgb = image if conversion is None else cv2.cvtColor(image, conversion)
    except cv2.error as error:
        width, height = image.shape[1::-1]
        raise RecordingError(f"{where}: {encoding} of {width}x{height} pixels is none") from error
    return np.ascontiguousarray(rgb).astype(np.uint8, copy=False)


def depth_image(message: Any, where: str) -> NDArray[np.uint16] | NDArray[np.float32]:
    """(H, W) depth as it is: uint16 [mm, unless the camera has another unit] or float32 [m].

    No return is 0 or nan. Raises RecordingError, beginning with `where`, for what is no depth.
    """
    if hasattr(message, "encoding"):
        type_ = _DEPTH.get(_encoding(message))
        if type_ is None:
            raise RecordingError(
                f"{where}: encoding {message.encoding!r} is not depth; known are "
                f"{', '.join(_DEPTH)}"
            )
        image = _raw_image(message, type_, 1, where)
        return np.maximum(image, 0).astype(np.uint16) if type_ is np.int16 else image
    kind, data = image_kind(message), _bytes(message)
    if kind.compression == "compressedDepth":
        return _compressed_depth(data, kind.encoding, "rvl" in message.format, where)
    return rtabmap_depth(data, where)


def rtabmap_depth(data: NDArray[np.uint8], where: str) -> NDArray[np.uint16] | NDArray[np.float32]:
    """(H, W) depth of a PNG of 16 bits, or as RTAB-Map keeps it: RVL, or a PNG of floats' bytes."""
    if data[: len(_RVL)].tobytes() == _RVL:
        return decode_sized_rvl(data[len(_RVL) :], where)
    image = decode_image(data, cv2.IMREAD_UNCHANGED, where)
    if image.ndim == 3 and image.shape[2] == 4 and image.dtype == np.uint8:
        return np.ascontiguousarray(image).view(np.float32)[:, :, 0]
    return _one_channel(image, where)


def _encoding(message: Any) -> str:
    """Encoding of an Image; some drivers write it in capitals, or as their own."""
    given = str(message.encoding)
    lower = given.lower()
    return given if given in _COLOUR or given in _DEPTH else {"z16": "16UC1"}.get(lower, lower)


def _bytes(message: Any) -> NDArray[np.uint8]:
    return np.frombuffer(memoryview(message.data), np.uint8)


def _raw_image(message: Any, type_: type, channels: int, where: str) -> NDArray[Any]:
    """(H, W) or (H, W, C) without the padding of its rows, in this machine's byte order."""
    height, width, step = int(message.height), int(message.width), int(message.step)
    item = np.dtype(type_).newbyteorder(">" if message.is_bigendian else "<")
    row = width * channels * item.itemsize
    data = _bytes(message)
    _check_size(width, height, where)
    if _encoding(message) in _PLANAR:
        return _planes(data, width, height, where)
    if step in (0, width) and len(data) == row * height:  # drivers leave it out, or count pixels
        step = row
    if step < row or len(data) < step * (height - 1) + row:
        raise RecordingError(
            f"{where}: {len(data)} bytes in rows of {step} are no {width}x{height} image of "
            f"{message.encoding}"
        )
    # the last row may lack its padding
    rows = np.lib.stride_tricks.as_strided(data, (height, row), (step, 1), writeable=False)
    pixels = rows.copy().view(item)
    shape = (height, width) if channels == 1 else (height, width, channels)
    return pixels.reshape(shape).astype(type_, copy=False)


def _planes(data: NDArray[np.uint8], width: int, height: int, where: str) -> NDArray[np.uint8]:
    """(3 H / 2, W) of an image whose colour follows its luminance."""
    size = width * height * 3 // 2
    if width % 2 or height % 2 or len(data) < size:
        raise RecordingError(f"{where}: {len(data)} bytes are no {width}x{height} planar image")
    return data[:size].reshape(height * 3 // 2, width)


def _compressed_depth(
    data: NDArray[np.uint8], encoding: str, is_rvl: bool, where: str
) -> NDArray[np.uint16] | NDArray[np.float32]:
    if bytes(data[:4]) == _PNG:  # some write a plain PNG under this name
        return _one_channel(decode_image(data, cv2.IMREAD_UNCHANGED, where), where)
    header, body = bytes(data[: _DEPTH_HEADER.size]), data[_DEPTH_HEADER.size :]
    if is_rvl and bytes(body[:4]) != _PNG:
        raw = decode_sized_rvl(body, where)
    elif bytes(body[:4]) == _PNG:
        raw = _one_channel(decode_image(body, cv2.IMREAD_UNCHANGED, where), where)
    else:
        raise RecordingError(f"{where}: compressedDepth holds neither PNG nor RVL")
    if encoding != "32FC1":
        return raw
    _, a, b = _DEPTH_HEADER.unpack(header)
    if not np.isfinite((a, b)).all():
        raise RecordingError(f"{where}: compressedDepth has parameters that are not finite")
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = np.float32(a) / (raw.astype(np.float32) - np.float32(b))
    depth[raw == 0] = np.nan
    return depth


def decode_sized_rvl(body: NDArray[np.uint8], where: str) -> NDArray[np.uint16]:
    """(H, W) depth of a stream that begins with its width and height; raises RecordingError."""
    if len(body) < _SIZE.size:
        raise RecordingError(f"{where}: RVL depth is cut short before its size")
    width, height = _SIZE.unpack(bytes(body[: _SIZE.size]))
    _check_size(width, height, where)
    return decode_rvl(body[_SIZE.size :], width * height, where).reshape(height, width)


def _check_size(width: int, height: int, where: str) -> None:
    if min(width, height) < 1 or width * height > MAX_PIXELS:
        raise RecordingError(f"{where}: an image of {width}x{height} pixels cannot be read")


def _one_channel(image: NDArray[Any], where: str) -> NDArray[np.uint16]:
    if image.ndim != 2 or image.dtype != np.uint16:
        raise RecordingError(
            f"{where}: depth must be one 16-bit channel, got {image.dtype} of shape {image.shape}"
        )
    return image


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
    matrix = _matrix(message, rectified)
    fisheye = not rectified and is_fisheye(str(message.distortion_model))
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
    return bool(_matrix(message)[0, 0])


def _matrix(message: Any, rectified: bool = False) -> NDArray[np.float64]:
    """K (3, 3); of rectified images P's, and where K is 0 and nothing has to be undone."""
    K = np.asarray(_field(message, "k"), np.float64)
    K = K.reshape(3, 3) if K.size == 9 else np.zeros((3, 3))
    P = np.asarray(_field(message, "p"), np.float64).reshape(-1)
    by_P = rectified or not (K[0, 0] or any(_field(message, "d")))
    return P.reshape(3, 4)[:, :3] if by_P and len(P) == 12 and P[0] else K


def view_of(message: Any) -> NDArray[np.float64]:
    """(2,) tangents of the field of view of a calibrated CameraInfo, across and down."""
    K = _matrix(message)
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


NANOSECONDS = 1_000_000_000


def nanoseconds(header: Any) -> int:
    """Stamp of a std_msgs/Header [ns]; 0 where it was not set."""
    stamp = header.stamp
    if hasattr(stamp, "nanosec"):
        return int(stamp.sec) * NANOSECONDS + int(stamp.nanosec)
    return int(stamp.secs) * NANOSECONDS + int(stamp.nsecs)


def frame_name(name: str) -> str:
    """Name of a frame without the leading slash that ROS 1 sometimes has."""
    return name.lstrip("/")

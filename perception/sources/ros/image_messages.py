"""Images of ROS messages as arrays: sensor_msgs/Image, CompressedImage, compressedDepth.

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
from perception.sources.ros.rvl import decode_rvl

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
#: type and channels of the encodings that are read
ENCODINGS: Final = {
    "rgb8": (np.uint8, 3),
    "bgr8": (np.uint8, 3),
    "rgba8": (np.uint8, 4),
    "bgra8": (np.uint8, 4),
    "8UC3": (np.uint8, 3),
    "8UC4": (np.uint8, 4),
    "rgb16": (np.uint16, 3),
    "bgr16": (np.uint16, 3),
    "mono8": (np.uint8, 1),
    "8UC1": (np.uint8, 1),
    "mono16": (np.uint16, 1),
    "16UC1": (np.uint16, 1),
    "32FC1": (np.float32, 1),
    "yuv422": (np.uint8, 2),
    "uyvy": (np.uint8, 2),
    "yuv422_yuy2": (np.uint8, 2),
    "yuyv": (np.uint8, 2),
    **dict.fromkeys(_PLANAR, (np.uint8, 1)),
    **{f"{mosaic}8": (np.uint8, 1) for mosaic in _MOSAICS},
    **{f"{mosaic}16": (np.uint16, 1) for mosaic in _MOSAICS},
}
DEPTH_ENCODINGS: Final = ("16UC1", "mono16", "32FC1")
_TO_RGB: Final = {
    "rgb8": None,
    "bgr8": cv2.COLOR_BGR2RGB,
    "8UC3": cv2.COLOR_BGR2RGB,
    "rgba8": cv2.COLOR_RGBA2RGB,
    "bgra8": cv2.COLOR_BGRA2RGB,
    "8UC4": cv2.COLOR_BGRA2RGB,
    "rgb16": None,
    "bgr16": cv2.COLOR_BGR2RGB,
    "mono8": cv2.COLOR_GRAY2RGB,
    "8UC1": cv2.COLOR_GRAY2RGB,
    "yuv422": cv2.COLOR_YUV2RGB_UYVY,
    "uyvy": cv2.COLOR_YUV2RGB_UYVY,
    "yuv422_yuy2": cv2.COLOR_YUV2RGB_YUY2,
    "yuyv": cv2.COLOR_YUV2RGB_YUY2,
    **_PLANAR,
    **{f"{mosaic}{bits}": code for mosaic, code in _MOSAICS.items() for bits in (8, 16)},
}
_DEPTH_HEADER: Final = struct.Struct("<iff")  # format, then the two parameters of the quantisation
_SIZE: Final = struct.Struct("<II")  # width, height of RVL depth
_VIDEO: Final = re.compile("h\\.?26[45]|hevc|avc|av1|vp[89]|theora|mpeg")
_PNG: Final = b"\x89PNG"


@dataclass(frozen=True, slots=True)
class ImageKind:
    """Content of a message, by its fields."""

    encoding: str  # of ENCODINGS, where it is raw or compressedDepth; "" if its bytes say it
    compression: str  # "" (raw), "jpeg", "png", "compressedDepth", "video"
    size: tuple[int, int] | None  # (W, H) [px]; None where only its bytes say it

    @property
    def is_depth(self) -> bool:
        """Whether it may be depth."""
        return self.compression == "compressedDepth" or self.encoding in DEPTH_ENCODINGS


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
    return ImageKind(encoding, "png" if "png" in given.lower() else "jpeg", None)


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
    if encoding not in _TO_RGB:
        raise RecordingError(
            f"{where}: encoding {encoding!r} is not read as colour; known are {', '.join(_TO_RGB)}"
        )
    image = _raw_image(message, where)
    conversion = _TO_RGB[encoding]
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
        if _encoding(message) not in DEPTH_ENCODINGS:
            raise RecordingError(
                f"{where}: encoding {message.encoding!r} is not depth; "
                f"known are {', '.join(DEPTH_ENCODINGS)}"
            )
        return _raw_image(message, where)
    kind, data = image_kind(message), _bytes(message)
    if kind.compression == "compressedDepth":
        return _compressed_depth(data, kind.encoding, "rvl" in message.format, where)
    return _one_channel(decode_image(data, cv2.IMREAD_UNCHANGED, where), where)


def _encoding(message: Any) -> str:
    """Encoding of an Image; some drivers write it in capitals, or as their own."""
    given = str(message.encoding)
    lower = given.lower()
    return given if given in ENCODINGS else {"z16": "16UC1"}.get(lower, lower)


def _bytes(message: Any) -> NDArray[np.uint8]:
    return np.frombuffer(memoryview(message.data), np.uint8)


def _raw_image(message: Any, where: str) -> NDArray[Any]:
    """(H, W) or (H, W, C) without the padding of its rows, in this machine's byte order."""
    height, width, step = int(message.height), int(message.width), int(message.step)
    encoding = _encoding(message)
    type_, channels = ENCODINGS[encoding]
    item = np.dtype(type_).newbyteorder(">" if message.is_bigendian else "<")
    row = width * channels * item.itemsize
    data = _bytes(message)
    _check_size(width, height, where)
    if encoding in _PLANAR:
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
        raw = _rvl(body, where)
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


def _rvl(body: NDArray[np.uint8], where: str) -> NDArray[np.uint16]:
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

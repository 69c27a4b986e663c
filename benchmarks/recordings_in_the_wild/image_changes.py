"""Changes of a robot's images: encodings, compressions, units, a depth camera beside."""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.recordings_in_the_wild.robot import (
    COLOUR,
    COMPRESSED,
    DEPTH,
    DEPTH_INFO,
    INFO,
    OPTICAL,
    STATIC,
    TF,
    Change,
    Message,
    Messages,
    changed,
    framed,
    image,
    transform,
)


def each(topic: str, change: Callable[[Message], Message]) -> Change:
    """A change of the messages of one topic."""
    return lambda messages: [change(m) if m.topic == topic else m for m in messages]


def rgb_of(message: Message) -> NDArray[np.uint8]:
    """Pixels of a message of COLOUR as the robot records it."""
    f = message.fields
    return np.asarray(f["data"], np.uint8).reshape(f["height"], f["width"], 3)


def depth_of(message: Message) -> NDArray[np.uint16]:
    """Millimetres of a message of DEPTH as the robot records it."""
    f = message.fields
    return f["data"].view(np.uint16).reshape(f["height"], f["width"])


def packed(message: Message, array: NDArray[Any], encoding: str, **more: Any) -> Message:
    """A message of an image with other pixels."""
    f = message.fields
    stamp = f["header"]["stamp"]
    ns = stamp["sec"] * 10**9 + stamp["nanosec"]
    fields = image(ns, f["header"]["frame_id"], array, encoding)
    fields |= {
        "height": f["height"],
        "width": f["width"],
        "step": fields["data"].size // f["height"],
    }
    return changed(message, **(fields | more))


def _yuv(rgb: NDArray[np.uint8], first: int) -> NDArray[np.uint8]:
    """(H, W, 2) YUV 4:2:2; `first` is the byte of a pair at which luminance is."""
    yuv = cv2.cvtColor(rgb, cv2.COLOR_RGB2YUV)
    out = np.empty((*rgb.shape[:2], 2), np.uint8)
    out[:, :, first] = yuv[:, :, 0]
    out[:, 0::2, 1 - first] = yuv[:, 0::2, 1]
    out[:, 1::2, 1 - first] = yuv[:, 0::2, 2]
    return out


def _nv12(rgb: NDArray[np.uint8]) -> NDArray[np.uint8]:
    planes = cv2.cvtColor(rgb, cv2.COLOR_RGB2YUV_I420)
    height, width = rgb.shape[:2]
    chroma = planes[height:].reshape(2, -1).T.reshape(height // 2, width)
    return np.vstack([planes[:height], chroma])


def _bayer(rgb: NDArray[np.uint8], rows: tuple[str, str]) -> NDArray[np.uint8]:
    out = np.empty(rgb.shape[:2], np.uint8)
    for y, row in enumerate(rows):
        for x, letter in enumerate(row):
            out[y::2, x::2] = rgb[y::2, x::2, "rgb".index(letter)]
    return out


def _alpha(rgb: NDArray[np.uint8]) -> NDArray[np.uint8]:
    return np.dstack([rgb, np.full(rgb.shape[:2], 255, np.uint8)])


COLOURS: Final[dict[str, Callable[[NDArray[np.uint8]], NDArray[Any]]]] = {
    "bgr8": lambda rgb: rgb[:, :, ::-1],
    "8UC3": lambda rgb: rgb[:, :, ::-1],
    "rgba8": _alpha,
    "bgra8": lambda rgb: _alpha(rgb[:, :, ::-1]),
    "8UC4": lambda rgb: _alpha(rgb[:, :, ::-1]),
    "rgb16": lambda rgb: rgb.astype(np.uint16) * 257,
    "mono8": lambda rgb: cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY),
    "bayer_rggb8": lambda rgb: _bayer(rgb, ("rg", "gb")),
    "bayer_grbg8": lambda rgb: _bayer(rgb, ("gr", "bg")),
    "yuv422": lambda rgb: _yuv(rgb, 1),
    "uyvy": lambda rgb: _yuv(rgb, 1),
    "yuv422_yuy2": lambda rgb: _yuv(rgb, 0),
    "yuyv": lambda rgb: _yuv(rgb, 0),
    "nv12": _nv12,
}


def colour(encoding: str) -> Change:
    """Colour in another encoding."""
    return each(COLOUR, lambda m: packed(m, COLOURS[encoding](rgb_of(m)), encoding))


def compressed_colour(form: str, suffix: str = "/compressed") -> Change:
    """Colour as CompressedImage of format `form`."""

    def change(m: Message) -> Message:
        ending = ".png" if "png" in form else ".jpg"
        data = cv2.imencode(ending, np.ascontiguousarray(rgb_of(m)[:, :, ::-1]))[1].ravel()
        fields = {"header": m.fields["header"], "format": form, "data": data}
        return Message(m.time, m.topic + suffix, COMPRESSED, fields)

    return each(COLOUR, change)


def depth(how: Callable[[NDArray[np.uint16]], NDArray[Any]], encoding: str, **more: Any) -> Change:
    """Depth in another encoding, made of millimetres."""
    return each(DEPTH, lambda m: packed(m, how(depth_of(m)), encoding, **more))


def metres(mm: NDArray[np.uint16]) -> NDArray[np.float32]:
    """Depth as 32FC1, nan = no return."""
    out = mm.astype(np.float32) / np.float32(1000)
    out[mm == 0] = np.nan
    return out


def big_endian(mm: NDArray[np.uint16]) -> NDArray[Any]:
    """Depth in the other byte order."""
    return mm.astype(">u2")


def padded(messages: Messages) -> Messages:
    """Rows of depth with 32 bytes of padding."""

    def change(m: Message) -> Message:
        mm = depth_of(m)
        rows = np.pad(mm.view(np.uint8).reshape(mm.shape[0], -1), ((0, 0), (0, 32)))
        return changed(m, data=rows.ravel(), step=rows.shape[1])

    return each(DEPTH, change)(messages)


def compressed_depth(kind: str) -> Change:
    """compressedDepth as compressed_depth_image_transport writes it: "png" or "rvl", or floats."""

    def change(m: Message) -> Message:
        mm = depth_of(m)
        head = struct.pack("<iff", 0, 0.0, 0.0)
        if kind == "float":
            a, b = 100.0 * (100.0 + 1.0), 1.0 - 100.0 * (100.0 + 1.0) / 10.0
            z = metres(mm)
            with np.errstate(invalid="ignore", divide="ignore"):
                raw = np.where(np.isfinite(z), a / z + b, 0).astype(np.uint16)
            head = struct.pack("<iff", 0, a, b)
            body = cv2.imencode(".png", raw)[1].tobytes()
            form = "32FC1; compressedDepth png"
        elif kind == "rvl":
            body = struct.pack("<II", mm.shape[1], mm.shape[0]) + rvl(mm.ravel())
            form = "16UC1; compressedDepth rvl"
        else:
            body = cv2.imencode(".png", mm)[1].tobytes()
            form = "16UC1; compressedDepth"
        data = np.frombuffer(head + body, np.uint8)
        fields = {"header": m.fields["header"], "format": form, "data": data}
        return Message(m.time, f"{m.topic}/compressedDepth", COMPRESSED, fields)

    return each(DEPTH, change)


def rvl(values: NDArray[np.uint16]) -> bytes:
    """Run length and variable length coding of depth (Wilson, 2017)."""
    nibbles, previous, at, n = list[int](), 0, 0, len(values)

    def put(value: int) -> None:
        while True:
            nibble, value = value & 7, value >> 3
            nibbles.append(nibble | (8 if value else 0))
            if not value:
                return

    numbers = values.tolist()
    while at < n:
        start = at
        while at < n and numbers[at] == 0:
            at += 1
        put(at - start)
        start = at
        while at < n and numbers[at] != 0:
            at += 1
        put(at - start)
        for value in numbers[start:at]:
            delta = value - previous
            put((delta << 1) ^ (delta >> 31))
            previous = value
    words = bytearray()
    for first in range(0, len(nibbles), 8):
        word = 0
        for nibble in nibbles[first : first + 8]:
            word = word << 4 | nibble
        word <<= 4 * (8 - len(nibbles[first : first + 8]))
        words += struct.pack("<I", word)
    return bytes(words)


def depth_apart(messages: Messages, *, tell: bool = True) -> Messages:
    """Depth of a camera 5 cm beside, with another focal length; tf says so, or does not."""
    out, focal = Messages(), 1.1
    beside = np.eye(4)
    beside[0, 3] = 0.05
    for m in messages:
        if m.topic == DEPTH:
            mm = depth_of(m)
            m = packed(m, seen_from_beside(mm, _camera(messages), focal, 0.05), "16UC1")
        if m.topic == DEPTH_INFO:
            K = np.array(m.fields["k"]).reshape(3, 3).copy()
            K[0, 0] *= focal
            K[1, 1] *= focal
            m = changed(m, k=K.ravel())
        out.append(framed(m, "depth_lens") if tell and m.topic in (DEPTH, DEPTH_INFO) else m)
    if tell:
        first = out[0].time
        out.insert(0, Message(first, STATIC, TF, transform(first, OPTICAL, "depth_lens", beside)))
    return out


def _camera(messages: Messages) -> NDArray[np.float64]:
    return np.array(next(m for m in messages if m.topic == INFO).fields["k"]).reshape(3, 3)


def seen_from_beside(
    mm: NDArray[np.uint16], K: NDArray[np.float64], focal: float, right: float
) -> NDArray[np.uint16]:
    """Depth as a camera sees it that sits so many metres to the right."""
    v, u = np.nonzero(mm)
    z = mm[v, u] / 1000.0
    x = (u - K[0, 2]) / K[0, 0] * z - right
    y = (v - K[1, 2]) / K[1, 1] * z
    uu = np.round(x / z * K[0, 0] * focal + K[0, 2]).astype(int)
    vv = np.round(y / z * K[1, 1] * focal + K[1, 2]).astype(int)
    inside = (uu >= 0) & (uu < mm.shape[1]) & (vv >= 0) & (vv < mm.shape[0])
    out = np.zeros(mm.shape, np.uint16)
    order = np.argsort(-z[inside])
    out[vv[inside][order], uu[inside][order]] = mm[v, u][inside][order]
    # points of one surface leave gaps where they spread
    return np.where(out == 0, cv2.dilate(out, np.ones((3, 3), np.uint8)), out).astype(np.uint16)

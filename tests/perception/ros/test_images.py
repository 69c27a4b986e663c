"""Images of messages are what a camera saw, whatever their encoding."""

from __future__ import annotations

import struct
from types import SimpleNamespace as Message

import cv2
import numpy as np
import pytest

from kg.errors import RecordingError
from perception.camera.image_decoding import metres
from perception.ros.images import colour_image, depth_image, image_kind
from tests.perception.ros.messages import header, image

RGB = np.random.default_rng(0).integers(0, 255, (6, 5, 3), np.uint8)
MM = np.array([[0, 500, 1234], [65535, 7000, 1]], np.uint16)


@pytest.mark.parametrize("padding", [0, 3])
@pytest.mark.parametrize(
    ("encoding", "stored"),
    [
        ("rgb8", RGB),
        ("bgr8", RGB[:, :, ::-1]),
        ("8UC3", RGB[:, :, ::-1]),
        ("rgba8", np.dstack([RGB, np.full((6, 5), 9, np.uint8)])),
        ("bgra8", np.dstack([RGB[:, :, ::-1], np.full((6, 5), 9, np.uint8)])),
    ],
)
def test_colour_of_every_encoding(encoding: str, stored: np.ndarray, padding: int) -> None:
    assert np.array_equal(colour_image(image(stored, encoding, padding=padding), "here"), RGB)


def test_grey_is_colour_three_times() -> None:
    grey = RGB[:, :, 0]
    assert np.array_equal(colour_image(image(grey, "mono8"), "here"), np.dstack([grey] * 3))


@pytest.mark.parametrize("big", [False, True])
@pytest.mark.parametrize("padding", [0, 8])
def test_depth_of_every_encoding(big: bool, padding: int) -> None:
    for encoding in ("16UC1", "mono16"):
        assert np.array_equal(
            depth_image(image(MM, encoding, padding=padding, big=big), "here"), MM
        )
    floats = np.array([[0.5, np.nan, np.inf], [-1, 0, 3.25]], np.float32)
    read = depth_image(image(floats, "32FC1", padding=padding, big=big), "here")
    assert np.array_equal(read, floats, equal_nan=True)
    wanted = np.array([[0.5, np.nan, np.nan], [np.nan, np.nan, 3.25]], np.float32)
    assert np.array_equal(metres(read, 1000.0), wanted, equal_nan=True)
    assert metres(read, 1e6)[0, 0] == np.float32(0.0005)  # floats that are millimetres


@pytest.mark.parametrize(("suffix", "exact"), [(".png", True), (".jpg", False)])
def test_compressed_colour(suffix: str, exact: bool) -> None:
    smooth = np.zeros((16, 16, 3), np.uint8)
    smooth[:, :, 0] = 200
    data = cv2.imencode(suffix, smooth[:, :, ::-1])[1].tobytes()
    read = colour_image(Message(header=header(), format="jpeg", data=data), "here")
    assert np.abs(read.astype(int) - smooth).max() <= (0 if exact else 6)


def png(array: np.ndarray) -> bytes:
    return cv2.imencode(".png", array)[1].tobytes()


def test_compressed_depth_in_millimetres() -> None:
    data = struct.pack("<iff", 0, 0, 0) + png(MM)
    message = Message(header=header(), format="16UC1; compressedDepth png", data=data)
    assert np.array_equal(depth_image(message, "here"), MM)
    assert image_kind(message).is_depth
    plain = Message(header=header(), format="16UC1; png compressed ", data=png(MM))
    assert np.array_equal(depth_image(plain, "here"), MM)
    assert image_kind(plain).is_depth


def test_compressed_depth_of_floats_is_quantised_inverse_depth() -> None:
    """compressed_depth_image_transport: raw = A / depth + B; A = z (z + 1), B = 1 - A / max."""
    z, farthest = 100.0, 10.0
    a = z * (z + 1)
    b = 1 - a / farthest
    depth = np.array([[0.5, 1.0, np.nan], [2.0, 4.0, 9.0]], np.float32)
    with np.errstate(invalid="ignore"):
        raw = np.nan_to_num(a / depth + b).astype(np.uint16)
    data = struct.pack("<iff", 0, a, b) + png(raw)
    message = Message(header=header(), format="32FC1; compressedDepth png", data=data)
    read = depth_image(message, "here")
    assert read.dtype == np.float32
    assert np.isnan(read[0, 2])
    seen = np.isfinite(depth)
    assert np.abs(read[seen] - depth[seen]).max() < 0.01


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"width": 0}, "0x6 pixels"),
        ({"height": 2**32 - 1, "width": 2**32 - 1}, "4294967295x4294967295 pixels"),
        ({"width": 4000}, "no 4000x6 image"),
        ({"height": 60}, "no 5x60 image"),
        ({"step": 0}, "rows of 0"),
        ({"step": 14}, "rows of 14"),
        ({"data": b""}, "0 bytes"),
        ({"encoding": "yuv422"}, "'yuv422' is not read as colour; known are rgb8"),
        ({"encoding": "32FC1"}, "'32FC1' is not read as colour"),
    ],
)
def test_fields_that_contradict_each_other(changes: dict[str, object], said: str) -> None:
    message = image(RGB, "rgb8")
    vars(message).update(changes)
    with pytest.raises(RecordingError, match=said) as caught:
        colour_image(message, "topic at 3")
    assert str(caught.value).startswith("topic at 3: ")


@pytest.mark.parametrize("data", [b"", b"\x89PNG", b"abc", struct.pack("<iff", 0, 0, 0)])
def test_compressed_depth_that_is_none(data: bytes) -> None:
    message = Message(header=header(), format="16UC1; compressedDepth png", data=data)
    with pytest.raises(RecordingError):
        depth_image(message, "here")


def test_colour_is_no_depth() -> None:
    with pytest.raises(RecordingError, match="'rgb8' is not depth; known are 16UC1"):
        depth_image(image(RGB, "rgb8"), "here")
    compressed = Message(header=header(), format="png", data=png(RGB))
    with pytest.raises(RecordingError, match="one 16-bit channel"):
        depth_image(compressed, "here")

"""Images of messages are what a camera saw, whatever their encoding."""

import struct
from types import SimpleNamespace as Message

import cv2
import numpy as np
import pytest

from kg.model.errors import RecordingError
from perception.camera.image_decoding import metres
from perception.sources.ros.image_messages import colour_image, depth_image, image_kind
from tests.perception.sources.ros.messages import header, image

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


@pytest.mark.parametrize("step", [0, 5])
def test_rows_whose_length_is_left_out_or_counted_in_pixels(step: int) -> None:
    message = image(RGB, "rgb8")
    message.step = step
    assert np.array_equal(colour_image(message, "here"), RGB)


@pytest.mark.parametrize(
    ("form", "compression"), [("h264", "video"), ("hevc", "video"), ("mjpeg", "jpeg")]
)
def test_video_in_a_compressed_image_is_no_jpeg(form: str, compression: str) -> None:
    assert image_kind(Message(format=form)).compression == compression


def test_grey_is_colour_three_times() -> None:
    grey = RGB[:, :, 0]
    assert np.array_equal(colour_image(image(grey, "mono8"), "here"), np.dstack([grey] * 3))


def smooth(height: int = 24, width: int = 32) -> np.ndarray:
    """A colour image whose channels are gradients of different directions."""
    v, u = np.mgrid[0:height, 0:width]
    return np.stack([20 + 5 * u, 200 - 4 * v, 40 + 2 * u + 3 * v], -1).astype(np.uint8)


@pytest.mark.parametrize("bits", [8, 16])
@pytest.mark.parametrize("mosaic", ["rggb", "bggr", "gbrg", "grbg"])
def test_bayer_mosaics_become_colour(mosaic: str, bits: int) -> None:
    wanted = smooth()
    raw = np.zeros(wanted.shape[:2], np.uint8)
    for (row, column), colour in zip(np.ndindex(2, 2), mosaic, strict=True):
        raw[row::2, column::2] = wanted[row::2, column::2, "rgb".index(colour)]
    stored = raw if bits == 8 else raw.astype(np.uint16) << 8
    read = colour_image(image(stored, f"bayer_{mosaic}{bits}"), "here")
    inside = (slice(2, -2), slice(2, -2))
    assert np.abs(read[inside].astype(int) - wanted[inside]).max() <= 2


@pytest.mark.parametrize(("encoding", "first"), [("yuv422", "uy"), ("yuv422_yuy2", "yu")])
def test_yuv_becomes_colour(encoding: str, first: str) -> None:
    y, u, v = 130, 90, 170  # BT.601, of the range 16 to 235
    pair = (u, y, v, y) if first == "uy" else (y, u, y, v)
    stored = np.tile(np.array(pair, np.uint8), (4, 3)).reshape(4, 6, 2)
    read = colour_image(image(stored, encoding), "here")
    luma, blue, red = 1.164 * (y - 16), u - 128, v - 128
    wanted = (luma + 1.596 * red, luma - 0.813 * red - 0.391 * blue, luma + 2.018 * blue)
    assert np.abs(read.astype(float) - wanted).max() < 1.5


@pytest.mark.parametrize("big", [False, True])
@pytest.mark.parametrize("padding", [0, 8])
def test_depth_of_every_encoding(big: bool, padding: int) -> None:
    for encoding in ("16UC1", "mono16"):
        assert np.array_equal(
            depth_image(image(MM, encoding, padding=padding, big=big), "here"), MM
        )
    signed = np.array([[500, -1, 0], [-32768, 32767, 7]], np.int16)
    read = depth_image(image(signed, "16SC1", padding=padding, big=big), "here")
    assert np.array_equal(read, np.array([[500, 0, 0], [0, 32767, 7]], np.uint16))
    assert read.dtype == np.uint16
    floats = np.array([[0.5, np.nan, np.inf], [-1, 0, 3.25]], np.float32)
    read = depth_image(image(floats, "32FC1", padding=padding, big=big), "here")
    assert np.array_equal(read, floats, equal_nan=True)
    wanted = np.array([[0.5, np.nan, np.nan], [np.nan, np.nan, 3.25]], np.float32)
    assert np.array_equal(metres(read, 1000.0), wanted, equal_nan=True)
    assert metres(read, 1e6)[0, 0] == np.float32(0.0005)  # floats that are millimetres


def compressed(form: str, data: bytes, quantised: tuple[float, float] | None = None) -> Message:
    """`quantised` are A and B of the header that compressedDepth has before its data."""
    head = b"" if quantised is None else struct.pack("<iff", 0, *quantised)
    return Message(header=header(), format=form, data=head + data)


def png(array: np.ndarray) -> bytes:
    return cv2.imencode(".png", array)[1].tobytes()


@pytest.mark.parametrize(("suffix", "exact"), [(".png", True), (".jpg", False)])
def test_compressed_colour(suffix: str, exact: bool) -> None:
    smooth = np.zeros((16, 16, 3), np.uint8)
    smooth[:, :, 0] = 200
    data = cv2.imencode(suffix, smooth[:, :, ::-1])[1].tobytes()
    read = colour_image(compressed("jpeg", data), "here")
    assert np.abs(read.astype(int) - smooth).max() <= (0 if exact else 6)


def test_compressed_depth_in_millimetres() -> None:
    for message in (
        compressed("16UC1; compressedDepth png", png(MM), (0, 0)),
        compressed("16UC1; png compressed ", png(MM)),
    ):
        assert np.array_equal(depth_image(message, "here"), MM)
        assert image_kind(message).is_depth


def test_compressed_depth_of_floats_is_quantised_inverse_depth() -> None:
    """compressed_depth_image_transport: raw = A / depth + B; A = z (z + 1), B = 1 - A / max."""
    z, farthest = 100.0, 10.0
    a = z * (z + 1)
    b = 1 - a / farthest
    depth = np.array([[0.5, 1.0, np.nan], [2.0, 4.0, 9.0]], np.float32)
    with np.errstate(invalid="ignore"):
        raw = np.nan_to_num(a / depth + b).astype(np.uint16)
    read = depth_image(compressed("32FC1; compressedDepth png", png(raw), (a, b)), "here")
    assert read.dtype == np.float32
    assert np.isnan(read[0, 2])
    seen = np.isfinite(depth)
    assert np.abs(read[seen] - depth[seen]).max() < 0.01


def rvl(depth: np.ndarray) -> bytes:
    """Size and stream of a depth image, as Wilson's paper has them."""
    numbers: list[int] = []
    values, last, i = depth.ravel().tolist(), 0, 0
    while i < len(values):
        for wanted in (False, True):
            start = i
            while i < len(values) and bool(values[i]) == wanted:
                i += 1
            numbers.append(i - start)
            for value in values[start:i] if wanted else ():
                delta, last = value - last, value
                numbers.append(2 * delta if delta >= 0 else -2 * delta - 1)
    groups: list[int] = []
    for number in numbers:
        while number > 7:
            groups.append(number & 7 | 8)
            number >>= 3
        groups.append(number)
    groups += [0] * (-len(groups) % 8)
    words = [
        int("".join(f"{g:x}" for g in groups[i : i + 8]), 16) for i in range(0, len(groups), 8)
    ]
    return struct.pack(f"<II{len(words)}I", depth.shape[1], depth.shape[0], *words)


@pytest.mark.parametrize(
    "depth",
    [
        MM,
        np.zeros((3, 5), np.uint16),
        np.full((2, 2), 65535, np.uint16),
        np.random.default_rng(1).integers(0, 65536, (30, 40)).astype(np.uint16),
        np.random.default_rng(2).integers(0, 2, (30, 41)).astype(np.uint16),
        (1500 + smooth().astype(np.uint16)[:, :, 0]) * (smooth()[:, :, 1] > 150),
    ],
)
def test_rvl_gives_back_every_pixel(depth: np.ndarray) -> None:
    data = rvl(depth)
    message = compressed("16UC1; compressedDepth rvl", data, (0, 0))
    assert np.array_equal(depth_image(message, "here"), depth)
    floats = compressed("32FC1; compressedDepth rvl", data, (10100.0, -1009.0))
    read = depth_image(floats, "here")
    seen = depth > 0
    assert np.isnan(read[~seen]).all()
    assert np.allclose(read[seen], 10100 / (depth[seen] + 1009.0))


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"width": 0}, "0x6 pixels"),
        ({"height": 2**32 - 1, "width": 2**32 - 1}, "4294967295x4294967295 pixels"),
        ({"width": 4000}, "no 4000x6 image"),
        ({"height": 60}, "no 5x60 image"),
        ({"step": 0, "data": RGB.tobytes() + b"\0"}, "rows of 0"),
        ({"step": 14}, "rows of 14"),
        ({"data": b""}, "0 bytes"),
        ({"encoding": "nv24"}, "'nv24' is not read as colour; known are rgb8"),
        ({"encoding": "yuv422"}, "yuv422 of 5x6 pixels is none"),
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
    with pytest.raises(RecordingError):
        depth_image(compressed("16UC1; compressedDepth png", data), "here")


@pytest.mark.parametrize("depth", [[[65535, 1, 65535, 1]], [[1, 0, 65535, 0]], [[65535]]])
def test_rvl_is_read_no_further_than_its_pixels_may_need(depth: list[list[int]]) -> None:
    data = rvl(np.array(depth)) + b"\xff" * 4096 + bytes(4)
    message = compressed("16UC1; compressedDepth rvl", data, (0, 0))
    assert depth_image(message, "here").tolist() == depth


WHOLE = rvl(MM)


@pytest.mark.parametrize(
    ("data", "said"),
    [
        (b"", "before its size"),
        (WHOLE[:12], "cut short before its 6 pixels"),
        (struct.pack("<II", 2**20, 2**20) + WHOLE[8:], "pixels cannot be read"),
        (struct.pack("<II", 0, 4) + WHOLE[8:], "0x4 pixels"),
        (struct.pack("<II", 2, 2) + WHOLE[8:], "does not end with its 4 pixels"),
        (WHOLE[:8] + b"\xff" * 16, "more than 32 bits|cut short"),
    ],
)
def test_rvl_that_is_none(data: bytes, said: str) -> None:
    with pytest.raises(RecordingError, match=said):
        depth_image(compressed("16UC1; compressedDepth rvl", data, (0, 0)), "here")


def test_colour_is_no_depth() -> None:
    with pytest.raises(RecordingError, match="'rgb8' is not depth; known are 16UC1"):
        depth_image(image(RGB, "rgb8"), "here")
    with pytest.raises(RecordingError, match="one 16-bit channel"):
        depth_image(compressed("png", png(RGB)), "here")

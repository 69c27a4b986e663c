"""Faults of recordings: each takes frames and gives those that a camera in trouble would."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from perception.frames import Frame

Frames = list[Frame]
Fault = Callable[[Frames, np.random.Generator], Frames]
SOME: Final = (0.4, 0.6)  # the part of a recording that most faults change


def _changed(frames: Frames, change: Callable[[Frame, int], Frame]) -> Frames:
    """Frames with `change(frame, number)` in the middle part."""
    first, last = (int(share * len(frames)) for share in SOME)
    return [
        change(frame, number - first) if first <= number < last else frame
        for number, frame in enumerate(frames)
    ]


def _colour(frame: Frame, rgb: NDArray[np.generic]) -> Frame:
    return replace(frame, rgb=np.ascontiguousarray(rgb).astype(np.uint8))


def _texture(shape: tuple[int, int], seed: int) -> NDArray[np.uint8]:
    """A coarse random pattern (H, W, 3)."""
    small = np.random.default_rng(seed).integers(0, 255, (shape[0] // 8, shape[1] // 8, 3))
    return np.asarray(cv2.resize(small.astype(np.uint8), shape[::-1]), np.uint8)


def blur(frames: Frames, _: np.random.Generator) -> Frames:
    """A quick motion smears the images."""
    return _changed(frames, lambda f, n: _colour(f, cv2.blur(f.rgb, (61, 9))))


def dark(frames: Frames, _: np.random.Generator) -> Frames:
    """The light is nearly off."""
    return _changed(frames, lambda f, n: _colour(f, f.rgb * 0.02))


def black(frames: Frames, _: np.random.Generator) -> Frames:
    """The lens is covered for colour, not for depth."""
    return _changed(frames, lambda f, n: _colour(f, f.rgb * 0))


def exposure(frames: Frames, _: np.random.Generator) -> Frames:
    """Automatic exposure goes up and down."""
    return [
        _colour(f, np.clip(f.rgb * (1 + 0.7 * np.sin(n / 2)), 0, 255)) for n, f in enumerate(frames)
    ]


def noise(frames: Frames, random: np.random.Generator) -> Frames:
    """Images of a dark room with high gain."""
    return [
        _colour(f, np.clip(f.rgb * 0.3 + random.normal(0, 40, f.rgb.shape), 0, 255)) for f in frames
    ]


def white_wall(frames: Frames, _: np.random.Generator) -> Frames:
    """The camera sees a white wall one metre ahead and goes along it."""
    return _changed(
        frames,
        lambda f, n: replace(
            f, rgb=np.full_like(f.rgb, 230), depth=np.full_like(f.depth, np.float32(1.0))
        ),
    )


def _covered(frame: Frame, share: float, depth: float, left: float, seed: int) -> Frame:
    """A textured thing over `share` of the width from `left` on, at `depth` [m] (nan: none)."""
    rgb, z = frame.rgb.copy(), frame.depth.copy()
    width = rgb.shape[1]
    columns = slice(max(int(left * width), 0), max(int((left + share) * width), 0))
    rgb[:, columns] = np.roll(_texture(z.shape, seed), int(left * width), axis=1)[:, columns]
    z[:, columns] = depth
    return replace(frame, rgb=rgb, depth=z)


def hand(frames: Frames, _: np.random.Generator) -> Frames:
    """A hand before most of the lens, too near for depth."""
    return _changed(frames, lambda f, n: _covered(f, 0.7, np.nan, 0.1, 1))


def near_hand(frames: Frames, _: np.random.Generator) -> Frames:
    """A hand or a tray before nearly all of the lens, with depth, that moves with the camera."""
    return _changed(frames, lambda f, n: _covered(f, 0.95, 0.45, 0.0, 2))


def gripper(frames: Frames, _: np.random.Generator) -> Frames:
    """A part of the robot covers a third of all images."""
    return [_covered(f, 0.33, 0.5, 0.0, 3) for f in frames]


def passer_by(frames: Frames, _: np.random.Generator) -> Frames:
    """A person crosses the view."""
    return _changed(frames, lambda f, n: _covered(f, 0.3, 1.2, -0.3 + 0.05 * n, 4))


def crowd(frames: Frames, _: np.random.Generator) -> Frames:
    """People cover most of the view and walk."""
    return _changed(frames, lambda f, n: _covered(f, 0.75, 1.3, 0.2 * np.sin(n / 4), 5))


def no_depth(frames: Frames, _: np.random.Generator) -> Frames:
    """Depth is away for a while."""
    return _changed(frames, lambda f, n: replace(f, depth=np.full_like(f.depth, np.nan)))


def little_depth(frames: Frames, random: np.random.Generator) -> Frames:
    """Sunlight leaves a tenth of the depth pixels."""

    def thinned(f: Frame) -> Frame:
        return replace(f, depth=np.where(random.random(f.depth.shape) < 0.1, f.depth, np.nan))

    return [replace(g := thinned(f), depth=g.depth.astype(np.float32)) for f in frames]


def noisy_depth(frames: Frames, random: np.random.Generator) -> Frames:
    """Depth has errors of five per cent."""
    return [
        replace(f, depth=(f.depth * random.normal(1, 0.05, f.depth.shape)).astype(np.float32))
        for f in frames
    ]


def depth_late(frames: Frames, _: np.random.Generator) -> Frames:
    """Depth is two frames behind colour."""
    return [replace(f, depth=frames[max(n - 2, 0)].depth) for n, f in enumerate(frames)]


def depth_very_late(frames: Frames, _: np.random.Generator) -> Frames:
    """Depth is 15 frames behind colour."""
    return [replace(f, depth=frames[max(n - 15, 0)].depth) for n, f in enumerate(frames)]


def out_of_order(frames: Frames, random: np.random.Generator) -> Frames:
    """Frames come out of order, within some."""
    order = np.argsort(np.arange(len(frames)) + random.uniform(0, 6, len(frames)), kind="stable")
    return [frames[n] for n in order]


def shuffled(frames: Frames, random: np.random.Generator) -> Frames:
    """Frames come in no order at all."""
    return [frames[n] for n in random.permutation(len(frames))]


def backwards_half(frames: Frames, _: np.random.Generator) -> Frames:
    """The second half of the frames comes backwards."""
    half = len(frames) // 2
    return frames[:half] + frames[half:][::-1]


def gap(frames: Frames, _: np.random.Generator) -> Frames:
    """A part of the recording is missing."""
    first, last = (int(share * len(frames)) for share in SOME)
    return frames[:first] + frames[last:]


def frozen(frames: Frames, _: np.random.Generator) -> Frames:
    """The driver repeats one image for a while, and the camera goes on."""
    first = frames[int(SOME[0] * len(frames))]
    return _changed(frames, lambda f, n: replace(first, id=f.id))


def frozen_colour(frames: Frames, _: np.random.Generator) -> Frames:
    """The driver repeats one colour image for a while; depth goes on."""
    first = frames[int(SOME[0] * len(frames))]
    return _changed(frames, lambda f, n: replace(f, rgb=first.rgb))


def intrinsics(frames: Frames, _: np.random.Generator) -> Frames:
    """The focal length is a quarter too short."""
    wrong = frames[0].K * np.array([[0.75, 1, 1], [1, 0.75, 1], [1, 1, 1]])
    return [replace(f, K=wrong) for f in frames]


def other_colour(frames: Frames, _: np.random.Generator) -> Frames:
    """Colour and depth are of two recordings: the colour runs backwards."""
    return [replace(f, rgb=g.rgb) for f, g in zip(frames, frames[::-1], strict=True)]


def mirrored(frames: Frames, _: np.random.Generator) -> Frames:
    """Colour is mirrored, depth is not."""
    return [_colour(f, f.rgb[:, ::-1]) for f in frames]


def turned(frames: Frames, _: np.random.Generator) -> Frames:
    """The camera is held upside down for a while."""
    return _changed(
        frames,
        lambda f, n: replace(
            f,
            rgb=np.ascontiguousarray(f.rgb[::-1, ::-1]),
            depth=np.ascontiguousarray(f.depth[::-1, ::-1]),
            T_map_cam=f.T_map_cam @ np.diag([-1.0, -1.0, 1.0, 1.0]),
        ),
    )


def dirty_lens(frames: Frames, _: np.random.Generator) -> Frames:
    """Specks on the lens that stay in the image, over depth of the room."""
    specks = np.random.default_rng(6).random(frames[0].depth.shape) < 0.02
    big = np.asarray(cv2.dilate(specks.astype(np.uint8), np.ones((5, 5)))) > 0
    return [_colour(f, np.where(big[:, :, None], 20, f.rgb)) for f in frames]


def still(frames: Frames, random: np.random.Generator) -> Frames:
    """The camera never moves; images and depth have noise."""
    first = frames[0]

    def seen(f: Frame) -> Frame:
        rgb = np.clip(first.rgb + random.normal(0, 3, first.rgb.shape), 0, 255).astype(np.uint8)
        z = first.depth * random.normal(1, 0.005, first.depth.shape)
        return replace(f, rgb=rgb, depth=z.astype(np.float32), T_map_cam=first.T_map_cam)

    return [seen(f) for f in frames]


def duplicates(frames: Frames, _: np.random.Generator) -> Frames:
    """Each frame comes four times, as from a camera of 15 Hz recorded at 60 Hz."""
    return [f for f in frames for _ in range(4)]


def three_frames(frames: Frames, _: np.random.Generator) -> Frames:
    """Nothing but three frames, far apart."""
    return frames[:: max(len(frames) // 3, 1)][:3]


def _resized(frame: Frame, scale: float) -> Frame:
    size = tuple(round(scale * n) for n in frame.depth.shape[::-1])
    K = frame.K.copy()
    K[:2] *= scale
    rgb = cv2.resize(frame.rgb, size, interpolation=cv2.INTER_AREA if scale < 1 else 1)
    depth = cv2.resize(frame.depth, size, interpolation=cv2.INTER_NEAREST)
    return replace(frame, rgb=np.asarray(rgb, np.uint8), depth=np.asarray(depth, np.float32), K=K)


def tiny(frames: Frames, _: np.random.Generator) -> Frames:
    """Images 160 wide."""
    return [_resized(f, 160 / f.depth.shape[1]) for f in frames]


def huge(frames: Frames, _: np.random.Generator) -> Frames:
    """Images 2560 wide, of few frames."""
    return [_resized(f, 2560 / f.depth.shape[1]) for f in frames[:20]]


def portrait(frames: Frames, _: np.random.Generator) -> Frames:
    """The camera is held upright: images lie on their side."""

    def change(f: Frame) -> Frame:
        (height, _), K = f.depth.shape, f.K
        M = np.array([[K[1, 1], 0, height - 1 - K[1, 2]], [0, K[0, 0], K[0, 2]], [0, 0, 1.0]])
        T = np.array([[0, 1.0, 0, 0], [-1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
        rgb, z = (np.ascontiguousarray(np.rot90(x, -1)) for x in (f.rgb, f.depth))
        return replace(f, rgb=rgb, depth=z, K=M, T_map_cam=f.T_map_cam @ T)

    return [change(f) for f in frames]


def frozen_depth(frames: Frames, _: np.random.Generator) -> Frames:
    """The driver repeats one depth image for a while; colour goes on."""
    first = frames[int(SOME[0] * len(frames))]
    return _changed(frames, lambda f, n: replace(f, depth=first.depth))


def flicker(frames: Frames, _: np.random.Generator) -> Frames:
    """Every second image is dark, as of a lamp or an emitter that blinks."""
    return [_colour(f, f.rgb * (0.15 if n % 2 else 1)) for n, f in enumerate(frames)]


def overexposed(frames: Frames, _: np.random.Generator) -> Frames:
    """Most of all images is white."""
    return [_colour(f, np.clip(f.rgb * 4.0, 0, 255)) for f in frames]


def subtitles(frames: Frames, _: np.random.Generator) -> Frames:
    """A driver writes text into the colour images."""

    def change(f: Frame) -> Frame:
        rgb = np.ascontiguousarray(f.rgb)
        for row in range(3):
            place = (10, rgb.shape[0] - 12 - 30 * row)
            cv2.putText(rgb, "REC 2026-11-24 CAM 1 30 FPS", place, 0, 0.9, (255, 255, 0), 2)
        return replace(f, rgb=rgb)

    return [change(replace(f, rgb=f.rgb.copy())) for f in frames]


def rolling(frames: Frames, _: np.random.Generator) -> Frames:
    """Rows are read one after the other while the camera shakes: they are shifted."""

    def change(f: Frame, n: int) -> Frame:
        height, width = f.depth.shape
        shift = 0.02 * width * np.sin(n * 1.3 + 3 * np.arange(height) / height)
        x = np.arange(width)[None] + shift[:, None]
        y = np.repeat(np.arange(height)[:, None], width, 1)
        maps = (x.astype(np.float32), y.astype(np.float32))
        return _colour(f, cv2.remap(f.rgb, *maps, cv2.INTER_LINEAR))

    return [change(f, n) for n, f in enumerate(frames)]


def coarse_depth(frames: Frames, _: np.random.Generator) -> Frames:
    """Depth in steps, as of stereo: 6 cm at 2 m."""

    def change(f: Frame) -> Frame:
        return replace(f, depth=(60.0 / np.round(60.0 / f.depth)).astype(np.float32))

    return [change(f) for f in frames]


def filled_depth(frames: Frames, _: np.random.Generator) -> Frames:
    """Depth that is missing is filled with one far value."""
    return [
        replace(f, depth=np.where(np.isfinite(f.depth), f.depth, np.float32(8))) for f in frames
    ]


def near_depth(frames: Frames, _: np.random.Generator) -> Frames:
    """Depth beyond 1.5 m is missing."""
    return [replace(f, depth=np.where(f.depth < 1.5, f.depth, np.float32(np.nan))) for f in frames]


def zoom(frames: Frames, _: np.random.Generator) -> Frames:
    """The lens zooms in half-way, colour and depth by a fifth."""

    def change(f: Frame) -> Frame:
        height, width = f.depth.shape
        part = (slice(height // 12, -height // 12), slice(width // 12, -width // 12))
        rgb = cv2.resize(f.rgb[part], (width, height))
        depth = cv2.resize(f.depth[part], (width, height), interpolation=cv2.INTER_NEAREST)
        return replace(f, rgb=np.asarray(rgb, np.uint8), depth=np.asarray(depth, np.float32))

    half = len(frames) // 2
    return frames[:half] + [change(f) for f in frames[half:]]


def two_cameras(frames: Frames, _: np.random.Generator) -> Frames:
    """Frames of two cameras in turn: every second one is of half the recording later."""
    half = len(frames) // 2
    return [frames[n % half + (half if n % 2 else 0)] for n in range(2 * half)]


def late_light(frames: Frames, _: np.random.Generator) -> Frames:
    """The light goes out for the second half, and depth goes on."""
    half = len(frames) // 2
    return frames[:half] + [_colour(f, f.rgb * 0.01) for f in frames[half:]]


FAULTS: Final[Sequence[Fault]] = (
    blur, dark, black, exposure, noise, white_wall, hand, near_hand, gripper, passer_by, crowd,
    no_depth, little_depth, noisy_depth, depth_late, depth_very_late, out_of_order, shuffled,
    backwards_half, gap, frozen, frozen_colour, intrinsics, other_colour, mirrored, turned,
    dirty_lens, still, duplicates, three_frames, tiny, huge, portrait, frozen_depth, flicker,
    overexposed, subtitles, rolling, coarse_depth, filled_depth, near_depth, zoom, two_cameras,
    late_light,
)  # fmt: skip

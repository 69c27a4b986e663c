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


FAULTS: Final[Sequence[Fault]] = (
    blur, dark, black, exposure, noise, white_wall, hand, near_hand, gripper, passer_by, crowd,
    no_depth, little_depth, noisy_depth, depth_late, depth_very_late, out_of_order, shuffled,
    backwards_half, gap, frozen, frozen_colour, intrinsics, other_colour, mirrored, turned,
    dirty_lens,
)  # fmt: skip

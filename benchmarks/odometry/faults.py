"""Faults of recordings: each takes frames and gives those that a camera in trouble would."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from perception.frames import Frame

Frames = list[Frame]
Fault = Callable[[Frames, np.random.Generator], Frames]
SOME: Final = (0.4, 0.6)  # the part of a recording that most faults change
Array = NDArray[Any]


def _each(change: Callable[..., Frame], *, random: bool = False) -> Fault:
    """All frames by `change(frame, number)`, or `change(frame, random)`."""
    return lambda frames, rng: [change(f, rng if random else n) for n, f in enumerate(frames)]


def _some(change: Callable[[Frame, int], Frame]) -> Fault:
    """The frames of the middle part by `change(frame, number in the part)`."""

    def changed(frames: Frames, _: np.random.Generator) -> Frames:
        first, last = _middle(frames)
        part = [change(frame, number) for number, frame in enumerate(frames[first:last])]
        return [*frames[:first], *part, *frames[last:]]

    return changed


def _held(change: Callable[[Frame, Frame], Frame]) -> Fault:
    """The frames of the middle part by `change(frame, first of the part)`."""
    return lambda frames, rng: _some(lambda f, _: change(f, frames[_middle(frames)[0]]))(
        frames, rng
    )


def _later(change: Callable[[Frame], Frame]) -> Fault:
    """The second half of the frames by `change`."""
    return lambda frames, _: [*frames[: _half(frames)], *map(change, frames[_half(frames) :])]


def _middle(frames: Frames) -> tuple[int, int]:
    return int(SOME[0] * len(frames)), int(SOME[1] * len(frames))


def _half(frames: Frames) -> int:
    return len(frames) // 2


def _colour(frame: Frame, rgb: Array) -> Frame:
    return replace(frame, rgb=np.ascontiguousarray(np.clip(rgb, 0, 255)).astype(np.uint8))


def _depth(frame: Frame, depth: Array) -> Frame:
    return replace(frame, depth=np.ascontiguousarray(depth).astype(np.float32))


def _texture(shape: tuple[int, int], seed: int) -> NDArray[np.uint8]:
    """A coarse random pattern (H, W, 3)."""
    small = np.random.default_rng(seed).integers(0, 255, (shape[0] // 8, shape[1] // 8, 3))
    return np.asarray(cv2.resize(small.astype(np.uint8), shape[::-1]), np.uint8)


def _covered(frame: Frame, share: float, depth: float, left: float, seed: int) -> Frame:
    """A textured thing over `share` of the width from `left` on, at `depth` [m] (nan: none)."""
    rgb, z = frame.rgb.copy(), frame.depth.copy()
    width = rgb.shape[1]
    columns = slice(max(int(left * width), 0), max(int((left + share) * width), 0))
    rgb[:, columns] = np.roll(_texture(z.shape, seed), int(left * width), axis=1)[:, columns]
    z[:, columns] = depth
    return replace(frame, rgb=rgb, depth=z)


def _upside_down(f: Frame, _: int) -> Frame:
    T = f.T_map_cam @ np.diag([-1.0, -1.0, 1.0, 1.0])
    return replace(_depth(_colour(f, f.rgb[::-1, ::-1]), f.depth[::-1, ::-1]), T_map_cam=T)


def _specks(f: Frame, _: int) -> Frame:
    specks = np.random.default_rng(6).random(f.depth.shape) < 0.02
    big = np.asarray(cv2.dilate(specks.astype(np.uint8), np.ones((5, 5)))) > 0
    return _colour(f, np.where(big[:, :, None], 20, f.rgb))


def _never_moves(frames: Frames, random: np.random.Generator) -> Frames:
    first = frames[0]

    def seen(f: Frame) -> Frame:
        rgb = first.rgb + random.normal(0, 3, first.rgb.shape)
        z = first.depth * random.normal(1, 0.005, first.depth.shape)
        return replace(_depth(_colour(f, rgb), z), T_map_cam=first.T_map_cam)

    return [seen(f) for f in frames]


def _resized(frame: Frame, width: int) -> Frame:
    scale = width / frame.depth.shape[1]
    size = tuple(round(scale * n) for n in frame.depth.shape[::-1])
    K = frame.K.copy()
    K[:2] *= scale
    rgb = cv2.resize(frame.rgb, size, interpolation=cv2.INTER_AREA if scale < 1 else 1)
    depth = cv2.resize(frame.depth, size, interpolation=cv2.INTER_NEAREST)
    return replace(frame, rgb=np.asarray(rgb, np.uint8), depth=np.asarray(depth, np.float32), K=K)


def _on_its_side(f: Frame, _: int) -> Frame:
    (height, _), K = f.depth.shape, f.K
    M = np.array([[K[1, 1], 0, height - 1 - K[1, 2]], [0, K[0, 0], K[0, 2]], [0, 0, 1.0]])
    T = np.array([[0, 1.0, 0, 0], [-1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
    rgb, z = (np.ascontiguousarray(np.rot90(x, -1)) for x in (f.rgb, f.depth))
    return replace(f, rgb=rgb, depth=z, K=M, T_map_cam=f.T_map_cam @ T)


def _written_on(f: Frame, _: int) -> Frame:
    rgb = np.ascontiguousarray(f.rgb.copy())
    for row in range(3):
        place = (10, rgb.shape[0] - 12 - 30 * row)
        cv2.putText(rgb, "REC 2026-11-24 CAM 1 30 FPS", place, 0, 0.9, (255, 255, 0), 2)
    return replace(f, rgb=rgb)


def _sheared(f: Frame, n: int) -> Frame:
    height, width = f.depth.shape
    shift = 0.02 * width * np.sin(n * 1.3 + 3 * np.arange(height) / height)
    x = np.arange(width)[None] + shift[:, None]
    y = np.repeat(np.arange(height)[:, None], width, 1)
    return _colour(f, cv2.remap(f.rgb, x.astype("f4"), y.astype("f4"), cv2.INTER_LINEAR))


def _zoomed(f: Frame) -> Frame:
    height, width = f.depth.shape
    part = (slice(height // 12, -height // 12), slice(width // 12, -width // 12))
    depth = cv2.resize(f.depth[part], (width, height), interpolation=cv2.INTER_NEAREST)
    return _depth(_colour(f, cv2.resize(f.rgb[part], (width, height))), depth)


def _shaken_order(frames: Frames, random: np.random.Generator) -> Frames:
    order = np.argsort(np.arange(len(frames)) + random.uniform(0, 6, len(frames)), kind="stable")
    return [frames[n] for n in order]


def _in_turn(frames: Frames, _: np.random.Generator) -> Frames:
    half = _half(frames)
    return [frames[n % half + (half if n % 2 else 0)] for n in range(2 * half)]


def _delayed(count: int) -> Fault:
    return lambda frames, _: [
        replace(f, depth=frames[max(n - count, 0)].depth) for n, f in enumerate(frames)
    ]


_WRONG_K: Final = np.array([[0.75, 1, 1], [1, 0.75, 1], [1, 1, 1]])

FAULTS: Final[dict[str, Fault]] = {
    # a quick motion smears the images; the light is nearly off; the lens is covered for colour
    "blur": _some(lambda f, n: _colour(f, cv2.blur(f.rgb, (61, 9)))),
    "dark": _some(lambda f, n: _colour(f, f.rgb * 0.02)),
    "black": _some(lambda f, n: _colour(f, f.rgb * 0)),
    # automatic exposure goes up and down; a dark room with high gain
    "exposure": _each(lambda f, n: _colour(f, f.rgb * (1 + 0.7 * np.sin(n / 2)))),
    "noise": _each(
        lambda f, rng: _colour(f, f.rgb * 0.3 + rng.normal(0, 40, f.rgb.shape)), random=True
    ),
    # the camera goes along a white wall one metre ahead
    "white_wall": _some(
        lambda f, n: _depth(_colour(f, np.full_like(f.rgb, 230)), np.full_like(f.depth, 1.0))
    ),
    # a hand too near for depth; a tray that moves with the camera; a part of the robot
    "hand": _some(lambda f, n: _covered(f, 0.7, np.nan, 0.1, 1)),
    "near_hand": _some(lambda f, n: _covered(f, 0.95, 0.45, 0.0, 2)),
    "gripper": _each(lambda f, n: _covered(f, 0.33, 0.5, 0.0, 3)),
    # a person crosses the view; people cover most of it and walk
    "passer_by": _some(lambda f, n: _covered(f, 0.3, 1.2, -0.3 + 0.05 * n, 4)),
    "crowd": _some(lambda f, n: _covered(f, 0.75, 1.3, 0.2 * np.sin(n / 4), 5)),
    # depth is away for a while; sunlight leaves a tenth of it; errors of five per cent
    "no_depth": _some(lambda f, n: _depth(f, np.full_like(f.depth, np.nan))),
    "little_depth": _each(
        lambda f, rng: _depth(f, np.where(rng.random(f.depth.shape) < 0.1, f.depth, np.nan)),
        random=True,
    ),
    "noisy_depth": _each(
        lambda f, rng: _depth(f, f.depth * rng.normal(1, 0.05, f.depth.shape)), random=True
    ),
    # depth is two, or 15, frames behind colour
    "depth_late": _delayed(2),
    "depth_very_late": _delayed(15),
    # frames out of order within some, in no order, half of them backwards, some missing
    "out_of_order": _shaken_order,
    "shuffled": lambda frames, rng: [frames[n] for n in rng.permutation(len(frames))],
    "backwards_half": lambda frames, _: frames[: _half(frames)] + frames[_half(frames) :][::-1],
    "gap": lambda frames, _: frames[: _middle(frames)[0]] + frames[_middle(frames)[1] :],
    # the driver repeats one frame, or one colour image, for a while
    "frozen": _held(lambda f, first: replace(first, id=f.id)),
    "frozen_colour": _held(lambda f, first: replace(f, rgb=first.rgb)),
    # the focal length is a quarter too short; colour runs backwards; colour is mirrored
    "intrinsics": lambda frames, _: [replace(f, K=frames[0].K * _WRONG_K) for f in frames],
    "other_colour": lambda frames, _: [
        replace(f, rgb=g.rgb) for f, g in zip(frames, frames[::-1], strict=True)
    ],
    "mirrored": _each(lambda f, n: _colour(f, f.rgb[:, ::-1])),
    # held upside down for a while; specks on the lens; a camera that never moves
    "turned": _some(_upside_down),
    "dirty_lens": _each(_specks),
    "still": _never_moves,
    # each frame four times, as of 15 Hz recorded at 60 Hz; nothing but three frames, far apart
    "duplicates": lambda frames, _: [f for f in frames for _ in range(4)],
    "three_frames": lambda frames, _: frames[:: max(len(frames) // 3, 1)][:3],
    # images 160 wide, 2560 wide (few of them), and on their side
    "tiny": _each(lambda f, n: _resized(f, 160)),
    "huge": lambda frames, _: [_resized(f, 2560) for f in frames[:20]],
    "portrait": _each(_on_its_side),
    "frozen_depth": _held(lambda f, first: replace(f, depth=first.depth)),
    # a lamp that blinks; too much light; text of a driver; rows read one after the other
    "flicker": _each(lambda f, n: _colour(f, f.rgb * (0.15 if n % 2 else 1))),
    "overexposed": _each(lambda f, n: _colour(f, f.rgb * 4.0)),
    "subtitles": _each(_written_on),
    "rolling": _each(_sheared),
    # depth in steps, as of stereo: 6 cm at 2 m; what is missing filled with 8 m; none beyond 1.5 m
    "coarse_depth": _each(lambda f, n: _depth(f, 60.0 / np.round(60.0 / f.depth))),
    "filled_depth": _each(lambda f, n: _depth(f, np.where(np.isfinite(f.depth), f.depth, 8))),
    "near_depth": _each(lambda f, n: _depth(f, np.where(f.depth < 1.5, f.depth, np.nan))),
    # the lens zooms in half-way; frames of two cameras in turn; the light goes out half-way
    "zoom": _later(_zoomed),
    "two_cameras": _in_turn,
    "late_light": _later(lambda f: _colour(f, f.rgb * 0.01)),
}

"""Simulated houses with patterned walls and floors, for tracking; and rooms that look alike."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from lab.houses.random_house import random_house
from lab.recordings.simulated_recording import KINECT
from perception.frames import Frame
from planner.simulation.camera import CameraModel, SimulatedCamera
from planner.simulation.house import FloorGrid, House
from planner.simulation.house_robot import MotionLimits, TimedPose, drive, look_around

PATCH: Final = 0.12  # [m] edge of the patches of the pattern
CONTRAST: Final = 0.35  # share of a surface's colour by which patches differ, at most
ROOM: Final = 5.0  # [m] length of each of the rooms that look alike
GAIT: Final = MotionLimits(stride=0.2, swing=float(np.deg2rad(8)))  # between two frames


def house_tour(seed: int, way: float, chosen: slice = slice(None)) -> list[Frame]:
    """Frames (the `chosen`) of a drive of `way` [m] through the house of `seed`, round on round."""
    house = random_house(seed)
    camera = SimulatedCamera(house, CameraModel(depth=KINECT), seed)
    return list(_patterned(camera, _poses(house, way)[chosen], seed))


def alike_rooms(chosen: slice = slice(None)) -> list[Frame]:
    """Frames (the `chosen`) of a drive through a row of rooms that look alike, each ROOM long.

    None has a door; each has a pillar, and the same pattern on walls, floor, ceiling and pillar.
    """
    model = CameraModel()
    frames = []
    for number, x in enumerate(np.arange(0.0, 2.5 * ROOM, 0.1)[chosen]):
        T = model.pose(x, -1.0, 0.9 + 0.4 * float(np.sin(2 * np.pi * x / ROOM)))
        rays = np.tensordot(T[:3, :3], _rays(model), 1)
        depth = _row_depth(rays, T[:3, 3])
        points = (rays * depth).transpose(1, 2, 0) + T[:3, 3]
        points[..., 0] %= ROOM
        grey = 230 * (1 - CONTRAST * _pattern(points, 3))
        rgb = np.repeat(grey[..., None].astype(np.uint8), 3, axis=2)
        seen = np.where(depth < KINECT.far, depth, np.nan).astype(np.float32)
        frames.append(Frame(f"frame-{number:06d}", rgb, seen, model.K, T, number / 5))
    return frames


def _row_depth(rays: NDArray[np.float64], at: NDArray[np.float64]) -> NDArray[np.float64]:
    """Depth (H, W) [m] of walls, floor and ceiling of the row of rooms, and of its pillars."""
    with np.errstate(divide="ignore"):
        sides = [
            np.where(rays[axis] > 0, high - at[axis], low - at[axis]) / rays[axis]
            for axis, low, high in ((1, -2.0, 2.0), (2, 0.0, 2.5))
        ]
        depth = np.minimum(*sides)
        for first in ROOM * np.arange(-1, 5) + 1.0:
            low, high = np.array([first, -0.3, 0.0]), np.array([first + 0.4, 0.1, 2.5])
            ends = [(corner - at)[:, None, None] / rays for corner in (low, high)]
            enter, leave = np.minimum(*ends).max(axis=0), np.maximum(*ends).min(axis=0)
            depth = np.where((enter < leave) & (enter > 0), np.minimum(enter, depth), depth)
    return np.minimum(depth, 50.0)


def _rays(model: CameraModel) -> NDArray[np.float64]:
    """Directions (3, H, W) of the pixels, z = 1."""
    v, u = np.indices((model.height, model.width))
    pixels = np.stack([u, v, np.ones_like(u)]).reshape(3, -1)
    rays: NDArray[np.float64] = (np.linalg.inv(model.K) @ pixels).reshape(3, *u.shape)
    return rays


def _poses(house: House, way: float) -> list[TimedPose]:
    """Poses from viewpoint to viewpoint, round after round, with a turn at each in the first."""
    floor = FloorGrid(house)
    stops = [np.array(xy) for room in house.rooms for xy in room.viewpoints]
    pose = TimedPose(float(stops[0][0]), float(stops[0][1]), 0.0, 0.0)
    poses, gone = [pose], 0.0
    for visit, stop in enumerate(itertools.cycle(stops)):
        for after in drive(pose, floor.path(pose.xy, stop), GAIT):
            gone += float(np.hypot(after.x - pose.x, after.y - pose.y))
            pose = after
            poses.append(pose)
            if gone >= way:
                return poses
        if visit < len(stops):
            poses.extend(look_around(pose, GAIT))
            pose = poses[-1]
    raise AssertionError("a drive has no end")


def _patterned(camera: SimulatedCamera, poses: Sequence[TimedPose], seed: int) -> Iterator[Frame]:
    """Frames with a pattern on all surfaces: each patch has a brightness of its own."""
    rays = _rays(camera.model)
    for number, pose in enumerate(poses):
        T = camera.model.pose(pose.x, pose.y, pose.heading)
        frame = camera.frame(f"frame-{number:06d}", T, pose.seconds)
        depth = camera.view(T, pose.seconds).depth
        points = np.tensordot(T[:3, :3], rays * depth, 1).transpose(1, 2, 0) + T[:3, 3]
        light = 1 - CONTRAST * _pattern(points, seed)
        rgb = np.clip(frame.rgb * light[..., None], 0, 255).astype(np.uint8)
        yield replace(frame, rgb=rgb)


def _pattern(points: NDArray[np.float64], seed: int) -> NDArray[np.float64]:
    """A number from 0 to 1 for the patch of each point (H, W, 3) [m]."""
    cells = np.floor(points / PATCH + 1e-3).astype(np.int64) + 1000
    mixed = np.bitwise_xor.reduce(cells * [73856093, 19349663, 83492791], axis=2) + 7919 * seed
    mixed = (mixed * 2654435761) % 2**32
    return (((mixed ^ (mixed >> 15)) * 2246822519) % 2**32) / 2**32

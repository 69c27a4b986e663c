"""Intersections of the rays of a pinhole camera with boxes, upright cylinders and ellipsoids.

Rays are scaled so that their parameter t is the depth along the optical axis in metres.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planner.simulation.house import Solid

Window = tuple[slice, slice]
Floats = NDArray[np.float32]

FAR = np.float32(1e6)


@dataclass(frozen=True, slots=True)
class Rays:
    """All rays of one image."""

    origin: Floats  # (3,) [m] map frame
    direction: Floats  # (3, H, W) one metre along the optical axis each
    inverse: Floats  # (3, H, W) 1 / direction, never infinite


@dataclass(frozen=True, slots=True)
class Hits:
    """Intersections of a window of rays with one solid."""

    t: Floats  # (h, w) [m] depth, FAR where the ray misses
    normal: Floats | None  # (3, h, w) outward; None for a box, which has `axis`
    axis: NDArray[np.int8] | None  # (h, w) 0, 1, 2: the face's axis


def rays_of(direction_cam: Floats, T_map_cam: NDArray[np.float64]) -> Rays:
    """Rays (3, H, W) of camera coordinates in the map frame."""
    rotation = T_map_cam[:3, :3].astype(np.float32)
    direction = np.einsum("ij,jhw->ihw", rotation, direction_cam)
    tiny = np.float32(1e-7)
    safe = np.where(np.abs(direction) < tiny, tiny, direction)
    inverse = np.asarray(np.float32(1) / safe, np.float32)
    return Rays(T_map_cam[:3, 3].astype(np.float32), direction, inverse)


def hit(solid: Solid, rays: Rays, window: Window) -> Hits:
    """The nearest intersection in front of the camera of each ray of `window` with `solid`."""
    if solid.shape == "box":
        return _hit_box(solid, rays, window)
    if solid.shape == "cylinder":
        return _hit_cylinder(solid, rays, window)
    return _hit_ellipsoid(solid, rays, window)


def _hit_box(solid: Solid, rays: Rays, window: Window) -> Hits:
    near = far = axis = None
    for i in range(3):
        inverse = rays.inverse[i][window]
        a = np.float32(solid.lo[i] - rays.origin[i]) * inverse
        b = np.float32(solid.hi[i] - rays.origin[i]) * inverse
        enter, leave = np.minimum(a, b), np.maximum(a, b)
        if near is None or far is None or axis is None:
            near, far, axis = enter, leave, np.zeros(enter.shape, np.int8)
            continue
        axis[enter > near] = i
        near, far = np.maximum(near, enter), np.minimum(far, leave)
    assert near is not None and far is not None
    return Hits(np.where((near < far) & (near > 0), near, FAR), None, axis)


def _hit_ellipsoid(solid: Solid, rays: Rays, window: Window) -> Hits:
    centre, radii = (solid.lo + solid.hi) / 2, (solid.hi - solid.lo) / 2
    scale = np.asarray(1 / radii, np.float32)
    d = rays.direction[:, window[0], window[1]] * scale[:, None, None]
    o = ((rays.origin - centre) / radii).astype(np.float32)
    t = _nearest_root(d, o)
    point = o[:, None, None] + d * t
    normal = point * scale[:, None, None]
    return Hits(t, normal / (np.linalg.norm(normal, axis=0) + np.float32(1e-9)), None)


def _hit_cylinder(solid: Solid, rays: Rays, window: Window) -> Hits:
    centre, radii = (solid.lo + solid.hi) / 2, (solid.hi - solid.lo) / 2
    direction = rays.direction[:, window[0], window[1]]
    scale = np.asarray(1 / radii[:2], np.float32)
    d = direction[:2] * scale[:, None, None]
    o = ((rays.origin - centre)[:2] / radii[:2]).astype(np.float32)
    side = _nearest_root(d, o)
    z = rays.origin[2] + direction[2] * side
    side = np.where((z >= solid.lo[2]) & (z <= solid.hi[2]), side, FAR)
    top = np.float32(solid.hi[2] - rays.origin[2]) * rays.inverse[2][window]
    inside = np.sum((o[:, None, None] + d * top) ** 2, axis=0) <= 1
    top = np.where(inside & (top > 0), top, FAR)
    t = np.minimum(side, top)
    around = (o[:, None, None] + d * t) * scale[:, None, None]
    normal = np.concatenate([around, np.zeros((1, *t.shape), np.float32)])
    normal /= np.linalg.norm(normal, axis=0) + np.float32(1e-9)
    normal[:, top < side] = np.array([[0], [0], [1]], np.float32)
    return Hits(t, normal, None)


def _nearest_root(d: Floats, o: Floats) -> Floats:
    """Smallest positive t with |o + d t| = 1, FAR where there is none; d (k, h, w), o (k,)."""
    a = np.sum(d * d, axis=0)
    b = np.einsum("khw,k->hw", d, o)
    c = np.float32(o @ o - 1)
    discriminant = b * b - a * c
    t = (-b - np.sqrt(np.maximum(discriminant, 0))) / a
    return np.where((discriminant > 0) & (t > 0), t, FAR)

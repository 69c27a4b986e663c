"""Depth agreement: whether two depth images show one static scene, by ICP.

Points of one image are transformed into the other camera and compared with the depth measured
there (projective data association: Blais and Levine, IEEE PAMI 17, 1995). A point on the measured
surface agrees. A point in front of it contradicts, since the other camera saw through it. A point
behind it does not count, since it may be hidden. Distances are relative, so that a wrong unit of
depth is the same as a wrong length of the motion.

Colour agrees where the grey levels of points that both images show are alike (photometric
consistency, by normalised cross-correlation). Neither exposure nor contrast matters.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from statistics import NormalDist
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from perception.camera.poses import cross, motion_of

Floats = NDArray[np.float64]

COLUMNS: Final = 64  # pixels of the sampled image, across
EDGE: Final = 0.05  # share of its depth by which a pixel may differ from its neighbours
TOLERANCE: Final = 0.03  # share of its depth by which a point may be off the surface
NOISY: Final = 0.004  # share of depth a metre, from which its noise widens both ...
SIGMAS: Final = 3.0  # ... to so many deviations of a difference ...
WIDEST: Final = 4.0  # ... but to so many times as much at most
SMOOTH: Final = 0.25  # share of the pixels that are taken for even surfaces
MIN_SMOOTH: Final = 100  # pixels of those
LONE: Final = 0.6  # share of agreeing points of a frame that does not belong to its neighbours
MIN_DEPTH: Final = 0.05  # [m] before the camera, in units that may be wrong
MAX_DEPTH: Final = 200.0  # [m]
BLUR: Final = 0.7  # samples by which grey levels are smoothed
MIN_SHOWN: Final = 150  # points that both images show, to compare their grey levels
MIN_CONTRAST: Final = 4.0  # standard deviation of these


@dataclass(frozen=True, slots=True, eq=False)
class DepthSamples:
    """A depth image on a grid of every few pixels, without pixels on depth edges."""

    depth: NDArray[np.float32]  # (h, w) [m], nan = no return or an edge
    K: Floats  # (3, 3) intrinsics of that grid [px]
    points: NDArray[np.float32]  # (n, 3) [m] the grid's points in the camera frame
    noise: float = 0.0  # standard deviation, as a share of the depth a metre; 0: small


@dataclass(frozen=True, slots=True)
class Agreement:
    """Points of two images that the other image shows, counted."""

    agreeing: int
    contradicting: int
    overlap: float  # share of the points that the other image shows

    @property
    def share(self) -> float:
        """Share of the judged points that agree; 0 without any."""
        judged = self.agreeing + self.contradicting
        return self.agreeing / judged if judged else 0.0


def depth_samples(depth: NDArray[np.float32], K: Floats) -> DepthSamples:
    """Samples of a depth image (H, W) [m] with intrinsics `K` (3, 3) [px]."""
    step = max(1, depth.shape[1] // COLUMNS)
    first = step // 2
    grid = depth[first::step, first::step].astype(np.float32)
    noise = _noise(grid)
    near = np.full((4, *grid.shape), np.nan, np.float32)
    near[0, :, 1:], near[1, :, :-1] = grid[:, :-1], grid[:, 1:]
    near[2, 1:], near[3, :-1] = grid[:-1], grid[1:]
    with np.errstate(invalid="ignore"):
        edge = (np.abs(near - grid) > _widened(EDGE, noise, grid) * grid).any(axis=0)
        grid[edge | ~(grid > 0) | (grid > MAX_DEPTH)] = np.nan
    scaled = K.copy()
    scaled[:2] /= step
    scaled[:2, 2] -= first / step
    return gridded_samples(grid, scaled, noise)


def _noise(grid: NDArray[np.float32]) -> float:
    """Standard deviation of a grid of depth, as a share of the depth a metre; 0 where small.

    A plane has an inverse depth linear in the pixels, so its second differences are noise.
    """
    with np.errstate(divide="ignore"):
        inverse = np.where(grid > 0, 1 / grid, np.nan)
    steps = [np.abs(np.diff(inverse, n=2, axis=axis)).ravel() for axis in (0, 1)]
    known = np.concatenate(steps)
    known = known[np.isfinite(known)]
    if len(known) < MIN_SMOOTH / SMOOTH:
        return 0.0
    # the second difference of three values has sqrt(6) times their deviation
    deviation = np.quantile(known, SMOOTH) / NormalDist().inv_cdf((1 + SMOOTH) / 2) / np.sqrt(6)
    return float(deviation) if deviation >= NOISY else 0.0


def _widened(least: float, noise: float, depth: NDArray[np.float32]) -> float | NDArray[np.float32]:
    """A tolerance, as a share of the depth, of the difference of two values with noise."""
    if not noise:
        return least
    wide = np.float32(SIGMAS * np.sqrt(2) * noise) * depth
    return np.asarray(np.clip(wide, least, WIDEST * least), np.float32)


def gridded_samples(grid: NDArray[np.float32], K: Floats, noise: float = 0.0) -> DepthSamples:
    """Samples of depth (h, w) [m], nan = unknown, with intrinsics `K` (3, 3) of that grid [px]."""
    rows, columns = np.nonzero(np.isfinite(grid))
    z = grid[rows, columns]
    x = (columns - K[0, 2]) * z / K[0, 0]
    y = (rows - K[1, 2]) * z / K[1, 1]
    return DepthSamples(grid, K, np.column_stack([x, y, z]).astype(np.float32), noise)


def agreement(a: DepthSamples, b: DepthSamples, T_a_b: Floats) -> Agreement:
    """Agreement of two images; `T_a_b` (4, 4) takes camera b to camera a."""
    R, t = T_a_b[:3, :3], T_a_b[:3, 3]
    noise = float(np.hypot(a.noise, b.noise) / np.sqrt(2))
    forth = _seen(a, b.points @ R.T + t, noise)
    back = _seen(b, (a.points - t) @ R, noise)
    points = max(len(a.points) + len(b.points), 1)
    agreeing = forth[0] + back[0]
    contradicting = forth[1] + back[1]
    return Agreement(agreeing, contradicting, (forth[2] + back[2]) / points)


def nearest_pixels(
    camera: DepthSamples, points: Floats
) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.intp]]:
    """Indices in view of `points` (n, 3) [m] of the camera frame, their rows and their columns."""
    z = points[:, 2]
    ahead = np.nonzero(z > MIN_DEPTH)[0]
    K, (height, width) = camera.K, camera.depth.shape
    column = np.rint(K[0, 0] * points[ahead, 0] / z[ahead] + K[0, 2]).astype(np.intp)
    row = np.rint(K[1, 1] * points[ahead, 1] / z[ahead] + K[1, 2]).astype(np.intp)
    inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    return ahead[inside], row[inside], column[inside]


def _seen(camera: DepthSamples, points: Floats, noise: float) -> tuple[int, int, int]:
    """Numbers of points that agree, that contradict, and that lie in view of measured depth."""
    seen, rows, columns = nearest_pixels(camera, points)
    measured = camera.depth[rows, columns]
    with np.errstate(invalid="ignore"):
        off = (points[seen, 2] - measured) / measured  # negative: in front of the surface
        tolerance = _widened(TOLERANCE, noise, measured)
        agreeing = int((np.abs(off) <= tolerance).sum())
        contradicting = int((off < -tolerance).sum())
    return agreeing, contradicting, int(np.isfinite(off).sum())


STEPS: Final = 12
GATES: Final = (0.5, 0.06)  # [m] distance of a point from its plane that still counts: first, last
MIN_POINTS: Final = 60  # points
DAMPING: Final = 0.02  # of a point's weight: what few surfaces hold stays as it is


@dataclass(frozen=True, slots=True)
class Correction:
    """Correction of a motion that makes two depth images agree."""

    T_a_b: Floats  # (4, 4) the corrected motion, camera b to camera a
    after: Agreement  # of the images by it
    offset: float  # [m] by which the points of b move, median


def register(a: DepthSamples, b: DepthSamples, T_a_b: Floats) -> Correction:
    """Correction of the motion `T_a_b` (4, 4), right to some decimetres."""
    T, normals = T_a_b.copy(), surface_normals(a)
    for gate in np.geomspace(*GATES, STEPS):
        step = _step(a, normals, b.points @ T[:3, :3].T + T[:3, 3], float(gate))
        if step is None:
            break
        T = step @ T
    moved = b.points @ (T[:3, :3] - T_a_b[:3, :3]).T + (T[:3, 3] - T_a_b[:3, 3])
    offset = float(np.median(np.linalg.norm(moved, axis=1))) if len(moved) else 0.0
    return Correction(T, agreement(a, b, T), offset)


def _step(a: DepthSamples, normals: Floats, points: Floats, gate: float) -> Floats | None:
    """One Gauss-Newton step (4, 4) of the points (n, 3) [m] of camera a; None with too few."""
    found = plane_residuals(a, normals, points, gate)
    if found is None:
        return None
    J, off, _ = found
    weight = 1 / (1 + (off / (0.3 * gate)) ** 2)
    H = (J * weight[:, None]).T @ J + DAMPING * weight.sum() * np.eye(6)
    twist = np.linalg.solve(H, (J * weight[:, None]).T @ off)
    return motion_of(twist)


def plane_residuals(
    a: DepthSamples, normals: Floats, points: Floats, gate: float
) -> tuple[Floats, Floats, Floats] | None:
    """Jacobian (n, 6), distance (n,) [m] and depth (n,) [m] of points off the planes of camera a.

    None with too few points nearer than `gate` [m] to the plane that the camera shows there.
    """
    seen, rows, columns = nearest_pixels(a, points)
    z, p, n = a.depth[rows, columns], points[seen], normals[rows, columns]
    with np.errstate(invalid="ignore"):
        off = ((columns - a.K[0, 2]) * z / a.K[0, 0] - p[:, 0]) * n[:, 0]
        off += ((rows - a.K[1, 2]) * z / a.K[1, 1] - p[:, 1]) * n[:, 1]
        off += (z - p[:, 2]) * n[:, 2]
        used = np.flatnonzero(np.abs(off) < gate)  # nan compares false
    if len(used) < MIN_POINTS:
        return None
    p, n = p[used], n[used]
    return np.hstack([cross(p, n), n]), off[used], p[:, 2]


@lru_cache(maxsize=2)
def surface_normals(camera: DepthSamples) -> Floats:
    """Unit normals (h, w, 3) by central differences; nan at edges and borders."""
    height, width = camera.depth.shape
    columns, rows = np.meshgrid(np.arange(width), np.arange(height))
    z, K = camera.depth, camera.K
    p = np.stack([(columns - K[0, 2]) * z / K[0, 0], (rows - K[1, 2]) * z / K[1, 1], z], axis=2)
    found = np.full(p.shape, np.nan)
    n = cross(p[2:, 1:-1] - p[:-2, 1:-1], p[1:-1, 2:] - p[1:-1, :-2])
    with np.errstate(invalid="ignore", divide="ignore"):
        found[1:-1, 1:-1] = n / np.sqrt((n * n) @ np.ones((3, 1)))
    return found


def grey_samples(rgb: NDArray[np.uint8], shape: tuple[int, ...]) -> NDArray[np.float32]:
    """Grey levels of an image (H, W, 3) on the grid (h, w) of its depth samples."""
    small = cv2.resize(rgb, (shape[1], shape[0]), interpolation=cv2.INTER_AREA)
    grey = np.asarray(cv2.cvtColor(small, cv2.COLOR_RGB2GRAY), np.float32)
    return np.asarray(cv2.GaussianBlur(grey, (0, 0), BLUR), np.float32)


def colour_agreement(
    a: DepthSamples,
    grey_a: NDArray[np.float32],
    b: DepthSamples,
    grey_b: NDArray[np.float32],
    T_a_b: Floats,
) -> float | None:
    """Correlation, -1 to 1, of the grey levels of points that both images show; None for few.

    `T_a_b` (4, 4) takes camera b to camera a.
    """
    seen, rows, columns = nearest_pixels(a, b.points @ T_a_b[:3, :3].T + T_a_b[:3, 3])
    z = b.points[seen] @ T_a_b[2, :3] + T_a_b[2, 3]
    measured = a.depth[rows, columns]
    with np.errstate(invalid="ignore"):
        near = np.abs(z - measured) <= 2 * TOLERANCE * measured
    there = grey_b[np.isfinite(b.depth)][seen[near]]
    here = grey_a[rows[near], columns[near]]
    if len(here) < MIN_SHOWN or min(here.std(), there.std()) < MIN_CONTRAST:
        return None
    return float(np.corrcoef(here, there)[0, 1])


def lone_text(what: str, frames: str, ids: Sequence[str]) -> str:
    """A sentence on `frames`, "5 frames", whose depth or colour contradicts those around them."""
    causes = {
        "depth": "of another unit, of another moment or by another pose",
        "colour": "late, mirrored, not registered or of another camera",
    }
    return (
        f"{what} of {frames} contradicts the frames before and after, which agree with each other, "
        f"as where it is {causes[what]}: {', '.join(ids[:3])}{', ...' * (len(ids) > 3)}"
    )

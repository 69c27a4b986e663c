"""Relative motion of two RGB-D images, by features of the first that the second shows.

The depth of a feature counts like the disparity of a stereo camera (Mur-Artal and Tardos,
ORB-SLAM2, IEEE T-RO 2017): its error grows with the square of the distance.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from perception.camera.depth_agreement import Agreement, agreement, plane_residuals, surface_normals
from perception.camera.poses import Pose, cross, inverse, logarithms, motion_of, rigid
from perception.odometry.features import Features, Image, depth_at, matched

Floats = NDArray[np.float64]

MIN_INLIERS: Final = 25
MIN_COARSE: Final = 10  # inliers of a motion that flow is to refine
REPROJECTION: Final = 3.0  # [px] of an inlier
BASELINE: Final = 40.0  # [px m] focal length times the baseline of the stereo camera stood for
MAX_FLOW_POINTS: Final = 200
_MAX_FLOW: Final = 4.0  # [px] from a guess to where a corner is found, on the top of the pyramid
_WINDOW: Final = 15  # [px] that are compared around a corner
_CRITERIA: Final = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 12, 0.03)  # [px]
MIN_FLOW_SHARE: Final = 0.3
_ATTEMPTS: Final = 2  # motions that are tried for one pair of images
_ITERATIONS: Final = 10
_HUBER: Final = 1.5  # [px] from which a residual counts less
_CUT: Final = 12.0  # [px] from which it does not count
_GATES: Final = np.geomspace(0.15, 0.05, 5)  # [m] from a surface to a point that still counts
_DEPTH_NOISE: Final = 0.0022  # [m] of depth close by; it grows with the square of the distance
_TOGETHER: Final = 4.0  # neighbouring corners share errors: so many count as one


@dataclass(frozen=True, slots=True, eq=False)
class RelativeMotion:
    """Motion between two cameras, with its information."""

    T: Pose  # (4, 4) takes points of the first camera to the second
    information: Floats  # (6, 6) of a small motion (rotation, translation) after T
    inliers: int
    share: float  # of the matches that are inliers


def motion_by_features(first: Features, second: Features, image: Image) -> RelativeMotion | None:
    """Motion from the camera of `first` to that of `second`, with its image; None: none found.

    Where the motion that most features show is not that of the image, since they are on something
    that moves with the camera, that of the others is tried.
    """
    a, b = matched(first, second)
    for _ in range(_ATTEMPTS):
        coarse, inliers = _coarse(first, second, a, b, image.K)
        if not len(inliers):
            return None
        fine = None if coarse is None else motion_by_flow(first, image, coarse.T, levels=1)
        if fine is not None and fine.share >= MIN_FLOW_SHARE:
            return fine
        a, b = np.delete(a, inliers), np.delete(b, inliers)
    return None


def coarse_motion(first: Features, second: Features, K: Floats) -> RelativeMotion | None:
    """Motion between two cameras by their features alone, where at least MIN_COARSE agree."""
    return _coarse(first, second, *matched(first, second), K)[0]


def _coarse(
    first: Features, second: Features, a: NDArray[np.intp], b: NDArray[np.intp], K: Floats
) -> tuple[RelativeMotion | None, NDArray[np.intp]]:
    """Motion by the matches of features `a` and `b` (m,), and those that agree by RANSAC."""
    if len(a) < MIN_COARSE:
        return None, np.zeros(0, np.intp)
    points, pixels, z = first.points[a], second.pixels[b], second.points[b, 2]
    T, inliers = consensus(points, pixels, K, REPROJECTION, confidence=0.999)
    if T is None or len(inliers) < MIN_COARSE:
        return None, np.zeros(0, np.intp)
    return refined(points, pixels, z, K, T, MIN_COARSE), inliers


def motion_by_flow(
    first: Features, second: Image, T: Pose, *, levels: int
) -> RelativeMotion | None:
    """The motion near `T`, by features of `first` found in the second image to a part of a pixel.

    Lucas and Kanade's optical flow on a pyramid of `levels` above the image.
    """
    points, before, K = first.points[:MAX_FLOW_POINTS], first.pixels[:MAX_FLOW_POINTS], second.K
    p = points @ T[:3, :3].T + T[:3, 3]
    guess = (p @ K.T)[:, :2] / np.maximum(p[:, 2:], 0.1)
    height, width = second.grey.shape
    inside = (p[:, 2] > 0.1) & ((guess > 8) & (guess < (width - 8, height - 8))).all(axis=1)
    if second.still is not None:
        column, row = before.astype(int).T
        inside &= ~second.still[row, column]
    points, before, guess = points[inside], before[inside], guess[inside]
    if len(points) < MIN_INLIERS:
        return None
    found, status, _ = cv2.calcOpticalFlowPyrLK(
        first.grey, second.grey, before.astype(np.float32), guess.astype(np.float32),
        winSize=(_WINDOW, _WINDOW), maxLevel=levels, flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
        criteria=_CRITERIA,
    )  # fmt: skip
    pixels = np.asarray(found, np.float64)
    near = np.linalg.norm(pixels - guess, axis=1) < _MAX_FLOW * 2**levels
    good = (np.asarray(status).ravel() == 1) & near
    if good.sum() < MIN_INLIERS:
        return None
    pixels = pixels[good]
    measured = refined(points[good], pixels, depth_at(second.depth, pixels), K, T)
    if measured is None:
        return None
    # corners that are in view and were not found count against the motion
    measured = replace(measured, share=measured.inliers / len(points))
    return with_depth(measured, first, second)


def consensus(
    points: Floats, pixels: Floats, K: Floats, off: float, *, confidence: float
) -> tuple[Pose | None, NDArray[np.intp]]:
    """Motion by RANSAC over the projections of three points, and the indices that agree.

    Those are at most `off` [px] from their pixels. None, and no indices, without a motion.
    """
    found, rotation, translation, inliers = cv2.solvePnPRansac(
        points, pixels, K, None,
        iterationsCount=200, reprojectionError=off, confidence=confidence,
        flags=cv2.SOLVEPNP_AP3P,
    )  # fmt: skip
    if not found or inliers is None:
        return None, np.zeros(0, np.intp)
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = cv2.Rodrigues(rotation)[0], np.asarray(translation).ravel()
    return T, np.asarray(inliers, np.intp).ravel()


def refined(
    points: Floats, pixels: Floats, z: Floats, K: Floats, T: Pose, least: int = MIN_INLIERS
) -> RelativeMotion | None:
    """The motion that fits projections and depths (nan: none) best, near `T`.

    Gauss-Newton with Huber's weights. None where fewer than `least` features agree.
    """
    for _ in range(_ITERATIONS):
        residuals, J = linearised(points, pixels, z, K, T)
        norm = np.sqrt((residuals * residuals) @ np.ones(3))
        weight = np.where(norm < _HUBER, 1.0, _HUBER / np.maximum(norm, 1e-9)) * (norm < _CUT)
        rows = J.reshape(-1, 6)
        weighted = rows * np.repeat(weight, 3)[:, None]
        H, g = weighted.T @ rows, weighted.T @ residuals.ravel()
        if not np.isfinite(H).all():
            return None
        lengths = np.linalg.eigvalsh(H)
        if not lengths[0] * 1e12 > lengths[-1]:
            return None
        step = -np.linalg.solve(H, g)
        T = motion_of(step) @ T
        if np.abs(step).max() < 1e-5:
            break
    residuals = linearised(points, pixels, z, K, T)[0]
    norm = np.sqrt((residuals * residuals) @ np.ones(3))
    inliers = int((norm < REPROJECTION).sum())
    if inliers < least:
        return None
    return RelativeMotion(rigid(T), H / _TOGETHER, inliers, inliers / len(points))


def linearised(
    points: Floats, pixels: Floats, z: Floats, K: Floats, T: Pose
) -> tuple[Floats, Floats]:
    """Residuals (n, 3) [px] of u, v and disparity, and their Jacobian (n, 3, 6)."""
    p = points @ T[:3, :3].T + T[:3, 3]
    depth = np.maximum(p[:, 2], 0.05)
    fx, fy = K[0, 0], K[1, 1]
    x, y = p[:, 0] / depth, p[:, 1] / depth
    known = np.isfinite(z)
    disparity = np.where(known, BASELINE * (1 / depth - 1 / np.where(known, z, 1.0)), 0.0)
    residuals, J = np.empty((len(p), 3)), np.zeros((len(p), 3, 6))
    residuals[:, 0] = fx * x + K[0, 2] - pixels[:, 0]
    residuals[:, 1] = fy * y + K[1, 2] - pixels[:, 1]
    residuals[:, 2] = disparity
    J[:, 0, 3], J[:, 0, 5] = fx / depth, -fx * x / depth
    J[:, 1, 4], J[:, 1, 5] = fy / depth, -fy * y / depth
    J[:, 2, 5] = np.where(known, -BASELINE / depth**2, 0.0)
    J[:, :, :3] = cross(p[:, None], J[:, :, 3:])  # by a small rotation
    return residuals, J


def with_depth(measured: RelativeMotion, first: Features, second: Image) -> RelativeMotion:
    """The motion that fits both the measured one and the surfaces of two depth images best.

    Iterative closest points from point to plane, with the features' motion as a prior.
    """
    T, inward = measured.T, surface_normals(second.samples)
    noise = np.hypot(first.samples.noise, second.samples.noise)
    H = measured.information
    for gate in _GATES:
        points = first.samples.points @ T[:3, :3].T + T[:3, 3]
        found = plane_residuals(second.samples, inward, points, float(gate))
        if found is None:
            return measured
        J, off, z = found
        deviation = np.hypot(_DEPTH_NOISE * (1 + (z / 2) ** 2), noise * z**2)
        weight = 1 / (1 + (off / (0.3 * gate)) ** 2) / deviation**2
        away = logarithms((T @ inverse(measured.T))[None])[0]
        H = (J * weight[:, None]).T @ J + measured.information
        g = (J * weight[:, None]).T @ off - measured.information @ away
        T = motion_of(np.linalg.solve(H, g)) @ T
    return replace(measured, T=T, information=H)


def confirmed_motion(
    first: Features,
    second: Features,
    image: Image,
    *,
    agrees: float,
    overlap: float,
    min_share: float = 0.0,
) -> RelativeMotion | None:
    """Motion by the features of two views, with depth; `image` is that of the second.

    None where less than `min_share` of the matches agree on it, or depth shows two scenes: at least
    `agrees` of it has to agree, in an `overlap` of at least so much.
    """
    coarse = coarse_motion(first, second, image.K)
    if coarse is None or coarse.share < min_share:
        return None
    measured = with_depth(coarse, first, image)
    shown = depth_agreement(first, image, measured.T)
    return measured if shown.share >= agrees and shown.overlap >= overlap else None


def depth_agreement(first: Features, second: Image | Features, T: Pose) -> Agreement:
    """Agreement of two images' depth by a motion `T`, first camera to second."""
    return agreement(second.samples, first.samples, T)

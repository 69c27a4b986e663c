"""Estimated poses: the entries of a recording that has no poses, with those its images give.

Frames whose pose is not found are left out. The world is level with the first camera's own axes:
the camera begins at its origin and looks along x (REP 103); the gravity alignment of recordings
levels it.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from kg.model.errors import RecordingError
from perception.camera.depth_edges import colour_fit
from perception.camera.poses import BODY_FROM_CAMERA, Pose, gridded_pose
from perception.frames import Frame
from perception.odometry.features import shrunk
from perception.odometry.tracking import Odometry, tracked
from perception.odometry.tracking_report import TrackingReport
from perception.sources.depth_check import shows_two_scenes, two_scenes
from perception.sources.depth_readings import usual
from perception.sources.intrinsics_check import check_intrinsics, check_views
from perception.sources.listing import FrameEntry, RecordingListing
from perception.sources.recording_options import RecordingOptions

HIGHEST: Final = 2.4  # [m] of a camera in a hand or on a robot, over the floor
USUAL_HEIGHT: Final = 1.4  # [m]
ALIKE: Final = np.cos(np.radians(5.0))  # length of the mean of directions that are one
MIN_FRAMES: Final = 2  # frames with a pose that make a recording
COLOUR_FRAMES: Final = 48  # whose colour is compared with depth
OnEstimated = Callable[[int, int], None]  # frames done, frames in all

_log = logging.getLogger(__name__)


def wants_estimate(listing: RecordingListing, options: RecordingOptions) -> bool:
    """Whether poses are to be estimated; raises RecordingError where that is not allowed."""
    if options.estimate_poses is not None and options.poses is None:
        if listing.no_poses and not options.estimate_poses:
            raise RecordingError(
                f"{listing.no_poses}; `hereabouts map` estimates them once it is complete"
            )
        return options.estimate_poses
    return bool(listing.no_poses) and options.poses is None


def with_estimated_poses(
    listing: RecordingListing,
    frame_at: Callable[[int], Frame],
    options: RecordingOptions,
    name: str,
    on_estimated: OnEstimated | None = None,
) -> tuple[RecordingListing, TrackingReport]:
    """The frames of a listing whose poses are found, with them; `frame_at` decodes a frame.

    Its `up` is that of the estimated world, where something tells it. Raises RecordingError where
    the camera is lost in nearly all frames.
    """
    because = listing.no_poses or f"{name}: as asked"
    _log.warning("%s; its poses are estimated from its images, and drift", because)
    entries = listing.entries

    def frames() -> Iterator[Frame]:
        for number in range(len(entries)):
            yield frame_at(number)
            if on_estimated is not None:
                on_estimated(number + 1, len(entries))

    odometry = tracked(frames)
    poses, report = odometry.poses(), odometry.report()
    if odometry.frozen.count:
        _log.warning(
            "%s: in %d frames colour or depth is a copy of an earlier image while the other goes "
            "on; they are left out",
            name,
            odometry.frozen.count,
        )
    if options.check:
        _check_intrinsics(name, odometry, poses, frame_at)
    found = [
        (entry, BODY_FROM_CAMERA @ T)
        for entry, T in zip(entries, poses, strict=True)
        if T is not None
    ]
    if len(found) < MIN_FRAMES:
        raise RecordingError(f"{name}: {report.summary()}; {advice()}")
    _log.warning("%s: %s", name, report.summary())
    fit = colour_fit_of(frame_at, len(entries)) if options.check else None
    if shows_two_scenes(fit) and report.mostly_lost:
        raise RecordingError(f"{two_scenes(name, fit)}; --no-check maps it as it is")
    if shows_two_scenes(fit):  # poses by depth alone may be right
        _log.warning("%s", two_scenes(name, fit))
    if options.check and report.contradicts_itself:
        raise RecordingError(
            f"{name}: the estimated poses are wrong: depth contradicts {report.contradicting} of "
            f"{report.compared} pairs of views; {advice()}, --no-check maps it as it is"
        )
    posed = tuple(replace(entry, T_world_cam=gridded_pose(T)) for entry, T in found)
    selected = options.selection.thinned.of(posed, name)
    up = _up(listing, found)
    return replace(listing, entries=selected, no_poses="", up=up, T_map_world=None), report


def colour_fit_of(frame_at: Callable[[int], Frame], count: int) -> float | None:
    """The `colour_fit` of a sample of so many frames."""
    chosen = np.unique(np.linspace(0, count - 1, COLOUR_FRAMES).astype(int))
    return colour_fit([(f.rgb, f.depth) for f in (frame_at(int(n)) for n in chosen)])


def _check_intrinsics(
    name: str,
    odometry: Odometry,
    poses: Sequence[Pose | None],
    frame_at: Callable[[int], Frame],
) -> None:
    """Check intrinsics by the frames that were found, or by key frames where most were lost."""
    known = [(number, T) for number, T in enumerate(poses) if T is not None]
    if 2 * len(known) < len(poses):
        first = frame_at(0)
        if shrunk(first) is first:  # else the line would name other intrinsics than those given
            check_views(name, [key.features for key in odometry.graph.keys], first.K)
        return
    numbers = [number for number, _ in known]
    check_intrinsics(name, [T for _, T in known], lambda place: frame_at(numbers[place]))


def check_height(name: str, heights: Sequence[float], depth_scale: float) -> None:
    """Warn where the camera is higher over the floor than hands and robots hold it.

    `heights` [m]; poses that are estimated have the unit of depth, so nothing contradicts it.
    """
    height = float(np.median(heights))
    if height > HIGHEST:
        scale = usual(depth_scale * height / USUAL_HEIGHT)
        _log.warning(
            "%s: the camera is %.1f m over the floor, by a depth of %g units a metre; "
            "--depth-scale %g would put it at %.1f m",
            name,
            height,
            depth_scale,
            scale,
            height * depth_scale / scale,
        )


def advice() -> str:
    """Advice for a recording whose poses cannot be estimated."""
    return (
        "slower motion, more light, and depth of things between 0.3 and 8 m in each image would "
        "work, or --poses FILE"
    )


def _up(
    listing: RecordingListing, found: Sequence[tuple[FrameEntry, Pose]]
) -> NDArray[np.float64] | None:
    """Up in the estimated world, from an IMU or the recording's own poses where they turn alike.

    `found` has the frames whose pose (4, 4) was found.
    """
    first, T_first = found[0]
    if listing.up_of_first_camera is not None and first is listing.entries[0]:
        return T_first[:3, :3] @ listing.up_of_first_camera
    if listing.up is None or listing.no_poses or listing.unused_poses:
        return None  # the entries have no poses by which it would be seen
    ups = [T[:3, :3] @ entry.T_world_cam[:3, :3].T @ listing.up for entry, T in found]
    known = [one for one in ups if np.isfinite(one).all()]  # others had lost their pose
    if not known:
        return None
    mean: NDArray[np.float64] = np.mean(known, axis=0)
    length = float(np.linalg.norm(mean))
    return mean / length if length > ALIKE else None

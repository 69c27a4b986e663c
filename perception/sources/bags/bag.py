"""Recordings in bags: ROS 1, ROS 2 (SQLite, MCAP) and plain MCAP files.

Colour and depth are paired by nearest stamps; the pose is that of colour's frame in the map frame
at colour's stamp, from tf or a topic of poses. World frames have z up (REP 103).
"""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from kg.model.errors import RecordingError
from perception.camera.image_decoding import MILLIMETRES
from perception.camera.intrinsics import Intrinsics
from perception.camera.poses import LOST, Pose, checked_pose
from perception.sources.bags.bag_file import bag_path
from perception.sources.bags.bag_images import MessageSource, frame_id, images_of
from perception.sources.bags.bag_index import BagIndex, Stream, read_index
from perception.sources.bags.bag_poses import (
    PoseSource,
    UnposedError,
    pose_source,
    up_of_camera,
    warn_of_publishers,
)
from perception.sources.bags.bag_topics import (
    camera_topic,
    cameras,
    check_pose_topic,
    colour_topic,
    depth_topic,
)
from perception.sources.listing import (
    DepthCamera,
    Format,
    FrameEntry,
    RecordingListing,
    Streams,
    nearest_pairs,
)
from perception.sources.ros.image_messages import NANOSECONDS, intrinsics_of, is_calibrated, view_of
from perception.sources.ros.transform_tree import TransformTree

SUFFIXES: Final = ".bag, .mcap, .db3"
OTHER_LENS: Final = 0.03  # by which the views of two lenses differ
MAX_TOLERANCE: Final = 0.5  # [s] that is advised between colour and depth

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class Choice:
    """The streams of a bag that make its frames."""

    colour: Stream
    depth: Stream
    camera: Stream | None
    depth_camera: Stream | None
    tree: TransformTree  # that the frames of both are in
    poses: PoseSource | None  # None: no poses reach the camera ...
    no_poses: str  # ... for this reason, ...
    posed_elsewhere: bool  # ... though there are poses of something else
    depth_apart: bool  # whether depth has another frame or view than colour, and is registered

    @property
    def pose_topic(self) -> Stream | None:
        """Topic of the poses; None for tf."""
        return None if self.poses is None else self.poses.topic

    @property
    def map_frame(self) -> str:
        """Frame of the poses; "" without any."""
        return "" if self.poses is None else self.poses.map_frame

    @property
    def posed(self) -> str:
        """The frame of the poses, and their source, for people."""
        if self.poses is None:
            return "none"
        by = "tf" if self.poses.topic is None else self.poses.topic.topic
        return f"{self.colour.frame} in {self.poses.map_frame}, from {by}"

    def pose_at(self, stamp: float) -> Pose | None:
        """Pose (4, 4) of the camera in the map frame at a stamp [s]; None where there is none."""
        if self.poses is None:
            return None
        return self.poses.tree.at(self.poses.map_frame, self.colour.frame, stamp)


def matches(path: Path) -> bool:
    """Whether `path` is a bag, or a folder with one."""
    return bag_path(path) is not None


def read(path: Path, streams: Streams) -> RecordingListing:
    """All colour images that have depth and a pose; the others are skipped with a warning.

    Raises RecordingError where the bag is damaged, or topics, camera or transforms are missing.
    """
    index = read_index(opened(path))
    return listing_of(index, choose(index, streams), streams)


def opened(path: Path) -> Path:
    """The bag that is `path`, or lies in it; raises RecordingError where there is none."""
    found = bag_path(path)
    if found is None:
        raise RecordingError(f"{path} is no bag ({SUFFIXES}, or a folder with metadata.yaml)")
    return found


def choose(index: BagIndex, streams: Streams) -> Choice:
    """The streams to read; raises RecordingError where images or cameras are missing."""
    if streams.map_frame is None and _noted_frame(index) is not None:
        streams = replace(streams, map_frame=_noted_frame(index))
    check_pose_topic(index, streams.pose)
    if index.restarts:
        for tree in index.trees.values():
            tree.keep_last_run()
    colour = colour_topic(index, streams)
    depth = depth_topic(index, streams.depth, colour)
    poses, missing, elsewhere = None, "", False
    try:
        poses = pose_source(index, colour, streams)
    except RecordingError as error:
        missing, elsewhere = str(error), not isinstance(error, UnposedError)
    if index.refused:
        _log.warning(
            "%s: %d transforms or poses that make no sense are skipped: %s",
            index.path,
            index.refused,
            index.refusal,
        )
    if index.restarts:
        _log.warning(
            "%s: the stamps of images go back, as where a simulation is started again; what was "
            "recorded after the last time is read",
            index.path,
        )
    if poses is not None:
        warn_of_publishers(str(index.path), poses, colour.frame, float(colour.seconds[0]))
    if poses is not None and poses.others and poses.topic is not None:
        _log.warning(
            "%s: poses of %s are taken for those of %s; --pose-frame %s if they are of that frame",
            index.path,
            poses.topic.topic,
            colour.frame,
            " or ".join(poses.others),
        )
    depth_camera = camera_topic(index, depth)
    camera = camera_topic(index, colour, streams.camera)
    robot = index.trees.get(index.robot(colour.topic), index.tree)
    tree = robot if poses is None else poses.tree
    apart = _is_apart(index, tree, colour, depth) or _has_own_lens(
        index, camera, depth_camera, (colour, depth)
    )
    return Choice(colour, depth, camera, depth_camera, tree, poses, missing, elsewhere, apart)


def _is_apart(index: BagIndex, tree: TransformTree, colour: Stream, depth: Stream) -> bool:
    if depth.frame in (colour.frame, index.streams[colour.topic].frame):
        return False
    try:
        tree.at(colour.frame, depth.frame, depth.stamps[0] / NANOSECONDS)
    except RecordingError as error:
        _log.warning(
            "%s: depth is taken for registered to colour, though it is in another frame: %s",
            index.path,
            error,
        )
        return False
    return True


def _has_own_lens(
    index: BagIndex,
    camera: Stream | None,
    depth_camera: Stream | None,
    images: tuple[Stream, Stream],
) -> bool:
    """Whether depth is in colour's frame, but has another view by its own CameraInfo."""
    same_frame = images[0].frame == images[1].frame
    if not same_frame or camera is None or depth_camera is None:
        return False
    if not is_calibrated(camera.first) or not is_calibrated(depth_camera.first):
        return False
    views = [view_of(one.first) for one in (camera, depth_camera)]
    if min(view.min() for view in views) <= 0:
        return False  # they do not tell a size
    if np.abs(views[1] / views[0] - 1).max() < OTHER_LENS:
        return False
    _log.warning(
        "%s: depth has another field of view than colour by its own CameraInfo, %s, and is "
        "projected into colour's",
        index.path,
        depth_camera.topic,
    )
    return True


def listing_of(index: BagIndex, choice: Choice, streams: Streams) -> RecordingListing:
    """Entries of the chosen streams; raises RecordingError where nothing fits together."""
    entries, missing = _entries(index, choice, streams)
    poses = choice.poses
    camera, no_camera = camera_or_reason(index, choice)
    return RecordingListing(
        entries,
        camera,
        index.text.depth_scale or MILLIMETRES,
        depth_camera_of(index, choice, entries[0].stamp) if choice.depth_apart else None,
        up=np.array([0.0, 0.0, 1.0]),
        T_map_world=noted_transform(index, choice),
        no_poses="" if poses is not None or choice.posed_elsewhere else missing,
        unused_poses=missing if poses is not None or choice.posed_elsewhere else "",
        up_of_first_camera=(
            up_of_camera(index, choice.colour, entries[0].stamp) if poses is None else None
        ),
        no_camera=no_camera,
        other_frames={
            f"--pose-frame {frame}": T
            for frame, T in (poses.others if poses is not None else {}).items()
        },
    )


def _entries(
    index: BagIndex, choice: Choice, streams: Streams
) -> tuple[tuple[FrameEntry, ...], str]:
    """Entries with their poses, LOST where one has none; without any the reason is given."""
    colour, depth = choice.colour, choice.depth
    stamps = colour.seconds
    pairs = sorted(
        nearest_pairs(stamps, depth.seconds, streams.tolerance), key=lambda ij: stamps[ij[0]]
    )
    if not pairs:
        raise RecordingError(
            f"{index.path}: no stamps of {colour.topic} and {depth.topic} lie within "
            f"{streams.tolerance:g} s{_wider(stamps, depth.seconds)}"
        )
    source = MessageSource(Path(index.path), (colour.topic, depth.topic))
    images = images_of(source, colour), images_of(source, depth)
    ids = _noted(index, "frames")
    named = isinstance(ids, list) and len(ids) == len(pairs) and all(map(_is_name, ids))
    named = named and len(set(ids)) == len(ids)
    entries = list[FrameEntry]()
    for place, (i, j) in enumerate(pairs):
        if entries and entries[-1].stamp == stamps[i]:
            continue
        id_ = ids[place] if named else frame_id(colour.stamps[i])
        T = choice.pose_at(float(stamps[i]))
        pose = LOST if T is None else T
        entries.append(FrameEntry(id_, images[0][i], images[1][j], pose, float(stamps[i])))
    if not any(np.isfinite(entry.T_world_cam).all() for entry in entries):
        return tuple(entries), choice.no_poses or _unposed(index, choice, stamps)
    if len(entries) < len(stamps):
        _log.warning(
            "%s: of %d images %d have no depth within %g s%s; they are skipped",
            index.path,
            len(stamps),
            len(stamps) - len(entries),
            streams.tolerance,
            _wider(stamps, depth.seconds)
            if 2 * len(pairs) < min(len(stamps), len(depth.stamps))
            else "",
        )
    return tuple(entries), ""


def _wider(a: NDArray[np.float64], b: NDArray[np.float64]) -> str:
    """Advice on stamps that lie farther apart than the tolerance."""
    ordered = np.sort(b)
    if 2 < len(a) == len(b):
        behind = float(np.ptp((ordered - np.sort(a))[[0, -1]]))
        if behind > np.median(np.diff(np.sort(a))):
            return f"; one falls behind by {behind:.2g} s, so stamps of one clock are needed"
    after = np.searchsorted(ordered, a)
    sides = [ordered[(after + step).clip(0, len(b) - 1)] for step in (-1, 0)]
    near = np.minimum(abs(a - sides[0]), abs(a - sides[1]))
    apart = float(np.median(near))
    if apart > MAX_TOLERANCE:
        return f"; they are {apart:.3g} s apart, so one of the clocks is wrong"
    wanted = np.ceil(apart * 110) / 100
    return f"; most lie {apart:.3f} s apart: --tolerance {wanted:g} would work"


def _unposed(index: BagIndex, choice: Choice, stamps: NDArray[np.float64]) -> str:
    """Message for poses that begin after the images, or end before them."""
    assert choice.poses is not None
    span = choice.poses.tree.span(choice.poses.map_frame, choice.colour.frame)
    reach = "" if span is None else f"; transforms reach from {span[0]:.3f} to {span[1]:.3f}"
    return (
        f"{index.path}: none of the images has a pose of {choice.colour.frame!r} in "
        f"{choice.poses.map_frame!r} (images: {stamps.min():.3f} to {stamps.max():.3f}{reach}); "
        "--poses FILE gives a trajectory by the images' clock, --poses estimate finds one in them"
    )


def _is_name(text: Any) -> bool:
    """Whether a frame's noted name may be a file's name."""
    return isinstance(text, str) and 0 < len(text) < 200 and not set(text) & set("/\\\0\n\r")


def camera_of(index: BagIndex, info: Stream | None, images: Stream) -> Intrinsics | None:
    """Camera of a stream of images by its CameraInfo; None where it has none."""
    if info is None:
        return None
    where = f"{index.path}, {info.topic}"
    return intrinsics_of(info.first, where, rectified="rect" in images.topic.split("/image")[-1])


def camera_or_reason(index: BagIndex, choice: Choice) -> tuple[Intrinsics | None, str]:
    """Camera of the colour images; or None, with the reason and the options that give it."""
    info, topic = choice.camera, choice.colour.topic
    if info is not None and is_calibrated(info.first):
        return camera_of(index, info, choice.colour), ""
    others = [s.topic for s in cameras(index, topic) if is_calibrated(s.first)]
    said = f"no CameraInfo of {topic}" if info is None else f"{info.topic} has K = 0"
    named = "".join(f", --info-topic {other}" for other in sorted(others))
    return None, f"{index.path}: {said}; --intrinsics FILE{named} would work"


def depth_camera_of(index: BagIndex, choice: Choice, stamp: float) -> DepthCamera:
    """Camera of the depth images, where it is apart from colour's; raises RecordingError."""
    camera = camera_of(index, choice.depth_camera, choice.depth)
    if camera is None:
        raise RecordingError(
            f"{index.path}: {choice.depth.topic} is in frame {choice.depth.frame!r}, not in "
            f"colour's {choice.colour.frame!r}, and has no CameraInfo to register it by"
        )
    T = choice.tree.at(choice.colour.frame, choice.depth.frame, stamp)
    if T is None:
        raise RecordingError(
            f"{index.path}: no transform of {choice.depth.frame!r} to {choice.colour.frame!r} at "
            f"{stamp:.3f}"
        )
    return DepthCamera(camera, T)


def _noted(index: BagIndex, key: str) -> Any:
    return None if index.note is None else index.note.get(key)


def _noted_frame(index: BagIndex) -> str | None:
    frame = _noted(index, "frame")
    return frame if isinstance(frame, str) and frame else None


def noted_transform(index: BagIndex, choice: Choice) -> Pose | None:
    """Transform (4, 4) of the poses' frame to the map that the bag itself notes; None without."""
    noted = _noted(index, "T_map_world") if choice.map_frame == _noted_frame(index) else None
    return None if noted is None else _transform(noted, index.path)


def _transform(numbers: Any, path: Path | str) -> NDArray[np.float64]:
    where = f"{path}: the noted T_map_world"
    try:
        T = np.array(numbers, np.float64).reshape(4, 4)
    except (TypeError, ValueError, OverflowError) as error:
        raise RecordingError(f"{where} is no 4x4 matrix") from error
    checked_pose(T, where)
    return T


FORMAT = Format("bag", "a ROS 1 or ROS 2 bag or an MCAP file", matches, read)

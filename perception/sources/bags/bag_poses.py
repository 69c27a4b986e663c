"""Poses of a bag's camera: its tree of transforms or topic, and the up of an IMU at rest.

A chain of links must lead from a map frame to the camera, and one of them must move. Each robot of
a bag, by the namespace of its tf, has a tree of its own.
"""

from __future__ import annotations

import itertools
import logging
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kg.model.errors import RecordingError
from perception.camera.poses import Pose
from perception.sources.bags.bag_file import BagFile
from perception.sources.bags.bag_index import ODOMETRY, PATH, POSES, BagIndex, Stream
from perception.sources.bags.camera_mounts import add_mount
from perception.sources.listing import Streams
from perception.sources.ros.image_messages import NANOSECONDS, frame_name, nanoseconds
from perception.sources.ros.transform_tree import MAP_FRAMES, TransformTree

POSE_TYPES: Final = (ODOMETRY, *POSES, PATH)
MAX_NAMED: Final = 12  # frames in an error
_AIM: Final = re.compile("goal|target|initialpose|clicked|setpoint|command|desired|reference")
OPTICAL: Final = ("optical", "camera", "cam")  # in names of frames, the likeliest first
BODIES: Final = ("base_link", "base_footprint", "base", "body", "imu")


_log = logging.getLogger(__name__)


class UnposedError(RecordingError):
    """Nothing moves the camera."""


@dataclass(frozen=True, slots=True)
class PoseSource:
    """The poses of a camera."""

    tree: TransformTree
    map_frame: str
    topic: Stream | None  # None: tf
    #: poses (4, 4) of the camera in other frames that a topic may give poses of, unnamed
    others: Mapping[str, Pose] = field(default_factory=dict)


def pose_source(index: BagIndex, images: Stream, streams: Streams) -> PoseSource:
    """The poses of the camera of `images`.

    Raises RecordingError where none reach it; it names the frames there are, and options.
    """
    trees = list(_trees(index, images, streams))
    if streams.pose is None:
        found = [one for tree in trees if (one := _by_tf(tree, images.frame, streams)) is not None]
        best = next((one for one in found if one.map_frame in MAP_FRAMES), None)
        if best is not None:
            return best
        joined = _by_topics(index, images, streams, trees, linked=True)
        if joined is not None or found:
            return joined or found[0]
    given = _by_topics(index, images, streams, trees, linked=False)
    if given is not None:
        return given
    raise _unreached(index, images, trees, streams)


def reaches(index: BagIndex, images: Stream, streams: Streams) -> bool:
    """Whether poses reach the camera of a stream of images."""
    try:
        pose_source(index, images, streams)
    except RecordingError:
        return False
    return True


def add_poses(index: BagIndex, topic: str, tree: TransformTree, camera: str, given: str | None
              ) -> None:  # fmt: skip
    """Add the poses of a topic to the tree; poses of an unnamed frame are the camera's own."""
    found = index.poses[topic]
    child = given or found.child or camera
    for place, stamp in enumerate(found.stamps):
        if index.restarts and place < found.run:
            continue
        try:
            tree.add(found.parent, child, stamp, found.rows[7 * place : 7 * place + 7])
        except RecordingError as error:
            index.refuse(str(error))
    tree.prefer(found.parent, child)


def _trees(index: BagIndex, images: Stream, streams: Streams) -> Iterator[TransformTree]:
    """Trees that may move a camera: its robot's, that of /tf, both together, then the others'."""
    own = index.robot(images.topic)
    order = [own, *([""] if own and "" in index.trees else [])]
    trees = [index.trees[name] for name in order if name in index.trees]
    if len(trees) == 2:
        trees.append(trees[0].merged(trees[1]))
    trees += [tree for name, tree in index.trees.items() if name not in order]
    for tree in trees or [index.tree]:
        add_mount(tree, images.frame, streams.camera_in)
        yield tree


def warn_of_publishers(path: str, poses: PoseSource, camera: str, begin: float) -> None:
    """Warn of frames with several parents, and of transforms that contradict each other.

    Images begin at `begin` [s].
    """
    tree, chain = poses.tree, poses.tree.ancestors(camera)
    for child, parent, others in tree.other_parents(chain[:-1]):
        _log.warning(
            "%s: %s is below %s and %s; %s is taken, --map-frame %s takes another",
            path,
            child,
            parent,
            ", ".join(others),
            parent,
            others[0],
        )
    for child in chain[:-1]:
        distance, angle = tree.contradiction(child, begin)
        if distance or angle:
            above = tree.parent(child)
            mount = f"--camera-in {above}=X,Y,Z,ROLL,PITCH,YAW"
            _log.warning(
                "%s: transforms %s -> %s contradict each other by %s, as of two publishers; %s, "
                "--poses FILE or --poses estimate would work",
                path,
                above,
                child,
                f"{distance:.2f} m" if distance else f"{np.degrees(angle):.0f} degrees",
                mount if tree.is_static(child) else "--pose-topic TOPIC of one of them",
            )


def _by_tf(tree: TransformTree, camera: str, streams: Streams) -> PoseSource | None:
    if streams.map_frame is not None:
        tree.lead(camera, streams.map_frame)
    above = tree.ancestors(camera)
    linked = [f for f, chain in tree.chains().items() if chain[-1] == above[-1] and f != camera]
    given = streams.map_frame
    if given is not None:  # a camera that stands still has a pose in it, too
        return PoseSource(tree, frame_name(given), None) if frame_name(given) in linked else None
    if any(not tree.is_static(frame) for frame in above[:-1]):
        return PoseSource(tree, _map_frame(tree, camera), None)
    # some publish the map's pose in the robot's frame
    below = (f for f in MAP_FRAMES if f in linked and tree.span(f, camera) is not None)
    return next((PoseSource(tree, frame, None) for frame in below), None)


def _map_frame(tree: TransformTree, camera: str, given: str | None = None) -> str:
    """Frame that poses are taken in: map, world or odom, where it carries the camera; or the root.

    A link must move the camera in it. Raises RecordingError where nothing links the given frame to
    the camera.
    """
    if given is not None:
        tree.at(given, camera, 0.0)
        return frame_name(given)
    above = tree.ancestors(camera)
    moving = next((i for i, frame in enumerate(above[:-1]) if not tree.is_static(frame)), 0)
    return next((frame for frame in MAP_FRAMES if frame in above[moving + 1 :]), above[-1])


def _by_topics(
    index: BagIndex, images: Stream, streams: Streams, trees: list[TransformTree], *, linked: bool
) -> PoseSource | None:
    """The first topic whose frame carries the camera; unless `linked`, also of an unnamed frame."""
    robot = index.robot(images.topic)
    aimless = [t for t, rows in index.poses.items() if not _AIM.search(t) and len(rows.stamps) > 1]
    topics = [index.streams[topic] for topic in ([streams.pose] if streams.pose else aimless)]
    topics.sort(
        key=lambda s: (index.robot(s.topic) == robot, s.type == ODOMETRY, len(s.stamps), s.topic),
        reverse=True,
    )
    for topic in topics:
        rows = index.poses[topic.topic]
        child = frame_name(streams.pose_frame or rows.child)
        for tree in trees:
            above = tree.ancestors(images.frame)
            if child in above if child else not linked:
                others = (
                    {}
                    if child
                    else {
                        frame: T
                        for frame in tree.mounts(images.frame)
                        if (T := tree.at(frame, images.frame, 0.0)) is not None
                    }
                )
                add_poses(index, topic.topic, tree, images.frame, child or None)
                root = _map_frame(tree, images.frame, streams.map_frame)
                return PoseSource(tree, root, topic, others)
    return None


def _unreached(
    index: BagIndex, images: Stream, trees: list[TransformTree], streams: Streams
) -> RecordingError:
    """Error for a camera that no poses reach: the frames there are, and options that work."""
    camera, given = images.frame, streams.map_frame
    if given is not None and not any(frame_name(given) in tree.frames for tree in trees):
        trees[0].at(given, camera, 0.0)  # raises for the unknown frame
    moved = [*dict.fromkeys(frame for tree in trees for frame in tree.carried())]
    moved += [frame_name(rows.child) for rows in index.poses.values() if rows.child]
    moved = [*dict.fromkeys(moved)]
    frames = [*dict.fromkeys(frame for tree in trees for frame in tree.frames)]
    known = any(camera in tree.frames for tree in trees)
    if not moved:
        poses = "its tf does not move" if frames else "no transforms, and no odometry or pose topic"
        still = f"; --map-frame {trees[0].ancestors(camera)[-1]} maps a camera that stands still"
        return UnposedError(
            f"{index.path} has no poses of {camera or 'the camera'!r} ({poses}); --poses FILE "
            f"gives a trajectory{still if known else ''}{_listed(frames)}"
        )
    base = max(moved, key=lambda f: (f in BODIES, f not in MAP_FRAMES, f))
    optical = next((f for word in OPTICAL for f in moved if word in f), "FRAME")
    options = f"--camera-in {base}=X,Y,Z,ROLL,PITCH,YAW or --camera-in URDF says where it sits"
    if streams.camera_in is not None and "=" not in streams.camera_in:  # its joints turn
        options = options.replace("URDF", "a URDF with fixed joints from there to the camera")
    if not known:
        options += f", --camera-frame {optical} names its frame"
    return RecordingError(
        f"{index.path} has poses of {', '.join(moved[:MAX_NAMED])}, but none reach the camera of "
        f"{images.topic}, whose frame is {camera!r}; {options}, --poses FILE gives "
        f"its trajectory, --poses estimate finds one in the images{_listed(frames)}"
    )


def _listed(frames: list[str]) -> str:
    more = f" and {len(frames) - MAX_NAMED} more" if len(frames) > MAX_NAMED else ""
    return f"; frames: {', '.join(frames[:MAX_NAMED])}{more}" if frames else ""


IMU: Final = "sensor_msgs/msg/Imu"
GRAVITY: Final = 9.81  # [m/s^2]
OFF: Final = 0.4  # [m/s^2] from gravity, of the mean acceleration of a camera at rest ...
SHAKEN: Final = 0.3  # [m/s^2] ... and its standard deviation along any axis
AROUND: Final = 0.5  # [s] before and after the image
MAX_NAME: Final = 256  # characters of a frame
MIN_MESSAGES: Final = 10
MAX_MESSAGES: Final = 2000


class Reading(NamedTuple):
    """Reading of an IMU: the acceleration in a frame at a time."""

    stamp: int  # [ns]
    frame: str
    acceleration: tuple[float, float, float]  # [m/s^2]

    @classmethod
    def of(cls, message: Any) -> Reading:
        """The reading of a sensor_msgs/Imu."""
        a, header = message.linear_acceleration, message.header
        return cls(nanoseconds(header), frame_name(header.frame_id)[:MAX_NAME], (a.x, a.y, a.z))


def up_of_camera(index: BagIndex, colour: Stream, stamp: float) -> NDArray[np.float64] | None:
    """Up (3,) in the colour camera at its first `stamp` [s]; None where no IMU tells it.

    The IMU is one that transforms link to the camera; it has to be at rest then.
    """
    path = Path(index.path)
    topics = [name for name, (kind, _) in sorted(index.others.items()) if kind == IMU]
    if not topics or not path.exists():
        return None
    tree = index.trees.get(index.robot(colour.topic), index.tree)
    begin = int((stamp - AROUND) * NANOSECONDS)
    with BagFile(path) as bag:
        for topic in topics:
            raws = itertools.islice(bag.messages({topic}, start=begin), MAX_MESSAGES)
            readings = (Reading.of(bag.decoded(raw)) for raw in raws)
            up = up_by_imu(readings, tree, colour.frame, stamp)
            if up is not None:
                return up
    return None


def up_by_imu(
    readings: Iterable[Reading], tree: TransformTree, camera: str, stamp: float
) -> NDArray[np.float64] | None:
    """Up (3,) in the frame `camera` at a `stamp` [s], by one IMU's readings.

    None where the IMU is not at rest then, or `tree` does not link it to the camera.
    """
    frame, found = "", list[tuple[float, float, float]]()
    try:
        for one in readings:
            if one.stamp > (stamp + AROUND) * NANOSECONDS:
                break
            if one.stamp >= (stamp - AROUND) * NANOSECONDS:
                frame = one.frame
                found.append(one.acceleration)
        T = np.eye(4) if frame == camera else tree.at(camera, frame, stamp)
    except RecordingError:  # damaged messages, or an IMU that is not mounted on the camera
        return None
    accelerations = np.array(found, np.float64).reshape(-1, 3)
    if T is None or not _is_at_rest(accelerations):
        return None
    up: NDArray[np.float64] = T[:3, :3] @ accelerations.mean(axis=0)
    return up / np.linalg.norm(up)


def _is_at_rest(accelerations: NDArray[np.float64]) -> bool:
    """Whether accelerations are those of gravity alone."""
    return (
        len(accelerations) >= MIN_MESSAGES
        and bool(np.isfinite(accelerations).all())
        and abs(float(np.linalg.norm(accelerations.mean(axis=0))) - GRAVITY) < OFF
        and float(accelerations.std(axis=0).max()) < SHAKEN
    )

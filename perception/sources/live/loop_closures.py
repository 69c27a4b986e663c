"""Loop closures of a robot's own SLAM: where the frames that it sent were, as it knows since.

The SLAM tells its corrected path again and again (nav_msgs/Path, or RTAB-Map's graph), or nothing
but a transform map -> odom that jumps. Odometry below that frame has no jumps. So each frame keeps
its pose by odometry, and a path gives odometry a place in the map at each of its poses, between
which it changes evenly. A jump says so for its moment alone: it is spread evenly over the way since
the last one, as odometry's drift grows.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from kg.model.errors import RecordingError
from perception.camera.poses import (
    Pose,
    gridded_pose,
    inverse,
    logarithms,
    motion,
    motions,
    pose_from_quaternion,
)
from perception.frames import Frame
from perception.sources.bags.bag_file import RawMessage
from perception.sources.bags.bag_index import PATH
from perception.sources.bags.bag_poses import PoseSource
from perception.sources.live.connection import LiveDecoder
from perception.sources.ros.image_messages import NANOSECONDS, frame_name, nanoseconds
from perception.sources.ros.message_types import MAP_GRAPHS, leading
from perception.sources.ros.transform_tree import TransformTree, pose_numbers

TF: Final = "tf"  # instead of a topic: jumps of map -> odom count
TYPES: Final = (PATH, *MAP_GRAPHS)
MAX_FRAMES: Final = 3000  # that are followed
MAX_NODES: Final = 10_000  # poses of a path that are kept
JUMP: Final = 0.1, np.deg2rad(3)  # [m], [rad] at the camera that make a jump of map -> odom
DRIFT: Final = 0.1, 0.3  # share of the way, and [m], beyond which a jump is no drift of odometry
LEVER: Final = 0.3  # [m] of way that a turn of 1 rad counts
MOUNT: Final = 0.15, np.deg2rad(8)  # [m], [rad] within which a path's body is a frame of tf

Floats = NDArray[np.float64]

_log = logging.getLogger(__name__)


@dataclass(slots=True)
class _Followed:
    """A frame that was given to be mapped."""

    id: str
    stamp: float  # [s]
    T_odom_cam: Pose
    T_map_odom: Pose  # as it was told then
    T_map_cam: Pose  # as it is known now
    mapped: Floats  # (3,) [m] where the camera was when the frame was mapped
    messages: int  # of the path, before it was given


@dataclass(slots=True)
class LoopClosures:
    """Corrected poses of the frames of one camera.

    `topic` has the corrected path, or is TF. Its messages and the camera's frames are added by
    different threads.
    """

    topic: str
    _frames: list[_Followed] = field(default_factory=list)
    _nodes: dict[int, tuple[Pose, Pose]] = field(default_factory=dict)  # stamp: by odometry, now
    _stamps: dict[int, int] = field(default_factory=dict)  # [ns] of RTAB-Map's nodes
    _mount: Pose | None = None  # (4, 4) of the path's body in the frame that odometry moves
    _moved: float = 0.0  # [m] since frames were mapped, at most
    _messages: int = 0
    _applied: int = 0  # messages that the frames' poses follow from
    _began: int = 0  # first frame after the last jump
    _jumped_from: Pose | None = None  # map -> odom before a jump that goes on
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def wanted(self, topics: Mapping[str, str]) -> set[str]:
        """The topic, where it has a type of TYPES."""
        return {self.topic} if topics.get(self.topic) in TYPES else set()

    @property
    def is_silent(self) -> bool:
        """Whether a topic was to tell the path, and has not."""
        return self.topic != TF and not self._messages

    @property
    def moved(self) -> float:
        """Distance [m] by which closures moved cameras since their frames were mapped, at most."""
        with self._lock:
            self._follow()
            return self._moved

    def corrected(self) -> dict[str, Pose]:
        """Poses (4, 4) of all frames by the closures so far, by id; `moved` counts from them."""
        with self._lock:
            self._follow()
            self._moved = 0.0
            for one in self._frames:
                one.mapped = one.T_map_cam[:3, 3]
            return {one.id: gridded_pose(one.T_map_cam) for one in self._frames}

    def add_frame(self, frame: Frame, stamp: float, poses: PoseSource, camera: str) -> None:
        """Add a frame that is about to be mapped, of `stamp` [s] by the robot's clock.

        `camera` is its frame in tf. Raises RecordingError where tf has no odometry to go by.
        """
        odom, _ = _odometry(poses.tree, poses.map_frame, camera)
        if self.topic == TF and odom == poses.map_frame:
            raise RecordingError(
                f"tf has no frame between {odom} and the robot that jumps could be of; "
                "--loops TOPIC of a corrected path would work"
            )
        T_map, T_odom = poses.tree.at(poses.map_frame, camera, stamp), np.eye(4)
        if odom != poses.map_frame:
            found = poses.tree.at(odom, camera, stamp)
            T_odom = T_odom if T_map is None or found is None else T_map @ inverse(found)
        with self._lock:
            if len(self._frames) < MAX_FRAMES:
                T = frame.T_map_cam
                one = _Followed(
                    frame.id, stamp, inverse(T_odom) @ T, T_odom, T, T[:3, 3], self._messages
                )
                self._frames.append(one)
                if self.topic == TF:
                    self._notice_jump()

    def add_message(
        self, raw: RawMessage, decoder: LiveDecoder, poses: PoseSource, camera: str
    ) -> None:
        """Add a message of the corrected path; raises RecordingError for one of no use."""
        message: Any
        if raw.type == PATH:
            message = decoder.decoded(raw)
            path = [(nanoseconds(one.header), one.pose) for one in message.poses]
            if len({stamp for stamp, _ in path}) < len(path):
                raise RecordingError("its poses have no stamps of their own")
        else:
            message = leading(MAP_GRAPHS[0], bytes(raw.data), is_ros1=decoder.is_ros1)
            path = self._stamped(message)
        parent = frame_name(message.header.frame_id)
        if parent != frame_name(poses.map_frame):
            raise RecordingError(
                f"it is in {parent}, and poses are in {poses.map_frame}; --map-frame {parent} "
                "would work where tf has it"
            )
        with self._lock:
            self._add_path([(stamp, _pose(one)) for stamp, one in path if stamp], poses, camera)

    def _stamped(self, message: Any) -> list[tuple[int, Any]]:
        """Stamp [ns] and pose of each node of RTAB-Map's graph whose stamp is known.

        The newest node has the stamp of the message that tells it first.
        """
        ids = [int(number) for number in message.nodes]
        if ids and max(ids) > max(self._stamps, default=-1):
            self._stamps[max(ids)] = nanoseconds(message.header)
        known = zip(ids, message.poses, strict=False)
        return [(self._stamps[number], pose) for number, pose in known if number in self._stamps]

    def _add_path(self, path: list[tuple[int, Pose]], poses: PoseSource, camera: str) -> None:
        tree, (odom, body) = poses.tree, _odometry(poses.tree, poses.map_frame, camera)
        new = dict[int, Pose]()
        for stamp, T in path:
            if stamp in self._nodes:
                self._nodes[stamp] = self._nodes[stamp][0], T
            elif len(self._nodes) + len(new) < MAX_NODES:
                at = tree.at(odom, body, stamp / NANOSECONDS)
                if at is not None:
                    new[stamp] = at
        told = [(stamp, T) for stamp, T in path if stamp in new]
        if told and self._mount is None:
            self._mount = _mount(tree, (poses.map_frame, body, camera), told)
        for stamp, T in told:
            assert self._mount is not None
            self._nodes[stamp] = new[stamp] @ self._mount, T
        self._messages += 1

    def _follow(self) -> None:
        """Bring the frames' poses up to date with the path."""
        if self._applied == self._messages or not self._nodes:
            return
        self._applied, stamps = self._messages, sorted(self._nodes)
        by_odometry, now = np.array([self._nodes[one] for one in stamps]).swapaxes(0, 1)
        T_map_odom = now @ _inverses(by_odometry)
        steps = logarithms(inverse(T_map_odom[0]) @ T_map_odom)
        seconds = np.array(stamps) / NANOSECONDS
        # the path knows nothing yet of frames that came after it
        known = [f for f in self._frames if f.stamp <= seconds[-1] or f.messages < self._messages]
        at = [np.interp([f.stamp for f in known], seconds, step) for step in steps.T]
        for one, T in zip(known, T_map_odom[0] @ motions(np.array(at).T), strict=True):
            one.T_map_cam = T @ one.T_odom_cam
        self._measure(known)

    def _measure(self, changed: Sequence[_Followed]) -> None:
        apart = (float(np.linalg.norm(one.T_map_cam[:3, 3] - one.mapped)) for one in changed)
        self._moved = max(apart, default=0.0)

    def _notice_jump(self) -> None:
        """Spread a jump of map -> odom over the way before it, once it has ended."""
        if len(self._frames) < 2:
            return
        before, last = self._frames[-2:]
        step = motion(before.T_map_odom @ last.T_odom_cam, last.T_map_odom @ last.T_odom_cam)
        jumps = step[0] > JUMP[0] or step[1] > JUMP[1]
        if jumps and self._jumped_from is None:
            self._jumped_from = before.T_map_odom
        elif not jumps and self._jumped_from is not None:
            self._spread(self._jumped_from, last.T_map_odom)
            self._began, self._jumped_from = len(self._frames) - 2, None

    def _spread(self, T_before: Pose, T_after: Pose) -> None:
        """Spread what map -> odom changed by over the frames since the last jump."""
        some = self._frames[self._began : -1]
        T = np.array([T_before @ one.T_odom_cam for one in some])
        goal = T_after @ some[-1].T_odom_cam
        steps = np.diff(T[:, :3, 3], axis=0)
        turns = np.linalg.norm(logarithms(_inverses(T[:-1]) @ T[1:])[:, :3], axis=1)
        way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(steps, axis=1) + LEVER * turns)])
        jump = float(np.linalg.norm(goal[:3, 3] - T[-1, :3, 3]))
        if jump > DRIFT[0] * way[-1] + DRIFT[1]:
            _log.warning(
                "map -> odom jumped by %.2f m after %.1f m of way, which is no drift of odometry "
                "(a robot that was set to a place, or found again); what was mapped stays",
                jump,
                way[-1],
            )
            return
        share = way / max(way[-1], 1e-9)
        turn = np.zeros((len(T), 6))
        turn[:, :3] = share[:, None] * logarithms((goal @ inverse(T[-1]))[None])[0, :3]
        R = motions(turn)[:, :3, :3]
        along = np.einsum("nij,nj->ni", R[1:], steps)
        at = T[0, :3, 3] + np.concatenate([np.zeros((1, 3)), np.cumsum(along, axis=0)])
        at += share[:, None] * (goal[:3, 3] - at[-1])
        for one, turned, before, place in zip(some, R, T, at, strict=True):
            one.T_map_cam = np.eye(4)
            one.T_map_cam[:3, :3], one.T_map_cam[:3, 3] = turned @ before[:3, :3], place
        self._measure(self._frames)


def _odometry(tree: TransformTree, map_frame: str, camera: str) -> tuple[str, str]:
    """The frame that odometry is in, and the one that it moves, on the way from map to camera.

    Without odometry these are the map and what lies next below it.
    """
    chain = tree.ancestors(camera)
    if frame_name(map_frame) not in chain[1:]:
        return map_frame, camera
    below = chain[: chain.index(frame_name(map_frame))]
    if any(not tree.is_static(frame) for frame in below[:-1]):
        return below[-1], below[-2]
    return map_frame, below[-1]


def _mount(tree: TransformTree, frames: tuple[str, str, str], told: list[tuple[int, Pose]]) -> Pose:
    """Pose (4, 4) of a path's body in the frame that odometry moves.

    `frames` are the map's, that one, and the camera's. The body is the frame of tf that the path
    agrees with best, by the pose at which it does; else where the first pose has it.
    """
    map_frame, moved, camera = frames
    best, found = 1.0, None
    chain = tree.ancestors(camera)
    for stamp, T in told:
        base = tree.at(map_frame, moved, stamp / NANOSECONDS)
        if base is None:
            continue
        X = inverse(base) @ T
        found = X if found is None else found
        for name in chain[: chain.index(moved) + 1]:
            at = tree.at(moved, name, stamp / NANOSECONDS)
            if at is not None:
                far = max(np.divide(motion(at, X), MOUNT))
                best, found = (far, at) if far < best else (best, found)
    return np.eye(4) if found is None else found


def _inverses(T: Floats) -> Floats:
    return np.array([inverse(one) for one in T]).reshape(-1, 4, 4)


def _pose(message: Any) -> Pose:
    numbers = np.array(pose_numbers(message.position, message.orientation))
    return pose_from_quaternion(numbers[:3], numbers[3:], "a pose of a corrected path")

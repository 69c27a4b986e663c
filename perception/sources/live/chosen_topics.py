"""The topics that a live stream makes frames of, and what may change in them while it runs.

A CameraInfo that differs from the one before is taken; a colour image of another frame has the
pose of that frame; transforms that come late are waited for longer.
"""

from __future__ import annotations

import logging
import time
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from kg.model.errors import RecordingError
from perception.camera.gravity_alignment import clear_turns, parse_up
from perception.camera.image_decoding import MILLIMETRES
from perception.camera.intrinsics import Rectifier
from perception.camera.poses import Pose
from perception.frames import Frame
from perception.sources.bags.bag import (
    Choice,
    camera_of,
    camera_or_reason,
    choose,
    depth_camera_of,
    noted_transform,
)
from perception.sources.bags.bag_file import RawMessage
from perception.sources.bags.bag_index import STAMPED, BagIndex, frame_of
from perception.sources.bags.bag_poses import add_poses
from perception.sources.listing import FrameEntry, RecordingListing
from perception.sources.live.connection import LiveDecoder, LiveImage
from perception.sources.live.loop_closures import LoopClosures
from perception.sources.recording import ABSOLUTE_STAMP, FolderRecording
from perception.sources.recording_options import RecordingOptions
from perception.sources.ros.image_messages import NANOSECONDS, frame_name

MAX_PATIENCE: Final = 8.0  # [s] for which transforms are waited for at most, ...
LATER: Final = 1.5  # ... else for so many times as they were late

_log = logging.getLogger(__name__)


def choice_or_error(index: BagIndex, options: RecordingOptions) -> Choice | RecordingError:
    """The choice by the messages so far, or an error that names the missing topic."""
    try:
        choice = choose(index, options.streams)
        posed = options.streams.pose or options.estimate_poses is False
        if choice.poses is None and (choice.posed_elsewhere or posed):
            raise RecordingError(choice.no_poses)
        if options.intrinsics is None:
            camera, reason = camera_or_reason(index, choice)
            if camera is None:
                raise RecordingError(reason)
        if choice.depth_apart and not options.registered:
            depth_camera_of(index, choice, choice.depth.stamps[-1] / NANOSECONDS)
        return choice
    except RecordingError as error:
        return error


@dataclass(slots=True)
class ChosenTopics:
    """The chosen topics of a stream, as they change."""

    index: BagIndex
    choice: Choice
    patience: float  # [s] for which transforms are waited for; grows where they come later
    has_camera: bool  # whether the camera is given, so that CameraInfo does not count
    loops: LoopClosures | None = None  # None: frames' poses stay
    cameras: int = 0  # how often a camera has changed
    _infos: dict[str, bytes] = field(default_factory=dict)  # CameraInfo by topic, without its stamp
    _names: set[str] = field(default_factory=set)  # frames of colour that were told
    _unposed: LiveImage | None = None  # an image that transforms have not reached in time

    @property
    def pose_topic(self) -> str:
        """Topic of the poses; "" where they come from tf."""
        return "" if self.choice.pose_topic is None else self.choice.pose_topic.topic

    @property
    def info_topics(self) -> set[str]:
        """Topics of CameraInfo that frames depend on."""
        infos = (self.choice.camera, self.choice.depth_camera)
        return set() if self.has_camera else {info.topic for info in infos if info is not None}

    @property
    def topics(self) -> set[str]:
        """Topics that frames and their poses are made of, but for transforms."""
        loops = "" if self.loops is None else self.loops.topic
        images = {self.choice.colour.topic, self.choice.depth.topic}
        return images | self.info_topics | {self.pose_topic, loops}

    def follow(self, frame: Frame, stamp: float) -> None:
        """Follow the pose of a frame of `stamp` [s] from now on; raises RecordingError."""
        if self.loops is not None and self.choice.poses is not None:
            self.loops.add_frame(frame, stamp, self.choice.poses, self.choice.colour.frame)

    def add_closures(self, raw: RawMessage, decoder: LiveDecoder) -> None:
        """Take what a message tells of poses before; raises RecordingError."""
        loops, choice = self.loops, self.choice
        if loops is not None and raw.topic == loops.topic and choice.poses is not None:
            loops.add_message(raw, decoder, choice.poses, choice.colour.frame)

    def add_poses(self, frame: str | None) -> None:
        """Take new poses of the topic of poses, of `frame` where the user names it."""
        choice = self.choice
        assert choice.poses is not None
        add_poses(self.index, self.pose_topic, choice.poses.tree, choice.colour.frame, frame)

    def add_camera(self, raw: RawMessage, decoder: LiveDecoder) -> None:
        """Take a CameraInfo that differs from the one before; raises RecordingError."""
        body = raw.data[STAMPED:]
        if self._infos.get(raw.topic) == body:
            return
        self._infos[raw.topic] = body
        stream, images = self.index.streams[raw.topic], self.choice.colour
        new = replace(stream, first=decoder.decoded(raw))
        before = camera_of(self.index, stream, images)
        if camera_of(self.index, new, images) != before:
            stream.first, self.cameras = new.first, self.cameras + 1
            _log.warning("%s: %s has changed, and counts from now on", decoder.address, raw.topic)

    def check_frame(self, raw: RawMessage, decoder: LiveDecoder) -> None:
        """Take the frame of a colour image for that of its poses."""
        colour, name = self.choice.colour, frame_name(frame_of(decoder, raw, decoder.address))
        if name == colour.frame:
            return
        if name not in self._names:
            self._names |= {name, colour.frame}
            line = "%s: %s is of the frame %r now, not of %r; poses are those of %r"
            _log.warning(line, decoder.address, raw.topic, name, colour.frame, name)
        colour.frame = name

    def pose(self, image: LiveImage, since: float) -> tuple[bool, Pose | None]:
        """Whether the pose of an image is final, and the pose, or None without transforms.

        The image has waited `since` [s]. Raises RecordingError where no transforms link it to the
        map.
        """
        poses, stamp, missed = self.choice.poses, image.seconds, self._unposed
        if poses is None:
            return True, np.eye(4)
        tree, names = poses.tree, (poses.map_frame, self.choice.colour.frame)
        span = tree.span(*names)
        if missed and span and span[1] >= missed.seconds:  # transforms go on: were they late?
            if tree.at(*names, missed.seconds) is not None:
                late = LATER * (time.monotonic() - missed.came)
                self.patience = min(max(late, self.patience), MAX_PATIENCE)
            self._unposed = None
        if since < self.patience and span is not None and span[1] < stamp:
            return False, None
        T = tree.at(*names, stamp)
        if T is None:
            self._unposed = self._unposed or image
        return True, T

    def recording_of(
        self, entry: FrameEntry, options: RecordingOptions, start_time: float | None
    ) -> FolderRecording:
        """Recording without frames that decodes images: the cameras, fitted to the first image.

        `start_time` [s] is that of the cameras before, so that times go on.
        """
        choice = self.choice
        camera = options.intrinsics or camera_of(self.index, choice.camera, choice.colour)
        assert camera is not None
        apart = None
        if choice.depth_apart and not options.registered:
            apart = depth_camera_of(self.index, choice, entry.stamp)
        height, width = entry.colour.colour().shape[:2]
        noted = noted_transform(self.index, choice)
        if start_time is None:
            start_time = time.time() - entry.stamp if entry.stamp < ABSOLUTE_STAMP else 0.0
        up = parse_up("z" if options.up is None else options.up)
        return FolderRecording(
            name=str(self.index.path),
            format="live",
            T_map_world=np.eye(4) if noted is None else noted,
            listing=RecordingListing((), camera, MILLIMETRES, apart),
            rectifier=Rectifier.for_camera(camera.fitted(width, height)),
            depth_scale=options.depth_scale or camera.depth_scale or MILLIMETRES,
            start_time=start_time,
            bgr=options.bgr,
            turns=0 if choice.poses is None else clear_turns([entry.T_world_cam], up),
        )

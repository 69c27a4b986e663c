"""Live streams of messages as frames: on request, the newest frame that is complete.

Topics are chosen, colour and depth paired and poses looked up as in bags (`perception.sources`):
nearest stamps within a tolerance, the transform at colour's stamp. A pair waits until no nearer
partner can come and transforms reach its stamp, for PATIENCE at first.
"""

from __future__ import annotations

import logging
import re
import threading
import time
from collections import Counter, deque
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from kg.model.errors import RecordingError
from perception.camera.gravity_alignment import turned_poses
from perception.camera.image_decoding import MILLIMETRES
from perception.camera.poses import CONVENTIONS, Pose, gridded_pose
from perception.frames import Frame
from perception.no_return import Constant
from perception.sources.bags.bag import Choice, noted_transform
from perception.sources.bags.bag_file import RawMessage, parts_of
from perception.sources.bags.bag_index import (
    IMAGES,
    NOTE_TOPIC,
    TRANSFORMS,
    WANTED,
    BagIndex,
    add_message,
    stamp_of,
)
from perception.sources.bags.bag_poses import IMU, Reading, up_by_imu, warn_of_publishers
from perception.sources.listing import FrameEntry, nearest_pairs
from perception.sources.live.chosen_topics import ChosenTopics, choice_or_error
from perception.sources.live.connection import HeldImages, LiveDecoder, LiveImage
from perception.sources.live.loop_closures import LoopClosures
from perception.sources.live.silence import Arrivals, Silence, StreamCounts
from perception.sources.live.topic_detector import TYPES, TopicDetector
from perception.sources.recording import FolderRecording
from perception.sources.recording_options import DEFAULT_OPTIONS, RecordingOptions
from perception.sources.ros.image_messages import NANOSECONDS
from perception.sources.ros.rgbd_image import wholes

PATIENCE: Final = 0.5  # [s] for a nearer partner, and at first for transforms
SETTLING: Final = 1.0  # [s] wait for further topics, once topics can be chosen
UNPOSED: Final = 10.0  # [s] wait for poses that reach the camera, before they are estimated
SILENT: Final = 3.0  # [s] the same wait while an advertised topic has had no message
TICK: Final = 0.02  # [s] between two checks of the transforms
RETRY: Final = 0.5  # [s] after which topics are tried again although no new name came
MAX_BYTES: Final = 1 << 28  # of the images of all topics that wait
KEPT: Final = 4000  # transforms of a link, readings of an IMU
STAMPS_KEPT: Final = 1000  # of a stream, before topics are chosen

_log = logging.getLogger(__name__)


@dataclass(slots=True)
class FrameStream:
    """Frames of a connection's messages; the newest first, and none twice.

    Of the `options` these count: `streams`; `intrinsics` of colour, instead of its CameraInfo;
    `depth_scale` [units a metre] of 16-bit depth, by default the intrinsics', else millimetres;
    `estimate_poses`, with which poses are not waited for.
    """

    address: str  # of the connection, for messages
    options: RecordingOptions = DEFAULT_OPTIONS
    detections: TopicDetector | None = None  # None: frames are not waited for by detections
    loops: LoopClosures | None = None  # None: poses are not followed after their frames are given
    camera: str = ""  # one of several: its topic of colour, or a name in all of its topics
    problem: str = ""  # the reason why there are no frames yet
    missed: int = 0  # calls of `next_frame`, one after another, without a frame
    _counts: StreamCounts = field(default_factory=StreamCounts)
    _received: Counter[str] = field(default_factory=Counter)  # number of images, by topic
    _index: BagIndex = field(init=False)  # stamps, cameras and transforms of the topics
    _chosen: ChosenTopics | None = None  # the topics that frames are made of
    _tried_choice: Choice | RecordingError | None = None  # the choice among `_tried_names`
    _tried_names: tuple[str, ...] | None = None  # topics and tf frames at the last try, ...
    _tried_at: float = 0.0  # [s] ... and its time
    _choosable_since: float | None = None  # [s] when a choice became possible
    _advertised: set[str] = field(default_factory=set)  # topics that the stream subscribes to
    _held: dict[str, HeldImages] = field(default_factory=dict)  # waiting images, by topic
    _imus: dict[str, deque[Reading]] = field(default_factory=dict)  # the last, by topic
    _camera: FolderRecording | None = None  # decodes images; made for the first frame
    _cameras: int = 0  # changes of the cameras before that
    _arrivals: Arrivals = field(default_factory=Arrivals)
    _warned: set[str] = field(default_factory=set)  # topics that had their one warning
    _changed: threading.Condition = field(default_factory=threading.Condition)  # and the lock

    def __post_init__(self) -> None:
        self._index = BagIndex(self.address, kept=KEPT)

    @property
    def cameras(self) -> tuple[FrameStream, ...]:
        """The streams of all cameras: this one."""
        return (self,)

    def is_chosen(self) -> bool:
        """Whether the topics are chosen, now or before."""
        with self._changed:
            return self._choice is not None or self._choose()

    @property
    def counts(self) -> StreamCounts:
        """Counts of the images so far."""
        with self._changed:
            by_topic, choice = self._received, self._choice
            received = by_topic.total() if choice is None else by_topic[choice.colour.topic]
            return replace(self._counts, received=received)

    @property
    def choice(self) -> Choice | None:
        """The topics and frames that frames are made of; None until they are chosen."""
        with self._changed:
            return self._choice

    @property
    def _choice(self) -> Choice | None:
        return None if self._chosen is None else self._chosen.choice

    def latest_pose(self, frame: str) -> tuple[Pose, float] | None:
        """Pose (4, 4) of `frame` in the map frame, and its stamp [s]; None where there is none.

        The stamp is 0 where no transform on the way moves.
        """
        with self._changed:
            if self._choice is None or self._choice.poses is None:
                return None
            tree, target = self._choice.poses.tree, self._choice.poses.map_frame
            try:
                span = tree.span(target, frame)
                stamp = span[1] if span else 0.0
                T = tree.at(target, frame, stamp)
            except RecordingError:
                return None
            noted = noted_transform(self._index, self._choice)
            return None if T is None else (T if noted is None else noted @ T, stamp)

    def silence(self) -> Silence | None:
        """Why no frame comes now; None where all that a frame needs comes."""
        with self._changed:
            if self._choice is None:
                return Silence(self.problem, self.problem) if self.problem else None
            tolerance = self.options.streams.tolerance
            return self._arrivals.silence(self._choice, tolerance, self.detections)

    @property
    def noted_transform(self) -> Pose | None:
        """Transform (4, 4) of the poses' frame to the map that the source itself tells."""
        with self._changed:
            return None if self._choice is None else noted_transform(self._index, self._choice)

    @property
    def estimates(self) -> bool:
        """Whether the frames have no poses, which are to be estimated from their images."""
        with self._changed:
            return self._choice is not None and self._choice.poses is None

    def up_of_camera(self, frame: Frame) -> NDArray[np.float64] | None:
        """Up (3,) in the camera of a frame of this stream; None where no IMU is at rest then."""
        with self._changed:
            assert self._choice is not None and self._camera is not None  # it came from here
            stamp = frame.stamp - self._camera.start_time
            tree, camera = self._choice.tree, self._choice.colour.frame
            found = (up_by_imu(held, tree, camera, stamp) for held in self._imus.values())
            return next((up for up in found if up is not None), None)

    @property
    def depth_scale(self) -> float:
        """Depth units a metre."""
        return MILLIMETRES if self._camera is None else self._camera.depth_scale

    def wanted(self, topics: Mapping[str, str]) -> set[str]:
        """Topics to subscribe to: all that may be used, and after the choice the chosen ones."""
        with self._changed:
            whole = wholes(topics)
            topics = {**topics, **{part: kind for part, (_, kind) in whole.items()}}
            wanted = {n for n, t in topics.items() if t in (*WANTED, IMU) or n == NOTE_TOPIC}
            if self.detections is not None and topics.get(self.detections.topic) in TYPES:
                wanted.add(self.detections.topic)
            if self.loops is not None:
                wanted |= self.loops.wanted(topics)
            given, chosen = self.options.streams, self._chosen
            if chosen is not None:
                used = chosen.topics | {"" if self.detections is None else self.detections.topic}
                types = TRANSFORMS if chosen.choice.poses else (*TRANSFORMS, IMU)
                wanted = {n for n in wanted if topics[n] in types or n in used}
            elif given.colour is not None and given.depth is not None:
                images = {given.colour, given.depth}
                wanted = {n for n in wanted if topics[n] not in IMAGES or n in images}
            self._advertised = wanted
            return {whole.get(name, (name, ""))[0] for name in wanted}

    def offer(self, raw: RawMessage, *, is_ros1: bool) -> None:
        """Receive a message; unreadable ones give one warning for each topic."""
        decoder = LiveDecoder(self.address, is_ros1)
        with self._changed:
            try:
                for one in parts_of(raw, is_ros1):
                    self._add(one, decoder)
            except (RecordingError, ValueError, ArithmeticError) as error:
                self._warn(raw.topic, error)

    def next_frame(self, seconds: float) -> Frame | None:
        """The newest whole frame, waiting for it up to `seconds`; None where none came."""
        until = time.monotonic() + seconds
        while True:
            with self._changed:
                entry = self._newest()
                if entry is None:
                    if (left := until - time.monotonic()) <= 0:
                        self.missed += 1
                        return None
                    self._changed.wait(min(left, TICK))
                    continue
            frame = self._frame(entry)
            if frame is not None:
                self.missed = 0
                return frame

    def _add(self, raw: RawMessage, decoder: LiveDecoder) -> None:
        index, chosen = self._index, self._chosen
        if raw.type in TYPES:
            self._add_detections(raw, decoder)
        elif raw.type == IMU:
            held = self._imus.setdefault(raw.topic, deque(maxlen=KEPT))
            held.append(Reading.of(decoder.decoded(raw)))
        elif raw.topic == NOTE_TOPIC:
            add_message(index, decoder, raw)
        elif raw.type in TRANSFORMS or (chosen is None and raw.type in WANTED):
            add_message(index, decoder, raw)
            self._trim(raw.topic)
        elif chosen is not None and raw.topic == chosen.pose_topic:
            add_message(index, decoder, raw)
            chosen.add_poses(self.options.streams.pose_frame)
            self._trim(raw.topic, poses=0)
        elif chosen is not None and raw.topic in chosen.info_topics:
            chosen.add_camera(raw, decoder)
        if chosen is not None:
            chosen.add_closures(raw, decoder)
        if raw.type in IMAGES and self._is_used(raw.topic):
            self._add_image(raw, decoder)

    def _add_image(self, raw: RawMessage, decoder: LiveDecoder) -> None:
        chosen = self._chosen
        self._received[raw.topic] += 1
        stamp = stamp_of(decoder, raw, self.address) or raw.time
        self._arrivals.add(raw.topic, stamp / NANOSECONDS)
        if chosen is not None and raw.topic == chosen.choice.colour.topic:
            chosen.check_frame(raw, decoder)
        image = LiveImage(raw, decoder, stamp, time.monotonic())
        self._held.setdefault(raw.topic, HeldImages()).add(image)
        while sum(held.size for held in self._held.values()) > MAX_BYTES:
            largest = max(self._held.values(), key=lambda held: held.size)
            largest.drop(largest.images[0])
        self._changed.notify_all()

    def _add_detections(self, raw: RawMessage, decoder: LiveDecoder) -> None:
        if self.detections is not None and raw.topic == self.detections.topic:
            stamp = stamp_of(decoder, raw, self.address)
            self._arrivals.add(raw.topic, stamp / NANOSECONDS)
            self.detections.add(stamp, decoder.decoded(raw))
            self._changed.notify_all()

    def _is_used(self, topic: str) -> bool:
        chosen = self._choice
        return chosen is None or topic in (chosen.colour.topic, chosen.depth.topic)

    def _trim(self, topic: str, poses: int = STAMPS_KEPT) -> None:
        """Drop old stamps of a stream, and of a stream of poses all but the last `poses`."""
        stream, index = self._index.streams[topic], self._index
        if len(stream.stamps) > 2 * STAMPS_KEPT:
            del stream.stamps[:-STAMPS_KEPT], stream.times[:-STAMPS_KEPT]
        rows = index.poses.get(topic)
        if rows is not None and len(rows.stamps) > 2 * poses:
            rows.stamps = rows.stamps[len(rows.stamps) - poses :]
            rows.rows = rows.rows[len(rows.rows) - 7 * poses :]
            rows.run = 0
        if index.refused:
            self._warn(topic, index.refusal)
        index.refused, index.refusal = 0, ""

    def _warn(self, topic: str, problem: object) -> None:
        if topic not in self._warned:
            self._warned.add(topic)
            _log.warning("%s: messages of %s are skipped: %s", self.address, topic, problem)

    def _newest(self) -> FrameEntry | None:
        """Newest whole frame; older images are dropped."""
        if self._choice is None and not self._choose():
            return None
        assert self._choice is not None
        colours, depths = (
            self._held.setdefault(s.topic, HeldImages())
            for s in (self._choice.colour, self._choice.depth)
        )
        self._counts.without_depth += colours.drop_unpaired(depths, self.options.streams.tolerance)
        return self._newest_pair(colours, depths)

    def _newest_pair(self, colours: HeldImages, depths: HeldImages) -> FrameEntry | None:
        if not colours.images or not depths.images:
            return None
        c, d = colours.seconds, depths.seconds
        now = time.monotonic()
        pairs = nearest_pairs(c, d, self.options.streams.tolerance)
        for i, j in sorted(pairs, key=lambda ij: -c[ij[0]]):
            colour, depth = colours.images[i], depths.images[j]
            since = now - max(colour.came, depth.came)
            waited = since >= PATIENCE
            apart = abs(c[i] - d[j])
            # later images are farther apart than this pair
            nearest = d.max() >= c[i] + apart and c.max() >= d[j] + apart
            if not (nearest or waited):
                continue
            if self.detections is not None and not self.detections.has(colour.stamp):
                continue
            final, T = self._pose(colour, since)
            if T is not None:
                for held, last in ((colours, colour), (depths, depth)):
                    for image in [one for one in held.images if one.stamp <= last.stamp]:
                        held.drop(image)
                before = f"{self.camera.strip('/').replace('/', '_')}-" if self.camera else ""
                T, id_ = self._convert(T), before + colour.id
                return FrameEntry(id_, colour, depth, T, colour.seconds, self.camera)
            if final:
                self._counts.without_pose += 1
                colours.drop(colour)
                depths.drop(depth)
                return self._newest_pair(colours, depths)
        return None

    def _convert(self, T: Pose) -> Pose:
        return T if self.estimates else CONVENTIONS[self.options.pose_convention](T)

    def _pose(self, image: LiveImage, since: float) -> tuple[bool, Pose | None]:
        """Whether the pose of an image that has waited `since` [s] is final, and the pose."""
        assert self._chosen is not None
        try:
            return self._chosen.pose(image, since)
        except RecordingError as error:
            self._warn("/tf", error)
            return since >= PATIENCE, None

    def _choose(self) -> bool:
        """Choose the topics once they are there; returns whether they are chosen."""
        index, now = self._index, time.monotonic()
        there = (*index.streams, *(f for tree in index.trees.values() for f in tree.frames))
        # links between known frames, and a camera's numbers, may come later than the names
        if there != self._tried_names or now >= self._tried_at + RETRY:
            self._tried_names, self._tried_at = there, now
            self._tried_choice = choice_or_error(index, self.options)
        if not isinstance(self._tried_choice, Choice):
            self.problem, self._choosable_since = str(self._tried_choice), None
            if self.camera:  # options of one camera do not go with several
                self.problem = re.split(r";? \(?--", self.problem)[0]
            return False
        self._choosable_since = self._choosable_since or now
        silent = self._advertised - index.streams.keys() - self._imus.keys()
        if now < self._choosable_since + (SILENT if silent else SETTLING):
            return False
        choice = choice_or_error(index, self.options)  # by all that has come since
        if isinstance(choice, Choice) and choice.poses is None:
            if not self.options.estimate_poses and now < self._choosable_since + UNPOSED:
                return False
            _log.warning("%s; they are estimated from the images", choice.no_poses.split("; ")[0])
        if not isinstance(choice, Choice):
            self._tried_names = None
            return False
        has_camera = self.options.intrinsics is not None
        self.problem = ""
        self._chosen = ChosenTopics(index, choice, PATIENCE, has_camera, self.loops)
        self._held = {t: held for t, held in self._held.items() if self._is_used(t)}
        used = f"colour {choice.colour.topic}, depth {choice.depth.topic}, poses of {choice.posed}"
        _log.warning("%s: %s", self.address, used)
        if choice.poses is not None:
            warn_of_publishers(self.address, choice.poses, choice.colour.frame, np.inf)
        return True

    def _frame(self, entry: FrameEntry) -> Frame | None:
        """The frame of an entry; None, and counted, where it cannot be read."""
        try:
            assert self._chosen is not None
            if self._camera is None or self._cameras != self._chosen.cameras:
                self._cameras = self._chosen.cameras
                start = None if self._camera is None else self._camera.start_time
                with self._changed:
                    self._camera = self._chosen.recording_of(entry, self.options, start)
            T = turned_poses(entry.T_world_cam, self._camera.turns)
            frame = self._camera.decoded(replace(entry, T_world_cam=gridded_pose(T)))
            if self.detections is not None:
                self._take_detections(self.detections, frame, entry)
            with self._changed:
                self._chosen.follow(frame, entry.stamp)
        except (RecordingError, ValueError) as error:
            self._counts.unreadable += 1
            self._warn("images", error)
            return None
        self._counts.taken += 1
        return frame

    def drop(self, constants: tuple[Constant, ...]) -> None:
        """Take depths of these values for no return from now on."""
        if self._camera is not None:
            self._camera = replace(self._camera, no_return=constants)

    def _take_detections(self, detections: TopicDetector, frame: Frame, entry: FrameEntry) -> None:
        """Pass the detections of a frame on."""
        assert self._camera is not None and self._choice is not None
        tree, camera = self._choice.tree, self._choice.colour.frame

        def T_cam_of(name: str) -> Pose | None:  # noqa: N802 - names its frames
            with self._changed:
                return tree.at(camera, name, entry.stamp)

        stamp = round(entry.stamp * NANOSECONDS)
        detections.take(frame, stamp, self._camera.rectifier, self._camera.turns, T_cam_of)

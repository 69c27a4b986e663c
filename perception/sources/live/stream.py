"""Live streams of messages as frames: on request, the newest frame that is complete.

Topics are chosen, colour and depth paired and poses looked up as in bags (`perception.sources`):
nearest stamps within a tolerance, the transform at colour's stamp. A pair waits until no nearer
partner can come and transforms reach its stamp, for PATIENCE at first. A CameraInfo that changes
and a colour image of another frame are taken from then on.
"""

from __future__ import annotations

import logging
import threading
import time
from collections import Counter, deque
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from kg.model.errors import RecordingError
from perception.camera.gravity_alignment import parse_up
from perception.camera.image_decoding import MILLIMETRES
from perception.camera.intrinsics import Rectifier, clear_turns, turned_poses
from perception.camera.poses import CONVENTIONS, Pose, gridded_pose
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
from perception.sources.bags.bag_index import (
    IMAGES,
    NOTE_TOPIC,
    STAMPED,
    TRANSFORMS,
    WANTED,
    BagIndex,
    add_message,
    frame_of,
    stamp_of,
)
from perception.sources.bags.bag_poses import IMU, Reading, add_poses, up_by_imu
from perception.sources.listing import FrameEntry, RecordingListing, nearest_pairs
from perception.sources.live.connection import HeldImages, LiveDecoder, LiveImage
from perception.sources.live.silence import Arrivals, Silence
from perception.sources.live.stream_counts import StreamCounts
from perception.sources.live.topic_detector import TYPES, TopicDetector
from perception.sources.recording import ABSOLUTE_STAMP, FolderRecording
from perception.sources.recording_options import DEFAULT_OPTIONS, RecordingOptions
from perception.sources.ros.image_messages import NANOSECONDS, frame_name

PATIENCE: Final = 0.5  # [s] for a nearer partner, and for transforms that reach a pair's stamp, ...
MAX_PATIENCE: Final = 8.0  # ... for which up to this is waited where they come later
LATER: Final = 1.5  # times as long as they were late
SETTLING: Final = 1.0  # [s] wait for further topics, once topics can be chosen
UNPOSED: Final = 10.0  # [s] wait for poses that reach the camera, before they are estimated
SILENT: Final = 3.0  # [s] the same wait while an advertised topic has had no message
TICK: Final = 0.02  # [s] between two checks of the transforms
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
    problem: str = ""  # the reason why there are no frames yet
    _counts: StreamCounts = field(default_factory=StreamCounts)
    _received: Counter[str] = field(default_factory=Counter)  # number of images, by topic
    _index: BagIndex = field(init=False)  # stamps, cameras and transforms of the topics
    _choice: Choice | None = None  # the topics that frames are made of
    _tried_choice: Choice | RecordingError | None = None  # the choice among `_tried_names`
    _tried_names: tuple[str, ...] | None = None  # topics and tf frames at the last try
    _choosable_since: float | None = None  # [s] when a choice became possible
    _advertised: set[str] = field(default_factory=set)  # topics that the stream subscribes to
    _held: dict[str, HeldImages] = field(default_factory=dict)  # waiting images, by topic
    _imus: dict[str, deque[Reading]] = field(default_factory=dict)  # the last, by topic
    _camera: FolderRecording | None = None  # decodes images; made for the first frame
    _is_outdated: bool = False  # whether the cameras changed since
    _infos: dict[str, bytes] = field(default_factory=dict)  # CameraInfo by topic, without its stamp
    _arrivals: Arrivals = field(default_factory=Arrivals)
    _late: float = PATIENCE  # [s] for which transforms are waited for
    _unposed: LiveImage | None = None  # an image that transforms have not reached in this time
    _warned: set[str] = field(default_factory=set)  # topics that had their one warning
    _changed: threading.Condition = field(default_factory=threading.Condition)  # and the lock

    def __post_init__(self) -> None:
        self._index = BagIndex(self.address, kept=KEPT)

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
            wanted = {n for n, t in topics.items() if t in (*WANTED, IMU) or n == NOTE_TOPIC}
            if self.detections is not None and topics.get(self.detections.topic) in TYPES:
                wanted.add(self.detections.topic)
            given, choice = self.options.streams, self._choice
            if choice is not None:
                images = {choice.colour.topic, choice.depth.topic}
                images.add(self._pose_topic or "")
                images |= self._info_topics
                images.add(self.detections.topic if self.detections is not None else "")
                types = TRANSFORMS if choice.poses else (*TRANSFORMS, IMU)
                wanted = {n for n in wanted if topics[n] in types or n in images}
            elif given.colour is not None and given.depth is not None:
                images = {given.colour, given.depth}
                wanted = {n for n in wanted if topics[n] not in IMAGES or n in images}
            self._advertised = wanted
            return wanted

    def offer(self, raw: RawMessage, *, is_ros1: bool) -> None:
        """Receive a message; unreadable ones give one warning for each topic."""
        decoder = LiveDecoder(self.address, is_ros1)
        with self._changed:
            try:
                self._add(raw, decoder)
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
                        return None
                    self._changed.wait(min(left, TICK))
                    continue
            frame = self._frame(entry)
            if frame is not None:
                return frame

    def _add(self, raw: RawMessage, decoder: LiveDecoder) -> None:
        chosen, index = self._choice, self._index
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
        elif chosen is not None and chosen.poses is not None and raw.topic == self._pose_topic:
            add_message(index, decoder, raw)
            frame = self.options.streams.pose_frame
            add_poses(index, raw.topic, chosen.poses.tree, chosen.colour.frame, frame)
            self._trim(raw.topic, poses=0)
        elif chosen is not None and raw.topic in self._info_topics:
            self._add_camera(raw, decoder)
        if raw.type in IMAGES and self._is_used(raw.topic):
            self._received[raw.topic] += 1
            stamp = stamp_of(decoder, raw, self.address) or raw.time
            self._arrivals.add(raw.topic, stamp / NANOSECONDS)
            if chosen is not None and raw.topic == chosen.colour.topic:
                self._check_frame(raw, decoder)
            image = LiveImage(raw, decoder, stamp, time.monotonic())
            self._held.setdefault(raw.topic, HeldImages()).add(image)
            while sum(held.size for held in self._held.values()) > MAX_BYTES:
                largest = max(self._held.values(), key=lambda held: held.size)
                largest.drop(largest.images[0])
            self._changed.notify_all()

    @property
    def _info_topics(self) -> set[str]:
        """Topics of CameraInfo that frames depend on."""
        choice = self._choice
        if choice is None or self.options.intrinsics is not None:
            return set()
        return {info.topic for info in (choice.camera, choice.depth_camera) if info is not None}

    def _add_detections(self, raw: RawMessage, decoder: LiveDecoder) -> None:
        if self.detections is not None and raw.topic == self.detections.topic:
            stamp = stamp_of(decoder, raw, self.address)
            self._arrivals.add(raw.topic, stamp / NANOSECONDS)
            self.detections.add(stamp, decoder.decoded(raw))
            self._changed.notify_all()

    def _add_camera(self, raw: RawMessage, decoder: LiveDecoder) -> None:
        """Take a CameraInfo that differs from the one before."""
        assert self._choice is not None
        body = raw.data[STAMPED:]
        if self._infos.get(raw.topic) == body:
            return
        self._infos[raw.topic] = body
        stream, images = self._index.streams[raw.topic], self._choice.colour
        new = replace(stream, first=decoder.decoded(raw))
        before = camera_of(self._index, stream, images)
        if camera_of(self._index, new, images) != before:
            stream.first, self._is_outdated = new.first, True
            _log.warning("%s: %s has changed, and counts from now on", self.address, raw.topic)

    def _check_frame(self, raw: RawMessage, decoder: LiveDecoder) -> None:
        """Take the frame of a colour image for that of its poses."""
        assert self._choice is not None
        colour = self._choice.colour
        name = frame_name(frame_of(decoder, raw, self.address))
        if name == colour.frame:
            return
        if name not in self._warned:
            self._warned.add(name)
            line = "%s: %s is of the frame %r now, not of %r; poses are those of %r"
            _log.warning(line, self.address, raw.topic, name, colour.frame, name)
        colour.frame = name

    @property
    def _pose_topic(self) -> str | None:
        topic = None if self._choice is None else self._choice.pose_topic
        return None if topic is None else topic.topic

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
        self._drop_unpaired(colours, depths)
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
            final, T = self._pose(colour, waited=since >= self._late)
            if T is not None:
                for held, last in ((colours, colour), (depths, depth)):
                    for image in [one for one in held.images if one.stamp <= last.stamp]:
                        held.drop(image)
                return FrameEntry(colour.id, colour, depth, self._convert(T), colour.seconds)
            if final:
                self._counts.without_pose += 1
                colours.drop(colour)
                depths.drop(depth)
                return self._newest_pair(colours, depths)
        return None

    def _convert(self, T: Pose) -> Pose:
        return T if self.estimates else CONVENTIONS[self.options.pose_convention](T)

    def _pose(self, image: LiveImage, *, waited: bool) -> tuple[bool, Pose | None]:
        """Whether the pose of an image is final, and the pose, or None without transforms."""
        assert self._choice is not None
        poses = self._choice.poses
        if poses is None:
            return True, np.eye(4)
        tree, names = poses.tree, (poses.map_frame, self._choice.colour.frame)
        stamp, missed = image.seconds, self._unposed
        try:
            span = tree.span(*names)
            if missed and span and span[1] >= missed.seconds:  # transforms go on: were they late?
                if tree.at(*names, missed.seconds) is not None:
                    late = LATER * (time.monotonic() - missed.came)
                    self._late = min(max(late, self._late), MAX_PATIENCE)
                self._unposed = None
            if waited or span is None or span[1] >= stamp:
                T = tree.at(*names, stamp)
                if T is None:
                    self._unposed = self._unposed or image
                return True, T
        except RecordingError as error:
            self._warn("/tf", error)
            return waited, None
        return False, None

    def _drop_unpaired(self, colours: HeldImages, depths: HeldImages) -> None:
        """Drop colour images older than the newest depth that have none within the tolerance."""
        if not depths.images:
            return
        passed = max(image.seconds for image in depths.images) - self.options.streams.tolerance
        near = depths.seconds
        for image in list(colours.images):
            apart = np.abs(near - image.seconds).min()
            if image.seconds < passed and apart > self.options.streams.tolerance:
                colours.drop(image)
                self._counts.without_depth += 1

    def _choose(self) -> bool:
        """Choose the topics once they are there; returns whether they are chosen."""
        index, now = self._index, time.monotonic()
        there = (*index.streams, *(f for tree in index.trees.values() for f in tree.frames))
        if there != self._tried_names:
            self._tried_names, self._tried_choice = there, self._try_choice()
        if not isinstance(self._tried_choice, Choice):
            self.problem, self._choosable_since = str(self._tried_choice), None
            return False
        self._choosable_since = self._choosable_since or now
        silent = self._advertised - index.streams.keys() - self._imus.keys()
        if now < self._choosable_since + (SILENT if silent else SETTLING):
            return False
        choice = self._try_choice()  # by all that has come since
        if isinstance(choice, Choice) and choice.poses is None:
            if not self.options.estimate_poses and now < self._choosable_since + UNPOSED:
                return False
            _log.warning("%s; they are estimated from the images", choice.no_poses.split("; ")[0])
        if not isinstance(choice, Choice):
            self._tried_names = None
            return False
        self.problem, self._choice = "", choice
        self._held = {t: held for t, held in self._held.items() if self._is_used(t)}
        used = f"colour {choice.colour.topic}, depth {choice.depth.topic}, poses of {choice.posed}"
        _log.warning("%s: %s", self.address, used)
        return True

    def _try_choice(self) -> Choice | RecordingError:
        """The choice by the messages so far, or an error that names the missing topic."""
        try:
            choice = choose(self._index, self.options.streams)
            if choice.poses is None and (choice.posed_elsewhere or self.options.streams.pose):
                raise RecordingError(choice.no_poses)
            if self.options.intrinsics is None:
                camera, reason = camera_or_reason(self._index, choice)
                if camera is None:
                    raise RecordingError(reason)
            if choice.depth_apart:
                depth_camera_of(self._index, choice, choice.depth.stamps[-1] / NANOSECONDS)
            return choice
        except RecordingError as error:
            return error

    def _frame(self, entry: FrameEntry) -> Frame | None:
        """The frame of an entry; None, and counted, where it cannot be read."""
        try:
            if self._camera is None or self._is_outdated:
                self._is_outdated = False
                self._camera = self._opened(entry)
            T = turned_poses(entry.T_world_cam, self._camera.turns)
            frame = self._camera.decoded(replace(entry, T_world_cam=gridded_pose(T)))
            if self.detections is not None:
                self._take_detections(self.detections, frame, entry)
        except (RecordingError, ValueError) as error:
            self._counts.unreadable += 1
            self._warn("images", error)
            return None
        self._counts.taken += 1
        return frame

    def _take_detections(self, detections: TopicDetector, frame: Frame, entry: FrameEntry) -> None:
        """Pass the detections of a frame on."""
        assert self._camera is not None and self._choice is not None
        tree, camera = self._choice.tree, self._choice.colour.frame

        def T_cam_of(name: str) -> Pose | None:  # noqa: N802 - names its frames
            with self._changed:
                return tree.at(camera, name, entry.stamp)

        stamp = round(entry.stamp * NANOSECONDS)
        detections.take(frame, stamp, self._camera.rectifier, self._camera.turns, T_cam_of)

    def _opened(self, entry: FrameEntry) -> FolderRecording:
        """Recording without frames that decodes images: the cameras, fitted to the first image."""
        assert self._choice is not None
        choice = self._choice
        camera = self.options.intrinsics or camera_of(self._index, choice.camera, choice.colour)
        assert camera is not None
        apart = None
        if choice.depth_apart:
            with self._changed:
                apart = depth_camera_of(self._index, choice, entry.stamp)
        noted, (height, width) = self.noted_transform, entry.colour.colour().shape[:2]
        start_time = time.time() - entry.stamp if entry.stamp < ABSOLUTE_STAMP else 0.0
        if self._camera is not None:  # times go on where a camera has changed
            start_time = self._camera.start_time
        return FolderRecording(
            name=self.address,
            format="live",
            T_map_world=np.eye(4) if noted is None else noted,
            listing=RecordingListing((), camera, MILLIMETRES, apart),
            rectifier=Rectifier.for_camera(camera.fitted(width, height)),
            depth_scale=self.options.depth_scale or camera.depth_scale or MILLIMETRES,
            start_time=start_time,
            turns=0
            if self.estimates
            else clear_turns(
                [entry.T_world_cam], parse_up("z" if self.options.up is None else self.options.up)
            ),
        )

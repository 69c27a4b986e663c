"""Live recordings: the frames of a connection as they come, and those that are kept on disk."""

from __future__ import annotations

import logging
import threading
import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from types import TracebackType
from typing import Final

import numpy as np

from kg.model.errors import RecordingError
from perception.camera.gravity_alignment import FRAMES, Up, gravity_aligned_transform
from perception.camera.intrinsics import Intrinsics, Rectifier
from perception.camera.poses import Pose
from perception.frames import Frame
from perception.no_return import UnmovedValues, told, without_constants
from perception.odometry.tracking_report import TrackingReport
from perception.sources.depth_check import check_depth, depth_findings
from perception.sources.folders.image_files import ImageFile
from perception.sources.listing import FrameEntry, RecordingListing
from perception.sources.live.cameras import CameraStreams
from perception.sources.live.connection import Connection
from perception.sources.live.live_tracker import LiveTracker
from perception.sources.live.loop_closures import LoopClosures
from perception.sources.live.silence import SilenceTeller
from perception.sources.live.stream import PATIENCE, SETTLING, UNPOSED, FrameStream
from perception.sources.recording import FolderRecording
from perception.sources.recording_writer import DEPTH_FACTOR, RecordingWriter

_log = logging.getLogger(__name__)


WITHIN: Final = 2.0  # [s] after the first frame, for the frames by which the floor is found
ENDING: Final = 2.0  # [s] for the last frames of a connection that ended of itself


@dataclass(slots=True)
class LiveRecording:
    """Frames of a connection as they come, for `map_recording`; they cannot be read again.

    Where the source gives no poses, `tracker` finds them from the images.
    It ends once `ended` is set, after `limit` frames, where no frame came for `idle` seconds, or
    with its connection.
    """

    name: str
    connection: Connection
    stream: FrameStream | CameraStreams
    ended: threading.Event
    limit: int | None = None
    idle: float | None = None
    T_map_world: Pose = field(default_factory=lambda: np.eye(4))  # (4, 4)
    tracker: LiveTracker | None = None  # None: the source has poses, or no frame came yet
    pauses: Callable[[], bool] = lambda: False  # whether `frames` is to end after a frame, for now
    paused: bool = False  # whether `frames` ended so; called again, it goes on
    found: str = ""  # how it was found in the map that it is mapped into, where poses are estimated
    _noted: Pose = field(default_factory=lambda: np.eye(4))  # (4, 4) that the source itself tells
    _first: list[Frame] = field(default_factory=list)  # taken by `level`
    _given: int = 0  # frames that the stream gave
    _over: float = 0.0  # [s] when the connection ended of itself, as a file does that is played
    _closed: threading.Event = field(default_factory=threading.Event)
    _failed: list[Exception] = field(default_factory=list)
    _thread: threading.Thread | None = None
    _tellers: defaultdict[str, SilenceTeller] = field(  # by camera
        default_factory=lambda: defaultdict(SilenceTeller)
    )

    @property
    def is_empty(self) -> bool:
        """Whether no frame came."""
        return self._given == 0

    @property
    def pose_estimate(self) -> str:
        """How poses are estimated, for the map; "" where the source gives them."""
        if self.tracker is None:
            return ""
        drift = "poses while the camera was live, which drift by 1 to 2 % of the way"
        return "; ".join(line for line in (drift, self.found) if line)

    def level(self, up: Up = "z", *, check: bool = True) -> None:
        """Read the first frames, up to FRAMES; turn `up` to z, and the floor that they show to 0.

        Raises RecordingError where their depth contradicts their poses, with `check`.
        """
        self._start()
        try:
            began, piece = 0.0, None
            for frame in self._until_ended():
                if self.tracker is not None and self.tracker.given != piece:
                    piece, began = self.tracker.given, 0.0  # the camera was lost: once more
                    self._given -= len(self._first)
                    self._first.clear()
                began = began or time.monotonic()
                self._first.append(frame)
                enough = FRAMES * len(self.stream.cameras)
                if len(self._first) == enough or time.monotonic() > began + WITHIN:
                    break
            if self._failed and not self._first:
                raise self._failed[0]
            for camera in self.stream.cameras if self.tracker is None else ():
                self._drop_constants(camera)
                if check:
                    self._check_depth(camera)
        except BaseException:
            self.close()
            raise
        self._place(up)

    def _place(self, up: Up | None) -> None:
        """Find the transform of the world into the map."""
        if self.tracker is not None:
            self.tracker.hold()
            up = self.stream.cameras[0].options.up  # else by floor and walls
            up = self._up_by_imu() if up is None else up
        # the stream's frames are placed by it
        transforms = (one.noted_transform for one in self.stream.cameras)
        noted = next((T for T in transforms if T is not None), None)
        if noted is not None:
            self._noted = noted
            self.T_map_world = noted
        elif self._first:
            self.T_map_world = self._leveled(up)

    def _up_by_imu(self) -> Up | None:
        """Up (3,) by an IMU that is at rest at one of the first frames."""
        for frame in self._first:
            up = self.stream.cameras[0].up_of_camera(frame)
            if up is not None:
                return frame.T_map_cam[:3, :3] @ up
        return None

    def _of(self, camera: FrameStream) -> list[Frame]:
        return [frame for frame in self._first if frame.camera == camera.camera]

    def _drop_constants(self, camera: FrameStream) -> None:
        """Drop depths that stay the same while the camera moves, here and in later frames."""
        unmoved = UnmovedValues()
        for one in self._of(camera):
            unmoved.add(one.depth, one.K, one.T_map_cam)
        if known := unmoved.found:
            name = camera.camera or self.name
            _log.warning("%s: depth of %s is taken for no return", name, told(known))
            camera.drop(known)
            for i, f in enumerate(self._first):
                if f.camera == camera.camera:
                    depth = without_constants(f.depth, f.K, known)
                    self._first[i] = replace(f, depth=depth)

    def _check_depth(self, camera: FrameStream) -> None:
        """Raise RecordingError where depth contradicts the poses."""
        if frames := self._of(camera):
            poses, name = [frame.T_map_cam for frame in frames], camera.camera or self.name
            at, scale = frames.__getitem__, camera.depth_scale
            check_depth(depth_findings(name, poses, "camera-to-world", scale, at))

    def _leveled(self, up: Up | None) -> Pose:
        try:
            return gravity_aligned_transform(_Sample(self.name, self._first), up=up)
        except RecordingError as error:
            _log.warning("%s is not levelled: %s", self.name, error)
            return np.eye(4)

    def _start(self) -> None:
        def receive() -> None:
            try:
                self.connection.run(self.stream, self._closed)
                self._over = time.monotonic()
            except Exception as error:  # noqa: BLE001 - raised again by the caller's thread
                self._failed.append(error)
                self.ended.set()

        if self._thread is None:
            self._thread = threading.Thread(target=receive, name="live", daemon=True)
            self._thread.start()

    def close(self) -> None:
        """End the connection."""
        self._closed.set()
        if self.tracker is not None:
            self.tracker.close()
        if self._thread is not None:
            self._thread.join(PATIENCE)

    def __len__(self) -> int:
        return 0

    def frames(self, start: int = 0) -> Iterator[Frame]:
        """Frames from now on, whatever `start` is: the map goes on where it was left."""
        self._start()
        self.paused = False
        try:
            while self._first:
                yield self._placed(self._first.pop(0))
            for frame in self._until_ended():
                yield self._placed(frame)
                self.paused = self.pauses()
                if self.paused:
                    return
        finally:
            if not self.paused:
                self.close()
        if self._failed:
            raise self._failed[0]

    @property
    def corrector(self) -> LiveTracker | LoopClosures | None:
        """Tracker or path whose loops change poses of frames that were given; None without."""
        return self.tracker or self.stream.cameras[0].loops

    def corrected_poses(self) -> dict[str, Pose]:
        """Pose in the map (4, 4) of each frame so far by the loops since, by id, where known."""
        if self.corrector is None:
            return {}
        T = self.T_map_world @ np.linalg.inv(self._noted)
        return {name: T @ found for name, found in self.corrector.corrected().items()}

    def _for_poses(self) -> float:
        """[s] for which the first frame may wait for poses, where images come."""
        return UNPOSED + SETTLING if self.is_empty and self.stream.counts.received else 0.0

    def _is_over(self, last: float, now: float) -> bool:
        """Whether no frame is waited for any more, after one at `last` [s]."""
        if self._over and now - max(last, self._over) >= ENDING:
            return True
        return self.idle is not None and now - last >= self.idle + self._for_poses()

    def views(self) -> Iterator[Frame]:
        """Frames by their first level, which are not mapped, until the caller has seen enough."""
        given = self._given
        for frame in self._until_ended():
            yield self._placed(frame)
            self._given = given

    def _next_frame(self) -> Frame | None:
        if self.tracker is not None:
            return self.tracker.next_frame(0.1)
        frame = self.stream.next_frame(0.1)
        if frame is None or not self.stream.estimates:
            return frame
        self.tracker = LiveTracker(self.name, self.stream.next_frame)
        self.tracker.start(frame)
        return None

    def _placed(self, frame: Frame) -> Frame:
        if self.T_map_world is self._noted:
            return frame
        T = self.T_map_world @ np.linalg.inv(self._noted)
        return replace(frame, T_map_cam=T @ frame.T_map_cam)

    def _until_ended(self) -> Iterator[Frame]:
        last = time.monotonic()
        for one in self.stream.cameras:
            self._tellers[one.camera].restart()
        while not self.ended.is_set() and (self.limit is None or self._given < self.limit):
            frame = self._next_frame()
            now = time.monotonic()
            if frame is not None:
                self._given += 1
                self._tell(self._tellers[frame.camera].frame(), frame.camera)
                yield frame
                last = time.monotonic()
            elif self._is_over(last, now):
                return
            for one in self.stream.cameras:
                teller = self._tellers[one.camera]
                is_missed = frame is None or (one.camera != frame.camera and one.missed > 1)
                if is_missed and teller.is_long:
                    self._tell(teller.silent(one.silence()), one.camera)

    def _tell(self, line: str, camera: str) -> None:
        if line:
            where = f"{self.connection.address}, camera {camera}" if camera else ""
            _log.warning("%s: %s", where or self.connection.address, line)


@dataclass(frozen=True, slots=True)
class _Sample:
    """The first frames, as a recording."""

    name: str
    taken: list[Frame]

    @property
    def T_map_world(self) -> Pose:  # noqa: N802 - names its frames
        return np.eye(4)

    def __len__(self) -> int:
        return len(self.taken)

    def frames(self, start: int = 0) -> Iterator[Frame]:
        return iter(self.taken[start:])


MAX_FRAMES: Final = 3000  # 0.9 MB each at 640 x 480


class KeptFrames:
    """Frames of one camera in a temporary folder, up to MAX_FRAMES; use `with`.

    Colour is kept as it is, depth to 0.2 mm and up to 13 m.
    """

    def __init__(self) -> None:
        self._folder = TemporaryDirectory(prefix="hereabouts-live-")
        self._writer = RecordingWriter(Path(self._folder.name))
        self._entries: list[FrameEntry] = []  # poses are in the map
        self._camera: Intrinsics | None = None
        self.whole = True  # whether all frames are here

    def __enter__(self) -> KeptFrames:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, _: TracebackType | None
    ) -> None:
        self._folder.cleanup()

    def __len__(self) -> int:
        return len(self._entries)

    def add(self, frame: Frame) -> None:
        """Keep a frame that was mapped; raises RecordingError where the disk is full."""
        if len(self._entries) >= MAX_FRAMES:
            self.whole = False
        if not self.whole:
            return
        name = f"{len(self._entries):06d}"
        self._writer.add(replace(frame, id=name))
        folder = Path(self._folder.name)
        colour, depth = (ImageFile(folder / f"{kind}/{name}.png") for kind in ("rgb", "depth"))
        entry = FrameEntry(frame.id, colour, depth, frame.T_map_cam, frame.stamp)
        self._entries.append(entry)
        if self._camera is None:
            (height, width), K = frame.depth.shape, frame.K
            self._camera = Intrinsics(K[0, 0], K[1, 1], K[0, 2], K[1, 2], width, height)

    def moved(self, poses: Mapping[str, Pose]) -> None:
        """Replace the poses that frames were mapped by, with poses in the map (4, 4) by id."""
        self._entries = [replace(e, T_world_cam=poses[e.id]) for e in self._entries]

    def recording(
        self,
        name: str,
        T_map_world: Pose,
        poses: Mapping[str, Pose] | None = None,
        *,
        estimated: bool = True,
    ) -> FolderRecording:
        """The frames as a recording of the world (4, 4), by the poses they were mapped by.

        `poses` in the map (4, 4), by the frames' ids, take their place. `estimated` tells whether
        they were found from the images.
        """
        assert self._camera is not None
        back = np.linalg.inv(T_map_world)
        entries = tuple(
            replace(e, T_world_cam=back @ (e.T_world_cam if poses is None else poses[e.id]))
            for e in self._entries
        )
        count = len(entries)
        return FolderRecording(
            name=name,
            format="live",
            T_map_world=T_map_world,
            listing=RecordingListing(entries, self._camera, DEPTH_FACTOR),
            rectifier=Rectifier.for_camera(self._camera),
            depth_scale=DEPTH_FACTOR,
            start_time=0.0,
            transform_given=True,
            estimate=TrackingReport(count, count, 1, 0, 0.0, (), 0, 0) if estimated else None,
        )

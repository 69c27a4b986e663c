"""Live tracker: poses of a live camera that has none, found from its images as they come.

A thread tracks every image that the stream gives, and keeps the last one with a pose for whoever
maps: detection drops images before tracking does. If fewer than RATE images a second are tracked,
though more come, mapping waits. Where the camera is lost, or sees a piece that
was not recognised yet, no image is given.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from perception.camera.poses import BODY_FROM_CAMERA, Pose, gridded_pose, inverse
from perception.frames import Frame
from perception.odometry.tracking import Odometry

MAX_IMAGES: Final = 250  # key frames that keep their image, 0.4 MB each at 640 x 480
RATE: Final = 10.0  # images a second that are tracked at least, where so many come
BEHIND: Final = 1.0  # [s] that mapping waits for that, at most
LOST: Final = 5  # images without a pose after which it is said
SILENT: Final = 10.0  # [s] between two lines of a camera that is still lost
_WAIT: Final = 0.1  # [s] for an image

_log = logging.getLogger(__name__)


@dataclass(slots=True)
class LiveTracker:
    """Tracks the images that `next_image` gives until it is closed."""

    name: str
    next_image: Callable[[float], Frame | None]  # waits up to so many [s]
    tracked: int = 0  # images with a pose
    lost: int = 0  # images without one
    seconds: float = 0.0  # of a core, tracking all of them
    odometry: Odometry = field(default_factory=lambda: Odometry(max_images=MAX_IMAGES))
    moved: float = 0.0  # [m] by which loops moved images after they were given, at most
    _due: float = 0.0  # [s] until when tracking keeps up, by time.monotonic()
    _asked: float | None = None  # [s] when the next image to be mapped was asked for
    _key: int = 0  # key frame of the last image that was given
    _anchor: tuple[int, Pose] | None = None  # first key frame of what is mapped, where it was then
    _newest: tuple[Frame, int, Pose] | None = None  # with its key frame, and its pose in that
    _tracks: dict[str, tuple[int, Pose]] = field(default_factory=dict)  # the same of those given
    _given: dict[int, tuple[Pose, Pose]] = field(default_factory=dict)  # key: in it, as given
    _edges: int = 0  # of the graph when `moved` was measured last
    _missing: int = 0  # images since the last that could be given
    _said: float = 0.0  # [s] when the last line about that was written
    _failed: Exception | None = None
    _changed: threading.Condition = field(default_factory=threading.Condition)
    _graph: threading.Lock = field(default_factory=threading.Lock)  # while key frames change
    _closed: threading.Event = field(default_factory=threading.Event)
    _thread: threading.Thread | None = None

    def start(self, first: Frame) -> None:
        """Begin to track: the `first` image, then those that come."""
        self._thread = threading.Thread(
            target=self._run, args=(first,), name="tracker", daemon=True
        )
        self._thread.start()

    def close(self) -> None:
        """End the thread, and adjust the key frames once more."""
        self._closed.set()
        if self._thread is not None:
            self._thread.join(2.0)
        with self._graph:
            self.odometry.poses()
            self.moved = self._moved()

    def next_frame(self, seconds: float) -> Frame | None:
        """The newest image with its pose, none twice, waiting up to `seconds`; None: none came."""
        with self._changed:
            self._asked = self._asked or time.monotonic()
            self._changed.wait_for(lambda: self._may_map() or self._failed is not None, seconds)
            if self._failed is not None:
                raise self._failed
            if not self._may_map() or self._newest is None:
                return None
            newest, self._newest, self._asked = self._newest, None, None
            frame, number, in_key = newest
            self._key, self._tracks[frame.id] = number, (number, in_key)
            self._given.setdefault(number, (in_key, frame.T_map_cam))
            return frame

    def step(self) -> None:
        """Track the next image, where one comes; the thread does so again and again."""
        image = self.next_image(0.0)
        if image is None:
            self._keeps_up(time.monotonic() + _WAIT)
            image = self.next_image(_WAIT)
        if image is not None:
            self._track(image)
            self._keeps_up(max(self._due, time.monotonic() - BEHIND) + 1 / RATE)

    def _may_map(self) -> bool:
        """Whether an image may be mapped, or tracking needs the time."""
        if self._newest is None or self._thread is None:
            return self._newest is not None
        now = time.monotonic()
        return self._due >= now or (self._asked is not None and now >= self._asked + BEHIND)

    def _keeps_up(self, until: float) -> None:
        with self._changed:
            self._due = until
            self._changed.notify_all()

    @property
    def given(self) -> int | None:
        """The piece of the last image that was given; None: there was none."""
        return self.odometry.graph.keys[self._key].piece if self._tracks else None

    def hold(self) -> None:
        """Yield only images of the last one's piece: others were not recognised in it yet."""
        keys = self.odometry.graph.keys
        with self._graph:
            if self._tracks:
                piece = keys[self._key].piece
                first = next(number for number, key in enumerate(keys) if key.piece == piece)
                self._anchor = first, keys[first].pose

    def corrected(self) -> dict[str, Pose]:
        """Poses (4, 4) of all given images by the loops so far, by id; `moved` counts from them."""
        with self._graph:
            self._given = {n: (T, self._pose(n, T)) for n, (T, _) in self._given.items()}
            self.moved = 0.0
            return {name: gridded_pose(self._pose(*track)) for name, track in self._tracks.items()}

    def _pose(self, number: int, in_key: Pose) -> Pose:
        """Pose of an image by its key frame, where the anchor is where it was."""
        keys = self.odometry.graph.keys
        T = keys[number].pose @ in_key
        if self._anchor is None or np.array_equal(keys[self._anchor[0]].pose, self._anchor[1]):
            return BODY_FROM_CAMERA @ T
        first, then = self._anchor
        return BODY_FROM_CAMERA @ then @ inverse(keys[first].pose) @ T

    def _moved(self) -> float:
        apart = [
            float(np.linalg.norm((self._pose(number, in_key) - then)[:3, 3]))
            for number, (in_key, then) in list(self._given.items())
        ]
        return max(apart, default=0.0)

    def _run(self, first: Frame) -> None:
        try:
            self._track(first)
            while not self._closed.is_set():
                self.step()
        except Exception as error:  # noqa: BLE001 - raised again by the caller's thread
            with self._changed:
                self._failed = error
                self._changed.notify_all()

    def _track(self, image: Frame) -> None:
        before = time.thread_time()
        with self._graph:
            self.odometry.add(image)
            if len(self.odometry.graph.edges) != self._edges:
                self._edges, self.moved = len(self.odometry.graph.edges), self._moved()
            followed = self.odometry.followed()
            usable = followed is not None and self._is_mapped(followed[0])
            T = self._pose(*followed) if followed is not None and usable else None
        self.seconds += time.thread_time() - before
        self.tracked += followed is not None
        self.lost += followed is None
        if followed is not None and T is not None:
            with self._changed:
                self._newest = (replace(image, T_map_cam=gridded_pose(T)), *followed)
                self._changed.notify_all()
        self._say(usable=usable)

    def _is_mapped(self, number: int) -> bool:
        """Whether a key frame is of the piece that is mapped."""
        keys = self.odometry.graph.keys
        return self._anchor is None or keys[number].piece == keys[self._anchor[0]].piece

    def _say(self, *, usable: bool) -> None:
        if usable:
            if self._missing >= LOST:
                _log.warning("%s: the camera is found after %d images", self.name, self._missing)
            self._missing = 0
            return
        self._missing += 1
        now = time.monotonic()
        if self._missing == LOST or (self._missing > LOST and now - self._said > SILENT):
            self._said = now
            _log.warning(
                "%s: the camera is lost; mapping pauses until it sees what it saw before, from "
                "about the same side",
                self.name,
            )

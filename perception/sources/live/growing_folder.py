"""Growing folders: a recording that is still being written, read in order as frames are added."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from kg.model.errors import RecordingError
from perception.camera.gravity_alignment import FRAMES
from perception.frames import Frame
from perception.sources.recording import FolderRecording

PERIOD: Final = 0.2  # [s] between two readings of the folder; more where they take long
QUIET: Final = 2.0  # [s] without a new frame, after which the last one is whole
STUCK: Final = 10.0  # [s] for which a folder may be unreadable while it is written

_log = logging.getLogger(__name__)


def first_opened(
    opened: Callable[[], FolderRecording], ended: threading.Event, *, level: bool
) -> FolderRecording | None:
    """The recording once it can be opened; None where `ended` was set before.

    Without `level` the gravity alignment is estimated from the frames. The call then waits for
    FRAMES frames, or until no more are added.
    """
    warning, count, since = "", 0, time.monotonic()
    while not ended.is_set():
        try:
            recording = opened()
        except RecordingError as error:
            if str(error) != warning and time.monotonic() - since > QUIET:
                warning = str(error)
                _log.warning("waiting: %s", warning)
        else:
            if len(recording) != count:
                count, since = len(recording), time.monotonic()
            if level or count >= FRAMES or time.monotonic() - since > QUIET:
                return recording
        ended.wait(PERIOD)
    return None


@dataclass(slots=True)
class GrowingRecording:
    """A recording in a folder that is being written; each frame once there is a later one.

    `opened` reads the folder anew, by the same transform. It ends once `ended` is set, after
    `limit` frames, or where no frame was added for `idle` seconds.
    """

    now: FolderRecording
    opened: Callable[[], FolderRecording]
    ended: threading.Event
    limit: int | None = None
    idle: float | None = None

    @property
    def name(self) -> str:
        """Name of the folder."""
        return self.now.name

    @property
    def T_map_world(self) -> NDArray[np.float64]:  # noqa: N802 - names its frames
        """(4, 4) takes the recording's world to the map frame."""
        return self.now.T_map_world

    def __len__(self) -> int:
        return len(self.now)

    def frames(self, start: int = 0) -> Iterator[Frame]:
        """Frames from index `start` on, including frames that are added meanwhile.

        Raises RecordingError where the folder cannot be read for STUCK seconds, or loses frames.
        """
        given, last = start, self.now.listing.entries[start - 1].id if start else ""
        grown, count = time.monotonic(), len(self.now)
        while not self.ended.is_set():
            quiet = time.monotonic() - grown
            whole = count if quiet >= QUIET else self._complete(count) - 1
            if self.idle is not None and quiet >= max(self.idle, QUIET) and given >= whole:
                return
            for index in range(given, whole):
                if self.ended.is_set() or index - start == self.limit:
                    return
                last = self.now.listing.entries[index].id
                yield self.now.frame(index)
            began = time.monotonic()
            self._read(last)
            given = self._after(last)
            if len(self.now) != count:
                grown, count = time.monotonic(), len(self.now)
            self.ended.wait(max(PERIOD, 2 * (time.monotonic() - began)))

    def _complete(self, count: int) -> int:
        """How many of the frames there are before those whose second image is not written yet."""
        entries, causes = self.now.listing.entries, self.now.damaged.causes
        while count and entries[count - 1].id in causes:
            count -= 1
        return count

    def _read(self, last: str) -> None:
        """Read the folder anew; raises RecordingError where that fails for STUCK seconds."""
        until = time.monotonic() + STUCK
        while not self.ended.is_set():
            try:
                self.now = self.opened()
                return
            except RecordingError:
                if time.monotonic() > until:
                    raise
                self.ended.wait(PERIOD)

    def _after(self, last: str) -> int:
        """Index of the frame after the one called `last`."""
        entries = self.now.listing.entries
        for index in range(len(entries), 0, -1):
            if entries[index - 1].id == last:
                return index
        if last:
            raise RecordingError(f"{self.name} has lost its frame {last}, which is mapped already")
        return 0

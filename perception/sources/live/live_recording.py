"""Live recordings: the frames of a connection, as they come."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from perception.frames import Frame
from perception.sources.live.connection import Connection
from perception.sources.live.stream import PATIENCE, SILENT, FrameStream

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class LiveRecording:
    """Frames of a connection as they come, for `map_recording`; they cannot be read again.

    Poses are in the map frame. It ends once `ended` is set, after `limit` frames, or where no
    frame came for `idle` seconds.
    """

    name: str
    connection: Connection
    stream: FrameStream
    ended: threading.Event
    limit: int | None = None
    idle: float | None = None

    @property
    def T_map_world(self) -> NDArray[np.float64]:  # noqa: N802 - names its frames
        """(4, 4) identity."""
        return np.eye(4)

    def __len__(self) -> int:
        return 0

    def frames(self, start: int = 0) -> Iterator[Frame]:
        """Frames from now on, whatever `start` is: the map goes on where it was left."""
        closed, failed = threading.Event(), list[Exception]()

        def receive() -> None:
            try:
                self.connection.run(self.stream, closed)
            except Exception as error:  # noqa: BLE001 - raised again by the caller's thread
                failed.append(error)
                self.ended.set()

        thread = threading.Thread(target=receive, name="live", daemon=True)
        thread.start()
        try:
            yield from self._until_ended()
        finally:
            closed.set()
            thread.join(PATIENCE)
        if failed:
            raise failed[0]

    def _until_ended(self) -> Iterator[Frame]:
        last, given, warning = time.monotonic(), 0, ""
        while not self.ended.is_set() and (self.limit is None or given < self.limit):
            frame = self.stream.next_frame(0.1)
            now = time.monotonic()
            if frame is not None:
                given += 1
                yield frame
                last = time.monotonic()
            elif self.idle is not None and now - last >= self.idle:
                return
            elif self.stream.problem not in ("", warning) and now - last >= SILENT:
                warning = self.stream.problem
                _log.warning("waiting: %s", warning)

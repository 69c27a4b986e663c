"""Videos as colour images: frames decoded in order, at a size that mapping needs."""

from __future__ import annotations

import threading
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from kg.model.errors import RecordingError
from kg.model.regular_files import MAX_BYTES, check_regular

LONGER_SIDE: Final = 640  # [px] larger frames are shrunk to
MAX_PIXELS: Final = 1 << 26  # of a frame
_FTYP: Final = slice(4, 8)  # first box of an MP4 or QuickTime file (ISO 14496-12)


@dataclass(slots=True)
class Video:
    """An MP4 or MOV file; frames by number, cheapest in rising order. Safe from several threads."""

    path: Path
    count: int
    size: tuple[int, int]  # (width, height) [px] as stored
    _capture: cv2.VideoCapture = field(repr=False)
    _next: int = 0  # number of the frame that `read` would give
    _last: tuple[int, NDArray[np.uint8]] | None = field(default=None, repr=False)
    _lock: threading.Lock = field(default_factory=threading.Lock, repr=False)

    @classmethod
    def open(cls, path: Path) -> Video:
        """Raises RecordingError for what is no video, or one without frames."""
        try:
            check_regular(path, MAX_BYTES << 7)
            with path.open("rb") as file:
                head = file.read(12)
        except OSError as error:
            raise RecordingError(f"cannot read {path}: {error.strerror}") from error
        if head[_FTYP] != b"ftyp":  # a playlist, say, would have other files and hosts opened
            raise RecordingError(f"{path} is no MP4 or MOV video")
        capture = _capture_of(path)
        count = int(capture.get(cv2.CAP_PROP_FRAME_COUNT))
        width, height = (
            int(capture.get(p)) for p in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT)
        )
        if count < 1 or not 0 < width * height <= MAX_PIXELS:
            raise RecordingError(f"{path} is damaged: {count} frames of {width}x{height}")
        return cls(path, count, (width, height), capture)

    @property
    def shrunk(self) -> tuple[int, int]:
        """(width, height) [px] of the frames that `frame` gives."""
        width, height = self.size
        scale = min(1.0, LONGER_SIDE / max(width, height))
        return max(1, round(width * scale)), max(1, round(height * scale))

    def frame(self, number: int) -> NDArray[np.uint8]:
        """(H, W, 3) RGB of a frame by its number from 0 on; raises RecordingError."""
        with self._lock:
            if self._last is None or self._last[0] != number:
                self._last = number, self._decoded(number)
            return self._last[1]

    def _decoded(self, number: int) -> NDArray[np.uint8]:
        if number < self._next:
            self._capture.release()
            self._capture, self._next = _capture_of(self.path), 0
        while self._next < number and self._capture.grab():
            self._next += 1
        read, image = self._capture.read() if self._next == number else (False, None)
        if not read or image is None or image.shape[1::-1] != self.size:
            raise RecordingError(f"{self.path}: frame {number} cannot be decoded")
        self._next += 1
        if self.shrunk != self.size:
            image = cv2.resize(image, self.shrunk, interpolation=cv2.INTER_AREA)
        return np.ascontiguousarray(image[:, :, ::-1]).astype(np.uint8, copy=False)


def _capture_of(path: Path) -> cv2.VideoCapture:
    capture = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG)
    if not capture.isOpened():
        raise RecordingError(f"{path} cannot be decoded: damaged, or of an unknown codec")
    # the camera matrix is that of the frames as stored, not as a player turns them
    capture.set(cv2.CAP_PROP_ORIENTATION_AUTO, 0)
    return capture


@dataclass(frozen=True, slots=True)
class VideoFrame:
    """A frame of a video as a colour image of a recording."""

    video: Video
    number: int

    def __str__(self) -> str:
        return f"{self.video.path}, frame {self.number}"

    def check(self) -> None:
        """Raise RecordingError where the video has no such frame."""
        if self.number >= self.video.count:
            raise RecordingError(f"{self.video.path} has {self.video.count} frames; {self} is none")

    def colour(self) -> NDArray[np.uint8]:
        """(H, W, 3) RGB; raises RecordingError for a damaged frame."""
        return self.video.frame(self.number)

    def depth(self, depth_scale: float) -> NDArray[np.float32]:
        """Raises RecordingError: a video has no depth."""
        raise RecordingError(f"{self}: a video has no depth")

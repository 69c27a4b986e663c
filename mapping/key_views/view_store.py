"""View store: the key views of a map in `views.sqlite` beside it, and their choice from frames.

A view is written before the transaction of its frame and marked with its number. After a kill the
views up to the map's last transaction hold, and the others are dropped. Nothing depends on the
file. Where it is missing, foreign or damaged, recordings are not recognised in the map; a file that
cannot be read is told in a warning.
"""

from __future__ import annotations

import logging
import sqlite3
from collections.abc import Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import closing, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from kg.maps.semantic_map import SemanticMap
from kg.model.errors import RecordingError
from kg.model.sqlite_files import open_sqlite, remove_sqlite, unreadable
from perception.camera.poses import Pose, checked_pose
from perception.frames import Frame
from perception.odometry.features import FeatureDetector
from perception.odometry.recognition import MIN_FEATURES, KeyView, decoded, encoded, view_of
from perception.odometry.spread_poses import is_new, spare

FILE: Final = "views.sqlite"
MAX_VIEWS: Final = 600  # of one map
MAX_BYTES: Final = 1 << 26  # of a file that is read
_VERSION: Final = 1
_LATEST: Final = (1 << 63) - 1  # later than any transaction
_SCHEMA: Final = (
    "CREATE TABLE views (recording TEXT, frame TEXT, mark INTEGER, pose BLOB, data BLOB,"
    " PRIMARY KEY (recording, frame))"
)
_ERRORS: Final = (sqlite3.Error, OSError, ValueError, TypeError, RecordingError)
_WITHOUT: Final = (
    "recordings are not recognised in what was mapped so far; mapping begins the file anew"
)

_log = logging.getLogger(__name__)

Key = tuple[str, str]  # name of the recording, id of the frame


@dataclass(frozen=True, slots=True, eq=False)
class StoredView:
    """A key view and the frame that it is of."""

    recording: str
    frame: str
    view: KeyView  # its pose is in the map frame

    @property
    def key(self) -> Key:
        """Recording and frame."""
        return self.recording, self.frame


class ViewStore:
    """Store of key views in the folder of a map, for its one writer."""

    def __init__(self, folder: Path, sequence: int) -> None:
        """`sequence` is the number of the map's last transaction; later views are dropped."""
        self._path = folder / FILE
        self._file: sqlite3.Connection | None = None
        try:
            self._file = open_sqlite(self._path, [_SCHEMA], _VERSION, MAX_BYTES)
            with self._file as file:
                file.execute("DELETE FROM views WHERE mark > ?", (sequence,))
        except _ERRORS as error:
            self._discard(error)

    def poses(self) -> dict[Key, Pose]:
        """Poses (4, 4) of all views, in the map frame."""
        if self._file is None:
            return {}
        rows = "SELECT recording, frame, pose FROM views ORDER BY mark, recording, frame"
        try:
            found = {(r, f): _pose(pose) for r, f, pose in self._file.execute(rows)}
            self._file.set_progress_handler(None, 0)
        except _ERRORS as error:
            self._discard(error)
            return {}
        return found

    def write(self, stored: StoredView, mark: int, dropped: Key | None) -> None:
        """Write a view, to hold from transaction `mark` on, instead of the `dropped` one."""
        row = (*stored.key, mark, _bytes(stored.view.pose), encoded(stored.view))
        if self._file is None:
            return
        try:
            with self._file as file:
                if dropped is not None:
                    file.execute("DELETE FROM views WHERE recording = ? AND frame = ?", dropped)
                file.execute("INSERT OR REPLACE INTO views VALUES (?, ?, ?, ?, ?)", row)
        except sqlite3.Error:
            self.close()

    def move(self, recording: str, motions: Mapping[str, NDArray[np.float64]]) -> None:
        """Move the views of a recording by motions (4, 4) of the map, by the frames' ids."""
        moved = [
            (_bytes(motions[frame] @ T), name, frame)
            for (name, frame), T in self.poses().items()
            if name == recording and frame in motions
        ]
        with suppress(sqlite3.Error):
            if self._file is not None:
                with self._file as file:
                    file.executemany(
                        "UPDATE views SET pose = ? WHERE recording = ? AND frame = ?", moved
                    )

    def close(self) -> None:
        """Close the file."""
        if self._file is not None:
            self._file.close()
            self._file = None

    def _discard(self, error: Exception) -> None:
        """Start anew; where that fails, nothing is kept."""
        _log.warning("%s", unreadable(self._path, error, _WITHOUT))
        self.close()
        with suppress(*_ERRORS):
            remove_sqlite(self._path)
            self._file = open_sqlite(self._path, [_SCHEMA], _VERSION, MAX_BYTES)


def stored_views(folder: Path | None, sequence: int, *, live: bool = False) -> list[StoredView]:
    """The views in the folder of a map, up to a transaction; none where they are unreadable.

    `live` says that the map is written meanwhile.
    """
    try:
        return _views(folder, sequence, live)
    except _ERRORS:
        return []


def view_poses(folder: Path | None, sequence: int, *, live: bool = False) -> dict[Key, Pose]:
    """Poses (4, 4) of the views up to a transaction, in the map frame; {} where unreadable."""
    if folder is None or not (path := folder / FILE).is_file():
        return {}
    rows = "SELECT recording, frame, pose FROM views WHERE mark <= ? LIMIT ?"
    how = {"read_only": True, "live": live}
    try:
        with closing(open_sqlite(path, [_SCHEMA], _VERSION, MAX_BYTES, **how)) as file:
            found = file.execute(rows, (sequence, MAX_VIEWS)).fetchall()
        return {(str(recording), str(frame)): _pose(pose) for recording, frame, pose in found}
    except _ERRORS:
        return {}


def views_damage(folder: Path | None, *, live: bool = False) -> str:
    """A line about views that cannot be read in the folder of a map; "" for good ones or none."""
    try:
        _views(folder, _LATEST, live)
    except _ERRORS as error:
        return unreadable((folder or Path()) / FILE, error, _WITHOUT)
    return ""


def _views(folder: Path | None, sequence: int, live: bool) -> list[StoredView]:
    if folder is None or not ((path := folder / FILE).exists() or path.is_symlink()):
        return []
    rows = (
        "SELECT recording, frame, pose, data FROM views WHERE mark <= ?"
        " ORDER BY mark, recording, frame LIMIT ?"
    )
    how = {"read_only": True, "live": live}
    with closing(open_sqlite(path, [_SCHEMA], _VERSION, MAX_BYTES, **how)) as file:
        return [
            StoredView(str(recording), str(frame), decoded(data, _pose(pose)))
            for recording, frame, pose, data in file.execute(rows, (sequence, MAX_VIEWS))
        ]


def _bytes(pose: Pose) -> bytes:
    return np.asarray(pose, "<f8").tobytes()


def _pose(data: bytes) -> Pose:
    return checked_pose(np.frombuffer(data, "<f8").reshape(4, 4).astype(np.float64), "a view")


Boxes = NDArray[np.float32]  # (n, 4) xyxy [px]


class ViewKeeper:
    """Keeps views of the frames of one recording; a map without a folder here keeps none."""

    def __init__(self, semantic_map: SemanticMap, recording: str) -> None:
        path = semantic_map.store.path
        writable = path is not None and not semantic_map.store.read_only
        self._store = ViewStore(path, semantic_map.sequence) if path and writable else None
        self._recording = recording
        self._detector = FeatureDetector()
        self._worker = ThreadPoolExecutor(1, "views")  # describes a view beside the mapping
        self._waiting: Future[StoredView | None] | None = None
        held = {} if self._store is None else self._store.poses()
        self._keys: list[Key] = list(held)
        self._poses: list[Pose] = list(held.values())
        self._new: StoredView | None = None  # not in the map yet

    def add(self, frame: Frame, people: Boxes) -> None:
        """Add a frame, for `save` and `accept`, without what is in the boxes of `people`."""
        self._new = self._waiting = None
        if self._store is not None and is_new(frame.T_map_cam, self._poses):
            self._waiting = self._worker.submit(self._described, frame, people)

    def _described(self, frame: Frame, people: Boxes) -> StoredView | None:
        """The view of a frame; None where it has too few features."""
        view, _ = view_of(frame, self._detector, without=people)
        enough = len(view.features) >= MIN_FEATURES
        return StoredView(self._recording, frame.id, view) if enough else None

    def save(self, sequence: int) -> None:
        """Store the view beside the map, before its transaction of that number."""
        self._new = None if self._waiting is None else self._waiting.result()
        if self._store is not None and self._new is not None:
            full = len(self._keys) >= MAX_VIEWS and self._new.key not in self._keys
            self._store.write(self._new, sequence, self._keys[spare(self._poses)] if full else None)

    def accept(self) -> Key | None:
        """Count the view, whose transaction is in the map now; its key, or None without one."""
        self._waiting = None
        if self._new is None:
            return None
        if self._new.key in self._keys:
            self._forget(self._keys.index(self._new.key))
        elif len(self._keys) >= MAX_VIEWS:
            self._forget(spare(self._poses))
        self._keys.append(self._new.key)
        self._poses.append(self._new.view.pose)
        self._new = None
        return self._keys[-1]

    def _forget(self, number: int) -> None:
        del self._keys[number], self._poses[number]

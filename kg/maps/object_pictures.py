"""Pictures of a map's objects: small JPEGs of each one's best observations, in the map's folder.

A map with an encoder has one of each key view, too.
"""

from __future__ import annotations

import os
import re
import stat
import zlib
from contextlib import suppress
from itertools import zip_longest
from pathlib import Path
from typing import Final

from kg.model.errors import GraphError
from kg.model.records import ObjectRecord

FOLDER: Final = "pictures"  # in the folder of a map
MAX_BYTES: Final = 10_000  # of one picture
MAX_PICTURES: Final = 5_000  # of one map; former views go first, then the oldest
MAX_VIEWS: Final = 4  # of one object: its best observation, and the last that were best before
MAX_VIEW_BYTES: Final = 20_000  # of the picture of a key view
_NUMBER = re.compile(r".*/object/([0-9]{1,18})")
_NAME = re.compile(r"[0-9]{1,18}-[0-9a-f]{8}\.jpg")


def view_picture(folder: Path, recording: str, frame: str) -> Path:
    """File of the picture of a key view of the map in `folder`."""
    return folder / FOLDER / f"view-{zlib.crc32(f'{recording}/{frame}'.encode()):08x}.jpg"


class ObjectPictures:
    """Pictures in the folder `path` of a map; a picture's name has a key of its observation."""

    def __init__(self, path: Path) -> None:
        self._folder = path / FOLDER

    def path_of(self, record: ObjectRecord) -> Path | None:
        """File with the best view of `record` that is kept; None without a picture.

        Where its best observation has no picture, that is the latest of the former ones.
        """
        views = self.views_of(record.iri)
        best = self._path(record)
        path = best if best in views else next(iter(views), None)
        return path if path and path.stat().st_size <= MAX_BYTES else None

    def has(self, record: ObjectRecord) -> bool:
        """Whether the best observation of `record` has a picture."""
        path = self._path(record)
        return path is not None and _is_picture(path)

    def views_of(self, iri: str) -> list[Path]:
        """Files with views of an object, the latest first; up to `MAX_VIEWS`."""
        number = _NUMBER.fullmatch(iri)
        return self._views(number[1])[:MAX_VIEWS] if number else []

    def read(self, record: ObjectRecord) -> bytes | None:
        """The JPEG of the best view of `record`; None without a picture."""
        path = self.path_of(record)
        try:
            return None if path is None else path.read_bytes()
        except OSError:
            return None  # removed meanwhile

    def write(self, record: ObjectRecord, jpeg: bytes) -> None:
        """Write `jpeg` as the picture of the best observation of `record`.

        The pictures of former best observations stay as further views, up to `MAX_VIEWS` in all.

        Raises GraphError if the folder cannot be written, ValueError for a larger picture.
        """
        path = self._path(record)
        if path is None:
            return
        if len(jpeg) > MAX_BYTES:
            raise ValueError(f"a picture has up to {MAX_BYTES} bytes, got {len(jpeg)}")
        part = path.with_suffix(".part")
        try:
            self._folder.mkdir(exist_ok=True)
            part.write_bytes(jpeg)
            part.replace(path)
            former = [view for view in self._views(path.name.partition("-")[0]) if view != path]
            for view in former[MAX_VIEWS - 1 :]:
                view.unlink(missing_ok=True)
        except OSError as error:
            raise GraphError(f"cannot write {path}: {error.strerror}") from error

    def remove(self, iri: str) -> None:
        """Remove the pictures of an object."""
        number = _NUMBER.fullmatch(iri)
        for path in self._folder.glob(f"{number[1]}-*.jpg") if number else ():
            path.unlink(missing_ok=True)

    def join(self, iri: str, other: str) -> None:
        """Move the pictures of the object `other` to `iri`, which is the same thing.

        The best views of both stay, up to `MAX_VIEWS`. Raises GraphError if the folder cannot be
        written.
        """
        kept, gone = _NUMBER.fullmatch(iri), _NUMBER.fullmatch(other)
        if kept is None or gone is None or iri == other:
            return
        in_turn = zip_longest(self._views(kept[1]), self._views(gone[1]))
        ranked = [path for pair in in_turn for path in pair if path is not None]
        try:
            latest = max((path.stat().st_mtime_ns for path in ranked), default=0)
            for rank, path in enumerate(ranked[:MAX_VIEWS]):
                os.utime(path, ns=(latest - rank, latest - rank))
                path.replace(self._folder / f"{kept[1]}-{path.name.partition('-')[2]}")
            for path in ranked[MAX_VIEWS:]:
                path.unlink(missing_ok=True)
        except OSError as error:
            raise GraphError(f"cannot write {self._folder}: {error.strerror}") from error

    def limit(self) -> None:
        """Remove pictures beyond `MAX_PICTURES`: former views first, then the oldest."""
        if not self._folder.is_dir():
            return
        paths = [path for path in self._folder.iterdir() if _NAME.fullmatch(path.name)]
        if len(paths) <= MAX_PICTURES:
            return
        paths.sort(key=lambda path: path.stat().st_mtime)
        latest = {path.name.partition("-")[0]: path for path in paths}
        paths.sort(key=lambda path: latest[path.name.partition("-")[0]] == path)  # keeps the order
        for path in paths[:-MAX_PICTURES]:
            path.unlink(missing_ok=True)

    def _views(self, number: str) -> list[Path]:
        """Regular files of an object's views, the latest first."""
        found = list[tuple[int, str]]()
        with suppress(OSError):  # as long as nothing has a picture
            for one in os.scandir(self._folder):
                if one.name.startswith(f"{number}-") and one.is_file(follow_symlinks=False):
                    found.append((-one.stat().st_mtime_ns, one.name))
        return [self._folder / name for _, name in sorted(found) if _NAME.fullmatch(name)]

    def _path(self, record: ObjectRecord) -> Path | None:
        number, shown = _NUMBER.fullmatch(record.iri), record.evidence
        if number is None or shown is None:
            return None
        key = zlib.crc32(f"{shown.recording}/{shown.frame}".encode())
        return self._folder / f"{number[1]}-{key:08x}.jpg"


def _is_picture(path: Path) -> bool:
    """Whether `path` is a regular file, and no link to one."""
    try:
        return stat.S_ISREG(path.lstat().st_mode)
    except OSError:
        return False

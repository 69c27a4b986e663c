"""Pictures of a map's objects: a small JPEG of each one's best observation, in the map's folder."""

from __future__ import annotations

import re
import zlib
from pathlib import Path
from typing import Final

from kg.model.errors import GraphError
from kg.model.records import ObjectRecord

FOLDER: Final = "pictures"  # in the folder of a map
MAX_BYTES: Final = 10_000  # of one picture
MAX_PICTURES: Final = 5_000  # of one map; the oldest are dropped
_NUMBER = re.compile(r".*/object/([0-9]{1,18})")
_NAME = re.compile(r"[0-9]{1,18}-[0-9a-f]{8}\.jpg")


class ObjectPictures:
    """Pictures in the folder `path` of a map; a picture's name has a key of its observation."""

    def __init__(self, path: Path) -> None:
        self._folder = path / FOLDER

    def path_of(self, record: ObjectRecord) -> Path | None:
        """File with the best observation of `record`; None without a picture."""
        path = self._path(record)
        if path is None or path.is_symlink() or not path.is_file():
            return None  # a link may lead to files that are not the map's
        return path if path.stat().st_size <= MAX_BYTES else None

    def write(self, record: ObjectRecord, jpeg: bytes) -> None:
        """Write `jpeg` as the picture of the best observation of `record`.

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
            for former in self._folder.glob(f"{path.name.partition('-')[0]}-*.jpg"):
                if former != path:
                    former.unlink(missing_ok=True)
        except OSError as error:
            raise GraphError(f"cannot write {path}: {error.strerror}") from error

    def remove(self, iri: str) -> None:
        """Remove the pictures of an object."""
        number = _NUMBER.fullmatch(iri)
        for path in self._folder.glob(f"{number[1]}-*.jpg") if number else ():
            path.unlink(missing_ok=True)

    def limit(self) -> None:
        """Remove the oldest pictures beyond `MAX_PICTURES`."""
        if not self._folder.is_dir():
            return
        paths = [path for path in self._folder.iterdir() if _NAME.fullmatch(path.name)]
        if len(paths) > MAX_PICTURES:
            for path in sorted(paths, key=lambda p: p.stat().st_mtime)[:-MAX_PICTURES]:
                path.unlink(missing_ok=True)

    def _path(self, record: ObjectRecord) -> Path | None:
        number, shown = _NUMBER.fullmatch(record.iri), record.evidence
        if number is None or shown is None:
            return None
        key = zlib.crc32(f"{shown.recording}/{shown.frame}".encode())
        return self._folder / f"{number[1]}-{key:08x}.jpg"

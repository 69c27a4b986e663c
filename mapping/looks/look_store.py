"""Look store: what an encoder makes of each picture of a map, and how alike two things look.

A row of values a picture, by its checksum, so that it stays with the picture whatever becomes of
the object. The folder of a map has `looks.npz` of the bundled classifier, and `encoder.npz` of the
user's own encoder, with its name and checksum; rows of another encoder are never read. Without the
file they are computed again; a file that cannot be read is told in a warning.
"""

from __future__ import annotations

import csv
import logging
import os
import zlib
from collections.abc import Hashable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cache, partial
from itertools import islice
from pathlib import Path
from typing import Final, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from kg.maps.object_pictures import MAX_PICTURES, MAX_VIEW_BYTES, ObjectPictures, view_picture
from kg.model.errors import ModelError, RecordingError
from kg.model.regular_files import read_bytes
from kg.model.sqlite_files import unreadable
from perception.inference.array_file import DAMAGE, read_arrays, write_arrays

LOOKS: Final = "looks.npz"  # of the bundled classifier, in the folder of a map
ENCODED: Final = "encoder.npz"  # of the user's encoder
MAX_NEW: Final = 200  # pictures that one call describes; the next call continues
_MAX_ROWS: Final = MAX_PICTURES + 600  # with those of key views
_MAX_FILE: Final = 1 << 27  # bytes
_WITHOUT: Final = "looks are computed again from the pictures of the map, into a new file"

_log = logging.getLogger(__name__)

Floats = NDArray[np.float32]
Key = tuple[str, str]  # recording and frame of a key view
Rows = dict[int, Floats]  # (D,) by the checksum of a picture
Name = TypeVar("Name", bound=Hashable)


class ImageEncoder(Protocol):
    """Makes a row of values of a picture."""

    @property
    def name(self) -> str:
        """Short name."""

    @property
    def checksum(self) -> str:
        """Text that no other encoder has."""

    @property
    def size(self) -> int:
        """Number of values in a row."""

    def describe(self, picture: bytes) -> Floats:
        """Values (D,) of a JPEG or PNG; raises RecordingError or ModelError for a useless one."""


@dataclass(frozen=True, slots=True)
class Kept:
    """The embeddings of one encoder in the folder of a map."""

    name: str
    checksum: str
    rows: Rows
    bytes: int  # of the file


class LookStore:
    """Looks of the things and views of the map in `folder`, by one encoder.

    What is computed is kept in that folder, or with `read_only` in the user's cache.
    """

    def __init__(
        self, folder: Path, encoder: ImageEncoder, file: str = LOOKS, *, read_only: bool = False
    ) -> None:
        self._folder, self._encoder = folder, encoder
        self._path, self._pictures = folder / file, ObjectPictures(folder)
        self._kept = _cached(file) if read_only else self._path

    def of(self, iris: Iterable[str], limit: int = MAX_NEW) -> dict[str, Floats]:
        """Rows (n, D) of the objects that have pictures, by IRI, one a view, the latest first.

        Describes up to `limit` new pictures, the best of each object first.
        """
        views = {iri: self._pictures.views_of(iri) for iri in dict.fromkeys(iris)}
        return self._described(views, limit)

    def of_views(self, keys: Iterable[Key], limit: int = MAX_NEW) -> dict[Key, Floats]:
        """Rows (1, D) of the key views that have pictures."""
        return self._described({key: [view_picture(self._folder, *key)] for key in keys}, limit)

    def settle(self, iris: Iterable[str], keys: Iterable[Key], known: Rows) -> None:
        """Describe the best picture of each object and the key views; drop rows of no picture.

        Former views that nobody had the time to describe are described when they are asked for.
        `known` are rows that were computed meanwhile. The file is written even without pictures.
        """
        views = [self._pictures.views_of(iri) for iri in dict.fromkeys(iris)]
        needed = [*(found[0] for found in views if found)]
        needed += [view_picture(self._folder, *key) for key in keys]
        former = [path for found in views for path in found[1:]]
        before = self._load(self._path) | known
        rows = {c: before[c] for c in _read_pictures(former) if c in before}
        pictures = _read_pictures(needed)
        rows |= {c: before[c] for c in pictures if c in before}
        self._describe({c: data for c, data in pictures.items() if c not in rows}, rows)
        self._save(rows)

    def _describe(self, pictures: Mapping[int, bytes], rows: Rows) -> None:
        """Add the rows of `pictures` to `rows`, with all processors: an encoder uses one."""
        from concurrent.futures import ThreadPoolExecutor  # not for those that are known

        one, data = partial(described, self._encoder), list(pictures.values())
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            found = [*map(one, data[:1]), *pool.map(one, data[1:])]  # the first opens the network
            rows.update(zip(pictures, found, strict=True))

    def _described(self, paths: Mapping[Name, Sequence[Path]], limit: int) -> dict[Name, Floats]:
        views = {name: _read_pictures(found) for name, found in paths.items()}
        if not any(views.values()):
            return {}
        known = self._load(self._path)
        if self._kept != self._path and any(c not in known for p in views.values() for c in p):
            known = self._load(self._kept) | known
        ranked = [one for pictures in views.values() for one in enumerate(pictures.items())]
        ranked.sort(key=lambda one: one[0])
        new = {checksum: data for _, (checksum, data) in ranked if checksum not in known}
        if new:
            self._describe(dict(islice(new.items(), limit)), known)
            self._save(known)
        found = {}
        for name, pictures in views.items():
            shown = [known[c] for c in pictures if c in known and np.isfinite(known[c]).all()]
            if shown:
                found[name] = np.stack(shown)
        return found

    def _load(self, path: Path) -> Rows:
        kept = kept_looks(path)
        if kept is None or kept.checksum != self._encoder.checksum:
            return {}
        sizes = {len(row) for row in kept.rows.values()}
        return kept.rows if sizes <= {self._encoder.size} else {}

    def _save(self, known: Rows) -> None:
        last = dict(list(known.items())[-_MAX_ROWS:])
        arrays = {
            "encoder": np.array(self._encoder.name),
            "checksum": np.array(self._encoder.checksum),
            "picture": np.array(list(last), np.int64),
            "rows": np.array(list(last.values()), np.float16).reshape(-1, self._encoder.size),
        }
        # a folder that cannot be written: described again next time
        with suppress(ModelError, OSError):
            self._kept.parent.mkdir(parents=True, exist_ok=True)
            write_arrays(self._kept, arrays)


def described(encoder: ImageEncoder, picture: bytes) -> Floats:
    """Row of a picture; not a number for one that shows nothing."""
    try:
        return encoder.describe(picture)
    except (RecordingError, ModelError):
        return np.full(encoder.size, np.float32(np.nan))


def picture_key(picture: bytes) -> int:
    """The number by which rows of a picture are kept."""
    return zlib.crc32(picture)


def kept_looks(path: Path) -> Kept | None:
    """The embeddings of a file; None without it, and with a warning where it is damaged."""
    try:
        return _read(path)
    except DAMAGE as error:
        _log.warning("%s", unreadable(path, error, _WITHOUT))
        return None


def kept_embeddings(folder: Path, iris: Iterable[str]) -> tuple[Kept, dict[str, Floats]]:
    """The file of the encoder of the map in `folder`, and embeddings (views, D) of its objects.

    Raises ModelError for a map that was made without one.
    """
    kept, pictures = kept_looks(folder / ENCODED), ObjectPictures(folder)
    if kept is None:
        raise ModelError("the map keeps no embeddings; one mapped with --encoder FILES would work")
    found = {}
    for iri in iris:
        views = _read_pictures(pictures.views_of(iri))
        if rows := [kept.rows[c] for c in views if c in kept.rows]:
            found[iri] = np.stack(rows)
    return kept, found


def looks_damage(path: Path) -> str:
    """A line about looks that cannot be read in a file of a map; "" for good ones or none."""
    try:
        _read(path)
    except DAMAGE as error:
        return unreadable(path, error, _WITHOUT)
    return ""


def _read(path: Path) -> Kept | None:
    """The content of a file; None for none and for a former format; raises one of `DAMAGE`."""
    if not (path.exists() or path.is_symlink()):
        return None
    data = read_arrays(path, _MAX_FILE)
    if "network" in data:
        return None
    pictures = data["picture"].astype(np.int64).tolist()
    rows = data["rows"].astype(np.float32)
    known = dict(zip(pictures, rows, strict=True))
    return Kept(str(data["encoder"]), str(data["checksum"]), known, path.stat().st_size)


def _read_pictures(paths: Iterable[Path]) -> Mapping[int, bytes]:
    """Checksum -> content of each picture, in their order."""
    found = {}
    for path in paths:
        with suppress(OSError):  # removed meanwhile, or never made
            data = read_bytes(path, MAX_VIEW_BYTES)
            found[picture_key(data)] = data
    return found


def _cached(file: str) -> Path:
    from perception.inference.model_zoo import cache_folder  # it loads an HTTP client

    return cache_folder() / file


def features_of(rows: Floats) -> Floats:
    """Features (n, F) in rows (n, F + C) of the bundled network."""
    return rows[:, : len(feature_statistics()[0])]


def log_p_of(rows: Floats) -> Floats:
    """Log-probabilities (n, C) of ImageNet's classes in the same rows."""
    return rows[:, len(feature_statistics()[0]) :]


def likeness(a: Floats, b: Floats) -> float:
    """How alike two things are, -1..1, from features (n, F) and (m, F) of their views.

    Features are in deviations from the mean of things in general. Each view counts by the cosine
    to the other thing's most similar view.
    """
    cosines = _directions(a) @ _directions(b).T
    return float(cosines.max(axis=0).mean() + cosines.max(axis=1).mean()) / 2


def most_alike(thing: Floats, others: Iterable[Floats]) -> float | None:
    """Likeness of a thing, features (n, F), to the most similar of `others`; None without any."""
    return max((likeness(other, thing) for other in others), default=None)


@cache
def feature_statistics() -> tuple[Floats, Floats]:
    """(F,) mean and deviation of each feature over boxes of many things in photographs."""
    with Path(__file__).with_name("look_statistics.csv").open(encoding="utf-8") as file:
        rows = [(float(row["mean"]), float(row["deviation"])) for row in csv.DictReader(file)]
    mean, deviation = np.array(rows, np.float32).T
    return mean, deviation


def _directions(features: Floats) -> Floats:
    """Features (n, F) as unit vectors, from the mean of things in general."""
    mean, deviation = feature_statistics()
    scaled: Floats = (features - mean) / deviation
    found: Floats = scaled / np.maximum(np.linalg.norm(scaled, axis=1, keepdims=True), 1e-9)
    return found

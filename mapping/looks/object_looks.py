"""Looks of a map's objects, computed from their pictures, and how alike two things look.

The map's folder keeps them in `looks.npz`, by the checksum of each picture, so that they stay with
the pictures whatever becomes of the objects. Without the file they are computed again; a file that
cannot be read is told in a warning.
"""

from __future__ import annotations

import csv
import logging
import zlib
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from kg.maps.object_pictures import MAX_BYTES, MAX_PICTURES, ObjectPictures
from kg.model.errors import ModelError, RecordingError
from kg.model.regular_files import read_bytes
from kg.model.sqlite_files import unreadable
from perception.inference.array_file import DAMAGE, read_arrays, write_arrays

if TYPE_CHECKING:
    from perception.inference.look_network import LookNetwork


FILE: Final = "looks.npz"  # in the folder of a map
MAX_NEW: Final = 200  # pictures that one call describes; the next call continues
_MAX_FILE: Final = 1 << 27  # bytes
_WITHOUT: Final = "looks are computed again from the pictures of the map, into a new file"

_log = logging.getLogger(__name__)

Floats = NDArray[np.float32]
Row = tuple[Floats, Floats]  # features (F,) and log-probabilities (C,) of one picture


@dataclass(frozen=True, slots=True)
class Looks:
    """Looks of one thing in n views."""

    features: Floats  # (n, F)
    log_p: Floats  # (n, C) log-probability of each of ImageNet's classes

    @classmethod
    def of_pictures(cls, pictures: Iterable[bytes]) -> Looks:
        """Looks in JPEG or PNG pictures.

        Raises RecordingError for a damaged one, ModelError for one that shows nothing.
        """
        found = [network().describe(data) for data in pictures]
        features, log_p = zip(*found, strict=True)
        return cls(np.stack(features), np.stack(log_p))


@cache
def network() -> LookNetwork:
    """The bundled network, opened once; its runtime is loaded then, too."""
    from perception.inference.look_network import load_look_network

    return load_look_network()


def _cached() -> Path:
    from perception.inference.model_zoo import cache_folder  # it loads an HTTP client

    return cache_folder() / FILE


class ObjectLooks:
    """Looks of the objects of the map in `folder`.

    What is computed is kept in that folder, or with `read_only` in the user's cache.
    """

    def __init__(self, folder: Path, *, read_only: bool = False) -> None:
        self._path, self._pictures = folder / FILE, ObjectPictures(folder)
        self._kept = _cached() if read_only else self._path

    def of(self, iris: Iterable[str]) -> dict[str, Looks]:
        """Looks of the objects that have pictures, by IRI.

        Describes up to `MAX_NEW` new pictures, the best of each object first.
        """
        views = {iri: self._read(iri) for iri in dict.fromkeys(iris)}
        if not any(views.values()):
            return {}
        known = self._load(self._path)
        if self._kept != self._path and any(c not in known for p in views.values() for c in p):
            known = self._load(self._kept) | known
        ranked = [one for pictures in views.values() for one in enumerate(pictures.items())]
        ranked.sort(key=lambda one: one[0])
        new = {checksum: data for _, (checksum, data) in ranked if checksum not in known}
        for checksum, data in list(new.items())[:MAX_NEW]:
            known[checksum] = _described(data)
        if new:
            self._save(known)
        found = {}
        for iri, pictures in views.items():
            shown = [known[c] for c in pictures if c in known and np.isfinite(known[c][0]).all()]
            if shown:
                found[iri] = Looks(*(np.stack(rows) for rows in zip(*shown, strict=True)))
        return found

    def _read(self, iri: str) -> dict[int, bytes]:
        """Checksum -> content of each picture of an object, the latest first."""
        found = {}
        for path in self._pictures.views_of(iri):
            with suppress(OSError):  # removed meanwhile
                data = read_bytes(path, MAX_BYTES)
                found[zlib.crc32(data)] = data
        return found

    def _load(self, path: Path) -> dict[int, Row]:
        try:
            name, known = _read(path)
        except DAMAGE as error:
            _log.warning("%s", unreadable(path, error, _WITHOUT))
            return {}
        sizes = {tuple(map(len, row)) for row in known.values()}
        return known if name == network().name and sizes <= {network().sizes} else {}

    def _save(self, known: dict[int, Row]) -> None:
        last = dict(list(known.items())[-MAX_PICTURES:])
        features, log_p = (np.stack(rows) for rows in zip(*last.values(), strict=True))
        arrays = {
            "network": np.array(network().name),
            "checksum": np.array(list(last), np.int64),
            "features": features.astype(np.float16),
            "log_p": log_p.astype(np.float16),
        }
        # a folder that cannot be written: described again next time
        with suppress(ModelError, OSError):
            self._kept.parent.mkdir(parents=True, exist_ok=True)
            write_arrays(self._kept, arrays)


def looks_damage(folder: Path, *, live: bool = False) -> str:
    """A line about looks that cannot be read in the folder of a map; "" for good ones or none."""
    try:
        _read(folder / FILE)
    except DAMAGE as error:
        return unreadable(folder / FILE, error, _WITHOUT)
    return ""


def _read(path: Path) -> tuple[str, dict[int, Row]]:
    """Name of the network, and the row of each picture by its checksum; raises one of `DAMAGE`."""
    if not (path.exists() or path.is_symlink()):
        return "", {}
    data = read_arrays(path, _MAX_FILE)
    features, log_p = (data[name].astype(np.float32) for name in Looks.__slots__)
    checksums = data["checksum"].astype(np.int64).tolist()
    known = dict(zip(checksums, zip(features, log_p, strict=True), strict=True))
    return str(data["network"]), known


def _described(picture: bytes) -> Row:
    """Look of a picture; not a number for one that shows nothing."""
    try:
        return network().describe(picture)
    except (RecordingError, ModelError):
        features, classes = network().sizes
        nothing = np.float32(np.nan)
        return np.full(features, nothing), np.full(classes, nothing)


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

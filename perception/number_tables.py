"""Number tables in text files, and JSON objects; errors name the file and the line."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from kg.model.errors import RecordingError
from kg.model.regular_files import read_bytes

LFS: Final = b"version https://git-lfs"  # beginning of a file that stands for another
_UTF16: Final = (b"\xff\xfe", b"\xfe\xff")
#: from which stamps are in another unit than seconds, and that unit [s]
_UNITS: Final = ((1e17, 1e-9), (1e14, 1e-6), (1e11, 1e-3))


def check_pointer(data: bytes, where: object, wanted: str = "not the file itself") -> None:
    """Raise RecordingError where a file is a pointer of Git LFS."""
    if data.startswith(LFS):
        raise RecordingError(f"{where} is a Git LFS pointer, {wanted}; `git lfs pull` fetches it")


def in_seconds(stamps: NDArray[np.float64]) -> NDArray[np.float64]:
    """Stamps (n,) since 1970 in seconds, where they are in milli-, micro- or nanoseconds."""
    largest = float(np.max(stamps, initial=0.0))
    unit = next((unit for least, unit in _UNITS if largest >= least), 1.0)
    return stamps if unit == 1.0 else np.round(stamps * unit, 9)


def json_object(text: str | bytes, where: object) -> dict[str, Any]:
    """The object that a text in JSON is; raises RecordingError, beginning with `where`."""
    try:
        found = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise RecordingError(f"{where} is no JSON: {error}") from error
    if not isinstance(found, dict):
        raise RecordingError(f"{where} holds no JSON object")
    return found


def rows(path: Path) -> Iterator[tuple[str, list[str]]]:
    """("FILE, line N", words) of each line that is neither empty nor a comment.

    Commas separate like white space. Raises RecordingError where the file cannot be read as text.
    """
    try:
        data = read_bytes(path)
        check_pointer(data, path)
        # programs of Windows begin with a mark
        text = data.decode("utf-16" if data.startswith(_UTF16) else "utf-8-sig")
    except OSError as error:
        raise RecordingError(f"cannot read {path}: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise RecordingError(f"{path} is not a text file") from error
    for number, line in enumerate(text.splitlines(), start=1):
        words = line.split("#", 1)[0].replace(",", " ").split()
        if words:
            yield f"{path}, line {number}", words


def floats(words: Iterable[str], where: str) -> list[float]:
    """The words as numbers; raises RecordingError with `where` at the first that is none."""
    values = []
    for word in words:
        try:
            values.append(float(word))
        except ValueError as error:
            raise RecordingError(f"{where}: {word!r} is not a number") from error
    return values


def all_numbers(path: Path) -> NDArray[np.float64]:
    """Every number of the file, (n,), row by row."""
    found: list[float] = []
    for where, words in rows(path):
        found += floats(words, where)
    return np.array(found)

"""Number tables in text files, and JSON objects; errors name the file and the line."""

from __future__ import annotations

import json
import logging
import re
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from kg.model.errors import RecordingError
from kg.model.regular_files import read_bytes

POINTER: Final = "a Git LFS pointer"
LFS: Final = b"version https://git-lfs"  # beginning of a file that stands for another
_DECIMAL: Final = re.compile(r"[-+]?\d+(,\d+)?([eE][-+]?\d+)?")  # as some countries write it
_UTF16: Final = (b"\xff\xfe", b"\xfe\xff")
#: from which stamps are in another unit than seconds, and that unit [s]
_UNITS: Final = ((1e17, 1e-9), (1e14, 1e-6), (1e11, 1e-3))
DATES: Final = (9e8, 3e9)  # [s] since 1970: 1998 to 2065
LONGEST: Final = 15.0  # [s] between two images of a recording, in the middle ...
USUAL: Final = 0.06  # [s] ... and as is usual
_log = logging.getLogger(__name__)


def check_pointer(data: bytes, where: object, wanted: str = "not the file itself") -> None:
    """Raise RecordingError where a file is a pointer of Git LFS."""
    if data.startswith(LFS):
        raise RecordingError(f"{where} is {POINTER}, {wanted}; `git lfs pull` fetches it")


def in_seconds(stamps: NDArray[np.float64], where: Path) -> NDArray[np.float64]:
    """Stamps (n,) in seconds, where they are in milli-, micro- or nanoseconds.

    Those since 1970 tell their unit. Of others, as of a computer's time since its start, the step
    from one to the next tells it, with a line; with a fraction they are seconds.
    """
    largest = float(np.max(stamps, initial=0.0))
    unit = next((unit for least, unit in _UNITS if largest >= least), 1.0)
    step = float(np.median(np.diff(np.unique(stamps)))) if len(stamps) > 2 else 0.0
    dated = DATES[0] < largest * unit < DATES[1]
    whole = bool((stamps == np.rint(stamps)).all())
    if whole and (step * unit >= LONGEST or (step >= LONGEST and not dated)):
        unit = min((unit for _, unit in _UNITS), key=lambda one: abs(np.log(step * one / USUAL)))
        text = "%s: its stamps, %g apart, are taken for %s"
        _log.warning(
            text, where, step, {1e-3: "milli", 1e-6: "micro", 1e-9: "nano"}[unit] + "seconds"
        )
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


def text_of(path: Path) -> str:
    """The text of a file in UTF-8 or UTF-16; raises RecordingError where it has none."""
    try:
        data = read_bytes(path)
        check_pointer(data, path)
        # programs of Windows begin with a mark
        return data.decode("utf-16" if data.startswith(_UTF16) else "utf-8-sig")
    except OSError as error:
        raise RecordingError(f"cannot read {path}: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise RecordingError(f"{path} is not a text file") from error


def rows(path: Path) -> Iterator[tuple[str, list[str]]]:
    """("FILE, line N", words) of each line that is neither empty nor a comment.

    Commas and semicolons separate like white space, but for commas within numbers. Raises
    RecordingError where the file cannot be read as text.
    """
    for number, line in enumerate(text_of(path).splitlines(), start=1):
        line = line.split("#", 1)[0].replace(";", " ")
        words = line.replace(",", " ").split()
        if "," in line and len(parts := line.split()) > 1 and all(map(_DECIMAL.fullmatch, parts)):
            words = [part.replace(",", ".") for part in parts]
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
        found += floats(filter(None, (word.strip("[]()") for word in words)), where)
    return np.array(found)

"""Number tables in text files; errors name the file and the line."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from kg.model.errors import RecordingError
from kg.model.regular_files import read_text


def rows(path: Path) -> Iterator[tuple[str, list[str]]]:
    """("FILE, line N", words) of each line that is neither empty nor a comment.

    Commas separate like white space. Raises RecordingError where the file cannot be read as text.
    """
    try:
        text = read_text(path, "utf-8-sig")  # programs of Windows begin with a mark
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

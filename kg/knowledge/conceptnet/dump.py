"""Reader of ConceptNet files or pipes, plain or gzip, line by line in bounded memory.

The format is detected from the lines, not from the name:

- ConceptNet 5 assertions: five columns between tabs, the first an assertion's URI, the last JSON;
- ConceptNet 4 graph: three columns, the last a Python dictionary of freq, score and rel.
"""

from __future__ import annotations

import gzip
import io
import warnings
import zlib
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import chain, count
from pathlib import Path
from typing import IO, Final

from kg.knowledge.conceptnet.edges import (
    Edge,
    EdgeFilter,
    MalformedEdgeError,
    is_conceptnet4,
    is_conceptnet5,
    parse_line4,
    parse_line5,
)
from kg.model.errors import ConceptNetError

MAX_LINE: Final = 1 << 20  # bytes; far more than any line of the real files
_CHUNK: Final = 1 << 20
_REPORTED: Final = 10_000  # lines between two reports of progress
_SNIFFED: Final = 1000  # lines read to detect the format
_GZIP: Final = b"\x1f\x8b"

#: Callback with (bytes read, total bytes).
Progress = Callable[[int, int], None]


@dataclass(slots=True)
class DumpStatistics:
    """Statistics of reading a source, updated while it is read."""

    lines: int = 0  # lines of a file, or edges of an answer
    skipped: Counter[str] = field(default_factory=Counter)  # why -> how many
    requests: int = 0  # to the web API


def read_dump(
    path: Path, language: str, wanted: EdgeFilter, statistics: DumpStatistics, progress: Progress
) -> Iterator[Edge]:
    """Assertions of a file in `language` that pass the filter `wanted`.

    Malformed lines are counted in `statistics`, by reason.

    Raises:
        ConceptNetError: the file is missing, truncated, or in neither format.
    """
    with _opened(path) as (raw, unpacked):
        lines = _lines(unpacked, statistics, _report(raw, path, progress))
        first, parse = _sniff(lines, path, statistics)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # about invalid escapes in a Python dictionary
            for line in chain(first, lines):
                yield from _parsed(parse, line, language, wanted, statistics)


_Parse = Callable[[bytes, str, EdgeFilter], Edge | None]
_FORMATS: Final[tuple[tuple[Callable[[bytes], bool], _Parse], ...]] = (
    (is_conceptnet5, parse_line5),
    (is_conceptnet4, parse_line4),
)


def _parsed(
    parse: _Parse, line: bytes, language: str, wanted: EdgeFilter, statistics: DumpStatistics
) -> Iterator[Edge]:
    try:
        assertion = parse(line, language, wanted)
    except UnicodeDecodeError:
        statistics.skipped["not UTF-8"] += 1
    except MalformedEdgeError as error:
        statistics.skipped[str(error)] += 1
    except (ValueError, SyntaxError, RecursionError, MemoryError):
        statistics.skipped["no data in it"] += 1
    else:
        if assertion is not None:
            yield assertion


@contextmanager
def _opened(path: Path) -> Iterator[tuple[IO[bytes], IO[bytes]]]:
    try:
        with path.open("rb") as raw:
            packed = raw.peek(2)[:2] == _GZIP  # a pipe cannot seek
            yield raw, io.BufferedReader(gzip.GzipFile(fileobj=raw), _CHUNK) if packed else raw
    except (EOFError, zlib.error, gzip.BadGzipFile) as error:
        reason = " ".join(str(error).split())
        raise ConceptNetError(
            f"{path}: the gzip data is truncated or damaged ({reason}); fetch the file again"
        ) from None
    except OSError as error:
        raise ConceptNetError(f"{path}: {error.strerror or error}") from None


def _report(raw: IO[bytes], path: Path, progress: Progress) -> Callable[[], None]:
    if not raw.seekable():
        return lambda: None
    total = path.stat().st_size
    return lambda: progress(raw.tell(), total)


def _lines(
    file: IO[bytes], statistics: DumpStatistics, report: Callable[[], None]
) -> Iterator[bytes]:
    """Lines without line ends; empty ones are omitted, and too long ones counted and omitted."""
    for number in count():
        if not number % _REPORTED:
            report()
        line = file.readline(MAX_LINE + 1)
        if not line:
            return
        if line.isspace():
            continue
        statistics.lines += 1
        if len(line) <= MAX_LINE or line.endswith(b"\n"):
            yield line.removesuffix(b"\n")
            continue
        statistics.skipped["line too long"] += 1
        while line and not line.endswith(b"\n"):
            line = file.readline(MAX_LINE)


def _sniff(
    lines: Iterator[bytes], path: Path, statistics: DumpStatistics
) -> tuple[list[bytes], _Parse]:
    """The lines read so far, and the parser for the detected format."""
    lines_read: list[bytes] = []
    for line in lines:
        lines_read.append(line)
        for has_form, parse in _FORMATS:
            if has_form(line):
                return lines_read, parse
        if len(lines_read) >= _SNIFFED:
            break
    none = f"none of its first {len(lines_read)} lines is one"
    what = none if statistics.lines else "it is empty"
    raise ConceptNetError(
        f"{path} holds no ConceptNet assertions ({what}): expected the TSV of ConceptNet 5 "
        "(5 columns, the first /a/[...]) or the graph of ConceptNet 4 (3 columns), plain or gzip"
    )

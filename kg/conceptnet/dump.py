"""A file (or pipe) of ConceptNet, plain or gzip, read line by line in bounded memory.

Which format it is shows in its lines, not in its name:

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
from itertools import chain
from pathlib import Path
from typing import IO, Final

from kg.conceptnet import graph4, tables5
from kg.conceptnet.assertion import Assertion, Unreadable
from kg.errors import ConceptNetError

LONGEST_LINE: Final = 1 << 20  # bytes; of the real files no line comes near
_CHUNK: Final = 1 << 20
_SNIFFED: Final = 1000  # lines looked at before a file is given up as neither format
_GZIP: Final = b"\x1f\x8b"

#: (relation, start term, end term) -> whether the import could use such an assertion.
Wanted = Callable[[str, str, str], bool]
#: Told (bytes read, bytes in all) now and then.
Progress = Callable[[int, int], None]


@dataclass(slots=True)
class Reading:
    """What reading a source came to, as far as it has got."""

    lines: int = 0  # lines of a file, or edges of an answer
    skipped: Counter[str] = field(default_factory=Counter)  # why -> how many
    requests: int = 0  # to the web API


def read_dump(
    path: Path, language: str, wanted: Wanted, reading: Reading, progress: Progress
) -> Iterator[Assertion]:
    """The assertions of a file that are in `language` and wanted; others are not even parsed.

    Lines that cannot be read are counted in `reading`, by reason.

    Raises:
        ConceptNetError: no such file, neither format, no line that can be read, or broken off.
    """
    with _opened(path) as (raw, unpacked):
        lines = _lines(unpacked, reading, _report(raw, path, progress))
        first, parse = _sniff(lines, path, reading)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of odd escapes in a Python dictionary
            for line in chain(first, lines):
                yield from _parsed(parse, line, language, wanted, reading)


_Parse = Callable[[bytes, str, Wanted], Assertion | None]


def _parsed(
    parse: _Parse, line: bytes, language: str, wanted: Wanted, reading: Reading
) -> Iterator[Assertion]:
    try:
        assertion = parse(line, language, wanted)
    except UnicodeDecodeError:
        reading.skipped["not UTF-8"] += 1
    except (ValueError, SyntaxError, RecursionError, MemoryError) as error:
        reading.skipped[str(error) if isinstance(error, Unreadable) else "no data in it"] += 1
    else:
        if assertion is not None:
            yield assertion


@contextmanager
def _opened(path: Path) -> Iterator[tuple[IO[bytes], IO[bytes]]]:
    try:
        with path.open("rb") as raw:
            packed = raw.peek(2)[:2] == _GZIP  # not by seeking: it may be a pipe
            yield raw, io.BufferedReader(gzip.GzipFile(fileobj=raw), _CHUNK) if packed else raw
    except (EOFError, zlib.error, gzip.BadGzipFile) as error:
        reason = " ".join(str(error).split())
        raise ConceptNetError(
            f"{path}: the gzip data breaks off or is damaged ({reason}); fetch the file again"
        ) from None
    except OSError as error:
        raise ConceptNetError(f"{path}: {error.strerror or error}") from None


def _report(raw: IO[bytes], path: Path, progress: Progress) -> Callable[[], None]:
    if not raw.seekable():
        return lambda: None
    total = path.stat().st_size
    return lambda: progress(raw.tell(), total)


def _lines(file: IO[bytes], reading: Reading, report: Callable[[], None]) -> Iterator[bytes]:
    """Lines without their end; one that is too long is counted, not kept."""
    rest, too_long = b"", False
    while chunk := file.read(_CHUNK):
        report()
        *whole, last = chunk.split(b"\n")
        if whole:
            if too_long:
                too_long = False
            else:
                whole[0] = rest + whole[0]
                yield from _short(whole[:1], reading)
            yield from _short(whole[1:], reading)
            rest = b""
        if not too_long:
            rest += last
        if len(rest) > LONGEST_LINE:
            too_long, rest = True, b""
            reading.lines += 1
            reading.skipped["line too long"] += 1
    yield from _short([rest] if rest else [], reading)


def _short(lines: list[bytes], reading: Reading) -> Iterator[bytes]:
    for line in lines:
        if len(line) > LONGEST_LINE:
            reading.skipped["line too long"] += 1
        elif line and not line.isspace():
            yield line
        else:
            continue
        reading.lines += 1


def _sniff(lines: Iterator[bytes], path: Path, reading: Reading) -> tuple[list[bytes], _Parse]:
    """The lines looked at, and how lines like the first good one of them are parsed."""
    seen: list[bytes] = []
    for line in lines:
        seen.append(line)
        for form in (tables5, graph4):
            if form.looks_like(line):
                return seen, form.parse
        if len(seen) >= _SNIFFED:
            break
    what = "it is empty" if not reading.lines else f"none of its first {len(seen)} lines is one"
    raise ConceptNetError(
        f"{path} holds no ConceptNet assertions ({what}): expected the TSV of ConceptNet 5 "
        "(5 columns, the first /a/[...]) or the graph of ConceptNet 4 (3 columns), plain or gzip"
    )

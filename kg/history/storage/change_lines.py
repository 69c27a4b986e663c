"""Compressed lines of N-Quads, the format of change sets and states in the log.

A change set is two blocks of sorted lines, the removed and the added quads, with an empty line
between them. A line that begins with a space has the subject of the previous line. The text is
compressed with zlib and a preset dictionary, so that vocabulary names cost little in small changes.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterable, Sequence
from itertools import takewhile
from typing import Final, NamedTuple

from pyoxigraph import Quad, RdfFormat, parse, serialize

from kg.model import vocabulary as v
from kg.model.errors import HistoryError, InvalidFactError

MAX_TEXT: Final = 1 << 29  # [bytes] of a row, decompressed
_LARGE: Final = 1 << 20  # [bytes] of a row, from which on it is compressed quickly
_REMEDY: Final = "move history.sqlite away to begin a new one"
_SPACE: Final = ord(" ")
_DOUBLES: Final = (v.Y_MIN, v.X_MAX, v.X_MIN, v.BELIEF, v.HEADING, v.SCORE, v.Z, v.Y, v.X)
_INTEGERS: Final = (v.NEXT_OBJECT, v.VIEW_COUNT, v.FRAMES_APPLIED, v.OBSERVATION_COUNT)
_TIMES: Final = (v.SOSA_RESULT_TIME, v.FIRST_SEEN, v.LAST_SEEN)
_TEXTS: Final = (v.BOX, v.FRAME, v.MODEL, v.LAST_FRAME, v.RDFS_LABEL)
_NODES: Final = (
    *(v.SOSA_FEATURE, v.FROM_RECORDING, v.EXPLAINED_BY, v.HAS_BELIEF, v.OF_CATEGORY),
    *(v.IN_PLACE, v.RDF_TYPE.value),
)


class ChangeLines(NamedTuple):
    """Lines of one change set, or of its part about one subject."""

    removed: list[bytes]
    added: list[bytes]


class LineCodec:
    """Compresses and decompresses blocks of lines with a preset dictionary.

    Reading raises HistoryError for what is damaged or larger than `MAX_TEXT`.
    """

    def __init__(self, dictionary: bytes) -> None:
        self._dictionary = dictionary

    def encode(self, *blocks: Iterable[bytes]) -> bytes:
        """Blocks of lines, sorted and compressed.

        Raises InvalidFactError for more than `MAX_TEXT` bytes.
        """
        text = b"\n\n".join(_packed(block) for block in blocks)
        # others wait while a large text is compressed; negative window bits leave out zlib's header
        level = 9 if len(text) < _LARGE else 3
        deflate = zlib.compressobj(level, zlib.DEFLATED, -zlib.MAX_WBITS, 9, zdict=self._dictionary)
        if len(text) > MAX_TEXT:
            raise InvalidFactError(
                f"a transaction of {len(text):,} bytes as N-Quads; at most {MAX_TEXT:,} would work"
            )
        return deflate.compress(text) + deflate.flush()

    def state(self, data: bytes) -> list[bytes]:
        """The lines of a single block."""
        return _unpacked(self._text(data))

    def change(self, data: bytes) -> ChangeLines:
        """The lines of a change set."""
        removed, _, added = self._text(data).partition(b"\n\n")
        return ChangeLines(_unpacked(removed), _unpacked(added))

    def change_about(self, data: bytes, subject: bytes) -> ChangeLines:
        """The lines of a change set about `subject`, a term as in N-Quads."""
        removed, _, added = self._text(data).partition(b"\n\n")
        return ChangeLines(_about(removed, subject), _about(added, subject))

    def _text(self, data: bytes) -> bytes:
        inflate = zlib.decompressobj(-zlib.MAX_WBITS, zdict=self._dictionary)
        try:
            text = inflate.decompress(data, MAX_TEXT)
        except zlib.error as error:
            raise HistoryError(f"the history is damaged ({error}); {_REMEDY}") from error
        if inflate.unconsumed_tail:
            raise HistoryError(f"a row of the history has more than {MAX_TEXT:,} bytes; {_REMEDY}")
        if not inflate.eof:
            raise HistoryError(f"the history is damaged (a row is cut off); {_REMEDY}")
        return text


def dictionary_for(base: str) -> bytes:
    """The preset dictionary of a map's log: typical lines, the most frequent last."""
    graph, thing = f"{v.MAP_GRAPH} .\n", f"<{base}object/1>"
    lines = [
        *(f"{thing} <{name}> <{base}place/1> {graph}" for name in _NODES),
        *(f'{thing} <{name}> "frame-0000" {graph}' for name in _TEXTS),
        *(f'{thing} <{name}> "2026-01-01T00:00:00Z"^^<{v.XSD}dateTime> {graph}' for name in _TIMES),
        *(f'{thing} <{name}> "1"^^<{v.XSD}integer> {graph}' for name in _INTEGERS),
        f"{thing} <{v.IN_CELL}> <{v.CELL}1_1> {graph}",
        *(f'{thing} <{name}> "0.1"^^{v.XSD_DOUBLE} {graph}' for name in _DOUBLES),
        f'{thing} <{v.CONFIDENCE}> "0.1"^^{v.XSD_DOUBLE} {graph}',
        f'{thing} <{v.EXISTENCE}> "0.1"^^{v.XSD_DOUBLE} {graph}',
    ]
    return "".join(lines).encode()


def lines_of(quads: Iterable[Quad]) -> list[bytes]:
    """A line of N-Quads for each quad."""
    return (serialize(quads, format=RdfFormat.N_QUADS) or b"").splitlines()


def quads_of(lines: Iterable[bytes]) -> list[Quad]:
    """The quads of lines; blank nodes keep their labels. Raises HistoryError for other lines."""
    try:
        return [*parse(b"\n".join(lines), format=RdfFormat.N_QUADS, lenient=True)]
    except SyntaxError as error:
        raise HistoryError(f"the history is damaged ({error}); {_REMEDY}") from error


def subject_of(line: bytes) -> bytes:
    """The subject of a line, a term as in N-Quads."""
    return line.partition(b" ")[0]


def net(changes: Sequence[ChangeLines]) -> ChangeLines:
    """The net change of consecutive change sets."""
    all_removed: set[bytes] = set()
    all_added: set[bytes] = set()
    for removed, added in changes:
        for line in removed:
            all_added.remove(line) if line in all_added else all_removed.add(line)
        for line in added:
            all_removed.remove(line) if line in all_removed else all_added.add(line)
    return ChangeLines(sorted(all_removed), sorted(all_added))


def _packed(lines: Iterable[bytes]) -> bytes:
    packed, last = [], b""
    for line in sorted(lines):
        subject, _, rest = line.partition(b" ")
        packed.append(b" " + rest if subject == last else line)
        last = subject
    return b"\n".join(packed)


def _unpacked(block: bytes) -> list[bytes]:
    lines, subject = [], b""
    for line in block.splitlines():
        if line.startswith(b" "):
            lines.append(subject + line)
        else:
            lines.append(line)
            subject = subject_of(line)
    return lines


def _about(block: bytes, subject: bytes) -> list[bytes]:
    # a block is sorted, so the lines of a subject are consecutive
    start = (b"\n" + block).find(b"\n" + subject + b" ")
    if start < 0:
        return []
    first, *rest = block[start:].splitlines()
    return [first, *(subject + line for line in takewhile(lambda x: x[0] == _SPACE, rest))]

"""Many rows of the log decoded side by side: step k takes the k-th change of each of them.

`kg.history.storage.row_codec` defines the format of a row. Row by row in Python, the rows of a
thousand subjects take a hundred milliseconds; a step over all rows costs some thirty array
operations.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kg.history.storage.row_codec import (
    ADDED,
    DIFFERENCE,
    HUNDREDTHS,
    INTEGER,
    REMOVED,
    REPLACED,
    STRING,
    TIME,
    Coded,
    decode_delta,
)

Ints = NDArray[np.int64]

NOTHING = -1  # as a kind: there is no such side
_FEW = 24  # rows; as many and fewer are quicker taken one by one
_LONGEST = 9  # bytes of a number that 63 bits hold


class ChangeColumns(NamedTuple):
    """Changes of single facts, in columns of one length, in no order.

    A side that is not there has the kind `NOTHING`; values of text are places in `texts`.
    """

    row: Ints
    predicate: Ints
    old_kind: Ints
    old: Ints
    new_kind: Ints
    new: Ints


class TextColumns:
    """Texts by number: equal numbers are equal texts."""

    def __init__(self) -> None:
        self.all: list[str] = []  # by number
        self._numbers: dict[str, int] = {}

    def number(self, text: str) -> int:
        """The number of a text, given out where it has none."""
        number = self._numbers.setdefault(text, len(self.all))
        if number == len(self.all):
            self.all.append(text)
        return number


class _Bytes:
    """The bytes of all rows, and the number that begins at each of them."""

    def __init__(self, rows: Sequence[bytes]) -> None:
        self.text = b"".join(rows)
        self.bytes = np.frombuffer(self.text, np.uint8)
        lengths = np.fromiter(map(len, rows), np.int64, len(rows))
        self.ends: Ints = np.cumsum(lengths)
        self.starts: Ints = self.ends - lengths
        self.number, self.after = _numbers(self.bytes)
        # what does not fit, or is text of that form, is left to the decoder of single rows
        long = np.flatnonzero(self.after - np.arange(len(self.bytes)) > _LONGEST)
        self.odd = np.zeros(len(rows), bool)
        self.odd[np.searchsorted(self.ends, long, side="right")] = True

    def signed(self, at: Ints) -> Ints:
        """The signed numbers that begin at these bytes."""
        number = self.number[at]
        half = (number >> 1) + (number & 1)
        return np.where(number & 1, -half, number >> 1)


def decode_rows(rows: Sequence[bytes], texts: TextColumns) -> ChangeColumns:
    """The changes of all rows; their texts are added to `texts`."""
    data = _Bytes(rows)
    found = [*_steps(data, texts)]
    columns = [np.concatenate(some) for some in zip(*found, strict=True)]
    return (
        ChangeColumns(*columns)
        if columns
        else ChangeColumns(*(np.zeros(0, np.int64) for _ in range(6)))
    )


def _steps(data: _Bytes, texts: TextColumns) -> Iterator[ChangeColumns]:
    rows = np.flatnonzero(~data.odd)
    at = data.starts[rows]
    while len(rows) > _FEW:
        left = at < data.ends[rows]
        rows, at = rows[left], at[left]
        if len(rows) <= _FEW:
            break
        changes, at = _step(data, rows, at, texts)
        yield changes
    odd = np.flatnonzero(data.odd)
    rest, places = np.append(rows, odd), np.append(at, data.starts[odd])
    yield _one_by_one(data, zip(rest.tolist(), places.tolist(), strict=True), texts)


def _step(data: _Bytes, rows: Ints, at: Ints, texts: TextColumns) -> tuple[ChangeColumns, Ints]:
    """The change that begins at `at` in each of the rows, and where it ends."""
    head = data.number[at]
    change, predicate = head & 3, head >> 2
    kind, value, at = _values(data, data.after[at], texts)
    old_kind, old = np.where(change == ADDED, NOTHING, kind), value
    new_kind, new = np.where(change == REMOVED, NOTHING, kind), value.copy()
    some = np.flatnonzero(change == REPLACED)
    if len(some):
        new_kind[some], new[some], at[some] = _values(data, at[some], texts)
    some = np.flatnonzero((change == DIFFERENCE) & (kind < STRING))
    if len(some):
        new[some] += data.signed(at[some])
        at[some] = data.after[at[some]]
    some = np.flatnonzero((change == DIFFERENCE) & (kind >= STRING))
    if len(some):
        new[some], at[some] = _other_endings(data, at[some], old[some], texts)
    return ChangeColumns(rows, predicate, old_kind, old, new_kind, new), at


def _values(data: _Bytes, at: Ints, texts: TextColumns) -> tuple[Ints, Ints, Ints]:
    """Kind and value at each byte, and where they end."""
    kind, at = data.bytes[at].astype(np.int64), at + 1
    numeric = (kind == INTEGER) | (kind == HUNDREDTHS) | (kind == TIME)
    value, after = np.where(numeric, data.signed(at), data.number[at]), data.after[at]
    some = np.flatnonzero(kind >= STRING)
    if len(some):
        value[some], after[some] = _texts(data, at[some], texts)
    return kind, value, after


def _texts(data: _Bytes, at: Ints, texts: TextColumns) -> tuple[list[int], Ints]:
    starts = data.after[at]
    ends = starts + data.number[at]
    spans = zip(starts.tolist(), ends.tolist(), strict=True)
    return [texts.number(data.text[start:end].decode()) for start, end in spans], ends


def _other_endings(data: _Bytes, at: Ints, old: Ints, texts: TextColumns) -> tuple[list[int], Ints]:
    """Texts that share their beginning with the `old` ones."""
    tails = TextColumns()
    endings, ends = _texts(data, data.after[at], tails)
    each = zip(old.tolist(), data.number[at].tolist(), endings, strict=True)
    whole = (texts.all[one][:shared] + tails.all[ending] for one, shared, ending in each)
    return [texts.number(text) for text in whole], ends


def _one_by_one(data: _Bytes, rest: Iterable[tuple[int, int]], texts: TextColumns) -> ChangeColumns:
    found: list[tuple[int, ...]] = []
    for row, at in rest:
        delta = decode_delta(data.text[at : data.ends[row]])
        found += ((row, c.predicate, *_side(c, texts), NOTHING, 0) for c in delta.removed)
        found += ((row, c.predicate, NOTHING, 0, *_side(c, texts)) for c in delta.added)
    return ChangeColumns(*np.array(found, np.int64).reshape(-1, 6).T)


def _side(coded: Coded, texts: TextColumns) -> tuple[int, int]:
    value = coded.value
    return coded.kind, texts.number(value) if isinstance(value, str) else value


def _numbers(data: NDArray[np.uint8]) -> tuple[Ints, Ints]:
    """For each byte: the number that begins there, if one does, and the byte after it."""
    last = data < 128
    stops = np.append(np.flatnonzero(last), len(data) - 1)
    stop = stops[np.cumsum(last) - last]
    number = (data & 127).astype(np.int64)
    more = np.flatnonzero(~last[:-1])
    for byte in range(1, _LONGEST):
        if not len(more):
            break
        number[more] |= (data[more + byte] & 127).astype(np.int64) << (7 * byte)
        more = more[stop[more] > more + byte]
    return number, stop + 1

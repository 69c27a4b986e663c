"""The changes of one subject as a few dozen bytes, and back.

A change set is cut into one row a subject: for each predicate what went and what came. Both sides
are kept, so that a row can be read without the rows before it and applied in either direction. A
value that gave way to another of its kind is kept with the difference alone: a position that moved
by a centimetre costs five bytes.
"""

from __future__ import annotations

from collections.abc import Iterable
from datetime import UTC, datetime
from functools import lru_cache
from typing import NamedTuple

from pyoxigraph import Literal, NamedNode, RdfFormat, parse

from kg import vocabulary as v

Term = object  # NamedNode, BlankNode, Literal or Triple of pyoxigraph

# how a value is kept
INTERNED, INTEGER, HUNDREDTHS, TIME, STRING, OTHER = range(6)
_NUMERIC = (INTEGER, HUNDREDTHS, TIME)
# what became of it
ADDED, REMOVED, REPLACED, DIFFERENCE = range(4)

_XSD_INTEGER, _XSD_STRING, _XSD_TIME = v.XSD + "integer", v.XSD + "string", v.XSD + "dateTime"
_TIME_NODE = NamedNode(_XSD_TIME)
_LARGEST = 1 << 62


class Coded(NamedTuple):
    """A predicate and an object of some subject; two are equal where the facts are."""

    predicate: int  # interned
    kind: int  # INTERNED ... OTHER
    value: int | str  # interned term, number, hundredths, seconds since 1970, or text


class Delta(NamedTuple):
    """What one transaction changed about one subject."""

    removed: list[Coded]
    added: list[Coded]


@lru_cache(maxsize=8192)
def code_literal(term: Term) -> tuple[int, int | str]:
    """Kind and value of anything but an IRI or a blank node; exact, to the lexical form."""
    if not isinstance(term, Literal) or term.language is not None:
        return OTHER, str(term)
    text, datatype = term.value, term.datatype.value
    if datatype == _XSD_STRING:
        return STRING, text
    try:
        kind, number = _code_number(text, datatype)
    except (ValueError, OverflowError):
        return OTHER, str(term)
    if abs(number) < _LARGEST and decode_literal(kind, number) == term:
        return kind, number
    return OTHER, str(term)


def _code_number(text: str, datatype: str) -> tuple[int, int]:
    if datatype == v.XSD_DOUBLE:
        return HUNDREDTHS, round(float(text) * 100)
    if datatype == _XSD_INTEGER:
        return INTEGER, int(text)
    if datatype == _XSD_TIME and len(text) == 20 and text[-1] == "Z":
        return TIME, int(datetime.fromisoformat(text).timestamp())
    raise ValueError(datatype)


@lru_cache(maxsize=8192)
def decode_literal(kind: int, value: int | str) -> Term:
    """The term that `code_literal` made `kind` and `value` of."""
    if kind == HUNDREDTHS:
        return Literal(int(value) / 100)
    if kind == INTEGER:
        return Literal(int(value))
    if kind == TIME:
        text = datetime.fromtimestamp(int(value), UTC).isoformat()[:19] + "Z"
        return Literal(text, datatype=_TIME_NODE)
    if kind == STRING:
        return Literal(str(value))
    (quad,) = parse(f"<s:s> <s:p> {value} .".encode(), format=RdfFormat.N_TRIPLES)
    return quad.object


def encode_delta(removed: Iterable[Coded], added: Iterable[Coded]) -> bytes:
    """One row: what a transaction changed about one subject."""
    unmatched: dict[int, list[Coded]] = {}
    for coded in removed:
        unmatched.setdefault(coded[0], []).append(coded)
    out = bytearray()
    for coded in added:
        before = unmatched.pop(coded[0], None)
        if before is None:
            _put(out, coded[0] << 2 | ADDED)
            _put_value(out, coded)
            continue
        old = before.pop()
        if before:
            unmatched[coded[0]] = before
        if old[1] == coded[1] and old[1] != INTERNED:
            _put(out, coded[0] << 2 | DIFFERENCE)
            _put_value(out, old)
            _put_difference(out, old, coded)
        else:
            _put(out, coded[0] << 2 | REPLACED)
            _put_value(out, old)
            _put_value(out, coded)
    for rest in unmatched.values():
        for coded in rest:
            _put(out, coded[0] << 2 | REMOVED)
            _put_value(out, coded)
    return bytes(out)


def decode_delta(data: bytes) -> Delta:
    """What `encode_delta` was given; the order within is not kept."""
    removed: list[Coded] = []
    added: list[Coded] = []
    at = 0
    while at < len(data):
        head, at = _take(data, at)
        predicate, change = head >> 2, head & 3
        coded, at = _take_value(data, at, predicate)
        if change == ADDED:
            added.append(coded)
            continue
        removed.append(coded)
        if change == REPLACED:
            coded, at = _take_value(data, at, predicate)
            added.append(coded)
        elif change == DIFFERENCE:
            coded, at = _take_difference(data, at, coded)
            added.append(coded)
    return Delta(removed, added)


def encode_numbers(numbers: Iterable[int]) -> bytes:
    """Numbers from 0 on, smallest first, as the steps between them."""
    out, last = bytearray(), 0
    for number in sorted(numbers):
        _put(out, number - last)
        last = number
    return bytes(out)


def decode_numbers(data: bytes) -> list[int]:
    """What `encode_numbers` was given, sorted."""
    numbers, at, last = [], 0, 0
    while at < len(data):
        step, at = _take(data, at)
        last += step
        numbers.append(last)
    return numbers


def _put(out: bytearray, number: int) -> None:
    while number > 127:
        out.append(number & 127 | 128)
        number >>= 7
    out.append(number)


def _take(data: bytes, at: int) -> tuple[int, int]:
    byte = data[at]
    at += 1
    if byte < 128:
        return byte, at
    number, shift = byte & 127, 7
    while True:
        byte = data[at]
        at += 1
        number |= (byte & 127) << shift
        if byte < 128:
            return number, at
        shift += 7


def _put_signed(out: bytearray, number: int) -> None:
    _put(out, number << 1 if number >= 0 else (-number << 1) - 1)


def _take_signed(data: bytes, at: int) -> tuple[int, int]:
    number, at = _take(data, at)
    return -((number + 1) >> 1) if number & 1 else number >> 1, at


def _put_text(out: bytearray, text: str) -> None:
    data = text.encode()
    _put(out, len(data))
    out += data


def _take_text(data: bytes, at: int) -> tuple[str, int]:
    length, at = _take(data, at)
    return data[at : at + length].decode(), at + length


def _put_value(out: bytearray, coded: Coded) -> None:
    _, kind, value = coded
    out.append(kind)
    if isinstance(value, str):
        _put_text(out, value)
    elif kind == INTERNED:
        _put(out, value)
    else:
        _put_signed(out, value)


def _take_value(data: bytes, at: int, predicate: int) -> tuple[Coded, int]:
    kind = data[at]
    value: int | str
    if kind in _NUMERIC:
        value, at = _take_signed(data, at + 1)
    elif kind == INTERNED:
        value, at = _take(data, at + 1)
    else:
        value, at = _take_text(data, at + 1)
    return Coded(predicate, kind, value), at


def _put_difference(out: bytearray, old: Coded, new: Coded) -> None:
    if isinstance(old.value, int) and isinstance(new.value, int):
        _put_signed(out, new.value - old.value)
        return
    shared = _shared(str(old.value), str(new.value))
    _put(out, shared)
    _put_text(out, str(new.value)[shared:])


def _shared(one: str, other: str) -> int:
    for at, (a, b) in enumerate(zip(one, other, strict=False)):
        if a != b:
            return at
    return min(len(one), len(other))


def _take_difference(data: bytes, at: int, old: Coded) -> tuple[Coded, int]:
    if isinstance(old.value, int):
        difference, at = _take_signed(data, at)
        return old._replace(value=old.value + difference), at
    shared, at = _take(data, at)
    rest, at = _take_text(data, at)
    return old._replace(value=old.value[:shared] + rest), at

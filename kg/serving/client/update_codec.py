"""JSON encoding of `MapUpdate`, the records that a mapper or a robot writes, in both directions.

The encoding follows from the types of the fields: a record is an object with a member for each
field, a tuple or an array is a list. Numbers are exact; floor cells are in the encoding of
here:floorCells. Decoding validates each member.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, is_dataclass
from enum import StrEnum
from functools import cache
from types import UnionType
from typing import Any, Final, Literal, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import NDArray

from kg.maps.facts.assertions import is_unicode
from kg.maps.facts.occupancy import decoded, decoded_times, encoded, encoded_times
from kg.model.errors import InvalidFactError
from kg.model.records import MapUpdate

MAX_WHOLE: Final = 1 << 53  # whole numbers up to it are exact in JSON
#: shapes of the arrays of float64, by the name of the field
_SHAPES: Final = {"p_map": (3,), "extent": (3,), "T_map_world": (4, 4)}


@dataclass(frozen=True, slots=True)
class _Codec:
    """Encoder and decoder of one type; the decoder raises InvalidFactError."""

    encode: Callable[[Any], Any]
    decode: Callable[[Any, str], Any]


def update_to_json(update: MapUpdate) -> dict[str, Any]:
    """The update as JSON values."""
    encoded_update: dict[str, Any] = codec_of(MapUpdate).encode(update)
    return encoded_update


def update_from_json(data: Any) -> MapUpdate:
    """The inverse of `update_to_json`; raises InvalidFactError for invalid data."""
    update: MapUpdate = codec_of(MapUpdate).decode(data, "update")
    return update


@cache
def codec_of(kind: Any, field: str = "") -> _Codec:
    """The codec of a type; `field` is the name of the field that has it.

    The type is that of a field of a record: a plain one, a dataclass, an enumeration of texts, or a
    mapping, tuple or optional one of these.
    """
    origin, args = get_origin(kind), get_args(kind)
    if kind in _PLAIN:
        return _PLAIN[kind]
    if kind == NDArray[np.float64]:
        return _array(_SHAPES[field])
    if isinstance(kind, type) and is_dataclass(kind):
        hints = get_type_hints(kind).items()
        return _record(kind, {name: codec_of(hint, name) for name, hint in hints})
    if isinstance(kind, type) and issubclass(kind, StrEnum):
        return _choice(tuple(kind), kind)
    if origin is Literal:
        return _choice(args)
    if origin is Mapping:
        return _mapping(*map(codec_of, args))
    if origin is UnionType:
        return _optional(codec_of(args[0], field))
    assert origin is tuple, f"no codec for {kind}"
    if args[-1] is Ellipsis:
        return _list(codec_of(args[0]))
    return _row(codec_of(args[0]), len(args), "numbers" if args[0] is float else "texts")


def _wrong(what: str, wanted: str, data: object) -> InvalidFactError:
    return InvalidFactError(f"{what} must be {wanted}, got {str(data)[:100]!r}")


def _number(data: Any, what: str) -> float:
    if isinstance(data, bool) or not isinstance(data, int | float):
        raise _wrong(what, "a number", data)
    try:
        return float(data)
    except OverflowError:
        raise _wrong(what, "a number that fits a double", data) from None


def _whole(data: Any, what: str) -> int:
    if isinstance(data, bool) or not isinstance(data, int) or abs(data) > MAX_WHOLE:
        raise _wrong(what, "a whole number", data)
    return data


def _text(data: Any, what: str) -> str:
    if not isinstance(data, str):
        raise _wrong(what, "a text", data)
    if not is_unicode(data):
        raise _wrong(what, "Unicode", data)
    return data


def _yes_no(data: Any, what: str) -> bool:
    if not isinstance(data, bool):
        raise _wrong(what, "true or false", data)
    return data


def _cells(data: Any, what: str) -> np.ndarray:
    cells = decoded(_text(data, what))
    if cells is None:
        raise _wrong(what, "cells in the encoding of here:floorCells", data)
    return cells


def _view_times(data: Any, what: str) -> np.ndarray:
    times = decoded_times(_text(data, what))
    if times is None:
        raise _wrong(what, "times in the encoding of here:viewTimes", data)
    return times


_PLAIN: Final[dict[Any, _Codec]] = {
    float: _Codec(float, _number),
    int: _Codec(int, _whole),
    str: _Codec(str, _text),
    bool: _Codec(bool, _yes_no),
    NDArray[np.uint8]: _Codec(encoded, _cells),
    NDArray[np.uint32]: _Codec(encoded_times, _view_times),
}


def _choice(options: tuple[str, ...], kind: type[str] = str) -> _Codec:
    def decode(data: Any, what: str) -> str:
        if data not in options:
            raise _wrong(what, " or ".join(options), data)
        return kind(data)

    return _Codec(str, decode)


def _mapping(keys: _Codec, values: _Codec) -> _Codec:
    def decode(data: Any, what: str) -> dict[Any, Any]:
        if not isinstance(data, dict):
            raise _wrong(what, "an object", data)
        return {
            keys.decode(name, what): values.decode(value, f"{what}: {name}")
            for name, value in data.items()
        }

    return _Codec(
        lambda held: {keys.encode(name): values.encode(value) for name, value in held.items()},
        decode,
    )


def _optional(codec: _Codec) -> _Codec:
    return _Codec(
        lambda value: None if value is None else codec.encode(value),
        lambda data, what: None if data is None else codec.decode(data, what),
    )


def _list(codec: _Codec) -> _Codec:
    def decode(data: Any, what: str) -> tuple[Any, ...]:
        if not isinstance(data, list):
            raise _wrong(what, "a list", data)
        return tuple(codec.decode(item, f"{what}[{n}]") for n, item in enumerate(data))

    return _Codec(lambda value: [codec.encode(item) for item in value], decode)


def _row(codec: _Codec, count: int, items: str) -> _Codec:
    def decode(data: Any, what: str) -> tuple[Any, ...]:
        if not isinstance(data, list) or len(data) != count:
            raise _wrong(what, f"a list of {count} {items}", data)
        return tuple(codec.decode(item, what) for item in data)

    return _Codec(lambda value: [codec.encode(item) for item in value], decode)


def _array(shape: tuple[int, ...]) -> _Codec:
    flat = _row(_PLAIN[float], int(np.prod(shape)), "numbers")
    return _Codec(
        lambda value: np.asarray(value, np.float64).ravel().tolist(),
        lambda data, what: np.array(flat.decode(data, what)).reshape(shape),
    )


def _record(kind: Callable[..., Any], fields: Mapping[str, _Codec]) -> _Codec:
    def decode(data: Any, what: str) -> Any:
        if not isinstance(data, dict) or data.keys() != fields.keys():
            raise _wrong(what, f"an object of {', '.join(fields)}", data)
        return kind(
            **{name: codec.decode(data[name], f"{what}.{name}") for name, codec in fields.items()}
        )

    def encode(value: Any) -> dict[str, Any]:
        return {name: codec.encode(getattr(value, name)) for name, codec in fields.items()}

    return _Codec(encode, decode)

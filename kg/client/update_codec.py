"""JSON encoding of `MapUpdate`, the records that a mapper or a robot writes, in both directions.

Each record is an object with a member for each of its fields. Numbers are exact; floor cells are in
the encoding of here:floorCells. Decoding validates every member.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final, Generic, TypeVar, get_args

import numpy as np

from kg.errors import InvalidFactError
from kg.facts.assertions import is_unicode
from kg.facts.occupancy import decoded, decoded_times, encoded, encoded_times
from kg.records import (
    DepartedRecord,
    DoorRecord,
    Evidence,
    FloorTile,
    LookRecord,
    MapUpdate,
    ObjectRecord,
    ObstacleRecord,
    PlaceRecord,
    PlaceViews,
    RecordingRecord,
    Relation,
    RelationKind,
    RobotRecord,
    SearchRecord,
    SearchState,
)

LARGEST: Final = 1 << 53  # whole numbers that JSON carries exactly

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class _Codec(Generic[T]):
    """Encoder and decoder of one kind of value; the decoder raises InvalidFactError."""

    encode: Callable[[Any], Any]
    decode: Callable[[Any, str], T]


def update_to_json(update: MapUpdate) -> dict[str, Any]:
    """The update as JSON values."""
    encoded_update: dict[str, Any] = _UPDATE.encode(update)
    return encoded_update


def update_from_json(data: Any) -> MapUpdate:
    """The inverse of `update_to_json`; raises InvalidFactError for invalid data."""
    return _UPDATE.decode(data, "update")


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
    if isinstance(data, bool) or not isinstance(data, int) or abs(data) > LARGEST:
        raise _wrong(what, "a whole number", data)
    return data


def _text(data: Any, what: str) -> str:
    if not isinstance(data, str):
        raise _wrong(what, "a text", data)
    if not is_unicode(data):
        raise _wrong(what, "Unicode", data)
    return data


def _state(data: Any, what: str) -> SearchState:
    for state in get_args(SearchState):
        if data == state:
            found: SearchState = state
            return found
    raise _wrong(what, " or ".join(get_args(SearchState)), data)


def _relation_kind(data: Any, what: str) -> RelationKind:
    for kind in get_args(RelationKind):
        if data == kind:
            found: RelationKind = kind
            return found
    raise _wrong(what, " or ".join(get_args(RelationKind)), data)


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


def _optional(codec: _Codec[T]) -> _Codec[T | None]:
    return _Codec(
        lambda value: None if value is None else codec.encode(value),
        lambda data, what: None if data is None else codec.decode(data, what),
    )


def _list(codec: _Codec[T]) -> _Codec[tuple[T, ...]]:
    def decode(data: Any, what: str) -> tuple[T, ...]:
        if not isinstance(data, list):
            raise _wrong(what, "a list", data)
        return tuple(codec.decode(item, f"{what}[{n}]") for n, item in enumerate(data))

    return _Codec(lambda value: [codec.encode(item) for item in value], decode)


def _yes_no(data: Any, what: str) -> bool:
    if not isinstance(data, bool):
        raise _wrong(what, "true or false", data)
    return data


def _pair(data: Any, what: str) -> tuple[str, ...]:
    if not isinstance(data, list) or len(data) != 2:
        raise _wrong(what, "a list of two texts", data)
    return tuple(_text(item, what) for item in data)


def _numbers(count: int) -> _Codec[Any]:
    def decode(data: Any, what: str) -> tuple[float, ...]:
        if not isinstance(data, list) or len(data) != count:
            raise _wrong(what, f"a list of {count} numbers", data)
        return tuple(_number(item, what) for item in data)

    return _Codec(lambda value: [float(number) for number in value], decode)


def _array(*shape: int) -> _Codec[np.ndarray]:
    flat = _numbers(int(np.prod(shape)))
    return _Codec(
        lambda value: flat.encode(np.asarray(value, np.float64).ravel()),
        lambda data, what: np.array(flat.decode(data, what)).reshape(shape),
    )


def _record(kind: Callable[..., T], fields: Mapping[str, _Codec[Any]]) -> _Codec[T]:
    def decode(data: Any, what: str) -> T:
        if not isinstance(data, dict) or data.keys() != fields.keys():
            raise _wrong(what, f"an object of {', '.join(fields)}", data)
        values = {
            name: codec.decode(data[name], f"{what}.{name}") for name, codec in fields.items()
        }
        return kind(**values)

    def encode(value: Any) -> dict[str, Any]:
        return {name: codec.encode(getattr(value, name)) for name, codec in fields.items()}

    return _Codec(encode, decode)


def _shares(data: Any, what: str) -> dict[str, float]:
    if not isinstance(data, dict):
        raise _wrong(what, "an object of numbers", data)
    return {_text(name, what): _number(share, f"{what}: {name}") for name, share in data.items()}


_NUMBER = _Codec(float, _number)
_WHOLE = _Codec(int, _whole)
_TEXT = _Codec(str, _text)
_TEXTS = _list(_TEXT)
_YES_NO = _Codec(bool, _yes_no)
_SHARES = _Codec(lambda held: {name: float(share) for name, share in held.items()}, _shares)

_EVIDENCE = _record(
    Evidence,
    {
        "frame": _TEXT,
        "recording": _TEXT,
        "stamp": _NUMBER,
        "box": _numbers(4),
        "score": _NUMBER,
        "model": _TEXT,
    },
)
_RELATION = _record(
    Relation,
    {"kind": _Codec(str, _relation_kind), "target": _TEXT, "probability": _NUMBER},
)
_OBJECT = _record(
    ObjectRecord,
    {
        "iri": _TEXT,
        "category": _TEXT,
        "p_map": _array(3),
        "confidence": _NUMBER,
        "existence": _NUMBER,
        "observations": _WHOLE,
        "first_seen": _NUMBER,
        "last_seen": _NUMBER,
        "place": _optional(_TEXT),
        "evidence": _optional(_EVIDENCE),
        "extent": _optional(_array(3)),
        "deviation": _optional(_NUMBER),
        "relations": _optional(_list(_RELATION)),
        "labels": _SHARES,
    },
)
_DEPARTED = _record(
    DepartedRecord,
    {
        "iri": _TEXT,
        "category": _TEXT,
        "p_map": _array(3),
        "peak": _NUMBER,
        "observations": _WHOLE,
        "first_seen": _NUMBER,
        "last_seen": _NUMBER,
        "found_gone": _NUMBER,
        "extent": _optional(_array(3)),
    },
)
_VIEWS = _record(PlaceViews, {"share": _NUMBER, "close_share": _NUMBER, "last": _NUMBER})
_PLACE = _record(
    PlaceRecord,
    {
        "iri": _TEXT,
        "label": _TEXT,
        "views": _WHOLE,
        "xmin": _NUMBER,
        "xmax": _NUMBER,
        "ymin": _NUMBER,
        "ymax": _NUMBER,
        "beliefs": _SHARES,
        "scene_beliefs": _SHARES,
        "told_by": _TEXTS,
        "outline": _list(_list(_numbers(2))),
        "viewed": _optional(_VIEWS),
        "from_floor": _YES_NO,
        "adjacent": _TEXTS,
    },
)
_DOOR = _record(
    DoorRecord,
    {
        "iri": _TEXT,
        "x": _NUMBER,
        "y": _NUMBER,
        "width": _NUMBER,
        "places": _Codec(list, _pair),
    },
)
_ROBOT = _record(RobotRecord, {"p_map": _array(3), "heading": _NUMBER, "stamp": _NUMBER})
_RECORDING = _record(
    RecordingRecord,
    {
        "name": _TEXT,
        "frames_applied": _WHOLE,
        "last_frame": _TEXT,
        "T_map_world": _array(4, 4),
        "scene_model": _TEXT,
    },
)
_SEARCH = _record(
    SearchRecord,
    {
        "iri": _TEXT,
        "words": _TEXTS,
        "categories": _TEXTS,
        "state": _Codec(str, _state),
        "started": _NUMBER,
        "ended": _optional(_NUMBER),
        "seconds": _NUMBER,
        "left": _NUMBER,
        "found": _TEXTS,
    },
)
_LOOK = _record(
    LookRecord,
    {
        "iri": _TEXT,
        "search": _TEXT,
        "number": _WHOLE,
        "stamp": _NUMBER,
        "position": _numbers(2),
        "heading": _NUMBER,
        "extent": _NUMBER,
        "categories": _TEXTS,
        "found": _TEXTS,
        "glimpses": _list(_numbers(3)),
    },
)
_OBSTACLE = _record(
    ObstacleRecord,
    {
        "iri": _TEXT,
        "search": _TEXT,
        "number": _WHOLE,
        "stamp": _NUMBER,
        "position": _numbers(2),
        "reason": _TEXT,
    },
)
_TILE = _record(
    FloorTile,
    {
        "storey": _WHOLE,
        "column": _WHOLE,
        "row": _WHOLE,
        "height": _NUMBER,
        "resolution": _NUMBER,
        "cells": _Codec(encoded, _cells),
        "changed": _NUMBER,
        "viewed": _optional(_Codec(encoded_times, _view_times)),
    },
)
_UPDATE: Final = _record(
    MapUpdate,
    {
        "objects": _list(_OBJECT),
        "removed": _TEXTS,
        "places": _list(_PLACE),
        "doors": _list(_DOOR),
        "robot": _optional(_ROBOT),
        "recording": _optional(_RECORDING),
        "search": _optional(_SEARCH),
        "looks": _list(_LOOK),
        "obstacles": _list(_OBSTACLE),
        "floor": _list(_TILE),
        "departed": _list(_DEPARTED),
    },
)

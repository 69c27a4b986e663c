"""What a mapper or a robot saw (`MapUpdate`) as JSON, there and back.

Each record is an object with a member for each of its fields. Numbers are exact; cells of the floor
are as here:floorCells has them. What comes from outside is checked member by member.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final, Generic, TypeVar, get_args

import numpy as np

from kg.assertions import is_unicode
from kg.errors import InvalidFactError
from kg.floor import decoded, encoded
from kg.records import (
    Evidence,
    FloorTile,
    LookRecord,
    MapUpdate,
    ObjectRecord,
    ObstacleRecord,
    PlaceRecord,
    RecordingRecord,
    RobotRecord,
    SearchRecord,
    SearchState,
)

LARGEST: Final = 1 << 53  # whole numbers that JSON carries exactly

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class _Form(Generic[T]):
    """How a value is told, and read; what is read wrongly raises InvalidFactError."""

    told: Callable[[Any], Any]
    read: Callable[[Any, str], T]


def update_to_json(update: MapUpdate) -> dict[str, Any]:
    """All of an update."""
    told: dict[str, Any] = _UPDATE.told(update)
    return told


def update_of(told: Any) -> MapUpdate:
    """What `update_to_json` was given; InvalidFactError, in one line, for what is no such thing."""
    return _UPDATE.read(told, "update")


def _wrong(what: str, wanted: str, told: object) -> InvalidFactError:
    return InvalidFactError(f"{what} must be {wanted}, got {str(told)[:100]!r}")


def _number(told: Any, what: str) -> float:
    if isinstance(told, bool) or not isinstance(told, int | float):
        raise _wrong(what, "a number", told)
    try:
        return float(told)
    except OverflowError:
        raise _wrong(what, "a number that fits a double", told) from None


def _whole(told: Any, what: str) -> int:
    if isinstance(told, bool) or not isinstance(told, int) or abs(told) > LARGEST:
        raise _wrong(what, "a whole number", told)
    return told


def _text(told: Any, what: str) -> str:
    if not isinstance(told, str):
        raise _wrong(what, "a text", told)
    if not is_unicode(told):
        raise _wrong(what, "Unicode", told)
    return told


def _state(told: Any, what: str) -> SearchState:
    for state in get_args(SearchState):
        if told == state:
            found: SearchState = state
            return found
    raise _wrong(what, " or ".join(get_args(SearchState)), told)


def _cells(told: Any, what: str) -> np.ndarray:
    cells = decoded(_text(told, what))
    if cells is None:
        raise _wrong(what, "cells as here:floorCells has them", told)
    return cells


def _optional(form: _Form[T]) -> _Form[T | None]:
    return _Form(
        lambda value: None if value is None else form.told(value),
        lambda told, what: None if told is None else form.read(told, what),
    )


def _list(form: _Form[T]) -> _Form[tuple[T, ...]]:
    def read(told: Any, what: str) -> tuple[T, ...]:
        if not isinstance(told, list):
            raise _wrong(what, "a list", told)
        return tuple(form.read(item, f"{what}[{n}]") for n, item in enumerate(told))

    return _Form(lambda value: [form.told(item) for item in value], read)


def _numbers(count: int) -> _Form[Any]:
    def read(told: Any, what: str) -> tuple[float, ...]:
        if not isinstance(told, list) or len(told) != count:
            raise _wrong(what, f"a list of {count} numbers", told)
        return tuple(_number(item, what) for item in told)

    return _Form(lambda value: [float(number) for number in value], read)


def _array(*shape: int) -> _Form[np.ndarray]:
    flat = _numbers(int(np.prod(shape)))
    return _Form(
        lambda value: flat.told(np.asarray(value, np.float64).ravel()),
        lambda told, what: np.array(flat.read(told, what)).reshape(shape),
    )


def _record(kind: Callable[..., T], fields: Mapping[str, _Form[Any]]) -> _Form[T]:
    def read(told: Any, what: str) -> T:
        if not isinstance(told, dict) or told.keys() != fields.keys():
            raise _wrong(what, f"an object of {', '.join(fields)}", told)
        values = {name: form.read(told[name], f"{what}.{name}") for name, form in fields.items()}
        return kind(**values)

    def tell(value: Any) -> dict[str, Any]:
        return {name: form.told(getattr(value, name)) for name, form in fields.items()}

    return _Form(tell, read)


def _shares(told: Any, what: str) -> dict[str, float]:
    if not isinstance(told, dict):
        raise _wrong(what, "an object of numbers", told)
    return {_text(name, what): _number(share, f"{what}: {name}") for name, share in told.items()}


_NUMBER = _Form(float, _number)
_WHOLE = _Form(int, _whole)
_TEXT = _Form(str, _text)
_TEXTS = _list(_TEXT)
_SHARES = _Form(lambda held: {name: float(share) for name, share in held.items()}, _shares)

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
    },
)
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
        "state": _Form(str, _state),
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
        "cells": _Form(encoded, _cells),
        "changed": _NUMBER,
    },
)
_UPDATE: Final = _record(
    MapUpdate,
    {
        "objects": _list(_OBJECT),
        "removed": _TEXTS,
        "places": _list(_PLACE),
        "robot": _optional(_ROBOT),
        "recording": _optional(_RECORDING),
        "search": _optional(_SEARCH),
        "looks": _list(_LOOK),
        "obstacles": _list(_OBSTACLE),
        "floor": _list(_TILE),
    },
)

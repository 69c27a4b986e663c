"""Where the places are: rectangles given by file (thesis section 3.3.2, Fig. 3.11).

JSON is a list of {"xmin", "xmax", "ymin", "ymax"} [m] with optional "id" (the place's number),
"label" (or "name") and "category"; the lists the thesis author's robot saved have this shape too
(their beliefs are not read here). CSV has the same names as columns. Rectangles may overlap: the
one listed first holds a point that lies in several.
"""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from kg.errors import LayoutError

SIDES: Final = ("xmin", "xmax", "ymin", "ymax")


@dataclass(frozen=True, slots=True)
class Rectangle:
    """One place. Raises LayoutError where it is inverted, empty or not finite."""

    number: int  # N of <base>place/N
    label: str
    xmin: float  # [m] map frame
    xmax: float
    ymin: float
    ymax: float
    category: str | None = None  # label of its category, where the file says it

    def __post_init__(self) -> None:
        if not all(math.isfinite(getattr(self, side)) for side in SIDES):
            raise LayoutError(f"{self.label} has a side that is not finite; metres would work")
        for low, high in (("xmin", "xmax"), ("ymin", "ymax")):
            if not getattr(self, low) < getattr(self, high):
                raise LayoutError(
                    f"{self.label} has {low} {getattr(self, low):g} and {high} "
                    f"{getattr(self, high):g}; {low} below {high} would work"
                )


@dataclass(frozen=True, slots=True)
class Layout:
    """The places of a building. Raises LayoutError where two share a number, or none are given."""

    rectangles: tuple[Rectangle, ...]

    def __post_init__(self) -> None:
        if not self.rectangles:
            raise LayoutError("a layout without places; at least one rectangle would work")
        numbers = [rectangle.number for rectangle in self.rectangles]
        twice = {number for number in numbers if numbers.count(number) > 1}
        if twice:
            raise LayoutError(f"two places share the id {min(twice)}; one id each would work")


def load_layout(path: Path) -> Layout:
    """Read a layout from JSON or, by the suffix .csv, from CSV.

    Raises LayoutError, naming the file and the entry, where it does not make sense.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")
        entries: Any = _csv(text) if path.suffix.lower() == ".csv" else json.loads(text)
    except (OSError, UnicodeDecodeError, ValueError, csv.Error) as error:
        raise LayoutError(f"cannot read places from {path}: {error}") from error
    if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
        raise LayoutError(f"{path} is no list of places; [{{xmin, xmax, ymin, ymax}}] would work")
    try:
        return Layout(tuple(_rectangle(entry, n) for n, entry in enumerate(entries, start=1)))
    except LayoutError as error:
        raise LayoutError(f"{path}: {error}") from error


def _csv(text: str) -> Sequence[Mapping[str, Any]]:
    return list(csv.DictReader(text.splitlines(), skipinitialspace=True))


def _rectangle(entry: Mapping[str, Any], position: int) -> Rectangle:
    number = _number(entry, position)
    label = entry.get("label") or entry.get("name") or f"place {number}"
    category = entry.get("category") or None
    return Rectangle(
        number=number,
        label=str(label),
        category=None if category is None else str(category),
        **{side: _side(entry, side, position) for side in SIDES},
    )


def _number(entry: Mapping[str, Any], position: int) -> int:
    given = entry.get("id")
    if given is None or given == "":
        return position
    try:
        number = int(given)
    except (TypeError, ValueError, OverflowError):
        number = -1
    if number < 0 or (isinstance(given, float) and number != given):
        raise LayoutError(f"place {position} has the id {given!r}; a whole number would work")
    return number


def _side(entry: Mapping[str, Any], side: str, position: int) -> float:
    if side not in entry:
        raise LayoutError(f"place {position} has no {side}; all of {', '.join(SIDES)} would work")
    value = entry[side]
    try:
        if isinstance(value, bool):
            raise TypeError
        return float(value)
    except (TypeError, ValueError, OverflowError):
        raise LayoutError(
            f"place {position} has {side} {value!r}; a number of metres would work"
        ) from None

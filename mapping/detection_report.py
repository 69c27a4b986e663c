"""Detection report: fates of detections by category, and the things that are not believed."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from enum import StrEnum
from typing import Any, Final

BELIEVED: Final = 0.5  # existence from which on queries show an object
VERSION: Final = 1
MAX_THINGS: Final = 200  # in one report
MAX_CATEGORIES: Final = 500
MAX_OBJECTS: Final = 20  # of one category whose detections are told apart
_MAX_NAME: Final = 1000  # characters of a name


class Fate(StrEnum):
    """Fate of a detection: its use, or why it has none."""

    WEAK = "too weak"
    UNKNOWN = "unknown label"
    IGNORED = "ignored label"
    NO_DEPTH = "no depth"
    NEAR = "too near"
    FAR = "too far"
    DOUBLE = "second box"  # of a thing that the frame shows already
    CUT = "cut off"  # by the border, beside a thing of its category
    CANDIDATE = "candidate"
    FORGOTTEN = "forgotten"  # of candidates that were dropped
    OBJECT = "object"
    LEFT = "former object"


@dataclass(frozen=True, slots=True)
class CategoryFates:
    """Detections of one category, or of a label that has none."""

    fates: Mapping[Fate, int]
    objects: Mapping[str, int] = field(default_factory=dict)  # IRI -> detections, the most first
    merged: int = 0  # things that turned out to be another one

    @property
    def detections(self) -> int:
        """All of them."""
        return sum(self.fates.values())


@dataclass(frozen=True, slots=True)
class DoubtedThing:
    """A candidate, or an object of the map that exists with less than 0.5."""

    category: str  # label
    existence: float
    seen: int  # times
    iri: str = ""  # of an object; "" for a candidate
    one_side: bool = False  # whether it was seen from one side only
    forgotten: bool = False  # whether it is a candidate that was dropped; `existence` is its peak
    p_map: tuple[float, float, float] = (0.0, 0.0, 0.0)  # [m]
    frame: str = ""  # of its best view, which the following describe
    recording: str = ""
    box: tuple[float, float, float, float] | None = None  # xyxy [px]
    score: float = 0.0  # of the detector


@dataclass(frozen=True, slots=True)
class DetectionReport:
    """Fates of the detections in `frames` frames."""

    frames: int
    categories: Mapping[str, CategoryFates]
    things: tuple[DoubtedThing, ...] = ()  # not believed: the most probable first
    doubted: int = 0  # things that are not believed; without forgotten ones
    least_score: float = 0.0  # detections below are too weak
    nearest: float = 0.0  # [m] that a thing may be, and ...
    farthest: float = 0.0

    def to_json(self) -> dict[str, Any]:
        """Plain values; as many as one report may have."""
        return {
            "version": VERSION,
            "frames": self.frames,
            "least_score": self.least_score,
            "nearest": self.nearest,
            "farthest": self.farthest,
            "categories": {
                name: {
                    "fates": {fate.value: n for fate, n in of.fates.items() if n},
                    "objects": dict(list(of.objects.items())[:MAX_OBJECTS]),
                    "merged": of.merged,
                }
                for name, of in list(self.categories.items())[:MAX_CATEGORIES]
            },
            "doubted": self.doubted,
            "things": [thing_json(thing) for thing in self.things[:MAX_THINGS]],
        }


def thing_json(thing: DoubtedThing) -> dict[str, Any]:
    """Plain values of a thing; lengths to 1 mm."""
    values = asdict(thing)
    for name, digits in (("existence", 4), ("score", 4)):
        values[name] = round(values[name], digits)
    values["p_map"] = [round(x, 3) for x in thing.p_map]
    values["box"] = None if thing.box is None else [round(x, 1) for x in thing.box]
    return values


def report_from_json(value: object) -> DetectionReport:
    """The report that `to_json` gave; raises ValueError, KeyError or TypeError for all else."""
    record = _record(value)
    if record["version"] != VERSION:
        raise ValueError(f"it has the version {record['version']!r:.20}, not {VERSION}")
    things = _listed(record["things"], MAX_THINGS)
    return DetectionReport(
        frames=_count(record["frames"]),
        categories={
            _text(name): _category(of)
            for name, of in _record(record["categories"], MAX_CATEGORIES).items()
        },
        things=tuple(_thing(one) for one in things),
        doubted=_count(record["doubted"]),
        least_score=_number(record["least_score"]),
        nearest=_number(record["nearest"]),
        farthest=_number(record["farthest"]),
    )


def _category(value: object) -> CategoryFates:
    record = _record(value)
    return CategoryFates(
        fates={Fate(name): _count(n) for name, n in _record(record["fates"]).items()},
        objects={
            _text(iri): _count(n) for iri, n in _record(record["objects"], MAX_OBJECTS).items()
        },
        merged=_count(record["merged"]),
    )


def _thing(value: object) -> DoubtedThing:
    record = _record(value)
    box = None if record["box"] is None else _numbers(record["box"], 4)
    x, y, z = _numbers(record["p_map"], 3)
    return DoubtedThing(
        category=_text(record["category"]),
        existence=_number(record["existence"]),
        seen=_count(record["seen"]),
        iri=_text(record["iri"]),
        one_side=record["one_side"] is True,
        forgotten=record["forgotten"] is True,
        p_map=(x, y, z),
        frame=_text(record["frame"]),
        recording=_text(record["recording"]),
        box=None if box is None else (box[0], box[1], box[2], box[3]),
        score=_number(record["score"]),
    )


def _record(value: object, most: int = 100) -> dict[str, Any]:
    if not isinstance(value, dict) or len(value) > most:
        raise ValueError("it has another form")
    return value


def _listed(value: object, most: int) -> Sequence[object]:
    if not isinstance(value, list) or len(value) > most:
        raise ValueError("it has another form")
    return value


def _text(value: object) -> str:
    if not isinstance(value, str) or len(value) > _MAX_NAME:
        raise ValueError("a name in it is none")
    return value


def _count(value: object) -> int:
    if not isinstance(value, int) or isinstance(value, bool) or not 0 <= value < 10**15:
        raise ValueError("a count in it is none")
    return value


def _number(value: object) -> float:
    if not isinstance(value, int | float) or not math.isfinite(value) or abs(value) > 1e9:
        raise ValueError("a number in it is none")
    return float(value)


def _numbers(value: object, count: int) -> list[float]:
    numbers = [_number(one) for one in _listed(value, count)]
    if len(numbers) != count:
        raise ValueError("a position in it is none")
    return numbers

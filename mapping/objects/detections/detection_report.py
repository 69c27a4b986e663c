"""Detection report: fates of detections by category, and the things that are not believed.

The folder of a map keeps the report as `detections.json`.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import StrEnum
from pathlib import Path
from typing import Any, Final

from kg.model.errors import GraphError
from kg.model.regular_files import read_bytes

BELIEVED: Final = 0.5  # existence from which on queries show an object
VERSION: Final = 1
MAX_THINGS: Final = 200  # in one report
MAX_CATEGORIES: Final = 500
MAX_OBJECTS: Final = 20  # of one category whose detections are listed
FILE: Final = "detections.json"  # in the folder of a map
MAX_BYTES: Final = 2_000_000  # of that file


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
    FORGOTTEN = "forgotten"  # belongs to a candidate that was dropped
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
        """Number of all detections."""
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
    doubted: int = 0  # number of things that are not believed, without forgotten ones
    least_score: float = 0.0  # detections below are too weak
    nearest: float = 0.0  # [m] least depth of a detection that counts
    farthest: float = 0.0  # [m] greatest depth

    def to_json(self) -> dict[str, Any]:
        """Plain values, of MAX_CATEGORIES categories and MAX_THINGS things at most."""
        from kg.serving.client.update_codec import codec_of

        categories = dict(list(self.categories.items())[:MAX_CATEGORIES])
        part = replace(self, categories=categories, things=self.things[:MAX_THINGS])
        members: dict[str, Any] = codec_of(DetectionReport).encode(part)
        return {"version": VERSION} | members


def report_from_json(value: object) -> DetectionReport:
    """The inverse of `to_json`; raises ValueError or InvalidFactError for anything else."""
    from kg.serving.client.update_codec import codec_of

    if not isinstance(value, dict) or value.get("version") != VERSION:
        raise ValueError(f"it has no version {VERSION}")
    members = {name: member for name, member in value.items() if name != "version"}
    report: DetectionReport = codec_of(DetectionReport).decode(members, "report")
    return report


def read_report(folder: Path) -> DetectionReport | None:
    """The report in the folder of a map; None where there is none.

    Raises GraphError for a file that holds no report, is too large, or is a link.
    """
    path = folder / FILE
    if path.is_symlink():
        raise GraphError(f"{path} is no file of its own; without it, mapping writes a new one")
    if not path.exists():
        return None
    try:
        data = read_bytes(path, MAX_BYTES)
    except OSError as error:
        raise GraphError(f"cannot read {path}: {error.strerror or error}") from error
    try:
        return report_from_json(json.loads(data, parse_float=_finite, parse_constant=_finite))
    except (ValueError, GraphError, RecursionError) as error:
        reason = " ".join(str(error).split())[:100]
        raise GraphError(f"{path} is no detection report: {reason}") from error


def _finite(text: str) -> float:
    number = float(text)
    if not math.isfinite(number):
        raise ValueError(f"{text[:20]} is no finite number")
    return number


def write_report(folder: Path, report: DetectionReport) -> None:
    """Write the report into the folder of a map; raises GraphError where that fails."""
    from kg.store.atomic_file import write_atomically

    path = folder / FILE
    try:
        if path.is_symlink():
            path.unlink()  # it may lead to a file that is not the map's
        if path.exists() and not path.is_file():
            raise GraphError(f"{path} is no file of its own")
    except OSError as error:
        raise GraphError(f"cannot write {path}: {error.strerror or error}") from error
    text = json.dumps(report.to_json(), ensure_ascii=False, allow_nan=False)
    write_atomically(path, text.encode("utf-8", "replace"), in_map=True)

"""Detection report: fates of detections by category, and the things that are not believed.

The folder of a map keeps the report as `detections.json`. Boxes of one category on one thing of a
frame count once. Detections of a candidate follow it: they count for the object that it becomes, or
for the thing that it is merged into.
"""

from __future__ import annotations

import json
import math
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from kg.model.errors import GraphError
from kg.model.regular_files import read_bytes

if TYPE_CHECKING:
    from mapping.objects.tracks import Track

BELIEVED: Final = 0.5  # existence from which on queries show an object
VERSION: Final = 2
MAX_THINGS: Final = 200  # in one report
MAX_CATEGORIES: Final = 500
FILE: Final = "detections.json"  # in the folder of a map
MAX_BYTES: Final = 2_000_000  # of that file


class Fate(StrEnum):
    """Fate of a detection: its use, or why it has none; in the order of a table's columns."""

    OBJECT = "object"
    CANDIDATE = "candidate"
    FORGOTTEN = "forgotten"  # belongs to a candidate that was dropped
    WEAK = "too weak"
    UNKNOWN = "unknown label"
    IGNORED = "ignored label"
    NO_DEPTH = "no depth"
    NEAR = "too near"
    FAR = "too far"
    CUT = "cut off"  # by the border, beside a thing of its category
    DOUBLE = "second box"  # of a thing that the frame shows already


@dataclass(frozen=True, slots=True)
class DoubtedThing:
    """A candidate, or an object of the map that exists with less than 0.5."""

    category: str  # label
    existence: float
    seen: int  # times
    iri: str = ""  # of an object; "" for a candidate
    frame: str = ""  # of its best view, which the following describe
    recording: str = ""
    box: tuple[float, float, float, float] | None = None  # xyxy [px]
    score: float = 0.0  # of the detector


@dataclass(frozen=True, slots=True)
class DetectionReport:
    """Fates of the detections in `frames` frames."""

    frames: int
    categories: Mapping[str, Mapping[Fate, int]]  # the most detected first
    things: tuple[DoubtedThing, ...] = ()  # not believed: the most probable first
    doubted: int = 0  # number of things that are not believed
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
    """The report in the folder of a map; None where there is none, or one of an older form.

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
        value = json.loads(data, parse_float=_finite, parse_constant=_finite)
        if isinstance(value, dict) and value.get("version") == 1:
            return None
        return report_from_json(value)
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
    from kg.store.folder import write_atomically

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


_SWEEP: Final = 100  # frames between two sweeps of things that are no longer held
_MAX_NAMES: Final = 1000  # names with counts of their own; labels may be any text
_MAX_LENGTH: Final = 100  # characters of a name
OTHERS: Final = "other labels"


class DetectionFates:
    """Counter of detection fates; `name` gives the name of a label or of a category's IRI.

    The counts of a frame can be undone until they are settled.
    """

    def __init__(self, name: Callable[[str], str] = str) -> None:
        self._name = name
        self.frames = 0
        # by name, without the detections of things that are held
        self.counts: defaultdict[str, Counter[Fate]] = defaultdict(Counter)
        # things that are held, by number of the track, with detections by name
        self.things: dict[int, tuple[Track, Counter[str]]] = {}
        self._frame: list[tuple[Fate | Track, str]] = []  # of this frame, with label or IRI
        self._open = False  # whether a frame has begun and is not settled

    def begin(self, held: Sequence[Track]) -> None:
        """Begin a frame; `held` are the tracks that the mapper has."""
        self.settle()
        self.frames += 1
        self._open = True
        if self.frames % _SWEEP == 0:
            self.sweep(held)

    def unused(self, fate: Fate, names: Iterable[str]) -> None:
        """Count detections, by labels or IRIs, that belong to no thing."""
        self._frame += [(fate, name) for name in names]

    def unplaced(self, depth: float | None, nearest: float, names: Iterable[str]) -> None:
        """Count detections at a `depth` [m] that is out of reach; None: without depth."""
        near = depth is not None and depth < nearest
        self.unused(Fate.NO_DEPTH if depth is None else Fate.NEAR if near else Fate.FAR, names)

    def seen(self, track: Track, categories: frozenset[str]) -> None:
        """Count detections of a track, of categories by IRI."""
        self._frame += [(track, category) for category in categories]

    def merge(self, kept: Track, absorbed: Track) -> None:
        """Count the detections of `absorbed` as those of `kept`."""
        self._frame = [(kept if to is absorbed else to, name) for to, name in self._frame]
        if (thing := self.things.pop(absorbed.number, None)) is not None:
            self._thing(kept).update(thing[1])

    def undo(self) -> None:
        """Undo the counts of a frame that is not settled; merged tracks stay merged."""
        self.frames -= self._open
        self._open = False
        self._frame.clear()

    def settle(self) -> None:
        """Add this frame's detections to the counts; they can no longer be undone."""
        for to, label_or_iri in self._frame:
            name = self._name(label_or_iri)[:_MAX_LENGTH]
            if isinstance(to, Fate):
                self.add(name, to)
            else:
                self._thing(to)[name] += 1
        self._frame.clear()
        self._open = False

    def sweep(self, held: Sequence[Track]) -> None:
        """Move the detections of things that the mapper no longer has to the other counts."""
        for number in self.things.keys() - {track.number for track in held}:
            track, counts = self.things.pop(number)
            for name, count in counts.items():
                self.add(name, Fate.FORGOTTEN if track.iri is None else Fate.OBJECT, count)

    def add(self, name: str, fate: Fate, count: int = 1) -> None:
        """Add to the count of a category or label."""
        if name not in self.counts and len(self.counts) >= _MAX_NAMES:
            name = OTHERS
        self.counts[name][fate] += count

    def by_category(self) -> dict[str, dict[Fate, int]]:
        """All settled counts, the most detected category first."""
        counts = defaultdict(Counter[Fate], {n: Counter(c) for n, c in self.counts.items()})
        for track, names in self.things.values():
            for name, count in names.items():
                counts[name][Fate.CANDIDATE if track.iri is None else Fate.OBJECT] += count
        ranked = sorted(counts.items(), key=lambda item: (-item[1].total(), item[0]))
        return {name: {fate: of[fate] for fate in Fate if of[fate]} for name, of in ranked}

    def _thing(self, track: Track) -> Counter[str]:
        return self.things.setdefault(track.number, (track, Counter()))[1]

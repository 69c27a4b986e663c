"""Progress reports of a mapping run: after each frame, and at its end."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, replace
from typing import Any, Final

from mapping.objects.detections.detection_report import DoubtedThing

STAGES: Final = ("read", "detect", "scene", "map", "floor", "surface", "graph")
_MAX_DOUBTED: Final = 20  # things that are seen but not believed, in JSON


@dataclass(frozen=True, slots=True)
class FrameReport:
    """Frame report: one frame, mapped and in the graph."""

    index: int  # within the recording, from 0
    total: int  # frames of the recording
    frame: str  # its id
    detections: int
    objects: int  # believed now, as the query `objects` lists them
    place: str | None  # IRI of the place whose belief this frame changed
    changed_triples: int
    seconds: Mapping[str, float]  # stage -> [s]
    frames_per_second: float  # of the run so far


@dataclass(frozen=True, slots=True)
class MappingReport:
    """Mapping report: a whole run."""

    recording: str
    frames: int  # mapped by this run
    skipped: int  # already in the map
    seconds: float  # [s] wall clock
    stage_seconds: Mapping[str, float]  # stage -> [s]; reading, detection and the rest overlap
    objects: int  # believed at the end
    places: int
    views: int  # frames that were used for a place
    unplaced: int  # detections without usable depth
    unknown_labels: Mapping[str, int]  # network labels without a category -> how often
    provisional: tuple[str, ...] = ()  # labels of provisional categories in the recording
    problems: tuple[str, ...] = ()  # errors of the poses, found by depth; a full surface
    recognised: Mapping[str, str] = field(default_factory=dict)  # IRI -> name of a known thing
    fit: str = ""  # fit into the map's other recordings, in one line
    doubted: int = 0  # things that were seen but exist with less than 0.5
    most_probable: tuple[DoubtedThing, ...] = ()  # the same things, the most probable first

    @property
    def frames_per_second(self) -> float:
        """Frames of this run over its wall clock; 0 where there were none."""
        return self.frames / self.seconds if self.frames else 0.0

    @property
    def milliseconds(self) -> dict[str, float]:
        """Stage -> mean [ms] a frame of this run."""
        return {k: 1000 * v / max(self.frames, 1) for k, v in self.stage_seconds.items()}

    def followed_by(self, later: MappingReport) -> MappingReport:
        """Report of both runs, where the `later` one went on with the same recording."""
        stages = Counter(self.stage_seconds)
        stages.update(later.stage_seconds)
        unknown = Counter(self.unknown_labels)
        unknown.update(later.unknown_labels)
        return replace(
            later,
            frames=self.frames + later.frames,
            seconds=self.seconds + later.seconds,
            stage_seconds=dict(stages),
            views=self.views + later.views,
            unplaced=self.unplaced + later.unplaced,
            unknown_labels=dict(unknown.most_common()),
            provisional=tuple(dict.fromkeys(self.provisional + later.provisional)),
            problems=tuple(dict.fromkeys(self.problems + later.problems)),
            recognised={**self.recognised, **later.recognised},
            fit=self.fit or later.fit,
        )

    def to_json(self) -> dict[str, Any]:
        """Plain values, for `--json`."""
        values = asdict(self)
        del values["stage_seconds"]
        return values | {
            "seconds": round(self.seconds, 3),
            "frames_per_second": round(self.frames_per_second, 2),
            "milliseconds_per_frame": {k: round(v, 2) for k, v in self.milliseconds.items()},
            "most_probable_doubted": values.pop("most_probable")[:_MAX_DOUBTED],
        }


class StageTimer:
    """Stage timer: seconds spent in each stage, of one frame and of the run."""

    def __init__(self) -> None:
        self._start = time.perf_counter()
        self.frame = dict.fromkeys(STAGES, 0.0)
        self.run = dict.fromkeys(STAGES, 0.0)

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Count the time within the block as stage `name`."""
        before = time.perf_counter()
        try:
            yield
        finally:
            self.count(name, time.perf_counter() - before)

    def count(self, name: str, seconds: float) -> None:
        """Count time that was spent on stage `name`, by this or another thread."""
        self.frame[name] += seconds
        self.run[name] += seconds

    def next_frame(self) -> None:
        """Begin a new frame."""
        self.frame = dict.fromkeys(STAGES, 0.0)

    def elapsed(self) -> float:
        """[s] since the clock was made."""
        return time.perf_counter() - self._start

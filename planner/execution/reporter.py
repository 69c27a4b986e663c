"""Reporter of a search: events with a line for people and plain values for programs."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any, Final

from kg.model.records import LookRecord
from kg.model.shares import percent
from planner.execution.object_updates import TargetDetection
from planner.execution.options import Event, EventSink, SearchOutcome
from planner.execution.protocol import Detected, OnTheWay, RobotPose
from planner.execution.search_log import SearchLog
from planner.execution.viewpoint_adapter import NextView

MAX_UNKNOWN: Final = 100  # labels without a category that are noted


class Reporter:
    """Reporter: sends events to `on_event`, stamped with `seconds()` of the search so far [s]."""

    def __init__(self, on_event: EventSink, seconds: Callable[[], float]) -> None:
        self._to, self._seconds = on_event, seconds
        self._unknown = set[str]()  # labels that were noted
        self._reason = ""  # of the last plan; the next plan does not repeat it

    def begin(self, log: SearchLog, left: float) -> None:
        """A search begins or is resumed."""
        record, looks = log.record, len(log.looks)
        verb = f"resumes after {looks} look{'s' * (looks > 1)}" if looks else "begins"
        self._emit(
            "begin",
            f"{log.name} for {', '.join(record.words)} {verb}: on this floor with a chance of "
            f"{percent(left)}",
            search=record.iri,
            words=list(record.words),
            left=round(left, 4),
            looks=looks,
        )

    def plan(self, p: NextView) -> None:
        """The next view and its reasons."""
        where = f"{p.place} " if p.place else ""
        first = p.why[0] if p.why else ""
        why = f": {first}" if first and first != self._reason else ""
        self._reason = first
        self._emit(
            "plan",
            f"next look from {where}({p.x:.1f}, {p.y:.1f}), over in {p.seconds:.0f} s: finds it "
            f"with {percent(p.probability)}{why}",
            place=p.place,
            x=round(p.x, 2),
            y=round(p.y, 2),
            heading=round(p.heading, 3),
            extent=round(p.extent, 3),
            probability=round(p.probability, 4),
            expected_seconds=round(p.seconds, 1),
            left_if_in_vain=round(p.left, 4),
            why=list(p.why),
        )

    def look(self, look: LookRecord, things: Sequence[Detected], left: float) -> None:
        """A view was taken."""
        self._emit(
            "look",
            f"look {look.number}: "
            + ("found" if look.found else f"nothing found, {percent(left)} remain"),
            look=look.iri,
            found=list(look.found),
            left=round(left, 4),
            seen=[thing.label for thing in things],
        )

    def found(self, sighting: TargetDetection, iri: str) -> None:
        """A target was found."""
        thing = sighting.thing
        self._emit(
            "found",
            f"found {thing.label} at ({thing.x:.2f}, {thing.y:.2f}, {thing.z:.2f})",
            target=sighting.target.text,
            object=iri,
            label=thing.label,
            score=round(thing.score, 3),
            x=round(thing.x, 2),
            y=round(thing.y, 2),
            z=round(thing.z, 2),
        )

    def way(self, way: OnTheWay) -> None:
        """Navigation tells of its way."""
        times = "once" if way.recoveries == 1 else f"{way.recoveries} times"
        recovered = f"; navigation had to get free {times}" if way.recoveries else ""
        self._emit(
            "note",
            f"on the way: {way.distance:.1f} m and {way.seconds:.0f} s are left{recovered}",
            distance=round(way.distance, 2),
            remaining_seconds=round(way.seconds, 1),
            recoveries=way.recoveries,
        )

    def surprise(self, text: str, pose: RobotPose | None = None) -> None:
        """An event that calls for a new plan."""
        where = {} if pose is None else {"x": round(pose.x, 2), "y": round(pose.y, 2)}
        self._emit("surprise", text, **where)

    def note(self, text: str) -> None:
        """A note that changes nothing."""
        self._emit("note", text)

    def unknown(self, labels: Iterable[str]) -> None:
        """Labels of detections that no category has; each is noted once."""
        for label in labels:
            if label not in self._unknown and len(self._unknown) < MAX_UNKNOWN:
                self._unknown.add(label)
                self.note(f"no category of objects is called {label!r}: left out")

    def end(self, outcome: SearchOutcome) -> None:
        """The run is over."""
        self._emit("end", outcome.line, **outcome.to_json())

    def _emit(self, kind: str, text: str, **data: Any) -> None:
        self._to(Event(kind, text, {"seconds": round(self._seconds(), 1), **data}))

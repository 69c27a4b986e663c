"""Search log: records of a search in the map; each look, obstacle and find is one transaction."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Collection, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Final

import numpy as np

from kg.maps.semantic_map import SemanticMap
from kg.model.errors import ConflictError, GraphError
from kg.model.iris import whole_number
from kg.model.records import (
    LookRecord,
    MapUpdate,
    ObstacleRecord,
    RobotRecord,
    SearchRecord,
    SearchState,
)
from kg.model.transactions import Cause
from mapping.objects.object_mapper import ObjectChanges
from mapping.occupancy.mapped_floor import FloorView
from mapping.places.place_mapper import ViewedFloor
from planner.execution.options import SearchOutcome
from planner.execution.protocol import RobotPose

TRIES: Final = 10  # of a write, as long as other writers conflict with it
#: [s] for which an obstacle of one search counts in others; later, a door may be open again
SHUT: Final = 1800.0


class SearchLog:
    """Writes one search, from `begin` or `resume` on."""

    def __init__(
        self, semantic_map: SemanticMap, record: SearchRecord, clock: Callable[[], float]
    ) -> None:
        self._map = semantic_map
        self._clock = clock
        robot = semantic_map.robot()
        self._height = 0.0 if robot is None else float(robot.p_map[2])  # the protocol has no z
        self._floor = ViewedFloor(semantic_map)
        self.record = record
        self.looks = list(semantic_map.searches.looks(record.iri))
        self.obstacles = list(semantic_map.searches.obstacles(record.iri))

    @classmethod
    def begin(
        cls,
        semantic_map: SemanticMap,
        words: Sequence[str],
        categories: Sequence[str],
        clock: Callable[[], float] = time.time,
    ) -> SearchLog:
        """Log of a new search, which is written to the map."""
        for _ in range(TRIES):
            with semantic_map.hold(), suppress(ConflictError):  # another robot took the number
                numbers = [_number(s.iri, semantic_map.base) for s in semantic_map.searches.all()]
                iri = f"{semantic_map.base}search/{max(numbers, default=0) + 1}"
                record = SearchRecord(iri, tuple(words), tuple(categories), "running", clock())
                log = cls(semantic_map, record, clock)
                semantic_map.apply(MapUpdate(search=record), log._cause("begun"))
                return log
        raise GraphError(f"others begin searches too fast: {TRIES} numbers were taken; try again")

    @classmethod
    def resume(
        cls,
        semantic_map: SemanticMap,
        record: SearchRecord,
        clock: Callable[[], float] = time.time,
    ) -> SearchLog:
        """Log of an unfinished search, continued."""
        log = cls(semantic_map, replace(record, state="running", ended=None), clock)
        log._write("resumed", MapUpdate(search=log.record))
        return log

    @property
    def name(self) -> str:
        """Name of the search in the map: ``search/3``."""
        return self.record.iri.removeprefix(self._map.base)

    def note_progress(self, *, left: float, seconds: float) -> None:
        """Set the progress; it is written with the next update."""
        left = min(max(left, 0.0), 1.0)
        self.record = replace(self.record, left=left, seconds=seconds)

    def look(
        self,
        pose: RobotPose,
        heading: float,
        extent: float,
        categories: Sequence[str],
        *,
        found: Sequence[str] = (),
        changes: ObjectChanges | None = None,
        shown: Collection[str] = (),
        glimpses: Sequence[tuple[float, float, float]] = (),
        viewed: Sequence[FloorView] = (),
    ) -> LookRecord:
        """Write a view with all changes.

        Viewed floor and the view counts of places are written once enough has changed, or at the
        end.

        Args:
            pose: Pose of the robot.
            heading: Middle of the view [rad].
            extent: Angle in view [rad].
            categories: IRIs of the categories searched for.
            found: IRIs of the objects found.
            changes: Changes of objects.
            shown: IRIs of the objects in the view.
            glimpses: Camera poses (x [m], y [m], heading [rad]) of pictures on the way.
            viewed: Floor in view.
        """
        number = max((look.number for look in self.looks), default=0) + 1
        record = LookRecord(
            iri=f"{self.record.iri}/look/{number}",
            search=self.record.iri,
            number=number,
            stamp=self._clock(),
            position=(pose.x, pose.y),
            heading=heading,
            extent=extent,
            categories=tuple(categories),
            found=tuple(found),
            glimpses=tuple(glimpses),
        )
        outcome = "found" if found else "nothing found"
        self._found(found)
        self._floor.add(viewed, self._height, record.stamp)
        floor, places = self._floor.take_changed(record.stamp)
        self._write(
            f"look {number}: {outcome}",
            replace(
                _update(changes or ObjectChanges()),
                places=places,
                robot=self._robot(pose),
                search=self.record,
                looks=(record,),
                floor=floor,
            ),
            shown,
        )
        self.looks.append(record)
        return record

    def sighting(
        self,
        pose: RobotPose,
        changes: ObjectChanges,
        shown: Collection[str],
        found: Sequence[str] = (),
    ) -> None:
        """Write the changes by a picture on the way; `shown` are the objects in it."""
        self._found(found)
        update = replace(_update(changes), robot=self._robot(pose), search=self.record)
        self._write("found on the way" if found else "seen on the way", update, shown)

    def obstacle(self, pose: RobotPose, x: float, y: float, reason: str) -> ObstacleRecord:
        """Write an obstacle at (x, y) [m] that stopped the robot, which is at `pose`."""
        number = len(self.obstacles) + 1
        iri = f"{self.record.iri}/obstacle/{number}"
        record = ObstacleRecord(iri, self.record.iri, number, self._clock(), (x, y), reason)
        update = MapUpdate(robot=self._robot(pose), search=self.record, obstacles=(record,))
        self._write(f"obstacle {number}: {reason}", update)
        self.obstacles.append(record)
        return record

    def change(self, note: str, changes: ObjectChanges) -> None:
        """Write objects whose existence a view has lowered, and remove those that are gone."""
        self._write(note, replace(_update(changes), search=self.record))

    def end(
        self,
        state: SearchState,
        pose: RobotPose | None,
        changes: ObjectChanges | None = None,
    ) -> None:
        """Write the end of this run with its final `changes`."""
        self.record = replace(self.record, state=state, ended=self._clock())
        floor, places = self._floor.take_rest()
        update = replace(
            _update(changes or ObjectChanges()),
            places=places,
            robot=None if pose is None else self._robot(pose),
            search=self.record,
            floor=floor,
        )
        self._write(state, update)

    def outcome(self, state: SearchState, reason: str) -> SearchOutcome:
        """Outcome of this run, as far as it is logged."""
        return SearchOutcome(
            search=self.record.iri,
            state=state,
            reason=reason,
            found=self.record.found,
            left=self.record.left,
            seconds=self.record.seconds,
            looks=len(self.looks),
        )

    def _found(self, iris: Sequence[str]) -> None:
        self.record = replace(self.record, found=tuple(dict.fromkeys((*self.record.found, *iris))))

    def _robot(self, pose: RobotPose) -> RobotRecord:
        p_map = np.array([pose.x, pose.y, self._height])
        return RobotRecord(p_map, math.remainder(pose.heading, 2 * math.pi), self._clock())

    def _write(self, note: str, update: MapUpdate, shown: Collection[str] = ()) -> None:
        """Apply `update`; resolve conflicts with objects that other writers changed meanwhile.

        Our state of the objects `shown` is written; other objects keep the state of the other
        writers. Floor and places are computed again for the next view.
        """
        for _ in range(TRIES):
            try:
                self._map.apply(update, self._cause(note))
                return
            except ConflictError as conflict:
                self._map.subscriptions.catch_up()
                self._floor.undo(update)
                update = replace(update, floor=(), places=())
                update = _without(update, {*conflict.things} - {*shown})
        raise GraphError(f"others change what {self.name} writes, {TRIES} times on end; stop them")

    def _cause(self, note: str) -> Cause:
        return Cause("search", self.name, note)


def _update(changes: ObjectChanges) -> MapUpdate:
    return MapUpdate(changes.updated, changes.removed, departed=changes.departed)


def _without(update: MapUpdate, things: Collection[str]) -> MapUpdate:
    """`update` without the objects `things`."""
    kept = tuple(record for record in update.objects if record.iri not in things)
    removed = tuple(iri for iri in update.removed if iri not in things)
    departed = tuple(record for record in update.departed if record.iri not in things)
    return replace(update, objects=kept, removed=removed, departed=departed)


def recent_obstacles(
    semantic_map: SemanticMap, search: str, now: float
) -> tuple[ObstacleRecord, ...]:
    """Obstacles of other searches than `search` within `SHUT` of `now` [s], before or after.

    Later stamps count since the clocks of robots differ. Earlier searches are skipped, since each
    costs a query.
    """
    return tuple(
        obstacle
        for other in semantic_map.searches.all()
        if other.iri != search and (other.ended is None or other.ended >= now - SHUT)
        for obstacle in semantic_map.searches.obstacles(other.iri)
        if abs(now - obstacle.stamp) <= SHUT
    )


def to_resume(semantic_map: SemanticMap, words: Sequence[str]) -> SearchRecord:
    """The latest unfinished search for `words`, or without words the latest unfinished search.

    Raises GraphError where there is none.
    """
    wanted = set(words)
    for record in reversed(semantic_map.searches.all()):
        if record.state != "found" and (not wanted or set(record.words) == wanted):
            return record
    targets = f" for {' and '.join(words)}" if words else ""
    raise GraphError(
        f"no unfinished search{targets} is in this map; without --resume a new one begins"
    )


def _number(iri: str, base: str) -> int:
    return whole_number(iri.removeprefix(f"{base}search/")) or 0

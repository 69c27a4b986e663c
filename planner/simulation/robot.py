"""The simulated robot on a search: drives to goals by way of the doors, turns, and looks.

It looks at every picture on the way too (thesis section 3.4: found as soon as it is detected). One
detection is not trusted: it counts when another one agrees within `CONFIRM_WITHIN`.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from mapping.localisation import localise, to_map
from mapping.settings import ReferenceSettings
from perception.frame import Detector
from planner.simulation.camera import SimulatedCamera
from planner.simulation.floor import Floor
from planner.simulation.motion import Gait, Pose, drive, look_around

CONFIRM_WITHIN = 0.75  # [m] kappa of the thesis: nearer than this is the same object


@dataclass(frozen=True, slots=True)
class Sighting:
    """The target as one picture shows it."""

    label: str
    score: float
    p_map: NDArray[np.float64]  # (3,) [m]
    pose: Pose  # of the robot
    frame: str


@dataclass(frozen=True, slots=True)
class Look:
    """One picture of a search, for whoever watches."""

    goal: int  # index of the goal it drives to or looks around at
    pose: Pose
    sighting: Sighting | None


@dataclass(frozen=True, slots=True)
class SearchRun:
    """How a search went."""

    found: Sighting | None  # the confirming one; None when all goals were explored in vain
    goal: int | None  # index of the goal on whose account it was found
    explored: int  # goals at which a whole turn ended in vain
    seconds: float
    distance: float  # [m] driven
    pictures: int
    path: NDArray[np.float64]  # (n, 2) [m] where the robot was


@dataclass(slots=True)
class _Diary:
    """What happens during one search."""

    poses: list[Pose] = field(default_factory=list)
    sightings: list[Sighting] = field(default_factory=list)
    explored: int = 0


class SimulatedRobot:
    """A robot in the house, at a pose, with a camera and a detector."""

    def __init__(
        self,
        camera: SimulatedCamera,
        detector: Detector,
        pose: Pose,
        *,
        gait: Gait | None = None,
        settings: ReferenceSettings | None = None,
    ) -> None:
        self._camera = camera
        self._detector = detector
        self.gait = gait or Gait()
        self._settings = settings or ReferenceSettings()
        self._floor = Floor(camera.house)
        self.pose = pose

    def route(self, goals: Sequence[NDArray[np.float64]]) -> NDArray[np.float64]:
        """(n, 2) [m] the way it would drive past `goals` ((2,) [m] each), by way of the doors.

        Raises LayoutError where the house has no free floor.
        """
        legs, here = [self.pose.xy[None, :]], self.pose.xy
        for goal in goals:
            legs.append(self._floor.path(here, goal)[1:])
            here = legs[-1][-1] if len(legs[-1]) else here
        return np.concatenate(legs)

    def search(
        self,
        labels: Collection[str],
        goals: Sequence[NDArray[np.float64]],
        on_look: Callable[[Look], None] | None = None,
    ) -> SearchRun:
        """Visit `goals` ((2,) [m] each) in their order until one of `labels` has been found.

        The robot stays where the search ends. Raises LayoutError where there is no way.
        """
        diary = _Diary(poses=[self.pose])
        started = self.pose.seconds
        for number, goal in enumerate(goals):
            for pose in self._approach(goal):
                self.pose = pose
                sighting = self._look(labels, f"search-{len(diary.poses):06d}")
                diary.poses.append(pose)
                if on_look is not None:
                    on_look(Look(number, pose, sighting))
                if sighting is not None and self._confirmed(sighting, diary):
                    return self._report(diary, started, sighting, number)
            diary.explored += 1
        return self._report(diary, started, None, None)

    def _approach(self, goal: NDArray[np.float64]) -> Iterator[Pose]:
        """The way to a goal and the turn there, from wherever the robot is by then."""
        yield from drive(self.pose, self._floor.path(self.pose.xy, goal), self.gait)
        yield from look_around(self.pose, self.gait)

    def _look(self, labels: Collection[str], frame_id: str) -> Sighting | None:
        T_map_cam = self._camera.model.pose(self.pose.x, self.pose.y, self.pose.heading)
        frame = self._camera.frame(frame_id, T_map_cam, self.pose.seconds)
        seen = self._detector.detect(frame)
        for box, score, label in zip(seen.xyxy, seen.score, seen.label, strict=True):
            p_cam = localise(frame, box, self._settings) if label in labels else None
            if p_cam is not None:
                p_map = to_map(T_map_cam, p_cam)
                return Sighting(label, float(score), p_map, self.pose, frame_id)
        return None

    @staticmethod
    def _confirmed(sighting: Sighting, diary: _Diary) -> bool:
        """Whether an earlier sighting agrees; remembers this one."""
        agrees = any(
            float(np.linalg.norm(earlier.p_map - sighting.p_map)) < CONFIRM_WITHIN
            for earlier in diary.sightings
        )
        diary.sightings.append(sighting)
        return agrees

    @staticmethod
    def _report(
        diary: _Diary, started: float, found: Sighting | None, goal: int | None
    ) -> SearchRun:
        path = np.array([pose.xy for pose in diary.poses])
        return SearchRun(
            found=found,
            goal=goal,
            explored=diary.explored,
            seconds=diary.poses[-1].seconds - started,
            distance=float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum()),
            pictures=len(diary.poses) - 1,
            path=path,
        )

"""Mapping tour: a drive through all rooms of a house, as a recording for the mapping pipeline."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from kg.model.errors import RecordingError
from perception.frames import Frame
from planner.simulation.houses.floor_grid import FloorGrid
from planner.simulation.robot.motion import MotionLimits, TimedPose, drive, look_around
from planner.simulation.sensing.camera import SimulatedCamera

#: Name of the demo's recording. The simulated robot searches maps of this recording only.
DEMO_RECORDING: Final = "demo-tour"
START = 1772442000.0  # [s] of the first frame: 2026-03-02 09:00:00 UTC


class SimulatedTour:
    """A `Recording`: a drive from viewpoint to viewpoint with a full turn at each.

    The rooms are visited in the order of the house; `poses` replace this drive. The first frame is
    of `start`, or the last one of `end` [s since 1970]. Frames are rendered when they are read.
    """

    def __init__(
        self,
        camera: SimulatedCamera,
        *,
        name: str = "tour",
        start: float = START,
        end: float | None = None,
        poses: Sequence[TimedPose] | None = None,
    ) -> None:
        self._camera = camera
        self._name = name
        self.poses = tuple(poses or _poses(camera, MotionLimits()))
        self._start = start if end is None else end - self.poses[-1].seconds

    @property
    def name(self) -> str:
        """Name that identifies the recording within a map."""
        return self._name

    @property
    def T_map_world(self) -> NDArray[np.float64]:  # noqa: N802 named by the protocol
        """(4, 4) identity: the house is described in the map frame."""
        return np.eye(4)

    def __len__(self) -> int:
        return len(self.poses)

    def frames(self, start: int = 0) -> Iterator[Frame]:
        """Frames from index `start` on; raises RecordingError for an index outside the tour."""
        if not 0 <= start <= len(self):
            raise RecordingError(f"{self._name} has frames 0 to {len(self) - 1}, not {start}")
        for index in range(start, len(self)):
            stamp = self._start + self.poses[index].seconds
            yield self._camera.frame(f"frame-{index:06d}", self.T_map_cam(index), stamp)

    def T_map_cam(self, index: int) -> NDArray[np.float64]:  # noqa: N802 named for its frames
        """(4, 4) true pose of the camera in frame `index`."""
        pose = self.poses[index]
        return self._camera.model.pose(pose.x, pose.y, pose.heading)


def _poses(camera: SimulatedCamera, gait: MotionLimits) -> Iterator[TimedPose]:
    floor = FloorGrid(camera.house)
    stops = [np.array(xy) for room in camera.house.rooms for xy in room.viewpoints]
    pose = TimedPose(float(stops[0][0]), float(stops[0][1]), 0.0, 0.0)
    yield pose
    for stop in stops:
        for pose in drive(pose, floor.path(pose.xy, stop), gait):  # noqa: B020 the last counts
            yield pose
        for pose in look_around(pose, gait):  # noqa: B020
            yield pose

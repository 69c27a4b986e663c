"""A drive through all rooms of the house, as a recording the mapping pipeline can read."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from kg.model.errors import RecordingError
from perception.frames import Frame
from planner.simulation.houses.floor_grid import FloorGrid
from planner.simulation.robot.motion import MotionLimits, Pose, drive, look_around
from planner.simulation.sensing.camera import SimulatedCamera

#: Name of the demo's recording: only maps of nothing else are the simulated robot's to search.
DEMO_RECORDING: Final = "demo-tour"
#: When the tour starts: 2026-03-02 09:00:00 UTC.
START = 1772442000.0


class SimulatedTour:
    """A `Recording`: from viewpoint to viewpoint by way of the doors, a full turn at each.

    Rooms are visited in the order the house lists them, or `poses` are driven instead. Frames are
    rendered as they are read.
    """

    def __init__(
        self,
        camera: SimulatedCamera,
        *,
        name: str = "tour",
        gait: MotionLimits | None = None,
        start: float = START,
        poses: Sequence[Pose] | None = None,
    ) -> None:
        self._camera = camera
        self._name = name
        self._start = start
        self.poses = tuple(poses or _poses(camera, gait or MotionLimits()))

    @property
    def name(self) -> str:
        """Name that identifies the recording within a map."""
        return self._name

    @property
    def T_map_world(self) -> NDArray[np.float64]:  # noqa: N802 named by the protocol
        """(4, 4) identity: the house is described in the map frame."""
        return np.eye(4)

    @property
    def end(self) -> float:
        """[s] stamp of the last frame."""
        return self._start + self.poses[-1].seconds

    @property
    def route(self) -> NDArray[np.float64]:
        """(n, 2) [m] where the frames are taken."""
        return np.array([pose.xy for pose in self.poses])

    def __len__(self) -> int:
        return len(self.poses)

    def frames(self, start: int = 0) -> Iterator[Frame]:
        """Frames from index `start` on; raises RecordingError for an index outside the tour."""
        if not 0 <= start <= len(self):
            raise RecordingError(f"{self._name} has frames 0 to {len(self) - 1}, not {start}")
        for index in range(start, len(self)):
            yield self._frame(index)

    def T_map_cam(self, index: int) -> NDArray[np.float64]:  # noqa: N802 named for its frames
        """(4, 4) true pose of the camera in frame `index`."""
        pose = self.poses[index]
        return self._camera.model.pose(pose.x, pose.y, pose.heading)

    def _frame(self, index: int) -> Frame:
        stamp = self._start + self.poses[index].seconds
        return self._camera.frame(f"frame-{index:06d}", self.T_map_cam(index), stamp)


def _poses(camera: SimulatedCamera, gait: MotionLimits) -> Iterator[Pose]:
    floor = FloorGrid(camera.house)
    stops = [np.array(xy) for room in camera.house.rooms for xy in room.viewpoints]
    pose = Pose(float(stops[0][0]), float(stops[0][1]), 0.0, 0.0)
    yield pose
    for stop in stops:
        for pose in drive(pose, floor.path(pose.xy, stop), gait):  # noqa: B020 the last counts
            yield pose
        for pose in look_around(pose, gait):  # noqa: B020
            yield pose

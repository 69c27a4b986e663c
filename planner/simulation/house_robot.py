"""The demo's robot, by the robot protocol: rendered pictures, a detector with errors, a tour."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from kg.maps.semantic_map import SemanticMap
from kg.model.errors import LayoutError, RecordingError
from perception.frames import Frame
from planner.execution.protocol import (
    Aborted,
    Arrived,
    DetectedFrame,
    DetectionsMessage,
    GoTo,
    Hello,
    LookAround,
    Message,
    RobotPose,
)
from planner.execution.robot import StepwiseRobot
from planner.simulation.camera import SimulatedCamera
from planner.simulation.house import FloorGrid, House, furnished_house
from planner.simulation.sensors import SimulatedDetector


@dataclass(frozen=True, slots=True)
class MotionLimits:
    """Speeds of the robot, and distances between its pictures."""

    speed: float = 0.5  # [m/s]
    turn_rate: float = 0.8  # [rad/s]
    stride: float = 0.6  # [m] driven between two pictures, at most
    swing: float = np.deg2rad(30.0)  # [rad] turned between two pictures, at most


@dataclass(frozen=True, slots=True)
class TimedPose:
    """A pose of the robot, with its time."""

    x: float  # [m] map frame
    y: float
    heading: float  # [rad] about z, 0 along x
    seconds: float  # [s] since the start of the motion

    @property
    def xy(self) -> NDArray[np.float64]:
        """(2,) [m] position."""
        return np.array([self.x, self.y])


def drive(pose: TimedPose, corners: NDArray[np.float64], gait: MotionLimits) -> Iterator[TimedPose]:
    """Poses along `corners` (n, 2) [m], turning on the spot at each; the start is not repeated."""
    for corner in corners:
        offset = corner - pose.xy
        distance = float(np.hypot(*offset))
        if distance < 1e-6:
            continue
        heading = float(np.arctan2(offset[1], offset[0]))
        for pose in turn(pose, _wrapped(heading - pose.heading), gait):  # noqa: B020 the last counts
            yield pose
        start, steps = pose, int(np.ceil(distance / gait.stride - 1e-9))
        for k in range(1, steps + 1):
            x, y = start.xy + offset * (k / steps)
            seconds = start.seconds + distance * (k / steps) / gait.speed
            pose = TimedPose(float(x), float(y), heading, seconds)
            yield pose


def turn(pose: TimedPose, angle: float, gait: MotionLimits) -> Iterator[TimedPose]:
    """Poses of a turn on the spot by `angle` [rad], the start not repeated."""
    steps = int(np.ceil(abs(angle) / gait.swing - 1e-9))
    for k in range(1, steps + 1):
        heading = _wrapped(pose.heading + angle * k / steps)
        seconds = pose.seconds + abs(angle) * k / steps / gait.turn_rate
        yield TimedPose(pose.x, pose.y, heading, seconds)


def look_around(pose: TimedPose, gait: MotionLimits) -> Iterator[TimedPose]:
    """Poses of one full turn to the left (thesis section 3.4: 360 degrees at each goal)."""
    return turn(pose, 2 * np.pi, gait)


def _wrapped(angle: float) -> float:
    return float((angle + np.pi) % (2 * np.pi) - np.pi)


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


RANGE = (0.8, 4.0)  # [m] at which the simulated detector detects most small things
RECALL = 0.6  # of objects within that range


class SimulatedHouseRobot(StepwiseRobot):
    """A `Robot` in the house; its clock is that of its motion, so it never waits."""

    name = "the simulated robot"

    def __init__(self, house: House, start: TimedPose, *, seed: int = 0) -> None:
        super().__init__()
        self._camera = SimulatedCamera(house, seed=seed)
        self._detector = SimulatedDetector(self._camera)
        self._floor = FloorGrid(house)
        self._gait = MotionLimits()
        self._pose = replace(start, seconds=0.0)
        self._positions = [self._pose.xy]
        self._pictures = 0

    @property
    def driven(self) -> NDArray[np.float64]:
        """(n, 2) [m] positions so far, the start first."""
        return np.array(self._positions)

    @property
    def seconds(self) -> float:
        """[s] of its motion so far."""
        return self._pose.seconds

    @property
    def hello(self) -> Hello:
        """The robot's description of itself."""
        model = self._camera.model
        return Hello(
            name=self.name,
            speed=self._gait.speed,
            turn_rate=self._gait.turn_rate,
            near=RANGE[0],
            far=RANGE[1],
            field_of_view=2 * math.atan(model.width / 2 / model.focal),
            recall=RECALL,
            detector=self._detector.name,
        )

    def receive(self, seconds: float) -> Message | None:
        """The next message, without waiting; None if there is none."""
        return next(self._under_way, None)

    def close(self) -> None:
        """Stand still."""
        self._stop()

    def _greet(self) -> Iterator[Message]:
        yield self.hello
        yield self._robot_pose()

    def _drive(self, goal: GoTo) -> Iterator[Message]:
        try:
            path = self._floor.path(self._pose.xy, np.array([goal.x, goal.y]))
        except LayoutError as error:
            yield Aborted(str(error))
            return
        for pose in drive(self._pose, path, self._gait):
            yield from self._pass(pose)
        towards = math.remainder(goal.heading - self._pose.heading, 2 * math.pi)
        for pose in turn(self._pose, towards, self._gait):
            yield from self._pass(pose)
        yield Arrived(goal.id)

    def _look(self, look: LookAround) -> Iterator[Message]:
        views = [self._view()]
        for pose in turn(self._pose, look.turn, self._gait):
            yield self._move(pose)
            views.append(self._view())
        yield DetectionsMessage(look.id, views=tuple(views))

    def _pass(self, pose: TimedPose) -> Iterator[Message]:
        yield self._move(pose)
        yield DetectionsMessage(None, pose=self._robot_pose(), views=(self._view(),))

    def _move(self, pose: TimedPose) -> RobotPose:
        self._pose = pose
        self._positions.append(pose.xy)
        return self._robot_pose()

    def _robot_pose(self) -> RobotPose:
        pose = self._pose
        return RobotPose(pose.x, pose.y, pose.heading, pose.seconds)

    def _view(self) -> DetectedFrame:
        pose = self._pose
        self._pictures += 1
        T_map_cam = self._camera.model.pose(pose.x, pose.y, pose.heading)
        frame = self._camera.frame(f"search-{self._pictures:06d}", T_map_cam, pose.seconds)
        return DetectedFrame(frame, self._detector.detect(frame))


def simulated_robot(
    semantic_map: SemanticMap, house: House | None = None, *, seed: int = 0
) -> SimulatedHouseRobot:
    """The robot in `house` (default: the demo's), at its pose in the map.

    Raises LayoutError where another recording than the demo's was mapped.
    """
    house = house or furnished_house()
    if {recording.name for recording in semantic_map.recordings()} != {DEMO_RECORDING}:
        raise LayoutError(
            "the simulated robot searches maps that `hereabouts demo` made, and this is none; a "
            "robot of your own is --robot stdio:COMMAND or http://..."
        )
    robot = semantic_map.robot()
    if robot is None:
        x, y = house.rooms[0].viewpoints[0]
        return SimulatedHouseRobot(house, TimedPose(x, y, 0.0, 0.0), seed=seed)
    start = TimedPose(float(robot.p_map[0]), float(robot.p_map[1]), robot.heading, 0.0)
    return SimulatedHouseRobot(house, start, seed=seed)

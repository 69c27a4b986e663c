"""The demo's robot, by the robot protocol: rendered pictures, a detector with errors."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from kg.maps.semantic_map import SemanticMap
from kg.model.errors import LayoutError
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
from planner.execution.stepwise_robot import StepwiseRobot
from planner.simulation.houses.floor_grid import FloorGrid
from planner.simulation.houses.house import House, furnished_house
from planner.simulation.robot.mapping_tour import DEMO_RECORDING
from planner.simulation.robot.motion import MotionLimits, TimedPose, drive, turn
from planner.simulation.sensing.camera import SimulatedCamera
from planner.simulation.sensing.sensors import SimulatedDetector

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

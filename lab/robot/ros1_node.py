"""ROS 1 node of a simulated house's robot: camera, tf, and goals like those of move_base.

Its clock runs `rate` times as fast as ours.
"""

from __future__ import annotations

import math
import threading
import time
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from kg.model.errors import LayoutError, RecordingError
from perception.sources.bag_writer import (
    CAMERA,
    COLOUR,
    COLOUR_INFO,
    DEPTH,
    DEPTH_INFO,
    IMAGE_TOPICS,
    MAP,
)
from perception.sources.bags.bag_file import RawMessage, decoded
from perception.sources.live.ros1 import Ros1Master
from perception.sources.live.ros1_publisher import Ros1Publisher
from perception.sources.ros.image_messages import NANOSECONDS, frame_name
from perception.sources.ros.message_maker import MessageMaker
from planner.simulation.camera import SimulatedCamera
from planner.simulation.house import FloorGrid, House
from planner.simulation.house_robot import MotionLimits, TimedPose, drive, turn

BASE: Final = "base_link"
STEP: Final = 0.05  # [s] between two poses
PICTURE: Final = 0.25  # [s] between two pictures
STATUS: Final = 0.2  # [s] between two messages of status
REMEMBERED: Final = 5.0  # [s] for which the outcome of a goal is published
NEAR: Final = 1.0  # [m] around a goal within which there must be free floor
_GOAL: Final = "move_base_msgs/msg/MoveBaseActionGoal"
_CANCEL: Final = "actionlib_msgs/msg/GoalID"
_STATUS: Final = "actionlib_msgs/msg/GoalStatusArray"
_RESULT: Final = "move_base_msgs/msg/MoveBaseActionResult"
_TRANSFORMS: Final = "tf2_msgs/msg/TFMessage"
#: states of actionlib_msgs/GoalStatus
ACTIVE, PREEMPTED, SUCCEEDED, ABORTED, REJECTED, RECALLED = 1, 2, 3, 4, 5, 8


@dataclass(slots=True)
class _Goal:
    """A goal and its state."""

    id: Any  # actionlib_msgs/GoalID
    way: Sequence[TimedPose]  # the last one is the end
    status: int = ACTIVE
    text: str = ""
    ended: float = math.inf  # [s] of time.monotonic()

    def pose(self, seconds: float) -> TimedPose:
        """The pose of the robot on the way at a time [s]."""
        x, y, headings, times = np.array([(p.x, p.y, p.heading, p.seconds) for p in self.way]).T
        values = (x, y, np.unwrap(headings))
        x, y, heading = (float(np.interp(seconds, times, value)) for value in values)
        return TimedPose(x, y, heading, seconds)


class Ros1HouseNode:
    """Node of the robot; an `Inbox` of goals."""

    CAMERA_AND_TF: Final = {**IMAGE_TOPICS, "/tf": _TRANSFORMS, "/tf_static": _TRANSFORMS}

    def __init__(
        self,
        master: Ros1Master,
        house: House,
        start: tuple[float, float],
        *,
        rate: float = 1.0,
        seed: int = 0,
        navigation: str = "/move_base",
    ) -> None:
        """The robot stands at `start` [m]; `navigation` is the name of its action."""
        self._rate, self._navigation = rate, navigation
        self._camera, self._floor = SimulatedCamera(house, seed=seed), FloorGrid(house)
        self._gait = MotionLimits()
        self._began = time.time(), time.monotonic()
        self.pose = TimedPose(*start, 0.0, self.seconds)
        self._goals = deque[_Goal](maxlen=100)
        self._orders = deque[tuple[str, Any]](maxlen=100)
        self._cancelled = deque[str](maxlen=100)  # ids of goals that have not arrived yet
        self._pictures = 0
        self._join(master)

    def _join(self, master: Any) -> None:
        """Begin to publish."""
        self._maker = MessageMaker(is_ros1=True)
        topics = {
            **self.CAMERA_AND_TF,
            f"{self._navigation}/status": _STATUS,
            f"{self._navigation}/result": _RESULT,
            f"{self._navigation}/feedback": "move_base_msgs/msg/MoveBaseActionFeedback",
        }
        self._publisher: Any = Ros1Publisher(master, topics, frozenset(["/tf_static"]))

    def _listen(self, ended: threading.Event) -> None:
        """Pass on messages to `offer` until `ended`."""
        self._publisher.master.run(self, ended)

    @property
    def seconds(self) -> float:
        """[s since 1970] by its clock."""
        since, monotonic = self._began
        return since + self._rate * (time.monotonic() - monotonic)

    def wanted(self, topics: Mapping[str, str]) -> set[str]:
        """Topics of goals and of their cancellations."""
        known = {f"{self._navigation}/goal": _GOAL, f"{self._navigation}/cancel": _CANCEL}
        return {topic for topic, type_ in topics.items() if known.get(topic) == type_}

    def offer(self, raw: RawMessage, *, is_ros1: bool) -> None:
        """Take a goal or its cancellation; other messages are ignored."""
        try:
            self._orders.append((raw.type, decoded(raw, is_ros1, raw.topic)))
        except RecordingError:
            return

    def run(self, ended: threading.Event) -> None:
        """Publish and take goals until `ended`."""
        threading.Thread(target=self._listen, args=(ended,), daemon=True).start()
        self._publisher.publish("/tf_static", self._mounted())
        periods = {self._publish_picture: PICTURE, self._publish_status: STATUS}
        due = dict.fromkeys(periods, 0.0)
        try:
            while not ended.wait(STEP):
                self._take_orders()
                self._move()
                for action, period in periods.items():
                    if time.monotonic() >= due[action]:
                        due[action] = time.monotonic() + period
                        action()
        finally:
            self._publisher.close()

    def _mounted(self) -> Any:
        """Where the camera sits, as a message of /tf_static."""
        T_base_cam = self._camera.model.pose(0.0, 0.0, 0.0)
        return self._maker.transforms(self._stamp, BASE, CAMERA, T_base_cam)

    @property
    def _stamp(self) -> int:
        return round(self.pose.seconds * NANOSECONDS)

    @property
    def _active(self) -> _Goal | None:
        return next((goal for goal in self._goals if goal.status == ACTIVE), None)

    def _take_orders(self) -> None:
        while self._orders:
            kind, message = self._orders.popleft()
            if kind == _GOAL:
                self._begin(message)
            else:
                self._cancel(str(message.id))

    def _cancel(self, number: str) -> None:
        """Cancel the goal of that id, "" for the active one; a goal may arrive after this."""
        active = self._active
        if active is not None and number in ("", active.id.id):
            self._end(active, PREEMPTED, "cancelled")
        elif number:
            self._cancelled.append(number)

    def _begin(self, message: Any) -> None:
        target = message.goal.target_pose
        p, q = target.pose.position, target.pose.orientation
        if (active := self._active) is not None:
            self._end(active, PREEMPTED, "another goal came")
        goal = _Goal(message.goal_id, (self.pose,))
        self._goals.append(goal)
        if goal.id.id in self._cancelled:
            self._end(goal, RECALLED, "cancelled")
        elif frame_name(target.header.frame_id) != MAP:
            self._end(goal, REJECTED, f"goals are in the frame {MAP}")
        elif not all(math.isfinite(value) for value in (p.x, p.y, q.x, q.y, q.z, q.w)):
            self._end(goal, REJECTED, "a goal needs finite numbers")
        else:
            heading = math.atan2(2 * (q.w * q.z + q.x * q.y), 1 - 2 * (q.y**2 + q.z**2))
            try:
                goal.way = self._way(np.array([p.x, p.y]), heading)
            except LayoutError as error:
                self._end(goal, ABORTED, str(error))

    def _way(self, goal: np.ndarray, heading: float) -> Sequence[TimedPose]:
        """Poses of the way to `goal` [m]; raises LayoutError where none leads there."""
        path = self._floor.path(self.pose.xy, goal)
        if math.dist(self.pose.xy, goal) <= self._gait.stride / 10:
            path = path[:1]
        elif float(np.linalg.norm(path[-1] - goal)) > NEAR:
            raise LayoutError(f"no way to ({goal[0]:.1f}, {goal[1]:.1f})")
        way = [self.pose, *drive(self.pose, path, self._gait)]
        towards = math.remainder(heading - way[-1].heading, 2 * math.pi)
        return [*way, *turn(way[-1], towards, self._gait)]

    def _move(self) -> None:
        """Move on, and publish the pose."""
        goal, now = self._active, self.seconds
        self.pose = TimedPose(self.pose.x, self.pose.y, self.pose.heading, now)
        if goal is not None:
            self.pose = goal.pose(now)
            if now >= goal.way[-1].seconds:
                self._end(goal, SUCCEEDED, "Goal reached.")
        T_map_base = np.eye(4)
        c, s = math.cos(self.pose.heading), math.sin(self.pose.heading)
        T_map_base[:2, :2] = [[c, -s], [s, c]]
        T_map_base[:2, 3] = self.pose.x, self.pose.y
        transform = self._maker.transforms(self._stamp, MAP, BASE, T_map_base)
        self._publisher.publish("/tf", transform)

    def _end(self, goal: _Goal, status: int, text: str) -> None:
        goal.status, goal.text, goal.ended = status, text, time.monotonic()
        self._publish_status()
        header = self._maker.header(self._stamp, "")
        message = self._maker.make(_RESULT, header=header, status=self._status(goal))
        self._publisher.publish(f"{self._navigation}/result", message)

    def _status(self, goal: _Goal) -> dict[str, Any]:
        return {"goal_id": goal.id, "status": goal.status, "text": goal.text}

    def _publish_status(self) -> None:
        """Publish the status of the active goal and of those that ended lately."""
        recent = time.monotonic() - REMEMBERED
        states = [self._status(goal) for goal in self._goals if goal.ended > recent]
        header = self._maker.header(self._stamp, "")
        message = self._maker.make(_STATUS, header=header, status_list=states)
        self._publisher.publish(f"{self._navigation}/status", message)

    def _publish_picture(self) -> None:
        """Publish a picture of the camera."""
        self._publish_view(0.0, CAMERA, COLOUR, DEPTH, (COLOUR_INFO, DEPTH_INFO))

    def _publish_view(
        self, turned: float, camera: str, colour: str, depth: str, infos: Sequence[str]
    ) -> None:
        """Publish a picture of a camera, which is turned [rad] against the robot, on its topics."""
        pose, make = self.pose, self._maker
        self._pictures += 1
        T_map_cam = self._camera.model.pose(pose.x, pose.y, pose.heading + turned)
        frame = self._camera.frame(f"ros1-{self._pictures:06d}", T_map_cam, pose.seconds)
        header = make.header(self._stamp, camera)
        for topic in infos:
            self._publisher.publish(topic, make.camera_info(frame.K, frame.depth.shape, header))
        self._publisher.publish(colour, make.colour(frame, header))
        self._publisher.publish(depth, make.depth(frame.depth, header))

"""Navigation of a robot: goals for move_base (ROS 1) and Nav2 (ROS 2), one at a time.

move_base takes goals by actionlib's topics: goal, cancel, status, result (wiki.ros.org/actionlib).
Nav2 takes them by the action navigate_to_pose, whose services foxglove_bridge passes on with
include_hidden, or over DDS by the topic /goal_pose. Services of ROS 2 over DDS are not used, since
vendors differ in where a request carries its sender. Status messages tell how a goal ends.
"""

from __future__ import annotations

import logging
import math
import os
import threading
import time
import uuid
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar, Final

from kg.model.errors import RecordingError, RobotError
from perception.sources.bags.bag_file import RawMessage, decoded
from perception.sources.live.foxglove import FoxgloveConnection
from perception.sources.live.ros1 import Ros1Master
from perception.sources.live.ros2 import Ros2Domain
from perception.sources.ros.image_messages import NANOSECONDS
from perception.sources.ros.message_maker import MessageMaker
from perception.sources.ros.message_types import serialised
from planner.execution.protocol import OnTheWay, cleaned

ANSWER: Final = 5.0  # [s] of answers about others after which a goal has failed
GONE: Final = 15.0  # [s] without any answer after which the server is gone
MAX_SIZE: Final = 1 << 20  # [bytes] of a message
_STATUS: Final = "actionlib_msgs/msg/GoalStatusArray"
_RESULT: Final = "move_base_msgs/msg/MoveBaseActionResult"
_GOAL: Final = "move_base_msgs/msg/MoveBaseActionGoal"
_CANCEL: Final = "actionlib_msgs/msg/GoalID"
_NAV2_STATUS: Final = "action_msgs/msg/GoalStatusArray"
_NAV2_FEEDBACK: Final = "nav2_msgs/action/NavigateToPose_FeedbackMessage"
TOLD: Final = 10.0  # [s] between two messages of the way

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class GoalPose:
    """A pose of the robot's base: its goal, or its own."""

    x: float  # [m] in `frame`
    y: float
    heading: float  # [rad]
    frame: str  # of tf
    stamp: int  # [ns] by the robot's clock

    def fields(self, maker: MessageMaker) -> dict[str, Any]:
        """Fields of geometry_msgs/PoseStamped."""
        turned = {"z": math.sin(self.heading / 2), "w": math.cos(self.heading / 2)}
        pose = {"position": {"x": self.x, "y": self.y}, "orientation": turned}
        return {"header": maker.header(self.stamp, self.frame), "pose": pose}


@dataclass(slots=True)
class _Goal:
    id: str  # "" until it is known
    heard: float = field(default_factory=time.monotonic)  # [s] when it was sent or last named
    is_taken: bool = False  # whether navigation has named it
    outcome: str | None = None  # reason of its failure, "" after success; None: under way
    way: OnTheWay | None = None  # as navigation told it last
    told: float = field(default_factory=time.monotonic)  # [s] when the way was passed on last
    recoveries: int = 0  # that were passed on


class Navigation(ABC):
    """Client of a navigation server; an `Inbox` of its messages. Close it."""

    OVER: ClassVar[Mapping[int, str]]  # final states, and the reason of the failure
    repeats: ClassVar[bool]  # whether it sends the status of its goals again and again
    types: Mapping[str, str]  # topics of status and result -> type
    name: str  # for people

    def __init__(self, where: str) -> None:
        self._where = where
        self._goal: _Goal | None = None
        self._lock = threading.RLock()
        self._alive = 0.0  # [s] of time.monotonic() when the server was last there
        self._warned = set[str]()  # topics

    @property
    @abstractmethod
    def ready(self) -> bool:
        """Whether it takes goals."""

    @property
    @abstractmethod
    def missing(self) -> str:
        """The missing part where it is not ready."""

    def wanted(self, topics: Mapping[str, str]) -> set[str]:
        """Topics of status and result."""
        wanted = {topic for topic, type_ in topics.items() if self.types.get(topic) == type_}
        if wanted and not self.repeats:
            self._alive = time.monotonic()
        return wanted

    def offer(self, raw: RawMessage, *, is_ros1: bool) -> None:
        """Receive a status or result; warns once for each topic with unreadable messages."""
        if self.types.get(raw.topic) != raw.type or len(raw.data) > MAX_SIZE:
            return
        self._alive = time.monotonic()
        try:
            self._read(decoded(raw, is_ros1, self._where))
        except (RecordingError, AttributeError, TypeError, ValueError) as error:
            if raw.topic not in self._warned:
                self._warned.add(raw.topic)
                _log.warning("%s: messages of %s are skipped: %s", self.name, raw.topic, error)

    @abstractmethod
    def _read(self, message: Any) -> None:
        """Take the status of goals from a message."""

    def send(self, pose: GoalPose) -> None:
        """Send a goal; one under way is replaced."""
        with self._lock:
            self._goal = _Goal(self._new_id())
            self._send(self._goal, pose)

    def outcome(self) -> str | None:
        """Reason why the goal failed, "" after success; None without a goal or under way.

        Raises RobotError where the server died with the goal under way, or takes none.
        """
        with self._lock:
            goal, now = self._goal, time.monotonic()
            if goal is None or goal.outcome is not None:
                return None if goal is None else goal.outcome
            is_known = self.repeats or goal.is_taken  # else that it is there proves nothing
            if now - (max(self._alive, goal.heard) if is_known else goal.heard) > GONE:
                why = "is gone, with a goal under way" if is_known else "takes no goals"
                raise RobotError(f"{self.name} {why}; start it, then search --resume")
            if self.repeats and self._alive - goal.heard > ANSWER:
                goal.outcome = f"{self.name} has not named its goal for {ANSWER:g} s"
            return goal.outcome

    def way(self) -> OnTheWay | None:
        """News of the way to the goal: now and then, and each time that navigation got free."""
        with self._lock:
            goal, now = self._goal, time.monotonic()
            if goal is None or goal.way is None or goal.outcome is not None:
                return None
            if now - goal.told < TOLD and goal.way.recoveries <= goal.recoveries:
                return None
            goal.told, goal.recoveries = now, goal.way.recoveries
            return goal.way

    def cancel(self, here: GoalPose | None) -> None:
        """Cancel our goal under way, if any; goals of other clients go on.

        `here` is where the robot is now, if known.
        """
        with self._lock:
            goal, self._goal = self._goal, None
            if goal is not None and goal.outcome is None:
                self._cancel(goal, here)

    @abstractmethod
    def close(self) -> None:
        """Leave."""

    def _new_id(self) -> str:
        return uuid.uuid4().hex

    @abstractmethod
    def _send(self, goal: _Goal, pose: GoalPose) -> None:
        """Send a goal."""

    @abstractmethod
    def _cancel(self, goal: _Goal, here: GoalPose | None) -> None:
        """Cancel a goal that is under way."""

    def _update(self, number: str, status: int, text: str = "") -> None:
        with self._lock:
            goal = self._goal
            if goal is None or not number or goal.id != number or goal.outcome is not None:
                return
            goal.heard, goal.is_taken = time.monotonic(), True
            if status in self.OVER:
                why, details = self.OVER[status], cleaned(text)
                goal.outcome = f"{why}: {details}" if why and details else why


class MoveBase(Navigation):
    """Client of move_base's action server, or of another with its messages."""

    #: of actionlib_msgs/GoalStatus
    OVER = {  # noqa: RUF012 a table
        2: "navigation was preempted: somebody gave another goal or cancelled this one",
        3: "",
        4: "navigation aborted",
        5: "navigation rejected the goal",
        8: "navigation was cancelled before it began",
        9: "navigation lost the goal",
    }
    repeats = True

    def __init__(self, master: Ros1Master, name: str = "/move_base") -> None:
        super().__init__(master.address)
        self.name = name.rstrip("/") or "/"
        self.types = {f"{self.name}/status": _STATUS, f"{self.name}/result": _RESULT}
        self._goal_topic, self._cancel_topic = f"{self.name}/goal", f"{self.name}/cancel"
        topics = {self._goal_topic: _GOAL, self._cancel_topic: _CANCEL}
        self._publisher = master.publisher(topics)
        self._maker = MessageMaker(is_ros1=True)

    @property
    def ready(self) -> bool:
        """Whether a node subscribes to goals."""
        return bool(self._publisher.subscribers(self._goal_topic))

    @property
    def missing(self) -> str:
        """The missing part where it is not ready."""
        return f"nobody takes goals of {self._goal_topic} (--navigation)"

    def close(self) -> None:
        """Leave the master."""
        self._publisher.close()

    def _read(self, message: Any) -> None:
        states = message.status_list if hasattr(message, "status_list") else [message.status]
        for state in states:
            self._update(str(state.goal_id.id), int(state.status), str(state.text))

    def _new_id(self) -> str:
        return f"hereabouts-{os.getpid()}-{time.time_ns()}"

    def _send(self, goal: _Goal, pose: GoalPose) -> None:
        target = pose.fields(self._maker)
        named = {"stamp": target["header"]["stamp"], "id": goal.id}
        message = self._maker.make(
            _GOAL, header=target["header"], goal_id=named, goal={"target_pose": target}
        )
        self._publisher.publish(self._goal_topic, message)

    def _cancel(self, goal: _Goal, here: GoalPose | None) -> None:
        self._publisher.publish(self._cancel_topic, self._maker.make(_CANCEL, id=goal.id))


class Nav2(Navigation):
    """Base of clients of Nav2's action navigate_to_pose."""

    #: of action_msgs/GoalStatus
    OVER = {  # noqa: RUF012 a table
        4: "",
        5: "navigation was cancelled: somebody gave another goal or cancelled this one",
        6: "navigation aborted",
    }
    repeats = False  # it sends what changes

    def __init__(self, where: str, name: str = "/navigate_to_pose") -> None:
        super().__init__(where)
        self.name = name.rstrip("/") or "/"
        self._status = f"{self.name}/_action/status"
        feedback = f"{self.name}/_action/feedback"
        self.types = {self._status: _NAV2_STATUS, feedback: _NAV2_FEEDBACK}
        self._maker = MessageMaker(is_ros1=False)

    def _read(self, message: Any) -> None:
        if hasattr(message, "status_list"):
            self._read_status(message)
            return
        left, goal = message.estimated_time_remaining, self._goal
        seconds, distance = left.sec + left.nanosec / NANOSECONDS, float(message.distance_remaining)
        if goal is not None and goal.id == _hex(message.goal_id) and math.isfinite(distance):
            with self._lock:
                goal.way = OnTheWay(distance, seconds, int(message.number_of_recoveries))

    def _read_status(self, message: Any) -> None:
        for state in message.status_list:
            self._update(_hex(state.goal_info.goal_id), int(state.status))


class Nav2Topics(Nav2):
    """Nav2 over DDS, by topics alone.

    It takes the first goal of the action that appears after ours for ours. It has no topic to
    cancel by: to end, the robot is sent to where it is.
    """

    GOAL: Final = "/goal_pose"

    def __init__(self, domain: Ros2Domain, name: str = "/navigate_to_pose") -> None:
        super().__init__(domain.address, name)
        self._seen = set[str]()  # ids of goals
        self._publisher = domain.publisher({self.GOAL: "geometry_msgs/msg/PoseStamped"})

    @property
    def ready(self) -> bool:
        """Whether a node subscribes to goals, and status is published."""
        return self._alive > 0 and self._publisher.subscribers(self.GOAL) > 0

    @property
    def missing(self) -> str:
        """The missing part where it is not ready."""
        return f"nobody subscribes to {self.GOAL}, or publishes {self._status} (--navigation)"

    def close(self) -> None:
        """Leave the domain."""
        self._publisher.close()

    def _read_status(self, message: Any) -> None:
        with self._lock:
            ids = [_hex(state.goal_info.goal_id) for state in message.status_list]
            new = [number for number in ids if number not in self._seen]
            self._seen.update(new)
            if new and self._goal is not None and not self._goal.id:
                self._goal.id = new[-1]
        super()._read_status(message)

    def _new_id(self) -> str:
        return ""  # the server gives it

    def _send(self, goal: _Goal, pose: GoalPose) -> None:
        message = self._maker.make("geometry_msgs/msg/PoseStamped", **pose.fields(self._maker))
        self._publisher.publish(self.GOAL, message)

    def _cancel(self, goal: _Goal, here: GoalPose | None) -> None:
        if here is not None:
            self._send(goal, here)


class Nav2Services(Nav2):
    """Nav2 behind foxglove_bridge, by the hidden services of its action."""

    def __init__(self, bridge: FoxgloveConnection, name: str = "/navigate_to_pose") -> None:
        super().__init__(bridge.address, name)
        self._bridge = bridge

    @property
    def ready(self) -> bool:
        """Whether the bridge passes the action on."""
        return self._bridge.services.has(self._service("send_goal")) and self._alive > 0

    @property
    def missing(self) -> str:
        """The missing part where it is not ready."""
        return (
            f"the server passes on no service {self._service('send_goal')}; a foxglove_bridge with "
            "include_hidden:=true does, where Nav2 runs (--navigation)"
        )

    def close(self) -> None:
        """Nothing: the connection belongs to the robot."""

    def _service(self, name: str) -> str:
        return f"{self.name}/_action/{name}"

    def _send(self, goal: _Goal, pose: GoalPose) -> None:
        number = {"uuid": list(bytes.fromhex(goal.id))}
        fields = {"goal_id": number, "pose": pose.fields(self._maker)}

        def answered(answer: bytes | str) -> None:
            if isinstance(answer, str):  # the viewpoint has no part in it
                _log.warning("%s does not answer: %s", self.name, cleaned(answer))
                return
            is_accepted = answer[4:5] == b"\x01"  # after CDR's header
            why = "" if is_accepted else "navigation rejected the goal"
            with self._lock:
                goal.heard, goal.is_taken = time.monotonic(), not why
                goal.outcome = why or goal.outcome

        self._call("send_goal", "nav2_msgs/msg/SendGoalRequest", fields, answered)

    def _cancel(self, goal: _Goal, here: GoalPose | None) -> None:
        number = {"uuid": list(bytes.fromhex(goal.id))}
        self._call("cancel_goal", "action_msgs/msg/GoalInfo", {"goal_id": number}, lambda _: None)

    def _call(self, service: str, kind: str, fields: dict[str, Any], answered: Any) -> None:
        data = serialised(kind, self._maker.make(kind, **fields), is_ros1=False)
        try:
            self._bridge.services.call(self._service(service), data, answered)
        except RecordingError as error:
            _log.warning("%s: %s", self.name, error)


def _hex(number: Any) -> str:
    return bytes(number.uuid).hex()

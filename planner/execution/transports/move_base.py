"""Client of move_base by actionlib's topics: goal, cancel, status, result (wiki.ros.org/actionlib).

There is one goal at a time. It ends by a status or result, or once no status has named it for
ANSWER seconds, after a restart of move_base for example.
"""

from __future__ import annotations

import logging
import math
import os
import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

from kg.model.errors import RecordingError
from perception.sources.bags.bag_file import RawMessage, decoded, message_types
from perception.sources.live.ros1 import Ros1Master
from perception.sources.live.ros1_publisher import Ros1Publisher
from perception.sources.ros.message_maker import MessageMaker
from planner.execution.protocol import cleaned

ANSWER: Final = 5.0  # [s] without a status of the goal after which it has failed
MAX_SIZE: Final = 1 << 20  # [bytes]
_STATUS: Final = "actionlib_msgs/msg/GoalStatusArray"
_RESULT: Final = "move_base_msgs/msg/MoveBaseActionResult"
_GOAL: Final = "move_base_msgs/msg/MoveBaseActionGoal"
_CANCEL: Final = "actionlib_msgs/msg/GoalID"
SUCCEEDED: Final = 3
#: final states of actionlib_msgs/GoalStatus, and the reason of the failure
_OVER: Final = {
    2: "navigation was preempted: somebody gave another goal or cancelled this one",
    SUCCEEDED: "",
    4: "navigation aborted",
    5: "navigation rejected the goal",
    8: "navigation was cancelled before it began",
    9: "navigation lost the goal",
}

_log = logging.getLogger(__name__)


@dataclass(slots=True)
class _Goal:
    id: str
    heard: float  # [s] of time.monotonic(), when it was sent or last named
    outcome: str | None = None  # reason of its failure, "" after success; None: under way


class MoveBase:
    """Client of move_base's action server; an `Inbox` of its messages."""

    def __init__(self, master: Ros1Master, name: str = "/move_base") -> None:
        self.name = name.rstrip("/") or "/"
        self._master = master
        self._goal_topic, self._cancel_topic = f"{self.name}/goal", f"{self.name}/cancel"
        self._publisher = Ros1Publisher(
            master, {self._goal_topic: _GOAL, self._cancel_topic: _CANCEL}
        )
        self._maker = MessageMaker(message_types(True), is_ros1=True)
        self._goal: _Goal | None = None
        self._lock = threading.Lock()
        self._warned = set[str]()  # topics

    @property
    def ready(self) -> bool:
        """Whether a node subscribes to goals."""
        return self._publisher.subscribers(self._goal_topic) > 0

    def wanted(self, topics: Mapping[str, str]) -> set[str]:
        """Topics of status and result."""
        known = {f"{self.name}/status": _STATUS, f"{self.name}/result": _RESULT}
        return {topic for topic, type_ in topics.items() if known.get(topic) == type_}

    def offer(self, raw: RawMessage, *, is_ros1: bool) -> None:
        """Receive a status or result; warns once for each topic with unreadable messages."""
        if raw.type not in (_STATUS, _RESULT) or len(raw.data) > MAX_SIZE:
            return
        try:
            message = decoded(raw, is_ros1, self._master.address)
            states = message.status_list if raw.type == _STATUS else [message.status]
            for state in states:
                self._update(str(state.goal_id.id), int(state.status), str(state.text))
        except (RecordingError, AttributeError, TypeError, ValueError) as error:
            if raw.topic not in self._warned:
                self._warned.add(raw.topic)
                _log.warning("%s: messages of %s are skipped: %s", self.name, raw.topic, error)

    def send(self, x: float, y: float, heading: float, frame: str, stamp: int) -> None:
        """Send a goal: a pose [m, rad] in `frame` at `stamp` [ns]; one under way is replaced."""
        goal = _Goal(f"hereabouts-{os.getpid()}-{time.time_ns()}", time.monotonic())
        with self._lock:
            self._goal = goal
        make = self._maker.make
        position = make("geometry_msgs/msg/Point", x=x, y=y, z=0.0)
        z, w = math.sin(heading / 2), math.cos(heading / 2)
        turned = make("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=z, w=w)
        pose = make(
            "geometry_msgs/msg/PoseStamped",
            header=self._maker.header(stamp, frame),
            pose=make("geometry_msgs/msg/Pose", position=position, orientation=turned),
        )
        message = make(
            _GOAL,
            header=self._maker.header(stamp, frame),
            goal_id=self._id(goal, stamp),
            goal=make("move_base_msgs/msg/MoveBaseGoal", target_pose=pose),
        )
        self._publisher.publish(self._goal_topic, message)

    def outcome(self) -> str | None:
        """Reason why the goal failed, "" after success; None without a goal or under way."""
        with self._lock:
            goal = self._goal
            if goal is None or goal.outcome is not None:
                return None if goal is None else goal.outcome
            if time.monotonic() - goal.heard > ANSWER:
                goal.outcome = f"{self.name} has not named its goal for {ANSWER:g} s"
            return goal.outcome

    def cancel(self) -> None:
        """Cancel our goal under way, if any; goals of other clients go on."""
        with self._lock:
            goal, self._goal = self._goal, None
        if goal is not None and goal.outcome is None:
            self._publisher.publish(self._cancel_topic, self._id(goal, 0))

    def close(self) -> None:
        """Cancel the goal under way, and leave."""
        self.cancel()
        self._publisher.close()

    def _id(self, goal: _Goal, stamp: int) -> Any:
        return self._maker.make(_CANCEL, stamp=self._maker.time(stamp), id=goal.id)

    def _update(self, number: str, status: int, text: str) -> None:
        with self._lock:
            goal = self._goal
            if goal is None or goal.id != number or goal.outcome is not None:
                return
            goal.heard = time.monotonic()
            if status in _OVER:
                why, details = _OVER[status], cleaned(text)
                goal.outcome = f"{why}: {details}" if why and details else why

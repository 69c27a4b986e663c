"""A stand-in for Nav2 in a house: it speaks the protocol of the action, over DDS or Foxglove.

It is not Nav2. Over DDS it takes /goal_pose, as Nav2's bt_navigator does, by Cyclone DDS or by Fast
DDS, whose services no other vendor calls; as foxglove_bridge does
with include_hidden, it serves the action's hidden services, with the server of Foxglove's own SDK.
"""

import math
import threading
import uuid
from collections.abc import Mapping
from types import SimpleNamespace
from typing import Any

import foxglove
from foxglove import Channel, Schema
from foxglove.websocket import Capability, MessageSchema, ServerListener, Service, ServiceSchema

from lab.robot.ros1_node import PREEMPTED, RECALLED, REJECTED, SUCCEEDED, Ros1HouseNode
from perception.sources.live.ros2 import Ros2Domain
from perception.sources.live.ros2_publisher import Ros2Publisher
from perception.sources.ros.message_maker import MessageMaker
from perception.sources.ros.message_types import message_types, serialised
from tests.perception.sources.live.fast_dds import FastDdsPeer

ACTION = "/navigate_to_pose/_action"
STATUS, FEEDBACK = f"{ACTION}/status", f"{ACTION}/feedback"
SERVER = {
    STATUS: "action_msgs/msg/GoalStatusArray",
    FEEDBACK: "nav2_msgs/action/NavigateToPose_FeedbackMessage",
}
GOAL = "geometry_msgs/msg/PoseStamped"
#: of action_msgs/GoalStatus, for those of move_base; ABORTED for all others
STATES = {1: 2, SUCCEEDED: 4, PREEMPTED: 5, RECALLED: 5}
LATCHED = frozenset(["/tf_static", STATUS])


class Nav2HouseNode(Ros1HouseNode):
    """The robot of a ROS 2 domain."""

    def _join(self, master: Ros2Domain) -> None:
        self._maker, self._master = MessageMaker(is_ros1=False), master
        self._told: list[tuple[str, int]] = []
        self._publisher = self._opened(self.CAMERA_AND_TF)
        self._server = self._opened(SERVER)

    def _opened(self, topics: Mapping[str, str]) -> Any:
        return Ros2Publisher(self._master, topics, LATCHED)

    def _listen(self, ended: threading.Event) -> None:
        self._master.run(self, ended)

    def kill_server(self) -> None:
        """Let the action's server die; camera and tf go on."""
        self._server.close()

    def run(self, ended: threading.Event) -> None:
        try:
            super().run(ended)
        finally:
            self._server.close()

    def wanted(self, topics: Mapping[str, str]) -> set[str]:
        return {topic for topic in topics if topic == "/goal_pose"}

    def _take_orders(self) -> None:
        while self._orders:
            kind, message = self._orders.popleft()
            if kind == "cancel":
                self._cancel(message)
                continue
            number, target = message if kind == "goal" else (uuid.uuid4().hex, message)
            goal = SimpleNamespace(target_pose=target)
            self.take(SimpleNamespace(goal_id=SimpleNamespace(id=number), goal=goal))

    def take(self, goal: Any) -> None:
        """Begin to drive to a goal, and tell that."""
        self._begin(goal)
        self._publish_status()

    def _move(self) -> None:
        super()._move()
        if (goal := self._active) is not None:
            end = goal.way[-1]
            feedback = {
                "goal_id": {"uuid": list(bytes.fromhex(goal.id.id))},
                "estimated_time_remaining": {"sec": round(end.seconds - self.seconds)},
                "number_of_recoveries": len(self._goals),  # more with each goal
                "distance_remaining": math.dist(end.xy, self.pose.xy),
            }
            made = self._maker.make(SERVER[FEEDBACK], **feedback)
            self._server.publish(FEEDBACK, made)

    def _end(self, goal: Any, status: int, text: str) -> None:
        goal.status, goal.text = status, text
        self._publish_status()

    def _publish_status(self) -> None:
        now = [(g.id.id, STATES.get(g.status, 6)) for g in self._goals if g.status != REJECTED]
        if now != self._told:  # as Nav2, once for each change
            self._told = now
            listed = [
                {"goal_info": {"goal_id": {"uuid": list(bytes.fromhex(number))}}, "status": state}
                for number, state in now
            ]
            made = self._maker.make(SERVER[STATUS], status_list=listed)
            self._server.publish(STATUS, made)


class FastHouseNode(Nav2HouseNode):
    """The robot of a ROS 2 domain whose nodes speak by Fast DDS."""

    def _opened(self, topics: Mapping[str, str]) -> Any:
        return FastDdsPeer(self._master, topics, LATCHED)

    def _listen(self, ended: threading.Event) -> None:
        self._publisher.subscribe(
            "/goal_pose", GOAL, lambda goal: self._orders.append((GOAL, goal))
        )
        ended.wait()


class BridgedHouseNode(Nav2HouseNode):
    """The robot behind a stand-in of foxglove_bridge; `url` is its address."""

    def _join(self, master: Ros2Domain) -> None:
        super()._join(master)
        self.url = self._publisher.url

    def _opened(self, topics: Mapping[str, str]) -> Any:
        return self._publisher.server if topics is SERVER else _Bridge(topics, self._orders.append)

    def _listen(self, ended: threading.Event) -> None:
        """Nothing: the services' handlers get goals."""


class _Bridge(ServerListener):
    def __init__(self, topics: Mapping[str, str], order: Any) -> None:
        self._context, self._order = foxglove.Context(), order
        self._server = foxglove.start_server(
            host="127.0.0.1", port=0, capabilities=[Capability.Services],
            supported_encodings=["cdr"], server_listener=self, context=self._context,
        )  # fmt: skip
        self._last: dict[str, bytes] = {}
        self._topics = dict(topics)
        self._channels = {topic: self._channel(topic) for topic in topics}
        self.url, self.server = f"ws://127.0.0.1:{self._server.port}", _BridgedServer(self)

    def _channel(self, topic: str) -> Channel:
        kind = _schema(self._topics[topic])
        return Channel(topic, schema=kind, message_encoding="cdr", context=self._context)

    def begin_action(self) -> None:
        """Pass on the topics and services of the action."""
        self._topics |= SERVER
        self._channels |= {topic: self._channel(topic) for topic in SERVER}
        handlers = {"send_goal": self._goal, "cancel_goal": self._cancelled}
        plain = MessageSchema(encoding="cdr", schema=_schema(GOAL))
        kind = ServiceSchema("any", request=plain, response=plain)
        names = {f"{ACTION}/{name}": handler for name, handler in handlers.items()}
        self._server.add_services(
            [Service(name, schema=kind, handler=handler) for name, handler in names.items()]
        )

    def end_action(self) -> None:
        """The action is gone."""
        self._server.remove_services([f"{ACTION}/send_goal", f"{ACTION}/cancel_goal"])
        for topic in SERVER:
            self._channels.pop(topic).close()

    def _goal(self, request: Any) -> bytes:
        sent = message_types(False).deserialize_cdr(
            request.payload, "nav2_msgs/msg/SendGoalRequest"
        )
        self._order(("goal", (bytes(sent.goal_id.uuid).hex(), sent.pose)))
        return b"\x00\x01\x00\x00\x01" + bytes(11)  # accepted, and a stamp

    def _cancelled(self, request: Any) -> bytes:
        sent = message_types(False).deserialize_cdr(request.payload, "action_msgs/msg/GoalInfo")
        self._order(("cancel", bytes(sent.goal_id.uuid).hex()))
        return b"\x00\x01\x00\x00" + bytes(8)

    def on_subscribe(self, client: object, channel: Any) -> None:
        if channel.topic in LATCHED and channel.topic in self._last:
            self._channels[channel.topic].log(self._last[channel.topic])

    def publish(self, topic: str, message: Any) -> None:
        if topic not in self._channels:
            return  # of an action that is gone
        self._last[topic] = serialised(self._topics[topic], message, is_ros1=False)
        self._channels[topic].log(self._last[topic])

    def close(self) -> None:
        self._server.stop()


class _BridgedServer:
    """The action's server, as the bridge passes it on."""

    def __init__(self, bridge: _Bridge) -> None:
        self._bridge, self._is_there = bridge, True
        bridge.begin_action()

    def publish(self, topic: str, message: Any) -> None:
        self._bridge.publish(topic, message)

    def close(self) -> None:
        if self._is_there:
            self._is_there = False
            self._bridge.end_action()


def _schema(kind: str) -> Schema:
    definition = message_types(False).generate_msgdef(kind, ros_version=2)[0]
    return Schema(name=kind, encoding="ros2msg", data=definition.encode())

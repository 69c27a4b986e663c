"""Publisher of ROS 2 topics over DDS, without ROS; through Eclipse Cyclone DDS."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from typing import Any, Final

from perception.sources.live.ros2 import TOPIC_PREFIX, Ros2Domain, idl_type, network_errors
from perception.sources.ros.message_types import serialised

MAX_BLOCKING: Final = 0.1  # [s] that a message may wait for subscribers that are slow
KEPT: Final = 10  # messages of a topic that is not latched
HEADER: Final = 4  # [bytes] of CDR's encapsulation


class Ros2Publisher:
    """A participant that publishes `types` (topic -> type, e.g. sensor_msgs/msg/Image); close it.

    All topics are reliable. Those of `latched` are transient local: later subscribers that ask for
    it get the last message. Raises RecordingError without a network.
    """

    def __init__(
        self, domain: Ros2Domain, types: Mapping[str, str], latched: frozenset[str] = frozenset()
    ) -> None:
        self._types, self._lock = dict(types), threading.Lock()
        with network_errors(domain.address):
            self._participant = domain.joined()
            self._writers = {t: self._writer(t, latched=t in latched) for t in types}

    def _writer(self, topic: str, *, latched: bool) -> Any:
        from cyclonedds.pub import DataWriter
        from cyclonedds.qos import Policy, Qos
        from cyclonedds.topic import Topic
        from cyclonedds.util import duration

        durability = Policy.Durability
        quality = Qos(
            Policy.Reliability.Reliable(duration(seconds=MAX_BLOCKING)),
            durability.TransientLocal if latched else durability.Volatile,
            Policy.History.KeepLast(1 if latched else KEPT),
            Policy.DataRepresentation(use_cdrv0_representation=True),
        )
        made = Topic(self._participant, f"{TOPIC_PREFIX}{topic}", idl_type(self._types[topic]))
        return DataWriter(self._participant, made, qos=quality)

    def subscribers(self, topic: str) -> int:
        """Number of a topic's subscribers now."""
        return len(self._writers[topic].get_matched_subscriptions())

    def publish(self, topic: str, message: Any) -> None:
        """Send a message of the topic's type; subscribers that are too slow miss it."""
        from cyclonedds.core import DDSException

        data = serialised(self._types[topic], message, is_ros1=False)
        with self._lock:
            if not self._writers:  # closed while a thread was publishing
                return
            try:
                self._writers[topic].write(idl_type(self._types[topic]).of(data))
            except DDSException as error:
                if error.code != DDSException.DDS_RETCODE_TIMEOUT:
                    raise

    def set_parameter(self, name: str, value: Any) -> None:
        """Nothing: ROS 2 has no parameters of a network."""

    def close(self) -> None:
        """Leave the domain."""
        with self._lock:
            if not self._writers:
                return
            self._writers.clear()
            del self._participant

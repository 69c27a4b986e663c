"""ROS 2: topics over DDS, without ROS; through Eclipse Cyclone DDS.

ROS 2 maps the topic /tf to rt/tf, the type sensor_msgs/msg/Image to
sensor_msgs::msg::dds_::Image_, and a message to its CDR (design.ros2.org: Topic and Service name
mapping to DDS). Types are made from the definitions that bags use too; messages are received as
bytes and decoded like those of bags.
"""

from __future__ import annotations

import logging
import os
import re
import socket
import threading
import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from typing import Any, Final
from xml.sax.saxutils import quoteattr

from kg.model.errors import RecordingError
from perception.sources.bags.bag_file import RawMessage
from perception.sources.bags.bag_index import WITH_IMAGES
from perception.sources.live.connection import MAX_WARNINGS, Inbox, max_size
from perception.sources.ros.message_types import message_types

ALONE: Final = 5.0  # [s] without any topic after which that is told
OURS: Final = ("/hereabouts/", "/tf_static", "/goal_pose")  # topics that we publish, too
POLL: Final = 0.2  # [s] between two readings of the publishers
MAX_READERS: Final = 100
MAX_WRITERS: Final = 10_000
MAX_DOMAIN: Final = 232
TAKEN: Final = 32  # messages of a topic at once
KEPT: Final = {True: 5, False: 100}  # messages of a topic that wait, of images and others
TOPIC_PREFIX: Final = "rt"
_TYPE: Final = re.compile(r"(\w+)::(msg|action)::dds_::(\w+)_")

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class _Topic:
    """A topic, with the quality of service that all its publishers offer."""

    name: str  # e.g. /tf
    type: str  # e.g. tf2_msgs/msg/TFMessage
    reliable: bool
    durable: bool  # whether later subscribers get its last messages too


@dataclass(frozen=True, slots=True)
class Ros2Domain:
    """A ROS 2 domain: all publishers that this computer reaches over its network.

    CYCLONEDDS_URI configures the network, as it does for ROS 2 with rmw_cyclonedds; without it,
    ROS_LOCALHOST_ONLY, ROS_AUTOMATIC_DISCOVERY_RANGE and ROS_STATIC_PEERS do.
    """

    number: int

    @classmethod
    def at(cls, address: str) -> Ros2Domain:
        """The domain ros2://NUMBER, or "ros2": that of ROS_DOMAIN_ID, else 0.

        Raises RecordingError for anything else.
        """
        text = address.removeprefix("ros2").removeprefix("://").rstrip("/")
        text = text or os.environ.get("ROS_DOMAIN_ID", "") or "0"
        if not text.isdecimal() or int(text) > MAX_DOMAIN:
            raise RecordingError(
                f"{text!r} is no ROS 2 domain; ros2://0 is one, up to {MAX_DOMAIN}"
            )
        return cls(int(text))

    @property
    def address(self) -> str:
        """The address, for messages."""
        return f"ros2://{self.number}"

    def run(self, inbox: Inbox, ended: threading.Event) -> None:
        """Offer messages to `inbox` until `ended`; raises RecordingError without a network."""
        with network_errors(self.address):
            _Participant(self.joined(), self.number, inbox).run(ended)

    def publisher(self, types: Mapping[str, str], latched: frozenset[str] = frozenset()) -> Any:
        """A `Ros2Publisher` of this domain."""
        from perception.sources.live.ros2_publisher import Ros2Publisher

        return Ros2Publisher(self, types, latched)

    def joined(self) -> Any:
        """A participant of the domain; raises DDSException without a network."""
        from cyclonedds.domain import DomainParticipant

        settings = network_settings(os.environ)
        if settings and not os.environ.get("CYCLONEDDS_URI"):
            os.environ["CYCLONEDDS_URI"] = settings  # where Cyclone DDS looks
        return DomainParticipant(self.number)


_PEERS: Final = """<CycloneDDS><Domain>{general}
<Discovery><ParticipantIndex>auto</ParticipantIndex>
<MaxAutoParticipantIndex>32</MaxAutoParticipantIndex>
<Peers>{peers}</Peers></Discovery></Domain></CycloneDDS>"""
_LOCAL: Final = """<General><Interfaces><NetworkInterface name="lo" multicast="false"/></Interfaces>
<AllowMulticast>false</AllowMulticast></General>"""


def network_settings(variables: Mapping[str, str]) -> str:
    """Configuration of Cyclone DDS by ROS' own environment variables; "" for its defaults.

    Raises RecordingError where they turn discovery off.
    """
    reach = variables.get("ROS_AUTOMATIC_DISCOVERY_RANGE", "").upper()
    peers = [peer for peer in variables.get("ROS_STATIC_PEERS", "").split(";") if peer]
    is_local = variables.get("ROS_LOCALHOST_ONLY", "0") not in ("", "0") or reach == "LOCALHOST"
    if reach == "OFF":
        raise RecordingError(
            "ROS_AUTOMATIC_DISCOVERY_RANGE=OFF finds no robot; SUBNET or LOCALHOST would work"
        )
    peers = ["127.0.0.1"] if is_local else peers
    listed = "".join(f"<Peer address={quoteattr(peer)}/>" for peer in peers)
    return _PEERS.format(general=_LOCAL if is_local else "", peers=listed) if peers else ""


@contextmanager
def network_errors(address: str) -> Iterator[None]:
    """Turn errors of DDS into a RecordingError about the domain at `address`."""
    from cyclonedds.core import DDSException

    try:
        yield
    except DDSException as error:
        reason = " ".join(str(error).split())
        raise RecordingError(
            f"{address}: {reason[:200]}; CYCLONEDDS_URI may name a network interface"
        ) from error


class _Participant:
    """Participant of a domain: reads its publications, and each topic that is wanted."""

    def __init__(self, participant: Any, domain: int, inbox: Inbox) -> None:
        from cyclonedds.builtin import BuiltinDataReader, BuiltinTopicDcpsPublication
        from cyclonedds.core import InstanceState, ReadCondition, SampleState, ViewState, WaitSet

        self._inbox, self._domain = inbox, domain
        self._participant, self._began = participant, time.monotonic()
        self._is_alone = True  # whether no topic of others was seen, and that was not told
        self._writers = BuiltinDataReader(self._participant, BuiltinTopicDcpsPublication)
        alive = InstanceState.Alive | SampleState.Any | ViewState.Any
        self._alive = ReadCondition(self._writers, alive)
        self._news = InstanceState.Any | SampleState.NotRead | ViewState.Any
        self._waiting = WaitSet(self._participant)
        self._warned = set[_Topic]()
        self._readers: dict[_Topic, tuple[Any, Any]] = {}  # reader, and its condition

    def run(self, ended: threading.Event) -> None:
        subscribed = 0.0
        while not ended.is_set():
            if time.monotonic() >= subscribed + POLL:
                self._subscribe()
                subscribed = time.monotonic()
            self._waiting.wait(round(POLL * 1e9))
            for topic, (reader, _) in self._readers.items():
                for sample in reader.take(TAKEN):
                    self._received(topic, getattr(sample, "cdr", None))

    def _subscribe(self) -> None:
        """Make readers of the topics that are wanted now, and close all others."""
        from cyclonedds.core import DDSException, ReadCondition

        there = topics_of(self._writers.read(MAX_WRITERS, self._alive))
        if self._is_alone and any(not topic.name.startswith(OURS) for topic in there):
            self._is_alone = False
        if self._is_alone and time.monotonic() > self._began + ALONE:
            self._is_alone = False
            _log.warning("ros2://%d: %s", self._domain, _unheard(self._domain))
        names = self._inbox.wanted({topic.name: topic.type for topic in there})
        wanted = [topic for topic in there if topic.name in names][:MAX_READERS]
        for topic in self._readers.keys() - wanted:
            self._waiting.detach(self._readers.pop(topic)[1])
        for topic in wanted:
            if topic not in self._readers:
                try:
                    reader = self._reader(topic)
                except DDSException as error:  # e.g. of a type that it had not before
                    self._warn(topic, error)
                    continue
                condition = ReadCondition(reader, self._news)
                self._waiting.attach(condition)
                self._readers[topic] = reader, condition

    def _reader(self, topic: _Topic) -> Any:
        from cyclonedds.qos import Policy, Qos
        from cyclonedds.sub import DataReader
        from cyclonedds.topic import Topic
        from cyclonedds.util import duration

        reliable = Policy.Reliability.Reliable(duration(seconds=1))
        durability = Policy.Durability
        quality = Qos(
            reliable if topic.reliable else Policy.Reliability.BestEffort,
            durability.TransientLocal if topic.durable else durability.Volatile,
            Policy.History.KeepLast(KEPT[topic.type in WITH_IMAGES]),
            Policy.DataRepresentation(use_cdrv0_representation=True),
        )
        made = Topic(self._participant, f"{TOPIC_PREFIX}{topic.name}", idl_type(topic.type))
        return DataReader(self._participant, made, qos=quality)

    def _warn(self, topic: _Topic, error: object) -> None:
        if topic not in self._warned and len(self._warned) < MAX_WARNINGS:
            self._warned.add(topic)
            reason = " ".join(str(error).split())[:200]
            _log.warning("%s of type %s cannot be read: %s", topic.name, topic.type, reason)

    def _received(self, topic: _Topic, data: bytes | None) -> None:
        if data is not None and len(data) <= max_size(topic.type):
            raw = RawMessage(topic.name, topic.type, time.time_ns(), data)
            self._inbox.offer(raw, is_ros1=False)


def _unheard(domain: int) -> str:
    """Advice where no topic is seen."""
    where = "as CYCLONEDDS_URI has it"
    if not os.environ.get("CYCLONEDDS_URI"):
        try:
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
                probe.connect(("239.255.0.1", 7400))  # where discovery goes; sends nothing
                where = f"through the interface of {probe.getsockname()[0]}"
        except OSError:
            where = "for lack of a network"
    served = "a discovery server (ROS_DISCOVERY_SERVER), " * ("ROS_DISCOVERY_SERVER" in os.environ)
    return (
        f"no topic of ROS 2 is seen in domain {domain}, {where}; ROS_DOMAIN_ID and CYCLONEDDS_URI "
        f"choose others, and robots with {served}Zenoh or behind a router need foxglove_bridge "
        "(ws://ROBOT:8765)"
    )


def topics_of(writers: Iterable[Any]) -> list[_Topic]:
    """Topics of known types, each with the quality of service that all its writers offer."""
    from cyclonedds.qos import Policy

    known = message_types(False).fielddefs
    found = dict[str, _Topic]()
    for writer in writers:
        name, match = str(writer.topic_name), _TYPE.fullmatch(str(writer.type_name))
        kind = "/".join(match.groups()) if match else ""
        if not name.startswith(f"{TOPIC_PREFIX}/") or kind not in known:
            continue
        # an image is large and soon outdated: a lost one is not sent again
        reliable = Policy.Reliability.BestEffort not in writer.qos and kind not in WITH_IMAGES
        durable = reliable and Policy.Durability.TransientLocal in writer.qos
        before = found.setdefault(
            name, _Topic(name.removeprefix(TOPIC_PREFIX), kind, reliable, durable)
        )
        if before.type == kind:
            both = before.reliable and reliable, before.durable and durable
            found[name] = _Topic(before.name, kind, *both)
    return list(found.values())


class Sample:
    """A message in its serialised form."""

    def __init__(self, cdr: bytes) -> None:
        self.cdr = cdr  # CDR with its encapsulation header
        self.sample_info: Any = None  # set by cyclonedds


@cache
def idl_type(name: str) -> Any:
    """The type of a message, e.g. sensor_msgs/msg/Image, for cyclonedds; it reads bytes."""
    from cyclonedds.idl import make_idl_struct

    package, part, last = name.split("/")
    _, definition = message_types(False).fielddefs[name]
    fields = {field: _idl_of(node) for field, node in definition}
    typename = f"{package}::{part}::dds_::{last}_"
    made: Any = make_idl_struct(f"{last}_", typename, fields)
    made.deserialize = Sample  # readers call it, and writers:
    made.serialize = lambda sample, use_version_2=None: sample.cdr
    made.of = classmethod(_of_cdr)
    return made


def _of_cdr(kind: Any, cdr: bytes) -> Any:
    """A sample of a type that is serialised already."""
    sample = kind.__new__(kind)
    sample.cdr = cdr
    return sample


def _idl_of(node: tuple[Any, Any]) -> Any:
    """Name of a field's type in cyclonedds.idl."""
    from cyclonedds.idl import types
    from rosbags.interfaces import Nodetype

    kind, content = node
    if kind == Nodetype.BASE:
        plain = {"bool": bool, "string": str, "byte": types.uint8, "char": types.uint8}
        return plain.get(content[0]) or getattr(types, content[0])
    if kind == Nodetype.NAME:
        return idl_type(content)
    holder: Any = types.array if kind == Nodetype.ARRAY else types.sequence
    item, length = _idl_of(content[0]), content[1]
    return holder[item, length] if kind == Nodetype.ARRAY else holder[item]

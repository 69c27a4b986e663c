"""A map that is published to ROS while it changes, as subscribers that come late hear it."""

import argparse
import threading
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import pytest

pytest.importorskip("cyclonedds")
from hereabouts.cli import ros_connections
from hereabouts.cli.ros_connections import connection_to, publish_to
from hereabouts.display.viewers.topic_viewer import published_types
from kg.maps.semantic_map import SemanticMap
from kg.model.errors import RecordingError, UnknownCategoryError
from kg.model.records import MapUpdate
from perception.sources.bags.bag_file import RawMessage, decoded
from tests.perception.sources.live.ros1_master import fake_master
from tests.perception.sources.live.test_ros2 import DOMAIN, LOOPBACK
from tests.waiting import until

T_MAP_ODOM = np.eye(4)
T_MAP_ODOM[:3, 3] = (1.0, 2.0, -0.5)


@pytest.fixture(params=["ros1", "ros2"])
def wire(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    monkeypatch.setenv("CYCLONEDDS_URI", LOOPBACK)
    monkeypatch.setattr(ros_connections, "_PERIOD", 0.05)
    if request.param == "ros2":
        yield f"ros2://{DOMAIN}"
        return
    with fake_master() as master:
        yield master.address.address


class Inbox:
    """The last message of each topic."""

    def __init__(self) -> None:
        self.last: dict[str, Any] = {}

    def wanted(self, topics: Mapping[str, str]) -> set[str]:
        return {t for t in topics if t.startswith("/hereabouts/") or t == "/tf_static"}

    def offer(self, raw: RawMessage, *, is_ros1: bool) -> None:
        self.last[raw.topic] = decoded(raw, is_ros1, raw.topic)


def labels(inbox: Inbox) -> list[str]:
    return [m.text for m in inbox.last["/hereabouts/markers"].markers if m.ns == "labels"]


def test_a_late_subscriber_hears_the_map_and_its_changes(wire: str, kitchen: SemanticMap) -> None:
    asked = ["table", "object/2", "object/99"]
    arguments = argparse.Namespace(publish="", into="kitchen.map", publish_tf=asked)
    publish, inbox, ended = publish_to(arguments, wire), Inbox(), threading.Event()
    source = connection_to(wire)
    assert source is not None
    with publish(kitchen, "odom", lambda: T_MAP_ODOM):
        thread = threading.Thread(target=source.run, args=(inbox, ended))
        thread.start()
        try:
            is_ros1 = wire.startswith("ros1")
            heard = set(published_types(is_ros1=is_ros1)) - {"/hereabouts/surface"}
            until(lambda: inbox.last.keys() >= heard)  # this kitchen has no surface
            things = kitchen.objects(min_existence=0.5)
            objects = inbox.last["/hereabouts/objects"]
            assert objects.header.frame_id == "hereabouts"
            assert [d.bbox.center.position.x for d in objects.detections] == pytest.approx(
                [one.p_map[0] for one in things]
            )
            table = objects.detections[0]
            assert table.bbox.size.x == pytest.approx(1.2)
            if is_ros1:
                assert [d.results[0].id for d in objects.detections] == [0, 1]
                assert inbox.last["/hereabouts/categories_info"].database_version == 2
            else:
                assert table.results[0].hypothesis.class_id == "dining table"
                assert f"{kitchen.base}{table.id}" == things[0].iri
            *frames, placed = inbox.last["/tf_static"].transforms
            assert [one.child_frame_id for one in frames] == ["table", "object_2"]
            assert [one.transform.translation.x for one in frames] == pytest.approx(
                [one.p_map[0] for one in things]
            )
            assert {one.header.frame_id for one in frames} == {"hereabouts"}
            assert (placed.header.frame_id, placed.child_frame_id) == ("odom", "hereabouts")
            moved = placed.transform.translation
            assert (moved.x, moved.y, moved.z) == pytest.approx((-1.0, -2.0, 0.5))
            assert np.asarray(inbox.last["/hereabouts/floor"].data).size
            kitchen.apply(MapUpdate(removed=(things[1].iri,)))
            until(lambda: len(inbox.last["/hereabouts/objects"].detections) == 1)
            until(lambda: labels(inbox) == ["dining table"])
            until(lambda: len(inbox.last["/tf_static"].transforms) == 2)  # object/2 is gone
        finally:
            ended.set()
            thread.join()


@pytest.mark.parametrize("to", ["zmq://here", "kitchen", "ws://127.0.0.1:port", "ros2://robot"])
def test_what_takes_no_messages_is_refused_before_the_map_is_opened(to, tmp_path):
    arguments = argparse.Namespace(publish=to, into="kitchen.map", publish_tf=None)
    with pytest.raises(RecordingError, match=r"would work|is one"):
        publish_to(arguments, str(tmp_path))


def test_frames_of_what_nobody_knows_are_refused(wire: str, kitchen: SemanticMap) -> None:
    arguments = argparse.Namespace(publish="", into="kitchen.map", publish_tf=["cupp"])
    with (
        pytest.raises(UnknownCategoryError, match="did you mean"),
        publish_to(arguments, wire)(kitchen, "odom", lambda: T_MAP_ODOM),
    ):
        pass

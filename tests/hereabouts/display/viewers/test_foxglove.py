"""What Foxglove is given, read again with the `mcap` package."""

import io
import json
import math
import os
import signal
import struct
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from mcap.exceptions import EndOfFile
from mcap.reader import NonSeekingReader, make_reader
from websockets.sync.client import connect

from hereabouts.display.viewers.feed import LiveFeed
from hereabouts.display.viewers.foxglove_viewer import FoxgloveServer, McapFile, scenes_as_mcap
from hereabouts.display.viewers.scene import ScenePlan, SceneReader, SceneStop
from hereabouts.display.viewers.viewer import ViewerGroup
from kg.maps.semantic_map import SemanticMap
from kg.model.errors import PictureError, ServerError
from kg.model.records import MapUpdate, RobotRecord
from kg.serving.opening import in_memory_map
from perception.frames import Detections, Frame
from perception.sources.ros.message_types import message_types


def read(data: bytes) -> list[tuple[str, str, int, Any]]:
    """Topic, schema, time [ns] and content of each message."""
    types = message_types(is_ros1=False)
    return [
        (
            channel.topic,
            schema.name,
            message.log_time,
            types.deserialize_cdr(message.data, schema.name),
        )
        for schema, channel, message in make_reader(io.BytesIO(data)).iter_messages()
        if schema is not None
    ]


def view(stamp: float = 5.0) -> Frame:
    T = np.eye(4)
    T[:3, :3] = [[0, 0, 1], [-1, 0, 0], [0, -1, 0]]  # looks along x, z up
    T[:3, 3] = (1, 2, 1.5)
    rgb = np.full((12, 16, 3), (200, 30, 30), np.uint8)
    K = np.array([[10.0, 0, 8], [0, 11, 6], [0, 0, 1]])
    return Frame("frame-1", rgb, np.ones((12, 16), np.float32), K, T, stamp)


BOX = Detections(np.array([[1, 2, 8, 9]], np.float32), np.array([0.9], np.float32), ("cu\x07p",))


def test_a_map_is_objects_places_relations_floor_and_robot(kitchen: SemanticMap) -> None:
    plan = ScenePlan(((0, 0), (1, 1)), (SceneStop((1, 1), 0.5, "near the cup"),))
    messages = read(scenes_as_mcap([(SceneReader(kitchen).read(plan), 1000.0)]))
    assert {at for _, _, at, _ in messages} == {1_000_000_000_000}
    by_topic = {topic: content for topic, _, _, content in messages}
    assert {(topic, schema) for topic, schema, _, _ in messages} == {
        ("/hereabouts/markers", "visualization_msgs/msg/MarkerArray"),
        ("/hereabouts/objects", "vision_msgs/msg/Detection3DArray"),
        ("/hereabouts/plan", "nav_msgs/msg/Path"),
        ("/hereabouts/robot", "geometry_msgs/msg/PoseStamped"),
        ("/map", "nav_msgs/msg/OccupancyGrid"),
        ("/tf", "tf2_msgs/msg/TFMessage"),
    }
    markers = by_topic["/hereabouts/markers"].markers
    assert markers[0].action == 3  # delete all: it is a whole state
    assert [m.text for m in markers if m.ns == "labels"] == ["dining table", "cup"]
    (box,) = [m for m in markers if m.ns == "extents" and m.scale.z > 0.5]
    assert [round(size, 3) for size in (box.scale.x, box.scale.z)] == [1.2, 0.8]
    assert 2 * math.asin(box.pose.orientation.z) == pytest.approx(0.3)
    assert [m.color.a for m in markers if m.ns == "objects"] == pytest.approx([1, 0.75])
    assert [m.text for m in markers if m.ns == "reasons"] == ["near the cup"]
    assert by_topic["/hereabouts/robot"].pose.position.x == 2.0
    assert len(by_topic["/hereabouts/plan"].poses) == 2


def test_objects_that_are_asked_for_have_frames_of_tf(kitchen: SemanticMap) -> None:
    scene = SceneReader(kitchen, frames=["table", "object/2", "bed"]).read()
    made = [one for _, kind, _, one in read(scenes_as_mcap([(scene, 1.0)])) if "TFMessage" in kind]
    placed = {t.child_frame_id: t for one in made for t in one.transforms}
    assert placed.keys() == {"robot", "table", "object_2"}  # there is no bed
    table = placed["table"]
    assert table.header.frame_id == "map"
    assert table.transform.translation.x == pytest.approx(kitchen.objects()[0].p_map[0])
    assert 2 * math.asin(table.transform.rotation.z) == pytest.approx(0.3)


def test_an_empty_map_is_a_valid_file() -> None:
    messages = read(scenes_as_mcap([(SceneReader(in_memory_map()).read(), math.nan)]))
    assert [topic for topic, *_ in messages] == ["/hereabouts/objects", "/hereabouts/markers"]


def test_frames_have_image_with_boxes_intrinsics_and_pose(tmp_path: Path) -> None:
    viewer = McapFile(tmp_path / "out.mcap")
    viewer.frame(view(), BOX)
    viewer.close()
    viewer.close()
    by_topic = {t: content for t, _, _, content in read((tmp_path / "out.mcap").read_bytes())}
    image = by_topic["/camera/image/compressed"]
    assert (image.format, image.header.frame_id) == ("jpeg", "camera")
    drawn = cv2.imdecode(np.asarray(image.data), cv2.IMREAD_COLOR)
    assert drawn[9, 4, 0] > 200 and drawn[0, 15, 0] < 100  # the box's lower edge is blue
    assert list(by_topic["/camera/camera_info"].k) == [10, 0, 8, 0, 11, 6, 0, 0, 1]
    q = by_topic["/tf"].transforms[0].transform.rotation
    w, xyz = q.w, np.array([q.x, q.y, q.z])
    forward = np.array([0.0, 0, 1])
    turned = forward + 2 * np.cross(xyz, np.cross(xyz, forward) + w * forward)
    assert turned == pytest.approx([1, 0, 0])


def test_what_did_not_change_is_not_written_again(kitchen: SemanticMap, tmp_path: Path) -> None:
    viewer, reader = McapFile(tmp_path / "out.mcap"), SceneReader(kitchen)
    viewer.show(reader.read(), 1.0)
    viewer.show(reader.read(), 2.0)
    kitchen.apply(MapUpdate(removed=(kitchen.objects()[1].iri,)))
    viewer.show(reader.read(), 3.0)
    viewer.close()
    times: dict[str, list[int]] = {}
    for topic, _, at, _ in read((tmp_path / "out.mcap").read_bytes()):
        times.setdefault(topic, []).append(at // 10**9)
    assert times["/hereabouts/markers"] == [1, 3]
    assert times["/map"] == [1]


def test_the_trail_of_a_long_drive_stays_short(tmp_path: Path) -> None:
    viewer = McapFile(tmp_path / "out.mcap")
    for number in range(3000):
        viewer.robot(RobotRecord(np.array([0.11 * number, 0, 1.2]), 0.0, float(number)))
    viewer.close()
    trails = [
        [pose.pose.position for pose in content.poses]
        for topic, _, _, content in read((tmp_path / "out.mcap").read_bytes())
        if topic == "/hereabouts/trail"
    ]
    assert max(map(len, trails)) <= 500
    assert trails[-1][0].x == 0 and trails[-1][-1].x > 300


def test_an_existing_file_or_a_missing_folder_is_refused(tmp_path: Path) -> None:
    (tmp_path / "there.mcap").write_text("mine")
    with pytest.raises(PictureError, match="exists"):
        McapFile(tmp_path / "there.mcap")
    with pytest.raises(PictureError, match="no folder"):
        McapFile(tmp_path / "nowhere" / "out.mcap")
    McapFile(tmp_path / "unused.mcap").close()
    assert (tmp_path / "there.mcap").read_text() == "mine"
    assert not (tmp_path / "unused.mcap").exists()


_KILLED = """
import sys
from pathlib import Path
import numpy as np
import hereabouts.display.viewers.foxglove_viewer as module
from kg.model.records import RobotRecord
module.FLUSHED = 0.0
viewer = module.McapFile(Path(sys.argv[1]))
for number in range(200):
    viewer.robot(RobotRecord(np.array([0.11 * number, 0, 1.2]), 0.0, float(number)))
print("written", flush=True)
sys.stdin.read()
"""


def test_a_killed_run_leaves_what_it_flushed(tmp_path: Path) -> None:
    path = tmp_path / "out.mcap"
    command = [sys.executable, "-c", _KILLED, str(path)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        assert process.stdout is not None and process.stdout.readline() == b"written\n"
        os.kill(process.pid, signal.SIGKILL)
        process.wait()
    seen = []
    with path.open("rb") as file, pytest.raises(EndOfFile):
        for _, channel, message in NonSeekingReader(file).iter_messages(log_time_order=False):
            seen.append((channel.topic, message.log_time // 10**9))
    assert ("/hereabouts/robot", 199) in seen


def test_a_client_gets_the_map_and_its_changes_live(kitchen: SemanticMap) -> None:
    server = FoxgloveServer("our kitchen", "127.0.0.1", 0)
    with (
        LiveFeed(kitchen, server, server.subscribed),
        connect(server.url, subprotocols=["foxglove.sdk.v1"], max_size=None) as client,  # type: ignore[list-item]
    ):
        assert client.subprotocol == "foxglove.sdk.v1"
        channels: dict[str, int] = {}
        while "/hereabouts/markers" not in channels:
            said = json.loads(client.recv(timeout=30))
            assert said["op"] != "serverInfo" or said["capabilities"] == []
            channels |= {c["topic"]: c["id"] for c in said.get("channels", ())}
        wanted = {"id": 7, "channelId": channels["/hereabouts/markers"]}
        client.send(json.dumps({"op": "subscribe", "subscriptions": [wanted]}))
        assert _labels(client, 7) == ["dining table", "cup"]
        cup = kitchen.objects()[1]
        kitchen.apply(MapUpdate(objects=(replace(cup, iri=kitchen.new_object_iri()),)))
        while _labels(client, 7) != ["dining table", "cup", "cup"]:
            pass
        with pytest.raises(ServerError, match=str(server.url.rpartition(":")[2])):
            FoxgloveServer("another", "127.0.0.1", int(server.url.rpartition(":")[2]))


def _labels(client: Any, subscription: int) -> list[str]:
    """The texts of objects in the next message."""
    types = message_types(is_ros1=False)
    data = _message(client, subscription)
    array = types.deserialize_cdr(data, "visualization_msgs/msg/MarkerArray")
    return [marker.text for marker in array.markers if marker.ns == "labels"]


def _message(client: Any, subscription: int) -> bytes:
    """The next message: 1, subscription (uint32), time (uint64), content."""
    while True:
        data = client.recv(timeout=30)
        if isinstance(data, bytes):
            kind, number, _ = struct.unpack_from("<BIQ", data)
            if (kind, number) == (1, subscription):
                return data[13:]


def test_a_file_that_cannot_be_written_leaves_the_other_viewers_alone(tmp_path: Path) -> None:
    (tmp_path / "gone").mkdir()
    viewers = ViewerGroup([McapFile(tmp_path / name) for name in ("gone/a.mcap", "b.mcap")])
    (tmp_path / "gone").rmdir()
    viewers.frame(view(1.0), BOX)
    viewers.remark("still here", 2.0)
    with pytest.raises(PictureError, match=r"cannot write .*a\.mcap"):
        viewers.close()
    viewers.close()
    assert "/rosout" in {topic for topic, _, _, _ in read((tmp_path / "b.mcap").read_bytes())}

"""Topics of a ROS 2 domain with a peer of Fast DDS: the DDS of Humble and Jazzy."""

import threading
from queue import SimpleQueue
from typing import Any

import numpy as np
import pytest

pytest.importorskip("cyclonedds")
from perception.sources.bag_writer import COLOUR, COLOUR_INFO, DEPTH, DEPTH_INFO, IMAGE_TOPICS
from perception.sources.live import stream
from perception.sources.live.ros2 import Ros2Domain
from perception.sources.live.ros2_publisher import Ros2Publisher
from perception.sources.live.stream import FrameStream
from perception.sources.ros.message_maker import MessageMaker
from tests.perception.sources.live.fast_dds import REASON, FastDdsPeer, is_there
from tests.perception.sources.live.test_ros2 import DOMAIN

KIND, TOPIC = "vision_msgs/msg/Detection3DArray", "/hereabouts/objects"
TRANSFORMS = "tf2_msgs/msg/TFMessage"

if not is_there():
    pytest.skip(REASON, allow_module_level=True)


def test_a_late_subscriber_hears_the_last_message() -> None:
    domain = Ros2Domain(DOMAIN + 3)
    publisher, heard = Ros2Publisher(domain, {TOPIC: KIND}, frozenset([TOPIC])), SimpleQueue[Any]()
    try:
        result = [{"hypothesis": {"class_id": "cup", "score": 0.5}}]
        box = {"center": {"position": {"x": 1.5}}, "size": {"z": 0.25}}
        found = [{"id": name, "results": result, "bbox": box} for name in ("object/1", "object/23")]
        make = MessageMaker(is_ros1=False)
        publisher.publish(
            TOPIC, make.make(KIND, header={"frame_id": "hereabouts"}, detections=found)
        )
        peer = FastDdsPeer(domain, {})
        try:
            peer.subscribe(TOPIC, KIND, heard.put, latched=True)
            message = heard.get(timeout=60)
        finally:
            peer.close()
    finally:
        publisher.close()
    assert message.header.frame_id == "hereabouts"
    assert [one.id for one in message.detections] == ["object/1", "object/23"]
    last = message.detections[1]
    assert last.results[0].hypothesis.class_id == "cup"
    assert (last.bbox.center.position.x, last.bbox.size.z) == (1.5, 0.25)


@pytest.mark.parametrize("is_best_effort", [True, False], ids=["sensor data", "reliable"])
def test_images_and_transforms_become_frames(is_best_effort, room, monkeypatch):
    monkeypatch.setattr(stream, "SETTLING", 0.1)
    domain, make, over = Ros2Domain(DOMAIN + 4), MessageMaker(is_ros1=False), threading.Event()
    frame = next(iter(room.frames()))
    topics = {**IMAGE_TOPICS, "/tf": TRANSFORMS, "/tf_static": TRANSFORMS}
    best = frozenset(IMAGE_TOPICS) if is_best_effort else frozenset[str]()
    peer = FastDdsPeer(domain, topics, frozenset(["/tf_static"]), best)
    peer.publish("/tf_static", make.transforms(0, "base_link", "camera", np.eye(4)))

    def drive() -> None:
        now = 1_700_000_000_000_000_000
        while not over.wait(0.1):
            now += 100_000_000
            header = make.header(now, "camera")
            peer.publish("/tf", make.transforms(now, "map", "base_link", frame.T_map_cam))
            info = make.camera_info(frame.K, frame.depth.shape, header)
            peer.publish(COLOUR_INFO, info)
            peer.publish(DEPTH_INFO, info)
            peer.publish(COLOUR, make.colour(frame, header))
            peer.publish(DEPTH, make.depth(frame.depth, header))

    made = FrameStream(domain.address)
    threads = [
        threading.Thread(target=drive),
        threading.Thread(target=domain.run, args=(made, over)),
    ]
    for thread in threads:
        thread.start()
    try:
        got = made.next_frame(60)
    finally:
        over.set()
        for thread in threads:
            thread.join()
        peer.close()
    assert got is not None, made.problem
    assert np.abs(got.rgb.astype(int) - frame.rgb).mean() < 3  # as JPEG has it
    assert np.allclose(got.depth, frame.depth, atol=0.001, equal_nan=True)
    assert np.allclose(got.T_map_cam, frame.T_map_cam, atol=1e-6)

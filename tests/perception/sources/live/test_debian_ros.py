"""A bag played by ROS itself, where it is installed (Debian: ros-core, python3-rosbag)."""

import os
import shutil
import threading
import time
from contextlib import ExitStack
from pathlib import Path

import pytest

pytest.importorskip("rosbags")
from perception.sources.bag_writer import write_bag
from perception.sources.live.ros1 import Ros1Master
from perception.sources.live.stream import FrameStream
from perception.sources.recording import FolderRecording
from tests.perception.sources.live.debian_ros import free_port, started
from tests.waiting import listens

if not (shutil.which("rosmaster") and shutil.which("rosbag")):
    pytest.skip("no ROS 1 here: apt-get install ros-core python3-rosbag", allow_module_level=True)


def test_a_bag_that_rosbag_plays_becomes_frames(room: FolderRecording, tmp_path: Path) -> None:
    assert sum(1 for _ in write_bag(room, tmp_path / "room.bag")) == 6
    port = free_port()
    environment = {
        **os.environ,
        "ROS_MASTER_URI": f"http://127.0.0.1:{port}",
        "ROS_IP": "127.0.0.1",
        "ROS_LOG_DIR": str(tmp_path),
    }
    play = ("rosbag", "play", "-q", "-d", "3", "-r", "0.05", str(tmp_path / "room.bag"))
    made, ended = FrameStream("roscore"), threading.Event()
    master = Ros1Master("127.0.0.1", port)
    thread = threading.Thread(target=master.run, args=(made, ended), daemon=True)
    with ExitStack() as stack:
        core = stack.enter_context(started(environment, "rosmaster", "--core", "-p", str(port)))
        assert listens(port, core)
        thread.start()
        stack.callback(thread.join, 10)
        stack.callback(ended.set)
        player = stack.enter_context(started(environment, *play))
        frames = []
        until = time.monotonic() + 60
        frame = None
        while player.poll() is None or frame is not None:
            assert time.monotonic() < until
            frame = made.next_frame(1)
            if frame is not None:
                frames.append(frame)
        assert player.returncode == 0
    counts = made.counts
    assert counts.received == 6
    # the first image has the stamp 0, which in ROS is none: it is dropped, or has no pose
    assert counts.dropped + counts.without_pose >= 1
    assert len(frames) == counts.taken == 6 - counts.dropped - counts.without_pose >= 1
    assert counts.without_depth == counts.unreadable == 0
    reds = {int(frame.rgb[0, 0, 0]) for frame in frames}
    assert reds <= {10, 11, 12, 13, 14, 15}
    assert len(reds) == len(frames)

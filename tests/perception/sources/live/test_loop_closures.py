"""Poses of frames follow the path that a SLAM corrects, or the jumps of map -> odom alone."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import pytest

pytest.importorskip("rosbags")
from kg.model.errors import RecordingError
from perception.camera.poses import Pose, inverse, motion, quaternion_from_pose
from perception.frames import Frame
from perception.sources.bags.bag_file import RawMessage
from perception.sources.bags.bag_poses import PoseSource
from perception.sources.live.connection import LiveDecoder
from perception.sources.live.loop_closures import TF, LoopClosures
from perception.sources.ros.image_messages import NANOSECONDS
from perception.sources.ros.message_maker import MessageMaker
from perception.sources.ros.message_types import MAP_GRAPHS, serialised
from perception.sources.ros.transform_tree import TransformTree
from tests.perception.sources.live.drifting_robot import (
    BEGIN,
    EVERY,
    FRAMES,
    HALF,
    PERIOD,
    drifted,
    drive,
    flat,
    pose_of,
)

PATH = "nav_msgs/msg/Path"
TRUE = drive()
ODOMETRY = drifted(TRUE)
MOUNT = np.array([[0, 0, 1, 0.1], [-1, 0, 0, 0.05], [0, -1, 0, 1.2], [0, 0, 0, 1.0]])
GRID, DEPTH, K = np.zeros((2, 2, 3), np.uint8), np.ones((2, 2), np.float32), np.eye(3)
STILL = np.eye(4)
MAKE = MessageMaker(is_ros1=False)


@dataclass
class Drive:
    """A drive whose loop closes at HALF, by `jump` (4, 4) of map -> odom."""

    topic: str
    jump: Pose = field(default_factory=lambda: TRUE[HALF] @ inverse(ODOMETRY[HALF]))
    tell: Callable[[int], tuple[str, object] | None] = lambda n: None  # a message after a frame

    def run(self) -> LoopClosures:
        tree, loops = TransformTree(4000), LoopClosures(self.topic)
        poses = PoseSource(tree, "map", None)

        def add(parent: str, child: str, stamp: int, T: Pose, *, static: bool = False) -> None:
            tree.add(parent, child, stamp, [*T[:3, 3], *quaternion_from_pose(T)], static=static)

        add("base_link", "camera", 0, MOUNT, static=True)
        for n in range(FRAMES):
            stamp = BEGIN + n * PERIOD
            add("map", "odom", stamp, np.eye(4) if n < HALF else self.jump)
            add("odom", "base_link", stamp, ODOMETRY[n])
            T = tree.at("map", "camera", stamp / NANOSECONDS)
            assert T is not None
            frame = Frame(str(n), GRID, DEPTH, K, T, stamp / NANOSECONDS)
            loops.add_frame(frame, stamp / NANOSECONDS, poses, "camera")
            if (told := self.tell(n)) is not None:
                kind, message = told
                data = serialised(kind, message, is_ros1=False)
                raw = RawMessage(self.topic, kind, stamp, data, "cdr")
                loops.add_message(raw, LiveDecoder("peer", False), poses, "camera")
        return loops


def path(n: int, *, mount: Pose = STILL, frame: str = "map") -> tuple[str, object] | None:
    """The path so far after image `n`: as it drifts, then as it is true."""
    known = ODOMETRY if n < HALF else TRUE
    poses = [
        {"header": MAKE.header(BEGIN + k * PERIOD, frame), "pose": whole_pose(known[k] @ mount)}
        for k in range(0, n + 1, EVERY)
    ]
    header = MAKE.header(BEGIN + n * PERIOD, frame)
    return (PATH, MAKE.make(PATH, header=header, poses=poses)) if n % EVERY == 0 else None


def whole_pose(T: Pose) -> dict[str, object]:
    x, y, z, w = map(float, quaternion_from_pose(T))
    return {**pose_of(T), "orientation": {"x": x, "y": y, "z": z, "w": w}}


def graph(n: int) -> tuple[str, object] | None:
    if n % EVERY:
        return None
    known, nodes = ODOMETRY if n < HALF else TRUE, range(0, n + 1, EVERY)
    message = MAKE.make(
        MAP_GRAPHS[0],
        header=MAKE.header(BEGIN + n * PERIOD, "map"),
        nodes=[k + 1 for k in nodes],
        poses=[pose_of(known[k]) for k in nodes],
    )
    return MAP_GRAPHS[0], message


def errors(loops: LoopClosures, last: int = HALF) -> np.ndarray:
    """Distance [m] and angle [rad] of each frame before `last` from its true pose."""
    found = loops.corrected()
    return np.array([motion(TRUE[n] @ MOUNT, found[str(n)]) for n in range(last)])


@pytest.mark.parametrize(
    ("tell", "last"),
    [
        (path, FRAMES - 2),
        (graph, FRAMES - 2),
        (lambda n: path(n, mount=MOUNT), FRAMES - 2),  # of the camera
        (lambda n: path(n) if n >= HALF else None, FRAMES - 2),  # told once the loop is closed
    ],
    ids=["path", "graph", "of the camera", "late"],
)
def test_frames_lie_on_the_corrected_path(tell, last):
    loops = Drive("/slam", tell=tell).run()
    assert 0.3 < loops.moved < 0.6
    assert errors(loops, last).max() < 0.01
    assert loops.moved == 0.0 and not loops.is_silent


def test_a_jump_is_spread_over_the_way_before_it() -> None:
    loops = Drive(TF).run()
    assert 0.3 < loops.moved < 0.6
    far, turned = errors(loops).T
    assert far.max() < 0.08 and far.mean() < 0.05 and turned.max() < 0.01


@pytest.mark.parametrize(
    ("jump", "said"), [(flat(3.0, 0.0, 0.0), "jumped by 3.00 m"), (flat(0.05, 0.0, 0.0), "")]
)
def test_what_is_no_drift_moves_nothing(jump, said, caplog):
    loops = Drive(TF, jump).run()
    assert loops.moved == 0.0
    assert said in caplog.text and bool(said) == bool(caplog.text)


def unstamped(n: int) -> tuple[str, object]:
    return PATH, MAKE.make(PATH, header=MAKE.header(0, "map"), poses=[{}, {}])


@pytest.mark.parametrize(
    ("tell", "said"),
    [
        (unstamped, "no stamps of their own"),
        (lambda n: path(n, frame="world"), "--map-frame world"),
    ],
)
def test_a_path_of_no_use_is_refused(tell, said):
    with pytest.raises(RecordingError, match=said):
        Drive("/slam", tell=tell).run()

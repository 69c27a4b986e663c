"""A process of its own: a robot in the simulated house whose odometry drifts, and whose SLAM knows.

python drifting_robot.py ros2://DOMAIN|ros1://HOST:PORT tf|path|graph SEEN: it publishes a camera,
detections of its own, tf (map -> odom -> base_link) and the SLAM's path or graph. After HALF images
the SLAM closes a loop: map -> odom jumps, and the path is the true one. Each image comes once the
folder SEEN has a picture of the one before, or after a while. The robot then stands still.
"""

import itertools
import sys
import time
from pathlib import Path

import numpy as np

from perception.camera.poses import inverse
from perception.sources.live.ros1 import Ros1Master
from perception.sources.live.ros1_publisher import Ros1Publisher
from perception.sources.live.ros2 import Ros2Domain
from perception.sources.live.ros2_publisher import Ros2Publisher
from perception.sources.ros.message_maker import MessageMaker
from planner.simulation.camera import CameraModel, SimulatedCamera
from planner.simulation.house import furnished_house
from planner.simulation.sensors import SimulatedDetector

HALF, FRAMES = 48, 60  # images until the loop closes, and in all
EVERY = 3  # images from one pose of the SLAM's path to the next
SCALE, TURN = 1.04, np.deg2rad(0.12)  # of odometry: length of a step, and its turn to the left
PERIOD = 500_000_000  # [ns] of stamps
BEGIN = 1_700_000_000 * 10**9  # [ns]
INFO, COLOUR, DEPTH = (
    f"/camera/{n}" for n in ("camera_info", "color/image_raw", "depth/image_raw")
)
TYPES = {
    INFO: "sensor_msgs/msg/CameraInfo",
    COLOUR: "sensor_msgs/msg/Image",
    DEPTH: "sensor_msgs/msg/Image",
    "/tf": "tf2_msgs/msg/TFMessage",
    "/tf_static": "tf2_msgs/msg/TFMessage",
    "/detections": "vision_msgs/msg/Detection2DArray",
    "/slam/path": "nav_msgs/msg/Path",
    "/slam/graph": "rtabmap_msgs/msg/MapGraph",
}
LABELS = sorted({item.label for item in furnished_house().objects})


def small_camera() -> SimulatedCamera:
    """A camera of few pixels in the demo's house."""
    return SimulatedCamera(furnished_house(), CameraModel(width=160, height=120, focal=144.0))


def flat(x: float, y: float, heading: float) -> np.ndarray:
    T = np.eye(4)
    T[:2, :2] = [[np.cos(heading), -np.sin(heading)], [np.sin(heading), np.cos(heading)]]
    T[:2, 3] = x, y
    return T


def drive() -> list[np.ndarray]:
    """True poses (4, 4) of the base: along the corridor, looking to both sides, and back."""
    x = np.concatenate([np.linspace(2.0, 9.5, FRAMES * 3 // 4), np.linspace(9.5, 5.0, FRAMES // 4)])
    return [flat(one, 4.7, np.pi / 2 * np.sin(1.1 * n)) for n, one in enumerate(x)]


def drifted(true: list[np.ndarray]) -> list[np.ndarray]:
    """Poses (4, 4) by odometry, whose steps are too long, and turn."""
    found = [true[0]]
    for before, after in itertools.pairwise(true):
        step = flat(0.0, 0.0, TURN) @ inverse(before) @ after
        step[:3, 3] *= SCALE
        found.append(found[-1] @ step)
    return found


def pose_of(T: np.ndarray) -> dict:
    half = np.arctan2(T[1, 0], T[0, 0]) / 2
    x, y, z = map(float, T[:3, 3])
    turned = {"z": float(np.sin(half)), "w": float(np.cos(half))}
    return {"position": {"x": x, "y": y, "z": z}, "orientation": turned}


class Robot:
    def __init__(self, address: str, told: str) -> None:
        self.is_ros1, self.told = address.startswith("ros1"), told
        latched = frozenset(["/tf_static"])
        self.publisher = (
            Ros1Publisher(Ros1Master.at(address), TYPES, latched)
            if self.is_ros1
            else Ros2Publisher(Ros2Domain.at(address), TYPES, latched)
        )
        self.make = MessageMaker(self.is_ros1)
        self.camera = small_camera()
        self.detector = SimulatedDetector(self.camera)
        self.true = drive()
        self.odometry = drifted(self.true)
        self.mount = self.camera.model.pose(0.0, 0.0, 0.0)

    def transform(self, topic: str, stamp: int, parent: str, child: str, T: np.ndarray) -> None:
        self.publisher.publish(topic, self.make.transforms(stamp, parent, child, T))

    def tell_pose(self, n: int, stamp: int) -> None:
        """Transforms and path at image `n`."""
        T = np.eye(4) if n < HALF else self.true[HALF] @ inverse(self.odometry[HALF])
        self.transform("/tf", stamp, "map", "odom", T)
        self.transform("/tf", stamp, "odom", "base_link", self.odometry[n])
        nodes = list(range(0, n + 1, EVERY))
        if n % EVERY or self.told == "tf":
            return
        known = self.odometry if n < HALF else self.true
        header = self.make.header(stamp, "map")
        if self.told == "path":
            headers = [self.make.header(BEGIN + k * PERIOD, "map") for k in nodes]
            poses = [
                {"header": h, "pose": pose_of(known[k])}
                for h, k in zip(headers, nodes, strict=True)
            ]
            path = self.make.make(TYPES["/slam/path"], header=header, poses=poses)
            self.publisher.publish("/slam/path", path)
        else:
            poses = [pose_of(known[k]) for k in nodes]
            kind = TYPES["/slam/graph"]
            graph = self.make.make(kind, header=header, nodes=[k + 1 for k in nodes], poses=poses)
            self.publisher.publish("/slam/graph", graph)

    def tell_image(self, n: int, stamp: int) -> None:
        """Image and detections."""
        frame = self.camera.frame(str(n), self.true[n] @ self.mount, stamp / 1e9)
        header = self.make.header(stamp, "camera")
        info = self.make.camera_info(frame.K, frame.depth.shape, header)
        self.publisher.publish(INFO, info)
        self.publisher.publish(COLOUR, self.make.image(frame.rgb, "rgb8", header))
        self.publisher.publish(DEPTH, self.make.depth(frame.depth, header))
        found, boxes = self.detector.detect(frame), []
        for (x0, y0, x1, y1), score, label in zip(
            found.xyxy.tolist(), found.score.tolist(), found.label, strict=True
        ):
            at = {"x": (x0 + x1) / 2, "y": (y0 + y1) / 2}
            result = {"hypothesis": {"class_id": label, "score": score}}
            if self.is_ros1:
                result = {"id": LABELS.index(label), "score": score}
            box = {
                "center": at if self.is_ros1 else {"position": at},
                "size_x": x1 - x0,
                "size_y": y1 - y0,
            }
            boxes.append({"header": header, "bbox": box, "results": [result]})
        message = self.make.make(TYPES["/detections"], header=header, detections=boxes)
        self.publisher.publish("/detections", message)


def main(address: str, told: str, seen: Path) -> None:
    robot, n = Robot(address, told), 0
    robot.transform("/tf_static", 0, "base_link", "camera", robot.mount)
    while True:
        for _ in range(40):  # while the first is awaited, and after the last, it stands still
            stamp, at = BEGIN + n * PERIOD, min(n, FRAMES - 1)
            robot.tell_pose(at if n else 0, stamp)
            robot.tell_image(at, stamp)
            if not n and not any(seen.glob("*")):
                time.sleep(0.3)
                continue
            n += 1
            robot.tell_pose(min(n, FRAMES - 1), BEGIN + n * PERIOD)  # transforms beyond the image
            pictures = len(list(seen.glob("*")))
            until = time.monotonic() + 3
            while len(list(seen.glob("*"))) == pictures and time.monotonic() < until:
                time.sleep(0.02)


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2], Path(sys.argv[3]))

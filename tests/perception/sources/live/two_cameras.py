"""A process of its own: a robot in the simulated house that publishes two cameras, front and rear.

python two_cameras.py ros2://DOMAIN|ros1://HOST:PORT FOLDER: it drives back and forth until it is
killed. A file FOLDER/rear stops the images of that camera.
"""

import math
import sys
import time
from pathlib import Path

import numpy as np

from perception.sources.live.ros1 import Ros1Master
from perception.sources.live.ros1_publisher import Ros1Publisher
from perception.sources.live.ros2 import Ros2Domain
from perception.sources.live.ros2_publisher import Ros2Publisher
from perception.sources.ros.message_maker import MessageMaker
from planner.simulation.camera import CameraModel, SimulatedCamera
from planner.simulation.house import House, Item, furnished_house

AHEAD = 7.05, 8.30, 0.89  # [m] middle of the orange before the robot ...
BEHIND = 4.40, 7.30, 0.89  # ... and of the one behind it
MODELS = {"front": CameraModel(), "rear": CameraModel(focal=250.0, mount_height=1.1)}
HEADING = {"front": 0.0, "rear": math.pi}  # [rad] in the robot's frame
PERIOD = 0.2  # [s] between two images of a camera
TYPES = {
    "color/image_raw/compressed": "sensor_msgs/msg/CompressedImage",
    "color/camera_info": "sensor_msgs/msg/CameraInfo",
    "depth/image_raw": "sensor_msgs/msg/Image",
}
TRANSFORMS = "tf2_msgs/msg/TFMessage"


def house() -> House:
    oranges = [Item("orange", x, y, z - 0.04) for x, y, z in (AHEAD, BEHIND)]
    return furnished_house().with_objects(oranges)


def base_at(seconds: float) -> np.ndarray:
    """Pose (4, 4) of the robot, which drives north and south and turns a little."""
    T, turn = np.eye(4), 0.15 * math.sin(0.9 * seconds)
    T[:2, :2] = [[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]]
    T[:2, 3] = 5.6, 7.7 + 0.6 * math.sin(0.4 * seconds)
    return T


def main(address: str, folder: Path) -> None:
    is_ros1 = address.startswith("ros1")
    topics = {f"/{name}/{rest}": kind for name in MODELS for rest, kind in TYPES.items()}
    topics |= {"/tf": TRANSFORMS, "/tf_static": TRANSFORMS}
    latched, maker = frozenset(["/tf_static"]), MessageMaker(is_ros1)
    publisher = (
        Ros1Publisher(Ros1Master.at(address), topics, latched)
        if is_ros1
        else Ros2Publisher(Ros2Domain.at(address), topics, latched)
    )
    cameras = {name: SimulatedCamera(house(), model) for name, model in MODELS.items()}
    mounted = {name: MODELS[name].pose(0.0, 0.0, HEADING[name]) for name in MODELS}
    static = maker.make(TRANSFORMS, transforms=[])
    static.transforms = [
        maker.transforms(0, "base_link", f"{name}_optical", T).transforms[0]
        for name, T in mounted.items()
    ]
    publisher.publish("/tf_static", static)
    began = time.monotonic()
    while True:
        for name, camera in cameras.items():
            now, passed = time.time_ns(), time.monotonic() - began
            T = base_at(passed)
            publisher.publish("/tf", maker.transforms(now, "map", "base_link", T))
            if not (folder / name).exists():
                frame = camera.frame(str(now), T @ mounted[name], now / 1e9)
                header = maker.header(now, f"{name}_optical")
                info = maker.camera_info(frame.K, frame.depth.shape, header)
                publisher.publish(f"/{name}/color/camera_info", info)
                publisher.publish(
                    f"/{name}/color/image_raw/compressed", maker.colour(frame, header)
                )
                publisher.publish(f"/{name}/depth/image_raw", maker.depth(frame.depth, header))
            time.sleep(PERIOD / len(cameras))


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]))

"""A process of its own that publishes a bag's messages in a ROS 2 domain, typed by hand.

python ros2_peer.py DOMAIN FILE: tf_static once, then all messages again and again, until killed.
"""

import sys
import time
from pathlib import Path
from typing import Any

from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct, make_idl_struct
from cyclonedds.idl.types import array, float64, int32, sequence, uint8, uint32
from cyclonedds.pub import DataWriter
from cyclonedds.qos import Policy, Qos
from cyclonedds.topic import Topic
from cyclonedds.util import duration


def struct(package: str, name: str, **fields: Any) -> Any:
    """A message as ROS 2 names its type in DDS."""
    return make_idl_struct(f"{name}_", f"{package}::msg::dds_::{name}_", fields)


BLOCK, SIZE = sequence[uint8], {"height": uint32, "width": uint32}
Time = struct("builtin_interfaces", "Time", sec=int32, nanosec=uint32)
Header = struct("std_msgs", "Header", stamp=Time, frame_id=str)
Image = struct("sensor_msgs", "Image", header=Header, **SIZE, encoding=str, is_bigendian=uint8,
               step=uint32, data=BLOCK)  # fmt: skip
CompressedImage = struct("sensor_msgs", "CompressedImage", header=Header, format=str, data=BLOCK)
RegionOfInterest = struct("sensor_msgs", "RegionOfInterest", x_offset=uint32, y_offset=uint32,
                          **SIZE, do_rectify=bool)  # fmt: skip
CameraInfo = struct("sensor_msgs", "CameraInfo", header=Header, **SIZE, distortion_model=str,
                    d=sequence[float64], k=array[float64, 9], r=array[float64, 9],
                    p=array[float64, 12], binning_x=uint32, binning_y=uint32,
                    roi=RegionOfInterest)  # fmt: skip
XYZ = dict.fromkeys("xyz", float64)
Vector3 = struct("geometry_msgs", "Vector3", **XYZ)
Point = struct("geometry_msgs", "Point", **XYZ)
Quaternion = struct("geometry_msgs", "Quaternion", **XYZ, w=float64)
Transform = struct("geometry_msgs", "Transform", translation=Vector3, rotation=Quaternion)
TransformStamped = struct("geometry_msgs", "TransformStamped", header=Header, child_frame_id=str,
                          transform=Transform)  # fmt: skip
TFMessage = struct("tf2_msgs", "TFMessage", transforms=sequence[TransformStamped])
Pose = struct("geometry_msgs", "Pose", position=Point, orientation=Quaternion)
COVARIANCE = array[float64, 36]
PoseWithCovariance = struct("geometry_msgs", "PoseWithCovariance", pose=Pose, covariance=COVARIANCE)
Twist = struct("geometry_msgs", "Twist", linear=Vector3, angular=Vector3)
TwistWithCovariance = struct("geometry_msgs", "TwistWithCovariance", twist=Twist,
                             covariance=COVARIANCE)  # fmt: skip
Odometry = struct("nav_msgs", "Odometry", header=Header, child_frame_id=str,
                  pose=PoseWithCovariance, twist=TwistWithCovariance)  # fmt: skip

TYPES = {
    "sensor_msgs/msg/Image": Image,
    "sensor_msgs/msg/CompressedImage": CompressedImage,
    "sensor_msgs/msg/CameraInfo": CameraInfo,
    "tf2_msgs/msg/TFMessage": TFMessage,
    "nav_msgs/msg/Odometry": Odometry,
}


def typed(kind: Any, message: Any) -> Any:
    """A message of rosbags as one of ours."""
    fields = {}
    for name, of in kind.__annotations__.items():
        fields[name] = converted(getattr(message, name), of)
    return kind(**fields)


def converted(value: Any, of: Any) -> Any:
    if isinstance(of, type) and issubclass(of, IdlStruct):
        return typed(of, value)
    if hasattr(value, "dtype"):
        return value.tobytes() if value.dtype == "uint8" else value.tolist()
    if isinstance(value, list):
        return [typed(TransformStamped, each) for each in value]
    return value


def quality(topic: str, kind: type) -> Qos:
    reliable = Policy.Reliability.Reliable(duration(seconds=1))
    if topic == "/tf_static":
        return Qos(reliable, Policy.Durability.TransientLocal, Policy.History.KeepLast(1))
    sensor = kind in (Image, CompressedImage, CameraInfo)
    reliability = Policy.Reliability.BestEffort if sensor else reliable
    return Qos(reliability, Policy.Durability.Volatile, Policy.History.KeepLast(5))


def main(domain: int, path: Path) -> None:
    from perception.sources.bags.bag_file import BagFile

    participant, writers = DomainParticipant(domain), {}
    with BagFile(path) as bag:
        raws = list(bag.messages([t.name for t in bag.topics if t.type in TYPES]))
        messages = [(raw.topic, typed(TYPES[raw.type], bag.decoded(raw))) for raw in raws]
    for topic, message in messages:
        if topic not in writers:
            made = Topic(participant, f"rt{topic}", type(message))
            writers[topic] = DataWriter(participant, made, qos=quality(topic, type(message)))
        if topic == "/tf_static":
            writers[topic].write(message)
    while True:
        for topic, message in messages:
            if topic != "/tf_static":
                writers[topic].write(message)
            if topic.endswith("image_raw"):
                time.sleep(0.1)


if __name__ == "__main__":
    main(int(sys.argv[1]), Path(sys.argv[2]))

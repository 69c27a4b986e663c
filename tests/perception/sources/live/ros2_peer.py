"""A process of its own that publishes a bag's messages in a ROS 2 domain, typed by hand.

python ros2_peer.py DOMAIN FILE: tf_static once, then all messages again and again, until killed.
"""

import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import array, float64, int32, sequence, uint8, uint32
from cyclonedds.pub import DataWriter
from cyclonedds.qos import Policy, Qos
from cyclonedds.topic import Topic
from cyclonedds.util import duration


@dataclass
class Time(IdlStruct, typename="builtin_interfaces::msg::dds_::Time_"):
    sec: int32
    nanosec: uint32


@dataclass
class Header(IdlStruct, typename="std_msgs::msg::dds_::Header_"):
    stamp: Time
    frame_id: str


@dataclass
class Image(IdlStruct, typename="sensor_msgs::msg::dds_::Image_"):
    header: Header
    height: uint32
    width: uint32
    encoding: str
    is_bigendian: uint8
    step: uint32
    data: sequence[uint8]


@dataclass
class CompressedImage(IdlStruct, typename="sensor_msgs::msg::dds_::CompressedImage_"):
    header: Header
    format: str
    data: sequence[uint8]


@dataclass
class RegionOfInterest(IdlStruct, typename="sensor_msgs::msg::dds_::RegionOfInterest_"):
    x_offset: uint32
    y_offset: uint32
    height: uint32
    width: uint32
    do_rectify: bool


@dataclass
class CameraInfo(IdlStruct, typename="sensor_msgs::msg::dds_::CameraInfo_"):
    header: Header
    height: uint32
    width: uint32
    distortion_model: str
    d: sequence[float64]
    k: array[float64, 9]
    r: array[float64, 9]
    p: array[float64, 12]
    binning_x: uint32
    binning_y: uint32
    roi: RegionOfInterest


@dataclass
class Vector3(IdlStruct, typename="geometry_msgs::msg::dds_::Vector3_"):
    x: float64
    y: float64
    z: float64


@dataclass
class Point(IdlStruct, typename="geometry_msgs::msg::dds_::Point_"):
    x: float64
    y: float64
    z: float64


@dataclass
class Quaternion(IdlStruct, typename="geometry_msgs::msg::dds_::Quaternion_"):
    x: float64
    y: float64
    z: float64
    w: float64


@dataclass
class Transform(IdlStruct, typename="geometry_msgs::msg::dds_::Transform_"):
    translation: Vector3
    rotation: Quaternion


@dataclass
class TransformStamped(IdlStruct, typename="geometry_msgs::msg::dds_::TransformStamped_"):
    header: Header
    child_frame_id: str
    transform: Transform


@dataclass
class TFMessage(IdlStruct, typename="tf2_msgs::msg::dds_::TFMessage_"):
    transforms: sequence[TransformStamped]


@dataclass
class Pose(IdlStruct, typename="geometry_msgs::msg::dds_::Pose_"):
    position: Point
    orientation: Quaternion


@dataclass
class PoseWithCovariance(IdlStruct, typename="geometry_msgs::msg::dds_::PoseWithCovariance_"):
    pose: Pose
    covariance: array[float64, 36]


@dataclass
class Twist(IdlStruct, typename="geometry_msgs::msg::dds_::Twist_"):
    linear: Vector3
    angular: Vector3


@dataclass
class TwistWithCovariance(IdlStruct, typename="geometry_msgs::msg::dds_::TwistWithCovariance_"):
    twist: Twist
    covariance: array[float64, 36]


@dataclass
class Odometry(IdlStruct, typename="nav_msgs::msg::dds_::Odometry_"):
    header: Header
    child_frame_id: str
    pose: PoseWithCovariance
    twist: TwistWithCovariance


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

"""Types of ROS 1's and ROS 2's messages, one table for all wires: files, TCPROS, DDS, Foxglove.

Most definitions ship with the package rosbags. Those that it lacks stand here, so that no code is
made from what a file or a robot sends. A type is called as by ROS 2 (sensor_msgs/msg/Image).
"""

from __future__ import annotations

import functools
from typing import Any, Final

import numpy as np

_TRANSFORMS: Final = "geometry_msgs/TransformStamped[] transforms"
_ACTION: Final = "Header header\nactionlib_msgs/"
_HEADER: Final = "std_msgs/Header header\n"
_RESULTS: Final = f"{_HEADER}ObjectHypothesisWithPose[] results\n"
_SIZE: Final = "\nfloat64 size_x\nfloat64 size_y"
_GOAL: Final = "unique_identifier_msgs/UUID goal_id\n"
_VISION: Final = {
    "BoundingBox3D": "geometry_msgs/Pose center\ngeometry_msgs/Vector3 size",
    "Detection2DArray": f"{_HEADER}Detection2D[] detections",
    "Detection3DArray": f"{_HEADER}Detection3D[] detections",
}
#: RTAB-Map's images in one message, by the names of its packages; features follow, unread
RGBD_IMAGES: Final = ("rtabmap_msgs/msg/RGBDImage", "rtabmap_ros/msg/RGBDImage")
_RTABMAP: dict[str, str] = dict.fromkeys(
    RGBD_IMAGES,
    f"{_HEADER}sensor_msgs/CameraInfo rgb_camera_info\nsensor_msgs/CameraInfo depth_camera_info\n"
    "sensor_msgs/Image rgb\nsensor_msgs/Image depth\nsensor_msgs/CompressedImage rgb_compressed\n"
    "sensor_msgs/CompressedImage depth_compressed",
)
#: RTAB-Map's graph, by the names of its packages; links follow, unread
MAP_GRAPHS: Final = ("rtabmap_msgs/msg/MapGraph", "rtabmap_ros/msg/MapGraph")
_RTABMAP |= dict.fromkeys(
    MAP_GRAPHS,
    f"{_HEADER}geometry_msgs/Transform map_to_odom\nint32[] nodes\ngeometry_msgs/Pose[] poses",
)
#: of ROS 1: a class is a number, and the parameter `database_location` has its name
_ROS1: Final = {
    **_RTABMAP,
    "tf2_msgs/msg/TFMessage": _TRANSFORMS,
    "tf/msg/tfMessage": _TRANSFORMS,
    "move_base_msgs/msg/MoveBaseGoal": "geometry_msgs/PoseStamped target_pose",
    "move_base_msgs/msg/MoveBaseResult": "",
    "move_base_msgs/msg/MoveBaseFeedback": "geometry_msgs/PoseStamped base_position",
    "move_base_msgs/msg/MoveBaseActionGoal": f"{_ACTION}GoalID goal_id\nMoveBaseGoal goal",
    "move_base_msgs/msg/MoveBaseActionResult": f"{_ACTION}GoalStatus status\nMoveBaseResult result",
    "move_base_msgs/msg/MoveBaseActionFeedback": (
        f"{_ACTION}GoalStatus status\nMoveBaseFeedback feedback"
    ),
    **{f"vision_msgs/msg/{name}": definition for name, definition in _VISION.items()},
    "vision_msgs/msg/ObjectHypothesisWithPose": (
        "int64 id\nfloat64 score\ngeometry_msgs/PoseWithCovariance pose"
    ),
    "vision_msgs/msg/BoundingBox2D": f"geometry_msgs/Pose2D center{_SIZE}",
    "vision_msgs/msg/Detection2D": f"{_RESULTS}BoundingBox2D bbox\nsensor_msgs/Image source_img",
    "vision_msgs/msg/Detection3D": (
        f"{_RESULTS}BoundingBox3D bbox\nsensor_msgs/PointCloud2 source_cloud"
    ),
    "vision_msgs/msg/VisionInfo": (
        f"{_HEADER}string method\nstring database_location\nint32 database_version"
    ),
}
#: of yolo_ros, whose masks are outlines [px]
_YOLO: Final = {
    "Point2D": "float64 x\nfloat64 y",
    "Vector2": "float64 x\nfloat64 y",
    "Pose2D": "Point2D position\nfloat64 theta",
    "BoundingBox2D": "Pose2D center\nVector2 size",
    "BoundingBox3D": f"{_VISION['BoundingBox3D']}\nstring frame_id",
    "Mask": "int32 height\nint32 width\nPoint2D[] data",
    "KeyPoint2D": "int32 id\nPoint2D point\nfloat64 score",
    "KeyPoint2DArray": "KeyPoint2D[] data",
    "KeyPoint3D": "int32 id\ngeometry_msgs/Point point\nfloat64 score",
    "KeyPoint3DArray": "KeyPoint3D[] data\nstring frame_id",
    "Detection": (
        "int32 class_id\nstring class_name\nfloat64 score\nstring id\nBoundingBox2D bbox\n"
        "BoundingBox3D bbox3d\nMask mask\nKeyPoint2DArray keypoints\nKeyPoint3DArray keypoints3d"
    ),
    "DetectionArray": f"{_HEADER}Detection[] detections",
}
_ROS2: Final = {
    **_RTABMAP,
    **{f"yolo_msgs/msg/{name}": definition for name, definition in _YOLO.items()},
    **{f"vision_msgs/msg/{name}": definition for name, definition in _VISION.items()},
    "vision_msgs/msg/ObjectHypothesis": "string class_id\nfloat64 score",
    "vision_msgs/msg/ObjectHypothesisWithPose": (
        "ObjectHypothesis hypothesis\ngeometry_msgs/PoseWithCovariance pose"
    ),
    "vision_msgs/msg/Point2D": "float64 x\nfloat64 y",
    "vision_msgs/msg/Pose2D": "Point2D position\nfloat64 theta",
    "vision_msgs/msg/BoundingBox2D": f"Pose2D center{_SIZE}",
    "vision_msgs/msg/Detection2D": f"{_RESULTS}BoundingBox2D bbox\nstring id",
    "vision_msgs/msg/Detection3D": f"{_RESULTS}BoundingBox3D bbox\nstring id",
    # NavigateToPose: what is fed back, and the request of its service SendGoal
    "nav2_msgs/action/NavigateToPose_FeedbackMessage": (
        f"{_GOAL}geometry_msgs/PoseStamped current_pose\n"
        "builtin_interfaces/Duration navigation_time\n"
        "builtin_interfaces/Duration estimated_time_remaining\n"
        "int16 number_of_recoveries\nfloat32 distance_remaining"
    ),
    "nav2_msgs/msg/SendGoalRequest": f"{_GOAL}geometry_msgs/PoseStamped pose\nstring behavior_tree",
}
_ZEROS: Final[dict[str, Any]] = {"bool": False, "string": "", "float32": 0.0, "float64": 0.0}
_ARRAYS: Final = {"byte": "uint8", "char": "uint8"}  # octets


@functools.cache
def message_types(is_ros1: bool) -> Any:
    """Message types of ROS 1 or ROS 2, a typestore of rosbags."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    types = get_typestore(Stores.ROS1_NOETIC if is_ros1 else Stores.ROS2_HUMBLE)
    added: dict[str, Any] = {}
    for name, definition in (_ROS1 if is_ros1 else _ROS2).items():
        added |= get_types_from_msg(definition, name)
    types.register(added)
    return types


def serialised(kind: str, message: Any, *, is_ros1: bool) -> bytes:
    """A message of a type as ROS 1 or ROS 2 (CDR with its header) sends it."""
    types = message_types(is_ros1)
    return bytes((types.serialize_ros1 if is_ros1 else types.serialize_cdr)(message, kind))


def leading(kind: str, data: bytes, *, is_ros1: bool) -> Any:
    """The message of a type that `data` begin with; what follows it is not looked at."""
    types = message_types(is_ros1)
    known: Any = types.get_msgdef(kind)
    if is_ros1:
        return known.deserialize_ros1(data, 0, known.cls, types)[0]
    read = known.deserialize_cdr_le if data[1] else known.deserialize_cdr_be
    return read(data[4:], 0, known.cls, types)[0]


def made(kind: str, fields: dict[str, Any], *, is_ros1: bool) -> Any:
    """A message with `fields`; a part may be a dictionary, and what is left out is 0 or empty.

    Raises TypeError for a field that the type lacks.
    """
    types = message_types(is_ros1)
    values = {
        name: _value(node, fields.get(name), is_ros1) for name, node in types.fielddefs[kind][1]
    }
    return types.types[kind](**{**fields, **values})


def _value(node: tuple[Any, Any], given: Any, is_ros1: bool) -> Any:
    """The value of a field; None is none given."""
    from rosbags.interfaces import Nodetype

    kind, content = node
    if kind == Nodetype.BASE:
        return _ZEROS.get(content[0], 0) if given is None else given
    if kind == Nodetype.NAME:
        return made(content, given or {}, is_ros1=is_ros1) if _is_part(given) else given
    (of, name), size = content
    if of == Nodetype.NAME:
        items = given or ()
        return [made(name, one, is_ros1=is_ros1) if _is_part(one) else one for one in items]
    if name[0] == "string":
        return list(given or ())
    dtype = _ARRAYS.get(name[0], name[0])
    if given is None:
        return np.zeros(size if kind == Nodetype.ARRAY else 0, dtype)
    return np.asarray(given, dtype)


def _is_part(value: Any) -> bool:
    return value is None or isinstance(value, dict)

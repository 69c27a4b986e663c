"""Scenes as ROS messages (MarkerArray, OccupancyGrid, Path, and more), and as ROS 1 bags.

Messages are of ROS 1 or ROS 2; no ROS is needed. A MarkerArray is
a whole state that replaces the one before, since a player that jumps to a moment reads the last
message of each topic alone.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np
from matplotlib.colors import to_rgb
from rosbags.rosbag1 import Writer

from hereabouts.display.plots.palette import INK, ROUTE, WALL
from hereabouts.display.viewers.scene import (
    Colour,
    Point,
    Scene,
    SceneFloor,
    SceneObject,
    ScenePlace,
    ScenePlan,
    triangles,
)
from hereabouts.display.viewers.viewer import (
    CAMERA,
    MAP,
    MARKER,
    ROBOT,
    SURFACE,
    TEXT,
    TINT,
    heading_quaternion,
)
from kg.maps.surface.voxels import Surface
from kg.model.records import FREE, LOW, TALL, UNKNOWN, RobotRecord
from perception.annotate import draw_detections, encode_jpeg
from perception.camera.poses import Pose
from perception.frames import Detections, Frame
from perception.sources.ros.message_maker import MessageMaker
from perception.sources.ros.message_types import message_types, serialised
from planner.execution.protocol import cleaned

_DETECTIONS: Final = "vision_msgs/msg/Detection3DArray"
#: topic -> type; ROS 1 leaves out the "msg"
TOPICS: Final = {
    "/map": "nav_msgs/msg/OccupancyGrid",
    "/hereabouts/markers": "visualization_msgs/msg/MarkerArray",
    "/hereabouts/surface": "sensor_msgs/msg/PointCloud2",
    "/hereabouts/robot": "geometry_msgs/msg/PoseStamped",
    "/hereabouts/plan": "nav_msgs/msg/Path",
}
#: topic -> type of further live messages
LIVE_TOPICS: Final = {
    "/tf": "tf2_msgs/msg/TFMessage",
    "/camera/camera_info": "sensor_msgs/msg/CameraInfo",
    "/camera/image/compressed": "sensor_msgs/msg/CompressedImage",
    "/hereabouts/objects": _DETECTIONS,
    "/hereabouts/trail": "nav_msgs/msg/Path",
    "/rosout": "rcl_interfaces/msg/Log",
}
#: by UNKNOWN, FREE, LOW, TALL: low furniture is an obstacle too
_OCCUPANCY: Final = np.zeros(4, np.int8)
_OCCUPANCY[[UNKNOWN, FREE, LOW, TALL]] = (-1, 0, 100, 100)
_LATEST: Final = 2**31 - 1  # [s]
_ARROW, _CUBE, _SPHERE, _CYLINDER, _STRIP, _LINES, _WORDS, _TRIANGLES = 0, 1, 2, 3, 4, 5, 9, 11
_SHAPES: Final = {"cube": _CUBE, "sphere": _SPHERE, "cylinder": _CYLINDER}
_ADD, _DELETE_ALL = 0, 3
_INFO: Final = 20
_FLOAT32: Final = 7  # of PointField


@dataclass(slots=True)
class RosMessages(MessageMaker):
    """Makes messages of ROS 1 or ROS 2; stamps are [s] since 1970."""

    map_frame: str = MAP
    classes: dict[str, int] = field(default_factory=dict)  # numbers of categories, of ROS 1

    def of(self, scene: Scene, stamp: float) -> Iterator[tuple[str, object, Callable[[], Any]]]:
        """Topic of each message at `stamp` [s], the part of `scene` that it tells, its maker."""
        if scene.floor is not None:
            yield "/map", scene.floor, partial(self.occupancy_grid, scene.floor, stamp)
        yield "/hereabouts/objects", scene.objects, partial(self.detections, scene, stamp)
        drawn = scene.objects, scene.places, scene.relations, scene.plan, scene.floor, scene.robot
        yield "/hereabouts/markers", drawn, partial(self.marker_array, scene, stamp)
        if len(scene.surface):
            surface = partial(self.point_cloud, scene.surface, stamp)
            yield "/hereabouts/surface", scene.surface, surface
        if scene.robot is not None:
            yield "/hereabouts/robot", scene.robot, partial(self.robot, scene.robot, stamp)
        yield "/hereabouts/plan", scene.plan, partial(self.path, scene.plan, stamp)

    def marker_array(self, scene: Scene, stamp: float) -> Any:
        """The scene without its floor; the message replaces all earlier markers."""
        header, height = self._header(stamp), scene.floor.height if scene.floor else 0.0
        markers = [self._marker(header, "", _CUBE, action=_DELETE_ALL)]
        for place in scene.places:
            markers += self._place(header, place)
        for thing in scene.objects:
            markers += self._object(header, thing)
        if scene.relations:
            ends = [end for ends in scene.relations for end in ends]
            style: dict[str, Any] = {"scale": (0.015, 0, 0), "colour": to_rgb(INK), "alpha": 0.6}
            markers.append(self._marker(header, "relations", _LINES, points=ends, **style))
        if scene.plan is not None:
            markers += self._plan(header, scene.plan, height + SURFACE)
        if scene.robot is not None:
            markers.append(self._arrow(header, "robot", scene.robot.p_map, scene.robot.heading))
        for number, marker in enumerate(markers):
            marker["id"] = number
        return self.make("visualization_msgs/msg/MarkerArray", markers=markers)

    def detections(self, scene: Scene, stamp: float) -> Any:
        """The objects, as vision_msgs/Detection3DArray, each with its category and its box.

        ROS 1 has a number for a category: that of an object's `text` in `classes`.
        """
        header, found = self._header(stamp), []
        for thing in scene.objects:
            pose, extent = _pose(thing.p_map, thing.yaw), thing.extent or (0.0, 0.0, 0.0)
            kind = {"score": thing.existence}
            result: dict[str, Any] = {"hypothesis": {"class_id": thing.text, **kind}}
            if self.is_ros1:
                number = self.classes.setdefault(thing.text, len(self.classes))
                result = {"id": number, **kind}
            name = {} if self.is_ros1 else {"id": thing.name}
            box = {"center": pose, "size": _point(extent)}
            results = [{**result, "pose": {"pose": pose}}]
            found.append({"header": header, "results": results, "bbox": box, **name})
        return self.make(_DETECTIONS, header=header, detections=found)

    def occupancy_grid(self, floor: SceneFloor, stamp: float) -> Any:
        """The floor: -1 unknown, 0 free, 100 occupied; rows along x."""
        grid = floor.grid
        width, height = grid.states.shape
        info = {
            "map_load_time": self.time(nanoseconds_of(stamp)),
            "resolution": grid.resolution,
            "width": width,
            "height": height,
            "origin": _pose((float(grid.origin[0]), float(grid.origin[1]), floor.height)),
        }
        data = np.ascontiguousarray(_OCCUPANCY[grid.states].T).ravel()
        return self.make(
            "nav_msgs/msg/OccupancyGrid", header=self._header(stamp), info=info, data=data
        )

    def point_cloud(self, surface: Surface, stamp: float) -> Any:
        """The surface: x, y, z [m] and rgb, four floats a point as RViz and Foxglove read them."""
        fields = [
            {"name": name, "offset": 4 * n, "datatype": _FLOAT32, "count": 1}
            for n, name in enumerate(("x", "y", "z", "rgb"))
        ]
        points = np.zeros(len(surface), [("at", "<f4", (3,)), ("bgra", "u1", (4,))])
        points["at"], points["bgra"][:, :3] = surface.points, surface.colours[:, ::-1]
        return self.make(
            "sensor_msgs/msg/PointCloud2",
            header=self._header(stamp),
            height=1,
            width=len(points),
            fields=fields,
            point_step=16,
            row_step=16 * len(points),
            data=points.view(np.uint8),
            is_dense=True,
        )

    def robot(self, robot: RobotRecord, stamp: float) -> Any:
        """The robot's position, its heading along x."""
        x, y, z = (float(c) for c in robot.p_map)
        pose = _pose((x, y, z), robot.heading)
        return self.make("geometry_msgs/msg/PoseStamped", header=self._header(stamp), pose=pose)

    def robot_transform(self, robot: RobotRecord) -> Any:
        """The robot's position as a transform to the map."""
        at = self.map_frame, ROBOT, _planar(robot.p_map, robot.heading)
        return self.transforms(nanoseconds_of(robot.stamp), *at)

    def object_frames(self, scene: Scene, stamp: float) -> Any:
        """The frames of objects that were asked for, as tf2_msgs/TFMessage."""
        made = self.make(LIVE_TOPICS["/tf"], transforms=[])
        for one in scene.frames:
            at = self.map_frame, one.name, _planar(one.p_map, one.yaw)
            made.transforms += self.transforms(nanoseconds_of(stamp), *at).transforms
        return made

    def camera(self, frame: Frame, detections: Detections) -> Iterator[tuple[str, Any]]:
        """Topic and message of a frame: pose, intrinsics, and the image with boxes, as JPEG."""
        stamp = nanoseconds_of(frame.stamp)
        header = self.header(stamp, CAMERA)
        yield "/tf", self.transforms(stamp, MAP, CAMERA, frame.T_map_cam)
        yield "/camera/camera_info", self.camera_info(frame.K, frame.depth.shape, header)
        jpeg = np.frombuffer(encode_jpeg(draw_detections(frame, detections)), np.uint8)
        image = {"header": header, "format": "jpeg", "data": jpeg}
        yield "/camera/image/compressed", self.make("sensor_msgs/msg/CompressedImage", **image)

    def log(self, text: str, stamp: float) -> Any:
        """A line of text, as rcl_interfaces/Log of ROS 2."""
        return self.make(
            "rcl_interfaces/msg/Log",
            stamp=self.time(nanoseconds_of(stamp)),
            level=_INFO,
            name="hereabouts",
            msg=cleaned(text),
        )

    def path(self, plan: ScenePlan | None, stamp: float) -> Any:
        """The way of a plan, as nav_msgs/Path; empty without a plan."""
        return self.way([(x, y, 0.0) for x, y in plan.path] if plan else (), stamp)

    def way(self, points: Iterable[Point], stamp: float) -> Any:
        """A line through `points`, as nav_msgs/Path."""
        header = self._header(stamp)
        poses = [{"header": header, "pose": _pose(point)} for point in points]
        return self.make("nav_msgs/msg/Path", header=header, poses=poses)

    def _object(self, header: Any, thing: SceneObject) -> Iterator[Any]:
        style: dict[str, Any] = {"at": thing.p_map, "colour": thing.colour}
        yield self._marker(
            header,
            "objects",
            _SHAPES[thing.shape],
            scale=(MARKER, MARKER, MARKER),
            alpha=thing.existence,
            **style,
        )
        if thing.extent is not None:
            alpha = 0.25 * thing.existence
            style |= {"scale": thing.extent, "heading": thing.yaw}
            yield self._marker(header, "extents", _CUBE, alpha=alpha, **style)
        x, y, z = thing.p_map
        above = max(MARKER, thing.extent[2] if thing.extent else 0.0) / 2 + TEXT
        yield self._words(header, "labels", thing.text, (x, y, z + above), thing.colour)

    def _place(self, header: Any, place: ScenePlace) -> Iterator[Any]:
        x, y, z = place.centre
        above = z + SURFACE / 2  # over the occupancy floor
        style: dict[str, Any]
        corners = triangles(place.outline).reshape(-1, 2)
        if place.colour is not None and len(corners):
            points = [(float(cx), float(cy), above) for cx, cy in corners]
            style = {"points": points, "scale": (1, 1, 1), "colour": place.colour, "alpha": TINT}
            yield self._marker(header, "places", _TRIANGLES, **style)
        for ring in place.outline:
            points = [(*corner, above) for corner in (*ring, ring[0])]
            style = {"points": points, "scale": (0.02, 0, 0), "colour": to_rgb(WALL), "alpha": 0.8}
            yield self._marker(header, "outlines", _STRIP, **style)
        yield self._words(header, "names", place.text, (x, y, z + 0.1), to_rgb(INK))

    def _plan(self, header: Any, plan: ScenePlan, z: float) -> Iterator[Any]:
        colour = to_rgb(ROUTE)
        if len(plan.path) > 1:
            points = [(x, y, z) for x, y in plan.path]
            style: dict[str, Any] = {"points": points, "scale": (0.04, 0, 0), "colour": colour}
            yield self._marker(header, "plan", _STRIP, **style)
        for stop in plan.stops:
            yield self._arrow(header, "stops", (*stop.p_map, z), stop.heading, colour)
            if stop.text:
                yield self._words(header, "reasons", stop.text, (*stop.p_map, z + 0.3), colour)

    def _arrow(
        self,
        header: Any,
        ns: str,
        at: Iterable[float],
        heading: float,
        colour: Colour | None = None,
    ) -> Any:
        x, y, z = (float(c) for c in at)
        style: dict[str, Any] = {"scale": (0.4, 0.08, 0.08), "colour": colour or to_rgb(INK)}
        return self._marker(header, ns, _ARROW, at=(x, y, z), heading=heading, **style)

    def _words(self, header: Any, ns: str, text: str, at: Point, colour: Colour) -> Any:
        scale = (0.0, 0.0, TEXT)
        return self._marker(header, ns, _WORDS, at=at, scale=scale, colour=colour, text=text)

    def _marker(
        self,
        header: Any,
        ns: str,
        kind: int,
        *,
        action: int = _ADD,
        at: Point = (0.0, 0.0, 0.0),
        heading: float = 0.0,
        scale: tuple[float, float, float] = (0.0, 0.0, 0.0),
        colour: Colour = (0.0, 0.0, 0.0),
        alpha: float = 1.0,
        points: Iterable[Point] = (),
        text: str = "",
    ) -> Any:
        red, green, blue = colour
        x, y, z = scale
        return {
            "header": header,
            "ns": ns,
            "type": kind,
            "action": action,
            "pose": _pose(at, heading),
            "scale": {"x": x, "y": y, "z": z},
            "color": {"r": red, "g": green, "b": blue, "a": alpha},
            "points": [_point(point) for point in points],
            "text": text,
        }

    def _header(self, stamp: float) -> dict[str, Any]:
        return self.header(nanoseconds_of(stamp), self.map_frame)


def _pose(at: Point, heading: float = 0.0) -> dict[str, Any]:
    turned = dict(zip("xyzw", heading_quaternion(heading), strict=True))
    return {"position": _point(at), "orientation": turned}


def _planar(p_map: Iterable[float], heading: float) -> Pose:
    """Pose (4, 4) of what stands upright."""
    T, c, s = np.eye(4), math.cos(heading), math.sin(heading)
    T[:2, :2], T[:3, 3] = [[c, -s], [s, c]], tuple(p_map)
    return T


def _point(at: Point) -> dict[str, float]:
    return dict(zip("xyz", at, strict=True))


def nanoseconds_of(stamp: float) -> int:
    """`stamp` [s] as [ns], within the 31 bits of seconds that messages have."""
    return round(min(max(stamp, 0.0), _LATEST) * 1e9) if math.isfinite(stamp) else 0


_LATCHED: Final = 1


def scenes_as_bag(scenes: Iterable[tuple[Scene, float]]) -> bytes:
    """A ROS 1 bag of scenes, each with its time [s since 1970].

    Topics are latched: a later subscriber gets the last message.
    """
    types = message_types(is_ros1=True)
    messages = RosMessages(is_ros1=True)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "scene.bag"
        with Writer(path) as bag:
            connections = {
                topic: bag.add_connection(topic, kind, typestore=types, latching=_LATCHED)
                for topic, kind in TOPICS.items()
            }
            for scene, stamp in scenes:
                at = max(nanoseconds_of(stamp), 1)  # ROS 1 has no time 0
                for topic, part, make in messages.of(scene, at / 1e9):
                    if topic in TOPICS and part is not None:
                        data = serialised(TOPICS[topic], make(), is_ros1=True)
                        bag.write(connections[topic], at, data)
        return path.read_bytes()

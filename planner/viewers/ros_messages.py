"""Scenes as ROS messages: visualization_msgs/MarkerArray, nav_msgs/OccupancyGrid, and more.

Messages are those of a `rosbags` typestore, of ROS 1 or ROS 2; no ROS is needed. Its
`serialize_ros1` or `serialize_cdr` makes the bytes that bags keep and connections carry.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from typing import Any, Final

import numpy as np
from matplotlib.colors import to_rgb

from kg.records import FREE, LOW, TALL, UNKNOWN, RobotRecord
from planner.viewers.scene import (
    Colour,
    Point,
    Scene,
    SceneFloor,
    SceneObject,
    ScenePlace,
    ScenePlan,
    triangles,
)
from planner.viewers.viewer import MAP, MARKER, SURFACE, TEXT, TINT, heading_quaternion
from planner.visualization.palette import INK, ROUTE, WALL

#: topic -> type; in ROS 1 without the "msg"
TOPICS: Final = {
    "/map": "nav_msgs/msg/OccupancyGrid",
    "/hereabouts/markers": "visualization_msgs/msg/MarkerArray",
    "/hereabouts/robot": "geometry_msgs/msg/PoseStamped",
    "/hereabouts/plan": "nav_msgs/msg/Path",
}
#: by UNKNOWN, FREE, LOW, TALL: what one looks over stops a robot all the same
_OCCUPANCY: Final = np.zeros(4, np.int8)
_OCCUPANCY[[UNKNOWN, FREE, LOW, TALL]] = (-1, 0, 100, 100)
_LATEST: Final = 2**31 - 1  # [s]
_ARROW, _CUBE, _SPHERE, _CYLINDER, _STRIP, _LINES, _WORDS, _TRIANGLES = 0, 1, 2, 3, 4, 5, 9, 11
_SHAPES: Final = {"cube": _CUBE, "sphere": _SPHERE, "cylinder": _CYLINDER}
_ADD, _DELETE_ALL = 0, 3


class RosMessages:
    """Makes messages of one typestore."""

    def __init__(self, types: Any) -> None:
        """`types` is a typestore of `rosbags.typesys`."""
        self._types = types.types
        header = self._types["std_msgs/msg/Header"]
        self._sequenced = "seq" in header.__dataclass_fields__  # ROS 1

    def of(self, scene: Scene, stamp: float) -> Iterator[tuple[str, Any]]:
        """Topic and message of everything that `scene` has, at `stamp` [s]."""
        if scene.floor is not None:
            yield "/map", self.occupancy_grid(scene.floor, stamp)
        yield "/hereabouts/markers", self.marker_array(scene, stamp)
        if scene.robot is not None:
            yield "/hereabouts/robot", self.robot(scene.robot, stamp)
        if scene.plan is not None:
            yield "/hereabouts/plan", self.path(scene.plan, stamp)

    def marker_array(self, scene: Scene, stamp: float) -> Any:
        """All of a scene but its floor; it replaces what was drawn before."""
        header, height = self._header(stamp), scene.floor.height if scene.floor else 0.0
        markers = [self._marker(header, "", _CUBE, action=_DELETE_ALL)]
        for place in scene.places:
            markers += self._place(header, place)
        for thing in scene.objects:
            markers += self._object(header, thing)
        if scene.relations:
            ends = [end for relation in scene.relations for end in relation.ends]
            style: dict[str, Any] = {"scale": (0.015, 0, 0), "colour": to_rgb(INK), "alpha": 0.6}
            markers.append(self._marker(header, "relations", _LINES, points=ends, **style))
        if scene.plan is not None:
            markers += self._plan(header, scene.plan, height + SURFACE)
        if scene.robot is not None:
            markers.append(self._arrow(header, "robot", scene.robot.p_map, scene.robot.heading))
        for number, marker in enumerate(markers):
            marker.id = number
        return self._make("visualization_msgs/msg/MarkerArray", markers=markers)

    def occupancy_grid(self, floor: SceneFloor, stamp: float) -> Any:
        """The floor: -1 unknown, 0 free, 100 occupied; rows along x."""
        grid = floor.grid
        width, height = grid.states.shape
        info = self._make(
            "nav_msgs/msg/MapMetaData",
            map_load_time=self._time(stamp),
            resolution=grid.resolution,
            width=width,
            height=height,
            origin=self._pose((float(grid.origin[0]), float(grid.origin[1]), floor.height)),
        )
        data = np.ascontiguousarray(_OCCUPANCY[grid.states].T).ravel()
        return self._make(
            "nav_msgs/msg/OccupancyGrid", header=self._header(stamp), info=info, data=data
        )

    def robot(self, robot: RobotRecord, stamp: float) -> Any:
        """Where the robot is, its heading along x."""
        x, y, z = (float(c) for c in robot.p_map)
        pose = self._pose((x, y, z), robot.heading)
        return self._make("geometry_msgs/msg/PoseStamped", header=self._header(stamp), pose=pose)

    def path(self, plan: ScenePlan, stamp: float) -> Any:
        """The way of a plan, as nav_msgs/Path."""
        header = self._header(stamp)
        poses = [
            self._make("geometry_msgs/msg/PoseStamped", header=header, pose=self._pose((x, y, 0.0)))
            for x, y in plan.path
        ]
        return self._make("nav_msgs/msg/Path", header=header, poses=poses)

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
            yield self._marker(header, "extents", _CUBE, scale=thing.extent, alpha=alpha, **style)
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
        return self._make(
            "visualization_msgs/msg/Marker",
            header=header,
            ns=ns,
            type=kind,
            action=action,
            pose=self._pose(at, heading),
            scale=self._make("geometry_msgs/msg/Vector3", x=x, y=y, z=z),
            color=self._make("std_msgs/msg/ColorRGBA", r=red, g=green, b=blue, a=alpha),
            points=[self._point(point) for point in points],
            text=text,
        )

    def _pose(self, at: Point, heading: float = 0.0) -> Any:
        x, y, z, w = heading_quaternion(heading)
        turn = self._make("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w)
        return self._make("geometry_msgs/msg/Pose", position=self._point(at), orientation=turn)

    def _point(self, at: Point) -> Any:
        x, y, z = at
        return self._make("geometry_msgs/msg/Point", x=x, y=y, z=z)

    def _header(self, stamp: float) -> Any:
        seq = {"seq": 0} if self._sequenced else {}
        return self._make("std_msgs/msg/Header", stamp=self._time(stamp), frame_id=MAP, **seq)

    def _time(self, stamp: float) -> Any:
        seconds, nanoseconds = divmod(nanoseconds_of(stamp), 10**9)
        return self._make("builtin_interfaces/msg/Time", sec=seconds, nanosec=nanoseconds)

    def _make(self, kind: str, **fields: Any) -> Any:
        """A message with these fields, the others empty."""
        made = self._types[kind]
        empty = {
            name: self._empty(str(field.type))
            for name, field in made.__dataclass_fields__.items()
            if name not in fields and "ClassVar" not in str(field.type)
        }
        return made(**fields, **empty)

    def _empty(self, kind: str) -> Any:
        plain = {"str": "", "int": 0, "float": 0.0, "bool": False}
        if kind in plain:
            return plain[kind]
        if kind.startswith("list["):
            return []
        if kind.startswith("np.ndarray"):
            return np.empty(0, np.uint8)
        return self._make(kind.replace("__", "/"))


def nanoseconds_of(stamp: float) -> int:
    """`stamp` [s] as [ns], within the 31 bits of seconds that messages have."""
    return round(min(max(stamp, 0.0), _LATEST) * 1e9) if math.isfinite(stamp) else 0

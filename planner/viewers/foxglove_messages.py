"""Scenes, frames and poses as messages of Foxglove's schemas.

https://docs.foxglove.dev/docs/sdk/schemas: metres, quaternions as x y z w, `map` with z up, camera
with z forwards. Each SceneUpdate is a whole state that replaces the one before, since a player that
jumps to a moment reads the last message of each topic alone.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Final

import numpy as np
from foxglove.messages import (
    ArrowPrimitive,
    CameraCalibration,
    Color,
    CompressedImage,
    CubePrimitive,
    CylinderPrimitive,
    FrameTransform,
    Grid,
    ImageAnnotations,
    KeyValuePair,
    LinePrimitive,
    LinePrimitiveLineType,
    Log,
    LogLevel,
    PackedElementField,
    PackedElementFieldNumericType,
    Point2,
    Point3,
    PointsAnnotation,
    PointsAnnotationType,
    Pose,
    PoseInFrame,
    Quaternion,
    SceneEntity,
    SceneEntityDeletion,
    SceneEntityDeletionType,
    SceneUpdate,
    SpherePrimitive,
    TextAnnotation,
    TextPrimitive,
    Timestamp,
    TriangleListPrimitive,
    Vector2,
    Vector3,
)
from matplotlib.colors import to_rgb

from kg.records import FREE, LOW, TALL, RobotRecord
from perception.annotate import encode_jpeg, label_colour
from perception.camera.poses import quaternion_from_pose
from perception.frames import Detections, Frame
from planner.execution.protocol import cleaned
from planner.viewers.scene import (
    Colour,
    Point,
    SceneFloor,
    SceneObject,
    ScenePlace,
    ScenePlan,
    SceneRelation,
    triangles,
)
from planner.viewers.viewer import (
    CAMERA,
    MAP,
    MARKER,
    ROBOT,
    SURFACE,
    TEXT,
    TINT,
    heading_quaternion,
)
from planner.visualization.palette import FURNITURE, INK, ROUTE, WALL

_LATEST: Final = 2.0**32 - 1  # [s]


def timestamp(stamp: float) -> Timestamp:
    """`stamp` [s] since 1970."""
    seconds, nanoseconds = divmod(nanoseconds_of(stamp), 10**9)
    return Timestamp(sec=seconds, nsec=nanoseconds)


def nanoseconds_of(stamp: float) -> int:
    """`stamp` [s] as [ns], within the 32 bits of seconds that messages have."""
    return round(min(max(stamp, 0.0), _LATEST) * 1e9) if math.isfinite(stamp) else 0


def remark(text: str, stamp: float) -> Log:
    """A line for Foxglove's log panel."""
    return Log(
        timestamp=timestamp(stamp), level=LogLevel.Info, message=cleaned(text), name="hereabouts"
    )


def objects_update(objects: Iterable[SceneObject], stamp: float) -> SceneUpdate:
    """Markers, texts and boxes."""
    return _update((_object(o, timestamp(stamp)) for o in objects), stamp)


def places_update(places: Iterable[ScenePlace], stamp: float) -> SceneUpdate:
    """Floors and names of places."""
    return _update((_place(p, timestamp(stamp)) for p in places), stamp)


def relations_update(relations: Iterable[SceneRelation], stamp: float) -> SceneUpdate:
    """A line for each relation."""
    return _update((_relation(r, timestamp(stamp)) for r in relations), stamp)


def plan_update(plan: ScenePlan | None, height: float, stamp: float) -> SceneUpdate:
    """The way and its numbered stops, on a floor at `height` [m]."""
    if plan is None:
        return _update((), stamp)
    colour = _colour(to_rgb(ROUTE), 1.0)
    z = height + SURFACE
    way = _entity(
        "path",
        timestamp(stamp),
        lines=[_line([(x, y, z) for x, y in plan.path], colour, 0.04)],
    )
    stops = [
        _entity(
            f"stop/{number}",
            timestamp(stamp),
            arrows=[
                ArrowPrimitive(
                    pose=_pose((*stop.p_map, z), heading_quaternion(stop.heading)),
                    shaft_length=0.3,
                    shaft_diameter=0.05,
                    head_length=0.12,
                    head_diameter=0.12,
                    color=colour,
                )
            ],
            texts=[_text(stop.text, (*stop.p_map, z + 0.3), colour)] if stop.text else [],
        )
        for number, stop in enumerate(plan.stops, start=1)
    ]
    return _update([way, *stops], stamp)


def trail_update(points: Iterable[Point], stamp: float) -> SceneUpdate:
    """Where the robot has been: a line through `points`."""
    line = _line(points, _colour(to_rgb(INK), 0.7), 0.03)
    return _update([_entity("trail", timestamp(stamp), lines=[line])], stamp)


def grid(floor: SceneFloor | None, stamp: float) -> Grid:
    """The floor as red, green, blue and alpha of each cell, rows along x."""
    fields = [
        PackedElementField(name=name, offset=i, type=PackedElementFieldNumericType.Uint8)
        for i, name in enumerate(("red", "green", "blue", "alpha"))
    ]
    tints = np.zeros((4, 4), np.uint8)
    for state, colour, strength in ((FREE, "white", 140), (LOW, FURNITURE, 170), (TALL, WALL, 230)):
        tints[state] = (*(round(255 * c) for c in to_rgb(colour)), strength)
    states = np.zeros((1, 1), np.uint8) if floor is None else floor.grid.states
    origin = (0.0, 0.0) if floor is None else floor.grid.origin
    cell = 0.05 if floor is None else floor.grid.resolution
    columns = states.shape[0]
    return Grid(
        timestamp=timestamp(stamp),
        frame_id=MAP,
        pose=_pose((float(origin[0]), float(origin[1]), floor.height if floor else 0.0)),
        column_count=columns,
        cell_size=Vector2(x=cell, y=cell),
        row_stride=4 * columns,
        cell_stride=4,
        fields=fields,
        data=tints[states.T].tobytes(),
    )


def robot_pose(robot: RobotRecord) -> PoseInFrame:
    """Where the robot is, its heading along x."""
    x, y, z = (float(c) for c in robot.p_map)
    pose = _pose((x, y, z), heading_quaternion(robot.heading))
    return PoseInFrame(timestamp=timestamp(robot.stamp), frame_id=MAP, pose=pose)


def robot_transform(robot: RobotRecord) -> FrameTransform:
    """The same as a transform from the robot to the map."""
    x, y, z = (float(c) for c in robot.p_map)
    return FrameTransform(
        timestamp=timestamp(robot.stamp),
        parent_frame_id=MAP,
        child_frame_id=ROBOT,
        translation=Vector3(x=x, y=y, z=z),
        rotation=_quaternion(heading_quaternion(robot.heading)),
    )


def camera_transform(frame: Frame) -> FrameTransform:
    """`T_map_cam`."""
    x, y, z = (float(c) for c in frame.T_map_cam[:3, 3])
    return FrameTransform(
        timestamp=timestamp(frame.stamp),
        parent_frame_id=MAP,
        child_frame_id=CAMERA,
        translation=Vector3(x=x, y=y, z=z),
        rotation=_quaternion(quaternion_from_pose(frame.T_map_cam).tolist()),
    )


def camera_calibration(frame: Frame) -> CameraCalibration:
    """Pinhole intrinsics, distortion already undone."""
    height, width = frame.depth.shape
    K = [float(value) for value in frame.K.ravel()]
    P = np.hstack([frame.K, np.zeros((3, 1))])
    return CameraCalibration(
        timestamp=timestamp(frame.stamp),
        frame_id=CAMERA,
        width=width,
        height=height,
        distortion_model="plumb_bob",
        D=[0.0] * 5,
        K=K,
        R=[float(value) for value in np.eye(3).ravel()],
        P=[float(value) for value in P.ravel()],
    )


def image(frame: Frame) -> CompressedImage:
    """The colour image as JPEG."""
    return CompressedImage(
        timestamp=timestamp(frame.stamp),
        frame_id=CAMERA,
        data=encode_jpeg(frame.rgb),
        format="jpeg",
    )


def boxes(frame: Frame, detections: Detections) -> ImageAnnotations:
    """A box and a text for each detection."""
    loops, texts = [], []
    for box, score, label in zip(detections.xyxy, detections.score, detections.label, strict=True):
        x0, y0, x1, y1 = (float(value) for value in box)
        red, green, blue = (value / 255 for value in label_colour(label))
        colour = _colour((red, green, blue), 1.0)
        loops.append(
            PointsAnnotation(
                timestamp=timestamp(frame.stamp),
                type=PointsAnnotationType.LineLoop,
                points=[Point2(x=x, y=y) for x, y in ((x0, y0), (x1, y0), (x1, y1), (x0, y1))],
                outline_color=colour,
                thickness=2.0,
            )
        )
        texts.append(
            TextAnnotation(
                timestamp=timestamp(frame.stamp),
                position=Point2(x=x0, y=y0),
                text=f"{cleaned(label)} {score:.2f}",
                font_size=14.0,
                text_color=_colour((1.0, 1.0, 1.0), 1.0),
                background_color=_colour((red, green, blue), 0.8),
            )
        )
    return ImageAnnotations(timestamp=timestamp(frame.stamp), points=loops, texts=texts)


def _object(thing: SceneObject, at: Timestamp) -> SceneEntity:
    colour = _colour(thing.colour, thing.existence)
    pose, size = _pose(thing.p_map), Vector3(x=MARKER, y=MARKER, z=MARKER)
    x, y, z = thing.p_map
    top = z + max(MARKER, thing.extent[2] if thing.extent else 0.0) / 2 + TEXT
    cubes, spheres, cylinders = [], [], []
    if thing.shape == "cube":
        cubes.append(CubePrimitive(pose=pose, size=size, color=colour))
    elif thing.shape == "sphere":
        spheres.append(SpherePrimitive(pose=pose, size=size, color=colour))
    else:
        cylinders.append(
            CylinderPrimitive(pose=pose, size=size, bottom_scale=1, top_scale=1, color=colour)
        )
    if thing.extent is not None:
        width, depth, height = thing.extent
        cubes.append(
            CubePrimitive(
                pose=pose,
                size=Vector3(x=width, y=depth, z=height),
                color=_colour(thing.colour, 0.25 * thing.existence),
            )
        )
    return _entity(
        thing.name,
        at,
        cubes=cubes,
        spheres=spheres,
        cylinders=cylinders,
        texts=[_text(thing.text, (x, y, top), _colour(thing.colour, 1.0))],
        metadata={
            "category": thing.text,
            "group": thing.group,
            "existence": f"{thing.existence:.3f}",
            "place": thing.place or "",
        },
    )


def _place(place: ScenePlace, at: Timestamp) -> SceneEntity:
    x, y, z = place.centre
    above = z + SURFACE / 2  # over the occupancy floor
    rings = [
        _line([(*corner, above) for corner in (*ring, ring[0])], _colour(to_rgb(WALL), 0.8), 0.02)
        for ring in place.outline
    ]
    surface = []
    if place.colour is not None:
        corners = triangles(place.outline).reshape(-1, 2)
        surface.append(
            TriangleListPrimitive(
                pose=_pose((0.0, 0.0, 0.0)),
                points=[Point3(x=float(cx), y=float(cy), z=above) for cx, cy in corners],
                color=_colour(place.colour, TINT),
            )
        )
    texts = [_text(place.text, (x, y, z + SURFACE), _colour(to_rgb(INK), 1.0))]
    return _entity(place.name, at, triangles=surface, lines=rings, texts=texts)


def _relation(relation: SceneRelation, at: Timestamp) -> SceneEntity:
    colour = _colour(to_rgb(INK), 0.6)
    return _entity(
        f"{relation.name} {relation.kind} {relation.target}",
        at,
        lines=[_line(relation.ends, colour, 0.015)],
        metadata={"kind": relation.kind},
    )


def _update(entities: Iterable[SceneEntity], stamp: float) -> SceneUpdate:
    everything = SceneEntityDeletion(
        timestamp=timestamp(stamp), type=SceneEntityDeletionType.All, id=""
    )
    return SceneUpdate(deletions=[everything], entities=list(entities))


def _entity(
    name: str,
    at: Timestamp,
    *,
    metadata: dict[str, str] | None = None,
    cubes: list[CubePrimitive] | None = None,
    spheres: list[SpherePrimitive] | None = None,
    cylinders: list[CylinderPrimitive] | None = None,
    lines: list[LinePrimitive] | None = None,
    triangles: list[TriangleListPrimitive] | None = None,
    arrows: list[ArrowPrimitive] | None = None,
    texts: list[TextPrimitive] | None = None,
) -> SceneEntity:
    return SceneEntity(
        timestamp=at,
        frame_id=MAP,
        id=name,
        metadata=[KeyValuePair(key=key, value=value) for key, value in (metadata or {}).items()],
        cubes=cubes or [],
        spheres=spheres or [],
        cylinders=cylinders or [],
        lines=lines or [],
        triangles=triangles or [],
        arrows=arrows or [],
        texts=texts or [],
    )


def _line(points: Iterable[Point], colour: Color, thickness: float) -> LinePrimitive:
    return LinePrimitive(
        type=LinePrimitiveLineType.LineStrip,
        pose=_pose((0.0, 0.0, 0.0)),
        thickness=thickness,
        points=[Point3(x=x, y=y, z=z) for x, y, z in points],
        color=colour,
    )


def _text(text: str, at: Point, colour: Color) -> TextPrimitive:
    return TextPrimitive(pose=_pose(at), billboard=True, font_size=TEXT, color=colour, text=text)


def _pose(at: Point, q: Sequence[float] = (0.0, 0.0, 0.0, 1.0)) -> Pose:
    x, y, z = at
    return Pose(position=Vector3(x=x, y=y, z=z), orientation=_quaternion(q))


def _quaternion(q: Sequence[float]) -> Quaternion:
    x, y, z, w = (float(c) for c in q)
    return Quaternion(x=x, y=y, z=z, w=w)


def _colour(colour: Colour, alpha: float) -> Color:
    red, green, blue = colour
    return Color(r=red, g=green, b=blue, a=alpha)

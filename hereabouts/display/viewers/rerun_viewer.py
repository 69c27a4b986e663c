"""Rerun: scenes, frames and poses as archetypes in an .rrd file."""

from __future__ import annotations

import ctypes
import math
import tempfile
import time
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
import rerun as rr
from matplotlib.colors import to_rgb

from hereabouts.display.plots.palette import FURNITURE, INK, ROUTE, WALL
from hereabouts.display.viewers.scene import (
    Colour,
    Scene,
    SceneFloor,
    SceneObject,
    ScenePlace,
    ScenePlan,
    triangles,
)
from hereabouts.display.viewers.viewer import (
    FLUSHED,
    MARKER,
    ROUNDING,
    SURFACE,
    TINT,
    check_new_file,
    heading_quaternion,
    picture_errors,
)
from kg.model.errors import PictureError
from kg.model.records import FREE, LOW, TALL, RobotRecord
from perception.annotate import encode_jpeg, label_colour
from perception.frames import Detections, Frame
from planner.execution.protocol import cleaned

_TIME: Final = "time"
_LATEST: Final = 2.0**33  # [s]
_PATIENCE: Final = 20.0  # [s] that writing to the disk may take


class RerunViewer:
    """Viewer that logs to a Rerun recording."""

    def __init__(self, title: str) -> None:
        self._log = rr.RecordingStream(title or "hereabouts")
        self._written: dict[str, object] = {}
        self._robot_stamp = -math.inf

    def show(self, scene: Scene, stamp: float) -> None:
        """Log the parts that changed."""
        self._at(stamp)
        if self._changed("axes", None):
            self._log.log("map", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        if self._changed("objects", scene.objects):
            self._objects(scene.objects)
        if self._changed("places", scene.places):
            self._places(scene.places)
        if self._changed("relations", scene.relations):
            self._lines("map/relations", scene.relations)
        if self._changed("floor", scene.floor) and scene.floor is not None:
            self._log.log("map/floor", _floor(scene.floor))
        if len(scene.surface) and self._changed("surface", scene.surface):
            half, points = scene.surface.size / 2, scene.surface.points
            cloud = rr.Points3D(points, colors=scene.surface.colours, radii=half)
            self._log.log("map/surface", cloud)
        if self._changed("plan", scene.plan):
            self._plan(scene.plan, scene.floor.height if scene.floor else 0.0)
        if scene.robot is not None and scene.robot.stamp > self._robot_stamp + ROUNDING:
            self.robot(scene.robot)

    def frame(self, frame: Frame, detections: Detections) -> None:
        """Log image, boxes, intrinsics and camera pose."""
        self._at(frame.stamp)
        height, width = frame.depth.shape
        pose = rr.Transform3D(translation=frame.T_map_cam[:3, 3], mat3x3=frame.T_map_cam[:3, :3])
        self._log.log("map/camera", pose)
        self._log.log(
            "map/camera/image", rr.Pinhole(image_from_camera=frame.K, width=width, height=height)
        )
        jpeg = rr.EncodedImage(contents=encode_jpeg(frame.rgb), media_type="image/jpeg")
        self._log.log("map/camera/image", jpeg)
        boxes = rr.Boxes2D(
            array=detections.xyxy,
            array_format=rr.Box2DFormat.XYXY,
            labels=[
                f"{cleaned(label)} {score:.2f}"
                for label, score in zip(detections.label, detections.score, strict=True)
            ],
            colors=[label_colour(label) for label in detections.label],
        )
        self._log.log("map/camera/image/detections", boxes)

    def robot(self, robot: RobotRecord) -> None:
        """Log the robot as an arrow along its heading."""
        self._robot_stamp = robot.stamp
        self._at(robot.stamp)
        pose = rr.Transform3D(
            translation=robot.p_map,
            quaternion=rr.Quaternion(xyzw=heading_quaternion(robot.heading)),
        )
        self._log.log("map/robot", pose)
        self._log.log("map/robot", rr.Arrows3D(vectors=[[0.4, 0, 0]], colors=[_rgba(to_rgb(INK))]))

    def remark(self, text: str, stamp: float) -> None:
        """Log a line of text."""
        self._at(stamp)
        self._log.log("log", rr.TextLog(cleaned(text)))

    def close(self) -> None:
        """Write what is left, and the list of contents."""
        self._log.disconnect()

    def _at(self, stamp: float) -> None:
        finite = stamp if math.isfinite(stamp) else 0.0
        self._log.set_time(_TIME, timestamp=min(max(finite, 0.0), _LATEST))

    def _changed(self, name: str, part: object) -> bool:
        if name in self._written and self._written[name] == part:
            return False
        self._written[name] = part
        return True

    def _objects(self, objects: tuple[SceneObject, ...]) -> None:
        half = MARKER / 2
        for shape in ("cube", "sphere", "cylinder"):
            things = [thing for thing in objects if thing.shape == shape]
            style: dict[str, Any] = {
                "centers": [thing.p_map for thing in things],
                "colors": [_rgba(thing.colour, thing.existence) for thing in things],
                "labels": [thing.text for thing in things],
                "show_labels": True,
                "fill_mode": rr.components.FillMode.Solid,
            }
            n = len(things)
            drawn: rr.Boxes3D | rr.Ellipsoids3D | rr.Cylinders3D
            if shape == "cube":
                drawn = rr.Boxes3D(half_sizes=[[half] * 3] * n, **style)
            elif shape == "sphere":
                drawn = rr.Ellipsoids3D(half_sizes=[[half] * 3] * n, **style)
            else:
                drawn = rr.Cylinders3D(lengths=[MARKER] * n, radii=[half] * n, **style)
            self._log.log(f"map/objects/{shape}s", drawn)
        boxes = [(thing, thing.extent) for thing in objects if thing.extent is not None]
        self._log.log(
            "map/objects/extents",
            rr.Boxes3D(
                centers=[thing.p_map for thing, _ in boxes],
                sizes=[extent for _, extent in boxes],
                quaternions=[rr.Quaternion(xyzw=heading_quaternion(t.yaw)) for t, _ in boxes],
                colors=[_rgba(thing.colour, thing.existence) for thing, _ in boxes],
            ),
        )

    def _places(self, places: tuple[ScenePlace, ...]) -> None:
        self._log.log("map/places", rr.Clear(recursive=True))
        for place in places:
            x, y, z = place.centre
            above = z + SURFACE / 2
            rings = [[(*corner, above) for corner in (*ring, ring[0])] for ring in place.outline]
            path = f"map/places/{rr.escape_entity_path_part(place.name)}"
            self._lines(f"{path}/outline", rings)
            corners = triangles(place.outline).reshape(-1, 2)
            if place.colour is not None and len(corners):
                vertices = np.column_stack([corners, np.full(len(corners), above)])
                mesh = rr.Mesh3D(vertex_positions=vertices, albedo_factor=_rgba(place.colour, TINT))
                self._log.log(f"{path}/floor", mesh)
            name = rr.Points3D([(x, y, z)], labels=[place.text], radii=[0.02], show_labels=True)
            self._log.log(f"{path}/name", name)

    def _plan(self, plan: ScenePlan | None, height: float) -> None:
        z = height + SURFACE
        path, stops = (plan.path, plan.stops) if plan else ((), ())
        way = [[(x, y, z) for x, y in path]] if path else []
        self._log.log("map/plan/path", rr.LineStrips3D(way, colors=[_rgba(to_rgb(ROUTE))]))
        arrows = rr.Arrows3D(
            origins=[(*stop.p_map, z) for stop in stops],
            vectors=[[0.4 * math.cos(s.heading), 0.4 * math.sin(s.heading), 0] for s in stops],
            labels=[stop.text for stop in stops],
            colors=[_rgba(to_rgb(ROUTE))] * len(stops),
        )
        self._log.log("map/plan/stops", arrows)

    def _lines(self, path: str, strips: Sequence[Any]) -> None:
        self._log.log(path, rr.LineStrips3D(strips, colors=[_rgba(to_rgb(WALL))]))


class RerunFile(RerunViewer):
    """Viewer that writes an .rrd file as it goes, made with the first message."""

    def __init__(self, title: str, path: Path) -> None:
        """Raises PictureError if no new file can be made at `path`."""
        super().__init__(title)
        check_new_file(path)
        self._path, self._begun = path, False
        self._flushed = time.monotonic()

    def close(self) -> None:
        """Write what is left, and the list of contents."""
        self._flush()
        super().close()

    def _at(self, stamp: float) -> None:
        if not self._begun:
            self._begun = True
            with picture_errors(self._path):
                self._path.touch(exist_ok=False)
                self._log.save(self._path)
        elif time.monotonic() - self._flushed > FLUSHED:
            self._flush()
        super()._at(stamp)

    def _flush(self) -> None:
        # only this shows a full disk: the writing thread has ended
        try:
            with picture_errors(self._path):
                self._log.flush(timeout_sec=_PATIENCE)
        except PictureError:
            # destroying the stream would wait for that thread for ever
            rr.unregister_shutdown()
            ctypes.pythonapi.Py_IncRef(ctypes.py_object(self._log.to_native()))
            raise
        self._flushed = time.monotonic()


def scenes_as_rrd(scenes: Iterable[tuple[Scene, float]]) -> bytes:
    """An .rrd file of scenes, each with its time [s since 1970]."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "scene.rrd"
        viewer: RerunFile | None = None
        for scene, stamp in scenes:
            viewer = viewer or RerunFile(scene.title, path)
            viewer.show(scene, stamp)
        if viewer is not None:
            viewer.close()
        return path.read_bytes()


def _floor(floor: SceneFloor) -> rr.Mesh3D:
    """The occupancy floor as a picture on a rectangle."""
    grid = floor.grid
    tints = np.full((4, 3), 200, np.uint8)
    for state, colour in ((FREE, "white"), (LOW, FURNITURE), (TALL, WALL)):
        tints[state] = [round(255 * c) for c in to_rgb(colour)]
    x0, y0 = grid.origin
    x1, y1 = grid.origin + np.array(grid.states.shape) * grid.resolution
    z = floor.height
    return rr.Mesh3D(
        vertex_positions=[(x0, y0, z), (x1, y0, z), (x1, y1, z), (x0, y1, z)],
        triangle_indices=[(0, 1, 2), (0, 2, 3)],
        vertex_texcoords=[(0, 1), (1, 1), (1, 0), (0, 0)],
        albedo_texture=np.ascontiguousarray(tints[grid.states.T[::-1]]),
    )


def _rgba(colour: Colour, alpha: float = 1.0) -> tuple[int, int, int, int]:
    red, green, blue = (round(255 * c) for c in colour)
    return red, green, blue, round(255 * min(max(alpha, 0.0), 1.0))

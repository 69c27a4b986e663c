"""Two drives through a simulated house, written as recordings, and what is true after each.

The door of one room is shut, and small things move between the drives. The truth is a plain map
(`lab.questions.plain_map`) of things that were seen well; a thing at the edge is doubtful.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from contextlib import nullcontext
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from lab.houses.house_changes import changed_house
from lab.houses.random_house import random_house
from lab.recordings.hard_senses import SENSES, detector_of
from lab.recordings.simulated_recording import DAY, KINECT
from lab.recordings.viewed_truth import HouseTruth, TourPart, surfaces
from perception.frames import Detections
from perception.inference.recorded_detections import save_recorded_detections
from perception.sources.recording_writer import RecordingWriter, write_text
from planner.simulation.camera import CameraModel, SimulatedCamera, TrueView
from planner.simulation.house import House, HouseRoom, Wall
from planner.simulation.house_robot import START, SimulatedTour

SESSIONS: Final = ("session-1", "session-2")
_SPREAD: Final = DAY / 2  # [s] over which houses are driven through, each at its own time
_SIDES: Final = (-0.2, 0.2)  # [m] from the middle of a wall into the rooms beside it

Box = tuple[int, int, int, int]
Boxes = dict[str, dict[int, Box]]  # frame -> number of a thing -> box


@dataclass(frozen=True, slots=True)
class Doubtful:
    """An item that a map may contain or not, under any of its labels."""

    labels: frozenset[str]
    x: float  # [m]
    y: float


@dataclass(slots=True)
class HouseFacts:
    """Truth of a house after the last drive."""

    number: str
    before: dict[str, Any] = field(default_factory=dict)  # plain map after the first drive
    now: dict[str, Any] = field(default_factory=dict)
    doubtful: list[Doubtful] = field(default_factory=list)
    frames: dict[str, list[tuple[str, str]]] = field(default_factory=dict)  # that show it well
    glimpsed: set[str] = field(default_factory=set)  # labels of things seen later, but not well
    rooms_with: dict[str, set[str]] = field(default_factory=dict)  # of each label, seen or not
    #: thing -> recording, frame and box (x0, y0, x1, y1) [px] of every good view
    boxes: dict[str, list[tuple[str, str, Box]]] = field(default_factory=dict)


def drive(seed: int, folder: Path | None) -> HouseFacts:
    """Write both recordings of the house of `seed` into `folder`, if given; its facts."""
    house, random = _with_closed_room(random_house(seed), seed), np.random.default_rng([seed, 29])
    points, truth, facts = surfaces(house), HouseTruth(), _Facts(house.rooms, str(seed))
    for number, name in enumerate(SESSIONS):
        if number:
            house = changed_house(house, random).house
        camera = SimulatedCamera(house, CameraModel(depth=KINECT), 1000 * seed + number)
        start = START + number * DAY + 3571.0 * seed % _SPREAD
        tour = SimulatedTour(camera, name=name, start=start)
        session = TourPart(camera, tour, 1.0, np.concatenate([points, truth.spots()]))
        stamps, boxes = _driven(session, None if folder is None else folder / name)
        truth.add(session, len(points))
        facts.add(session, stamps, truth, boxes)
    if folder is not None:
        _write_json(folder / "places.json", [_place(n, room) for n, room in facts.rooms])
    return facts.told(house)


def _with_closed_room(house: House, seed: int) -> House:
    """The house with the door of one room shut: one that leads nowhere else, and not the first."""
    doors = {room.name: _doors(room, house) for room in house.rooms}
    whole = {room.name for room in house.rooms} - {room.part_of for room in house.rooms}
    ends = [r for r in house.rooms[1:] if len(doors[r.name]) == 1 and r.name in whole]
    ends = [room for room in ends if not room.part_of]
    if not ends:
        return house
    shut = ends[int(np.random.default_rng([seed, 31]).integers(len(ends)))]
    (closed,) = doors[shut.name]
    walls = [replace(w, doors=tuple(d for d in w.doors if (w, d) != closed)) for w in house.walls]
    rooms = [replace(r, viewpoints=()) if r == shut else r for r in house.rooms]
    return replace(house, rooms=tuple(rooms), walls=tuple(walls))


def _doors(room: HouseRoom, house: House) -> list[tuple[Wall, tuple[float, float]]]:
    """The doorways of a room, each with its wall."""
    found = []
    for wall in house.walls:
        for door in wall.doors:
            along, across = sum(door) / 2, wall.start[1 if wall.along_x else 0]
            sides = [(along, across + d) if wall.along_x else (across + d, along) for d in _SIDES]
            if any(room.contains(*side) for side in sides):
                found.append((wall, door))
    return found


def _driven(session: TourPart, folder: Path | None) -> tuple[dict[str, float], Boxes]:
    """Stamps of a drive's frames, and the boxes of things in them; written with detections."""
    detectors = {name: detector_of(session.camera, SENSES[name]) for name in SENSES}
    stamps, boxes = dict[str, float](), Boxes()
    found: dict[str, dict[str, Detections]] = {name: {} for name in SENSES}
    writing = nullcontext() if folder is None else RecordingWriter(folder, up=(0, 0, 1))
    with writing as writer:
        for frame in session.frames():
            stamps[frame.id] = frame.stamp
            boxes[frame.id] = _boxes(session.camera.view(frame.T_map_cam, frame.stamp))
            if writer is not None:
                writer.add(frame)
                for name, detector in detectors.items():
                    found[name][frame.id] = detector.detect(frame)
    if folder is not None:
        for name, detector in detectors.items():
            path = folder / f"detections-{name}.json"
            save_recorded_detections(path, detector.name, found[name])
        _write_json(folder / "transform.json", {"T_map_world": np.eye(4).tolist()})
    return stamps, boxes


def _boxes(view: TrueView) -> dict[int, Box]:
    """The box (x0, y0, x1, y1) [px] around what a view shows of each thing."""
    found = dict[int, Box]()
    for number in np.unique(view.instance[view.instance >= 0]).tolist():
        rows, columns = np.nonzero(view.instance == number)
        low, high = (int(columns.min()), int(rows.min())), (columns.max() + 1, rows.max() + 1)
        found[number] = (*low, int(high[0]), int(high[1]))
    return found


class _Facts:
    """Collects what is true, drive by drive."""

    def __init__(self, rooms: Iterable[HouseRoom], number: str) -> None:
        self.rooms = list(enumerate(rooms, start=1))
        self._facts = HouseFacts(number)
        self._numbers: dict[str, int] = {}  # of things that were ever known
        #: name -> recording, frame, stamp and position of every good view
        self._views: dict[str, list[tuple[str, str, float, Any]]] = {}
        self._boxes: dict[str, list[tuple[str, str, Box]]] = {}

    def add(
        self, session: TourPart, stamps: dict[str, float], truth: HouseTruth, boxes: Boxes
    ) -> None:
        numbers = {item.name: n for n, item in enumerate(session.camera.house.objects)}
        for name, entry in session.truth().items():
            for frame in entry.get("frames", ()):
                view = session.name, frame, stamps[frame], entry["position"]
                self._views.setdefault(name, []).append(view)
                box = session.name, frame, boxes[frame][numbers[name]]
                self._boxes.setdefault(name, []).append(box)
        departed = [one for one in self._objects_before() if one["thing"] not in truth.known]
        self._facts.before = self._facts.now
        self._facts.now = self._document(truth)
        if self._facts.before:
            self._facts.now["departed"] = departed
        self._facts.doubtful = list(_doubtful(truth))
        self._facts.glimpsed = {
            truth.known[name]["cls"]
            for name, stamp in session.shown.items()
            if name in truth.known and stamp > self._views[name][-1][2] + 30.0
        }

    def told(self, house: House) -> HouseFacts:
        """The facts, once all drives are added."""
        for item in house.objects:
            rooms = self._facts.rooms_with.setdefault(item.label, set())
            rooms |= {room.name for room in house.rooms if room.contains(item.x, item.y)}
        self._facts.frames = {
            f"object/{number}": [view[:2] for view in self._views[name]]
            for name, number in self._numbers.items()
        }
        self._facts.boxes = {
            f"object/{number}": self._boxes[name] for name, number in self._numbers.items()
        }
        return self._facts

    def _objects_before(self) -> list[dict[str, Any]]:
        return [one for room in self._facts.now.get("rooms", ()) for one in room["objects"]]

    def _document(self, truth: HouseTruth) -> dict[str, Any]:
        for name in truth.known:
            self._numbers.setdefault(name, len(self._numbers) + 1)
        return {
            "title": f"house {self._facts.number}",
            "rooms": [
                {
                    "name": f"place/{number}",
                    "label": room.name,
                    "likely_category": room.category,
                    "outline": [_corners(room)],
                    "viewed_share": round(truth.share(room), 4),
                    "objects": [
                        self._object(name, entry, truth)
                        for name, entry in truth.known.items()
                        if room.contains(*entry["position"][:2])
                    ],
                }
                for number, room in self.rooms
            ],
        }

    def _object(self, name: str, entry: dict[str, Any], truth: HouseTruth) -> dict[str, Any]:
        views = [view for view in self._views[name] if view[3] == entry["position"]]
        on = self._numbers.get(entry["on"]) if entry["on"] in truth.known else None
        return {
            "name": f"object/{self._numbers[name]}",
            "thing": name,
            "category": entry["cls"],
            "position": entry["position"],
            "size": entry["extent"],
            "existence": 1.0,
            "last_seen": views[-1][2],
            "seen_in": {
                "recording": views[-1][0],
                "frame": views[-1][1],
                "box": self._box(name, views[-1][:2]),
            },
            "relations": []
            if on is None
            else [{"kind": "on", "target": f"object/{on}", "probability": 1.0}],
        }

    def _box(self, name: str, frame: tuple[str, str]) -> list[int]:
        return next(list(one[2]) for one in self._boxes[name] if one[:2] == frame)


def _doubtful(truth: HouseTruth) -> Iterable[Doubtful]:
    furnishings = [entry for entry in truth.now.values() if entry["cls"] == "not coco"]
    several = [entry for entry in truth.known.values() if entry["also"]]
    for entry in (*truth.doubtful, *furnishings, *several):
        x, y, _ = entry["position"]
        yield Doubtful(frozenset({entry["cls"], *entry["also"]}) - {"not coco"}, x, y)


def _corners(room: HouseRoom) -> list[list[float]]:
    (x0, x1), (y0, y1) = (room.xmin, room.xmax), (room.ymin, room.ymax)
    return [[x0, y0], [x1, y0], [x1, y1], [x0, y1]]


def _place(number: int, room: HouseRoom) -> dict[str, Any]:
    sides = {side: getattr(room, side) for side in ("xmin", "xmax", "ymin", "ymax")}
    return {"id": number, "label": room.name, "category": room.category, **sides}


def _write_json(path: Path, data: Any) -> None:
    write_text(path, json.dumps(data, indent=1) + "\n")

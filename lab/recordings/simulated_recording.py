"""Simulated recordings on disk: images, poses, detections and truth of a random house."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from kg.model.errors import RecordingError
from lab.houses.house_changes import HouseChange, carries, changed_house
from lab.houses.random_house import random_house
from lab.recordings.depth_sensor import KINECT
from lab.recordings.object_truth import VisibilityRecord, object_truth
from lab.recordings.odometry import with_drift
from perception.frames import Detections
from perception.inference.class_labels import read_labels
from perception.inference.model_zoo import NETWORKS
from perception.inference.recorded_detections import save_recorded_detections
from perception.sources.recording_writer import RecordingWriter, pose_line, write_text
from planner.simulation.houses.house import House, HouseRoom
from planner.simulation.robot.house_robot import START, SimulatedTour
from planner.simulation.sensing.camera import CameraModel, SimulatedCamera
from planner.simulation.sensing.sensors import SENSES, DetectorFaults, SimulatedDetector

TRUTH: Final = "objects_full_gt.json"
DETECTIONS: Final = "detections.json"
PLACES: Final = "places.json"
TRANSFORM: Final = "transform.json"
TRUE_POSES: Final = "true_poses.txt"
DAY: Final = 86400.0  # [s] between two sessions


@dataclass(frozen=True, slots=True)
class SimulationOptions:
    """Options of the simulation."""

    size: tuple[int, int] = (640, 480)  # [px] width and height of the images
    senses: DetectorFaults = SENSES["demo"]
    odometry: float = 0.0  # error of the poses, as a share of each step
    stride: int = 1  # every `stride`-th frame of the tour is written
    masks: bool = False  # whether the detector gives instance masks


@dataclass(frozen=True, slots=True)
class SimulatedSession:
    """Counts of the data written into one folder."""

    folder: Path
    frames: int
    objects: int  # true ones, doubtful ones left out
    detections: int
    moved: int
    vanished: int
    new: int
    carried: int

    def to_json(self) -> dict[str, Any]:
        """Plain values, for `--json`."""
        return {**asdict(self), "folder": str(self.folder)}


OnFrame = Callable[[str, int, int], None]  # folder's name, frames done, frames in all


def simulate_house(
    folder: Path,
    seed: int,
    sessions: int = 1,
    options: SimulationOptions | None = None,
    on_frame: OnFrame | None = None,
) -> list[SimulatedSession]:
    """Write `sessions` recordings of the house of `seed`: one into `folder`, several below it.

    Raises RecordingError where a folder is not empty or cannot be written.
    """
    house, options = random_house(seed), options or SimulationOptions()
    folders = [folder] if sessions == 1 else [folder / f"session-{k + 1}" for k in range(sessions)]
    for place in folders:
        if place.exists() and (not place.is_dir() or any(place.iterdir())):
            raise RecordingError(f"{place} is not empty; a new or an empty folder would work")
    written = list[SimulatedSession]()
    before: House | None = None
    for number, place in enumerate(folders):
        session = _Session(place, house, before, seed, number, options)
        written.append(session.write(house.rooms, on_frame or (lambda *_: None)))
        before = session.house
    return written


class _Session:
    """One drive through the house, changed since the session before."""

    def __init__(
        self,
        folder: Path,
        house: House,
        before: House | None,
        seed: int,
        number: int,
        options: SimulationOptions,
    ) -> None:
        self._folder = folder
        self._before = before
        self._options = options
        self._random = np.random.default_rng([seed, 23, number])
        self._change: HouseChange | None = None
        self.house = house
        if before is not None:
            self._change = changed_house(before, self._random)
            self.house = self._change.house
        width, height = options.size
        self._model = CameraModel(width, height, 0.875 * width, depth=KINECT)
        camera_seed = 1000 * seed + number
        camera = SimulatedCamera(self.house, self._model, camera_seed)
        start = START + number * DAY
        tour = SimulatedTour(camera, name=folder.name, start=start)
        if before is not None and self._change is not None:
            moving, poses = carries(before, self._change, tour.poses, self._model, start)
            camera = SimulatedCamera(self.house, self._model, camera_seed, moving)
            tour = SimulatedTour(camera, name=folder.name, start=start, poses=poses)
        self._camera, self._tour = camera, tour

    def write(self, rooms: Sequence[HouseRoom], on_frame: OnFrame) -> SimulatedSession:
        """Render and write all frames, then detections, truth and places."""
        detector = SimulatedDetector(self._camera, self._options.senses, masks=self._options.masks)
        seen = VisibilityRecord(self.house, self._model)
        found: dict[str, Detections] = {}
        true_poses = [self._tour.T_map_cam(k) for k in range(len(self._tour))]
        drifting = with_drift(true_poses, self._options.odometry, self._random)
        lines = list[str]()
        with RecordingWriter(self._folder, up=(0, 0, 1)) as writer:
            for index, (frame, T) in enumerate(zip(self._tour.frames(), drifting, strict=True)):
                if index % self._options.stride:
                    continue
                writer.add(frame, T)
                lines.append(pose_line(frame.stamp, frame.T_map_cam))
                found[frame.id] = detector.detect(frame)
                seen.add(frame.id, self._camera.view(frame.T_map_cam, frame.stamp))
                on_frame(self._folder.name, index + 1, len(self._tour))
        if self._options.odometry:
            write_text(self._folder / TRUE_POSES, "\n".join(lines) + "\n")
        save_recorded_detections(self._folder / DETECTIONS, detector.name, found)
        labels = read_labels(NETWORKS / "labels_coco80.txt")
        truth = object_truth(self.house, seen.frames, labels, self._before, self._change)
        _write_json(self._folder / TRUTH, truth)
        _write_json(self._folder / PLACES, _places(rooms))
        identity = {"T_map_world": np.eye(4).tolist()}
        _write_json(self._folder / TRANSFORM, {"sequences": {self._folder.name: identity}})
        return self._report(truth, found)

    def _report(self, truth: dict[str, Any], found: dict[str, Detections]) -> SimulatedSession:
        change = self._change
        return SimulatedSession(
            folder=self._folder,
            frames=len(found),
            objects=sum(not entry["ignore"] for entry in truth["objects"].values()),
            detections=sum(map(len, found.values())),
            moved=len(change.moved) if change else 0,
            vanished=len(change.vanished) if change else 0,
            new=len(change.new) if change else 0,
            carried=len(change.carried) if change else 0,
        )


def _places(rooms: Sequence[HouseRoom]) -> list[dict[str, Any]]:
    """The rooms for `--places`; mapping does not read the key of their true categories."""
    return [
        {
            "id": number,
            "label": f"place {number}",
            **{side: getattr(room, side) for side in ("xmin", "xmax", "ymin", "ymax")},
            "room": room.part_of or room.name,
            "true_category": room.category,
        }
        for number, room in enumerate(rooms, start=1)
    ]


def _write_json(path: Path, data: Any) -> None:
    write_text(path, json.dumps(data, indent=1) + "\n")

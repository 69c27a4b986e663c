"""Simulated recordings on disk: images, poses, detections and truth of a random house.

Depth has the gaps and steps of a structured-light camera: steps follow the disparity's resolution
(Khoshelham and Elberink, Sensors 2012), which makes them grow with z^2. Poses may drift away from
the true ones, as those of odometry do.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from kg.model.errors import RecordingError
from lab.houses.house_changes import CarryingCamera, HouseChange, carries, changed_house
from lab.houses.random_house import random_house
from lab.recordings.hard_senses import SENSES, detector_of
from lab.recordings.object_truth import VisibilityRecord, object_truth
from perception.camera.poses import rotation_angle
from perception.frames import Detections
from perception.inference.class_labels import read_labels
from perception.inference.model_zoo import NETWORKS
from perception.inference.recorded_detections import save_recorded_detections
from perception.sources.recording_writer import RecordingWriter, pose_line, write_text
from planner.simulation.camera import CameraModel, DepthSensor, SimulatedCamera
from planner.simulation.house import House, HouseRoom
from planner.simulation.house_robot import START, SimulatedTour
from planner.simulation.sensors import DetectorFaults

EDGE: Final = 0.06  # relative step of depth between neighbouring pixels that makes an edge


@dataclass(frozen=True, slots=True)
class StructuredLightSensor(DepthSensor):
    """A depth camera that loses depth far off, along edges and on grazed surfaces."""

    fading: float = 0.0  # [m] before `far` over which the share of pixels with depth falls
    step: float = 0.0  # [m] resolution at a depth of 1 m; it grows with z^2
    grazing: float = 0.0  # least cosine between ray and normal that gives depth
    edge_loss: float = 0.0  # share of the pixels along edges of depth without depth

    def measure(
        self,
        depth: NDArray[np.float32],
        incidence: NDArray[np.float32],
        returns: NDArray[np.bool_],
        rng: np.random.Generator,
    ) -> NDArray[np.float32]:
        """Measured depth (H, W) [m], nan = no return."""
        measured = DepthSensor.measure(self, depth, incidence, returns, rng)
        if self.step:
            disparity = 1 / np.maximum(measured, 0.1) / self.step
            measured = (1 / np.maximum(np.round(disparity), 1) / self.step).astype(np.float32)
        lost = np.zeros(depth.shape, np.bool_)
        if self.grazing:
            lost |= ~returns | (incidence < self.grazing)
        if self.fading:
            draw = rng.random(depth.shape, dtype=np.float32)
            lost |= depth > self.far - self.fading * draw
        if self.edge_loss:
            draw = rng.random(depth.shape, dtype=np.float32)
            lost |= _edges(depth) & (draw < self.edge_loss)
        measured[lost] = np.nan
        return measured


#: A Kinect v1: 1/8 px of disparity, baseline 75 mm, focal length 580 px.
KINECT: Final = StructuredLightSensor(
    near=0.5, far=4.9, fading=0.6, step=0.00287, grazing=0.13, edge_loss=0.6
)


def _edges(depth: NDArray[np.float32]) -> NDArray[np.bool_]:
    """(H, W) pixels next to a step of depth."""
    edges = np.zeros(depth.shape, np.bool_)
    across = np.abs(np.diff(depth, axis=1)) > EDGE * depth[:, 1:]
    down = np.abs(np.diff(depth, axis=0)) > EDGE * depth[1:]
    edges[:, 1:] |= across
    edges[:, :-1] |= across
    edges[1:] |= down
    edges[:-1] |= down
    return edges


def with_drift(
    poses: Iterable[NDArray[np.float64]], share: float, rng: np.random.Generator
) -> Iterator[NDArray[np.float64]]:
    """Poses T_world_cam (4, 4) estimated by odometry; the first one is true.

    Each step has an error in position of `share` of its length (standard deviation, horizontal),
    and in heading of `share` of its turn and `share` times 15 degrees a metre (Thrun, Burgard and
    Fox, Probabilistic Robotics, section 5.4). A share of 0 gives the true poses.
    """
    previous: NDArray[np.float64] | None = None
    estimate = np.eye(4)
    for T in poses:
        if previous is None:
            estimate = T.copy()
        else:
            step = np.linalg.inv(previous) @ T
            estimate = _disturbed(estimate @ step, step, share, rng)
        previous = T
        yield estimate.copy()


def _disturbed(
    T: NDArray[np.float64], step: NDArray[np.float64], share: float, rng: np.random.Generator
) -> NDArray[np.float64]:
    distance = float(np.linalg.norm(step[:3, 3]))
    turn = rotation_angle(step[:3, :3])
    angle = share * np.hypot(turn, np.deg2rad(15.0) * distance) * rng.standard_normal()
    out = T.copy()
    c, s = np.cos(angle), np.sin(angle)
    out[:3, :3] = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ T[:3, :3]
    out[:2, 3] += share * distance * rng.standard_normal(2)
    return out


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
    folders = [folder] if sessions == 1 else [folder / f"session-{k + 1}" for k in range(sessions)]
    for place in folders:
        if place.exists() and (not place.is_dir() or any(place.iterdir())):
            raise RecordingError(f"{place} is not empty; a new or an empty folder would work")
    house, options = random_house(seed), options or SimulationOptions()
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
            camera = CarryingCamera(self.house, self._model, camera_seed, moving)
            tour = SimulatedTour(camera, name=folder.name, start=start, poses=poses)
        self._camera, self._tour = camera, tour

    def write(self, rooms: Sequence[HouseRoom], on_frame: OnFrame) -> SimulatedSession:
        """Render and write all frames, then detections, truth and places."""
        detector = detector_of(self._camera, self._options.senses, masks=self._options.masks)
        seen = VisibilityRecord(self.house, self._model)
        found: dict[str, Detections] = {}
        true_poses = [self._tour.T_map_cam(k) for k in range(len(self._tour))]
        drifting = [*with_drift(true_poses, self._options.odometry, self._random)]
        lines = list[str]()
        with RecordingWriter(self._folder, up=(0, 0, 1)) as writer:
            for index in range(0, len(self._tour), self._options.stride):
                frame, T = next(self._tour.frames(index)), drifting[index]
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

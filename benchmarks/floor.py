"""Cost of the mapped floor: `python benchmarks/floor.py RECORDING ... [--demo]`.

Maps each recording twice, without the floor and then with it, and counts seconds of the processor.
Prints Markdown rows.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from kg.maps.facts.occupancy import encoded
from kg.maps.semantic_map import SemanticMap
from kg.serving.opening import create_map, in_memory_map
from mapping.mapping_options import MappingOptions
from mapping.occupancy.occupancy_map import OccupancyMap
from mapping.recording_mapper import map_recording
from perception.frames import Detector, Frame, Recording, SceneClassifier
from perception.inference.detector import load_detector
from perception.inference.scene_classifier import load_scene_classifier
from perception.sources.recording import open_recording
from perception.sources.recording_options import RecordingOptions
from planner.simulation.houses.house import furnished_house
from planner.simulation.robot.house_robot import SimulatedTour
from planner.simulation.sensing.camera import SimulatedCamera
from planner.simulation.sensing.sensors import SimulatedDetector, SimulatedSceneClassifier

HEADER = (
    "| recording | frames | ms a frame | of it floor | share | floor alone | tiles | floor kB | "
    "tile writes | history kB without / with |"
)


class Timed:
    """A recording whose frames are read before the clock runs."""

    def __init__(self, recording: Recording) -> None:
        self.name, self.T_map_world = recording.name, recording.T_map_world
        self._frames = list(recording.frames())

    def __len__(self) -> int:
        return len(self._frames)

    def frames(self, start: int = 0) -> Iterator[Frame]:
        """Frames from index `start` on."""
        return iter(self._frames[start:])

    @property
    def all(self) -> list[Frame]:
        """Every frame."""
        return self._frames


def mapped(
    recording: Timed, detector: Detector, scene: SceneClassifier, folder: Path, *, floor: bool
) -> tuple[float, SemanticMap, int]:
    """[s] of the processor, the map, and the bytes of its history."""
    path = folder / f"{recording.name}-{floor}.map"
    semantic_map = create_map(path)
    before = time.process_time()
    map_recording(recording, semantic_map, detector, scene, options=MappingOptions(occupancy=floor))
    spent = time.process_time() - before
    semantic_map.store.flush()
    history = sum(file.stat().st_size for file in path.glob("history.sqlite*"))
    return spent, semantic_map, history


def alone(frames: list[Frame]) -> tuple[float, int]:
    """[s] of the processor for the grid without the graph, and how many tiles it would write."""
    with in_memory_map() as semantic_map:
        book, writes = OccupancyMap(semantic_map), 0
        before = time.process_time()
        for frame in frames:
            book.add(frame)
            writes += len(book.take_changed(frame.stamp))
        return time.process_time() - before, writes


def row(recording: Timed, detector: Detector, scene: SceneClassifier) -> str:
    """A row of the table."""
    count = len(recording)
    with tempfile.TemporaryDirectory() as folder:
        runs = {}
        for floor in (False, True):
            runs[floor] = mapped(recording, detector, scene, Path(folder), floor=floor)
        (without, _, history), (spent, semantic_map, longer) = runs[False], runs[True]
        tiles = semantic_map.floor()
        size = sum(len(encoded(tile.cells)) for tile in tiles)
        grid, writes = alone(recording.all)
        for _, made, _ in runs.values():
            made.close()
    extra = spent - without
    return (
        f"| {recording.name} | {count} | {1000 * spent / count:.1f} | {1000 * extra / count:.1f} | "
        f"{extra / spent:.0%} | {1000 * grid / count:.1f} | {len(tiles)} | {size / 1000:.1f} | "
        f"{writes} | {history / 1000:.0f} / {longer / 1000:.0f} |"
    )


def transform(path: str, sequence: str) -> NDArray[np.float64] | None:
    """Where a recording lies, if there is a file that says it."""
    from mapping.alignment.recording_fit import load_transform

    return load_transform(Path(path), sequence) if path else None


def main() -> None:
    """Map and tell."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("recordings", nargs="*", type=Path)
    parser.add_argument("--transforms", default="", help="JSON of T_map_world by sequence")
    parser.add_argument("--demo", action="store_true", help="the demo's tour as well")
    arguments = parser.parse_args()
    sys.stdout.write(f"{HEADER}\n{'|---' * HEADER.count(' | ')}|---|\n")
    for folder in arguments.recordings:
        T = transform(arguments.transforms, folder.name)
        recording = Timed(open_recording(folder, RecordingOptions(T_map_world=T)))
        networks = load_detector("default"), load_scene_classifier()
        sys.stdout.write(row(recording, *networks) + "\n")
    if arguments.demo:
        camera = SimulatedCamera(furnished_house())
        with in_memory_map() as known:
            places = [c.label for c in known.catalogue.categories if c.kind == "place"]
        recording = Timed(SimulatedTour(camera, name="demo tour"))
        senses = SimulatedDetector(camera), SimulatedSceneClassifier(camera, places)
        sys.stdout.write(row(recording, *senses) + "\n")


if __name__ == "__main__":
    main()

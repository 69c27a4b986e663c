"""Objects that leave the map before a still camera: `python -m benchmarks.still_camera [SEED ...]`.

In each random house the stretch of the mapping tour before its fullest picture is mapped, then the
robot stands there: the same view again and again, with new noise of depth and detector each time.
Prints a Markdown row for each preset of the senses:
objects that were right when the robot stopped (existence 0.5 and above, of the label of a thing of
the house within 0.5 m), and how many of them left the map. Nothing left in truth.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

import numpy as np

from kg.maps.semantic_map import SemanticMap
from kg.serving.opening import in_memory_map
from lab.houses.random_house import random_house
from mapping.mapper import Mapper
from mapping.mapping_options import MappingOptions
from planner.simulation.houses.house import House
from planner.simulation.robot.house_robot import SimulatedTour
from planner.simulation.sensing.camera import SimulatedCamera
from planner.simulation.sensing.sensors import SENSES, SimulatedDetector

HEADER = "| senses | houses | still frames | right objects | left |\n|---|---|---|---|---|"
BEFORE = 60  # frames of the tour that are mapped first
NEAR = 0.5  # [m]
INTERVAL = 0.2  # [s] between still frames


def still(seed: int, senses: str, count: int) -> tuple[int, int]:
    """Right objects when the robot stopped, and those of them that left in `count` frames."""
    house = random_house(seed)
    camera = SimulatedCamera(house, seed=seed)
    tour = SimulatedTour(camera)
    detector = SimulatedDetector(camera, SENSES[senses])
    shown = [len(np.unique(camera.view(f.T_map_cam, f.stamp).instance)) for f in tour.frames()]
    stop = int(np.argmax(shown))
    with in_memory_map(base="https://example.org/map/") as semantic_map:
        mapper = Mapper(semantic_map, MappingOptions(occupancy=False, check_poses=False))
        for index in range(max(stop - BEFORE, 0), stop + 1):
            frame = next(tour.frames(index))
            mapper.add(frame, detector.detect(frame))
        right, left = _right(semantic_map, house), set[str]()
        for number in range(count):
            stamp = frame.stamp + INTERVAL * (number + 1)
            one = camera.frame(f"still-{number}", frame.T_map_cam, stamp)
            left |= right & set(mapper.add(one, detector.detect(one)).removed)
    return len(right), len(left)


def _right(semantic_map: SemanticMap, house: House) -> set[str]:
    label = semantic_map.catalogue.label
    return {
        record.iri
        for record in semantic_map.objects()
        if record.existence >= 0.5
        and any(
            item.label == label(record.category)
            and np.hypot(item.x - record.p_map[0], item.y - record.p_map[1]) < NEAR
            for item in house.objects
        )
    }


def row(seeds: Sequence[int], senses: str, frames: int) -> str:
    """The row of one preset, so many frames in each house."""
    found = [still(seed, senses, frames) for seed in seeds]
    right, left = (sum(column) for column in zip(*found, strict=True))
    return f"| {senses} | {len(seeds)} | {len(seeds) * frames} | {right} | {left} |"


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("seeds", type=int, nargs="*", default=[101, 102, 103, 104, 105, 106, 107])
    parser.add_argument("--frames", type=int, default=2000, help="in each house")
    parser.add_argument("--senses", nargs="+", default=["hard"], choices=list(SENSES))
    given = parser.parse_args()
    print(HEADER)  # noqa: T201
    for senses in given.senses:
        print(row(given.seeds, senses, given.frames), flush=True)  # noqa: T201
    return 0


if __name__ == "__main__":
    sys.exit(main())

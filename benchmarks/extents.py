"""Boxes of objects against the truth, without and with the surface, in simulated houses.

python -m benchmarks.extents --seeds 1 2 3

Each house is mapped as it stands and turned by a random angle, with easy and hard senses. A box's
score is the volume that it and the true box share, divided by the volume of both together (3D IoU
of oriented boxes, exact in plan). A true box is the bounding box of a thing along the thing's axes.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from benchmarks.command_line import run
from benchmarks.rooms.houses import Tour, toured
from benchmarks.rooms.measuring import each
from hereabouts.cli.arguments import count, whole
from kg.model.areas import OrientedBox
from kg.model.records import ObjectRecord
from kg.serving.opening import in_memory_map
from lab.maps.truth_matching import MappedObject, TruthMatcher
from mapping.mapping_options import MappingOptions
from mapping.objects.bayes_mapper import BayesObjectMapper
from mapping.surface.surface_mapper import SurfaceMapper
from perception.frames import Detector, Frame

SEEDS: Final = (11, 12, 13, 14, 15)
GOOD: Final = 0.25  # overlap from which on a box is right
SHOWN: Final = 0.5  # existence from which on an object counts
BEFORE, AFTER = "latest sightings", "surface"
_NO_PEOPLE: Final = np.empty((0, 4), np.float32)
_VOXEL: Final = MappingOptions().surface or 0.025

Key = tuple[str, str, str]  # senses, "as it stands" or "turned", and how boxes are made


@dataclass(frozen=True, slots=True)
class Boxes:
    """Boxes of one map against the truth."""

    overlaps: tuple[float, ...]
    errors: tuple[float, ...]  # [m] of positions
    matched: int
    seconds: float  # [s] of processor time in the mapper of objects
    frames: int


def measured_house(seed: int) -> dict[Key, Boxes]:
    """The house of `seed`, by all senses, as it stands and turned, by both kinds of boxes."""
    tour, found = toured(seed), {}
    angle = float(np.random.default_rng([seed, 22]).uniform(-np.pi / 4, np.pi / 4))
    for name, yaw in (("as it stands", 0.0), ("turned", angle)):
        frames, matcher = turned(tour, yaw)
        for senses, detector in tour.seen.items():
            for kind in (BEFORE, AFTER):
                records, seconds = mapped(frames, detector, kind == AFTER)
                boxes = compared(records, matcher, yaw)
                found[senses, name, kind] = replace(boxes, seconds=seconds, frames=len(frames))
    return found


def turned(tour: Tour, yaw: float) -> tuple[list[Frame], TruthMatcher]:
    """Frames and truth of a tour in a map frame turned by `yaw` [rad]."""
    c, s = np.cos(yaw), np.sin(yaw)
    T = np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
    frames = [replace(frame, T_map_cam=T @ frame.T_map_cam) for frame in tour.frames]
    return frames, TruthMatcher(tour.truth.truth, T)


def mapped(
    frames: Sequence[Frame], detector: Detector, grown: bool
) -> tuple[list[tuple[str, ObjectRecord]], float]:
    """Labels and records of objects, and processor time [s]; with boxes `grown` from the surface.

    The time of the surface itself is not counted: `benchmarks.surface` measures it.
    """
    seconds = 0.0
    with in_memory_map(base="https://example.org/map/") as semantic_map:
        surface = SurfaceMapper(semantic_map, _VOXEL, "benchmark") if grown else None
        voxels = None if surface is None else surface.within
        mapper = BayesObjectMapper(semantic_map, model=detector.name, voxels=voxels)
        for frame in frames:
            detections = detector.detect(frame)
            if surface is not None:
                surface.add(frame, _NO_PEOPLE)
                surface.save(1)
                surface.accept()
            begun = time.process_time()
            mapper.add(frame, detections)
            seconds += time.process_time() - begun
        begun = time.process_time()
        mapper.finish()
        seconds += time.process_time() - begun
        label = semantic_map.catalogue.label
        shown = (record for record in mapper.objects() if record.existence >= SHOWN)
        return [(label(record.category), record) for record in shown], seconds


def compared(
    records: Sequence[tuple[str, ObjectRecord]], matcher: TruthMatcher, yaw: float
) -> Boxes:
    """Overlaps of the boxes of matched objects with true boxes, which stand turned by `yaw`."""
    objects = [MappedObject(label, one.p_map, one.existence) for label, one in records]
    matched = matcher.match(objects).matched
    overlaps = []
    for pair in matched:
        extent, (_, record) = matcher.truth[pair.true].extent, records[pair.mapped]
        if len(extent) == 3 and record.extent is not None:
            true = OrientedBox(matcher.p_map[pair.true], np.maximum(extent, 0.02), yaw)
            box = OrientedBox(record.p_map, record.extent, record.yaw)
            overlaps.append(box.overlap(true))
    return Boxes(tuple(overlaps), tuple(pair.distance for pair in matched), len(matched), 0.0, 0)


def table(found: Sequence[dict[Key, Boxes]]) -> Iterator[str]:
    """Markdown: a line for each key, and for all together."""
    rows = defaultdict[Key, list[Boxes]](list)
    for house in found:
        for (senses, stands, kind), boxes in house.items():
            for key in ((senses, stands, kind), ("all", "", kind)):
                rows[key].append(boxes)
    heads = "senses", "house", "boxes from", "boxes", "median IoU", "IoU from 0.25", "error [m]"
    yield f"| {' | '.join(heads)} | ms a frame |"
    yield "|---|---|---|---|---|---|---|---|"
    for (senses, stands, kind), several in rows.items():
        overlaps = np.concatenate([boxes.overlaps for boxes in several])
        error = np.mean(np.concatenate([boxes.errors for boxes in several]))
        spent = 1000 * sum(b.seconds for b in several) / sum(b.frames for b in several)
        scores = f"{np.median(overlaps):.2f} | {np.mean(overlaps >= GOOD):.2f}"
        yield (
            f"| {senses} | {stands} | {kind} | {len(overlaps)} | {scores} | {error:.3f} "
            f"| {spent:.1f} |"
        )


def _command(arguments: argparse.Namespace) -> int:
    found = each(measured_house, [(seed,) for seed in arguments.seeds], arguments.processes)
    sys.stdout.write("\n".join(table(found)) + "\n")
    return 0


def main(argv: Sequence[str] | None = None) -> int:
    """Measure, and print the table."""
    parser = argparse.ArgumentParser(prog="benchmarks.extents", description=__doc__)
    parser.add_argument("--seeds", type=count, nargs="+", default=SEEDS, help="houses")
    parser.add_argument("--processes", type=whole, default=1)
    return run(parser, _command, argv)


if __name__ == "__main__":
    sys.exit(main())

"""Identity of things over restarts: `python -m benchmarks.restarts HOUSE ... --every 0 100 25`.

Each HOUSE holds what `hereabouts simulate house --sessions 2` wrote. Its sessions are mapped one
after the other into one map in memory, by a new mapper for each session and, in the second, after
every so many frames (0: none there). Prints Markdown rows: pairs of things and objects as
`hereabouts evaluate map --sessions` counts them, milliseconds of mapping and triples that changed a
frame, and how many objects the map remembers in the end that left.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from kg.maps.semantic_map import SemanticMap
from kg.serving.opening import in_memory_map
from lab.command_line import run
from lab.maps.complete_truth import load_complete_truth
from lab.maps.map_evaluation import evaluate_map
from lab.maps.session_identity import SessionIdentity, pooled_identity, session_identity
from lab.maps.truth_matching import TruthMatcher
from mapping.mapper import Mapper
from mapping.mapping_options import MappingOptions
from perception.inference.recorded_detections import open_detector
from perception.sources.recording import open_recording

HEADER: Final = (
    "| restart after | of | things | right | wrong | F1 | ms a frame | triples | departed |\n"
    "|---|---|---|---|---|---|---|---|---|"
)
_NEAR: Final = 0.5  # [m], and
_THRESHOLD: Final = 0.2  # as `hereabouts evaluate map` has them


@dataclass(slots=True)
class Totals:
    """Time of mapping, over all houses."""

    frames: int = 0
    seconds: float = 0.0
    triples: int = 0
    departed: int = 0


def identity_of(house: Path, every: int, totals: Totals) -> SessionIdentity:
    """Map both sessions of a house; identity of its things from one to the next."""
    ends = []
    with in_memory_map(base="https://example.org/map/") as semantic_map:
        for number in (1, 2):
            folder, since = house / f"session-{number}", semantic_map.sequence
            T_map_world = _map_session(folder, semantic_map, every if number == 2 else 0, totals)
            truth = load_complete_truth(folder / "objects_full_gt.json")
            matcher = TruthMatcher(truth, T_map_world, _NEAR)
            ends.append((evaluate_map(semantic_map, matcher, since).shown, matcher))
        totals.departed += len(semantic_map.departed())
    return session_identity(*ends)


def _map_session(
    folder: Path, semantic_map: SemanticMap, every: int, totals: Totals
) -> NDArray[np.float64]:
    recording = open_recording(folder)
    detector = open_detector(folder / "detections.json", threshold=_THRESHOLD)
    mapper = None
    for index, frame in enumerate(recording.frames()):
        found = detector.detect(frame)
        if mapper is None or (every and index % every == 0):
            mapper = Mapper(semantic_map, MappingOptions(occupancy=False), recording=folder.name)
        before = time.perf_counter()
        mapper.add(frame, found)
        totals.seconds += time.perf_counter() - before
        totals.triples += mapper.changed_triples
        totals.frames += 1
    return recording.T_map_world


def rows(houses: Sequence[Path], every: int) -> str:
    """The rows of one way to restart."""
    totals = Totals()
    found = pooled_identity([identity_of(house, every, totals) for house in houses])
    lines = []
    for name, score in (("all", found.everything), ("moved", found.moved)):
        f1 = "" if score.f1 is None else f"{score.f1:.2f}"
        columns = [f"{every} frames" if every else "session 1", name]
        columns += [str(score.things), str(score.right), str(score.wrong), f1]
        if name == "all":
            columns += [
                f"{1000 * totals.seconds / totals.frames:.1f}",
                f"{totals.triples / totals.frames:.2f}",
                str(totals.departed),
            ]
        lines.append(f"| {' | '.join(columns)} |" + " | | |" * (name != "all"))
    return "\n".join(lines)


def main() -> int:
    """Print rows for each way to restart."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("house", nargs="+", type=Path)
    parser.add_argument("--every", nargs="+", type=int, default=[0, 100, 25], help="frames")
    return run(parser, _print)


def _print(given: argparse.Namespace) -> int:
    sys.stdout.write(HEADER + "\n")
    for every in given.every:
        sys.stdout.write(rows(given.house, every) + "\n")
        sys.stdout.flush()
    return 0


if __name__ == "__main__":
    sys.exit(main())

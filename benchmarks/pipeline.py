"""How much a mapping run overlaps its stages: `python -m benchmarks.pipeline RECORDING ...`.

Times each stage alone (reading; the detector, opened and run on frames in memory; the rest on
frames and detections in memory) and the whole run, in turns, so that all meet the same machine.
Prints Markdown rows of medians: a pipeline is at best as fast as its slowest stage.
"""

from __future__ import annotations

import statistics
import sys
import time
from collections.abc import Callable, Iterator
from itertools import islice
from pathlib import Path

import numpy as np

from kg.serving.opening import in_memory_map
from lab.command_line import parser_of
from mapping.recording_mapper import map_recording
from perception.frames import Detections, Detector, Frame, Recording, SceneClassifier
from perception.inference.detector_pair import RememberingDetector
from perception.inference.recorded_detections import open_detector
from perception.inference.scene_classifier import load_scene_classifier
from perception.sources.recording import open_recording

HEADER = (
    "| recording | frames | read | detect | rest: map | one after the other "
    "| whole run | slowest / run |\n|---|---|---|---|---|---|---|---|"
)


class FirstFrames:
    """The first frames of a recording, from disk or, once `kept`, from memory."""

    def __init__(self, recording: Recording, count: int) -> None:
        self.name, self.T_map_world = recording.name, recording.T_map_world
        self._recording, self._count = recording, min(count, len(recording))
        self.kept: list[Frame] = []

    def __len__(self) -> int:
        return self._count

    def frames(self, start: int = 0) -> Iterator[Frame]:
        """Frames from index `start` on."""
        if self.kept:
            return iter(self.kept[start:])
        return islice(self._recording.frames(start), self._count - start)


def measured(path: Path, detector_name: str, count: int, rounds: int) -> str:
    """The row of one recording."""
    detector, scene = open_detector(detector_name), load_scene_classifier()
    recording = open_recording(path)
    on_disk, in_memory = FirstFrames(recording, count), FirstFrames(recording, count)
    in_memory.kept = list(on_disk.frames())
    known = RememberingDetector(detector)
    _detected(in_memory, known)
    stages: dict[str, Callable[[], object]] = {
        "read": lambda: sum(1 for _ in on_disk.frames()),
        "detect": lambda: _detected(in_memory, open_detector(detector_name)),
        "map": lambda: _mapped(in_memory, known, scene),
        "run": lambda: _mapped(on_disk, open_detector(detector_name), scene),
    }
    seconds: dict[str, list[float]] = {name: [] for name in stages}
    for _ in range(rounds):
        for name, stage in stages.items():
            before = time.perf_counter()
            stage()
            seconds[name].append(time.perf_counter() - before)
    ms = {k: 1000 * statistics.median(v) / len(on_disk) for k, v in seconds.items()}
    alone = [ms[name] for name in ("read", "detect", "map")]
    ratio = np.median(
        [max(parts) / run for *parts, run in zip(*(seconds[name] for name in stages), strict=True)]
    )
    columns = [path.name, str(len(on_disk)), *(f"{x:.1f}" for x in alone)]
    columns += [f"{sum(alone):.1f}", f"{ms['run']:.1f}", f"{ratio:.2f}"]
    return f"| {' | '.join(columns)} |"


def _detected(recording: FirstFrames, detector: Detector) -> list[Detections]:
    return [detector.detect(frame) for frame in recording.frames()]


def _mapped(recording: Recording, detector: Detector, scene: SceneClassifier) -> None:
    with in_memory_map(base="https://example.org/map/") as semantic_map:
        map_recording(recording, semantic_map, detector, scene)


def main() -> None:
    """Print a row for each recording."""
    parser = parser_of("benchmarks.pipeline", __doc__)
    parser.add_argument("recording", nargs="+", type=Path)
    parser.add_argument("--detector", default="default")
    parser.add_argument("--frames", type=int, default=250, help="of each recording")
    parser.add_argument("--rounds", type=int, default=3)
    given = parser.parse_args()
    sys.stdout.write(HEADER + "\n")
    for path in given.recording:
        sys.stdout.write(measured(path, given.detector, given.frames, given.rounds) + "\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()

"""Overlap of the stages of a mapping run: `python -m benchmarks.pipeline RECORDING ...`.

Times each stage alone (reading; the detector, opened and run on frames in memory; the rest on
frames and detections in memory) and the whole run, in turns, so that all meet the same machine.
Prints Markdown rows of medians: a pipeline is at best as fast as its slowest stage.

With `--rules` instead the processor time of `Mapper.add` a frame, of the default rules and of the
thesis' own (`--mode reference`), on the same detections, without networks and with all that maps in
folders have: of all threads, and of the calling one alone. Exits with 1 where the default rules
take more than twice the time of all threads.
"""

from __future__ import annotations

import argparse
import statistics
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from itertools import islice
from pathlib import Path

import numpy as np

from kg.serving.opening import create_map, in_memory_map
from lab.command_line import parser_of
from mapping.mapper import Mapper
from mapping.mapping_options import MappingOptions, Mode
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
RULES_HEADER = (
    "| recording | frames | default rules: ms a frame | the calling thread "
    "| the thesis' rules | the calling thread | ratio |\n|---|---|---|---|---|---|---|"
)
MAX_RATIO = 2.0  # of the processor time of the default rules and of the thesis' own


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


def by_rules(path: Path, detector_name: str, count: int, rounds: int) -> tuple[str, float]:
    """The row of one recording by the default and by the thesis' rules, and their ratio."""
    recording = FirstFrames(open_recording(path), count)
    recording.kept = list(recording.frames())
    seen = _detected(recording, open_detector(detector_name))
    modes: tuple[Mode, ...] = ("bayes", "reference")
    for mode in modes:  # modules that the first frames import are not of one mode
        _added(recording, seen[:2], mode)
    seconds = [[_added(recording, seen, mode) for mode in modes] for _ in range(rounds)]
    ratio = float(np.median([ours / theirs for (ours, _), (theirs, _) in seconds]))
    ms = 1000 * np.median(seconds, axis=0).ravel() / len(seen)
    columns = [path.name, str(len(seen)), *(f"{x:.1f}" for x in ms), f"{ratio:.2f}"]
    return f"| {' | '.join(columns)} |", ratio


def _added(recording: FirstFrames, seen: list[Detections], mode: Mode) -> tuple[float, float]:
    """Processor time [s] in which `Mapper.add` maps the frames `seen` into a new folder.

    Of all threads, and of the calling one.
    """
    seconds, own = 0.0, 0.0
    with tempfile.TemporaryDirectory() as folder, create_map(Path(folder) / "map") as semantic_map:
        mapper = Mapper(semantic_map, MappingOptions(mode=mode), recording=recording.name)
        for frame, detections in zip(recording.kept, seen, strict=False):
            before, own_before = time.process_time(), time.thread_time()
            mapper.add(frame, detections)
            seconds += time.process_time() - before
            own += time.thread_time() - own_before
    return seconds, own


def _detected(recording: FirstFrames, detector: Detector) -> list[Detections]:
    return [detector.detect(frame) for frame in recording.frames()]


def _mapped(recording: Recording, detector: Detector, scene: SceneClassifier) -> None:
    with in_memory_map(base="https://example.org/map/") as semantic_map:
        map_recording(recording, semantic_map, detector, scene)


def main(argv: Sequence[str] | None = None) -> int:
    """Print a row for each recording; returns 1 where the default rules take too long."""
    parser = parser_of("benchmarks.pipeline", __doc__)
    parser.add_argument("recording", nargs="+", type=Path)
    parser.add_argument("--detector", default="default")
    parser.add_argument("--frames", type=int, default=250, help="of each recording")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--rules", action="store_true", help="compare with the thesis' rules")
    given = parser.parse_args(argv)
    if given.rules:
        return _compare_rules(given)
    sys.stdout.write(HEADER + "\n")
    for path in given.recording:
        sys.stdout.write(measured(path, given.detector, given.frames, given.rounds) + "\n")
        sys.stdout.flush()
    return 0


def _compare_rules(given: argparse.Namespace) -> int:
    slow = list[str]()
    sys.stdout.write(RULES_HEADER + "\n")
    for path in given.recording:
        row, ratio = by_rules(path, given.detector, given.frames, given.rounds)
        sys.stdout.write(row + "\n")
        if ratio > MAX_RATIO:
            slow.append(f"{path.name}: {ratio:.2f} times the thesis' rules, at most {MAX_RATIO:g}")
    sys.stdout.write("\n".join([f"- gate: {line}" for line in slow or ["passed"]]) + "\n")
    return 1 if slow else 0


if __name__ == "__main__":
    sys.exit(main())

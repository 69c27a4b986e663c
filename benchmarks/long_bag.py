"""Memory that long bags take: peak resident memory of `info`, `convert` and `map` by frames.

    python -m benchmarks.long_bag RECORDING [--frames 1125] [--times 1 4 16] [--commands info map]

Writes MCAP files of the recording played forwards and backwards, five frames a second in 160 x 120
pixels, so that 18,000 frames are an hour, and runs each command on them in a process of its own.
Prints Markdown rows.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from lab.command_line import parser_of
from lab.command_line import run as run_benchmark
from perception.sources.bag_writer import write_bag
from perception.sources.listing import FrameEntry, StoredImage
from perception.sources.recording import FolderRecording, open_recording
from perception.sources.recording_options import RecordingOptions

RATE = 5.0  # frames a second
SIZE = (160, 120)  # [px]
BEGIN = 1_700_000_000.0  # [s]
COMMANDS = ("info", "convert", "map")
HEADER = "| command | frames | bag MB | peak MB | s |\n|---|---|---|---|---|\n"


@dataclass(frozen=True, slots=True)
class SmallImage:
    """An image of a recording, made smaller."""

    of: StoredImage

    def check(self) -> None:
        """As the whole image."""
        self.of.check()

    def colour(self) -> NDArray[np.uint8]:
        """(H, W, 3) RGB."""
        return cv2.resize(self.of.colour(), SIZE, interpolation=cv2.INTER_AREA).astype(np.uint8)

    def depth(self, depth_scale: float) -> NDArray[np.float32]:
        """(H, W) [m], nan = no return."""
        depth = self.of.depth(depth_scale)
        return cv2.resize(depth, SIZE, interpolation=cv2.INTER_NEAREST).astype(np.float32)


def played(path: Path, frames: int) -> FolderRecording:
    """The recording forwards and backwards until it has so many small frames."""
    whole = open_recording(path, RecordingOptions(check=False))
    listing = replace(whole.listing, camera=whole.rectifier.camera)
    there = [
        replace(entry, colour=SmallImage(entry.colour), depth=SmallImage(entry.depth))
        for entry in listing.entries
    ]
    both = [*there, *there[-2:0:-1]]
    entries = tuple(_at(both[i % len(both)], i) for i in range(frames))
    return open_recording(
        path, RecordingOptions(check=False), listing=replace(listing, entries=entries)
    )


def _at(entry: FrameEntry, index: int) -> FrameEntry:
    return replace(entry, id=f"frame-{index:06d}", stamp=BEGIN + index / RATE)


def peak(words: list[object]) -> tuple[float, float]:
    """Peak resident memory [MB] of a command, and how long it took [s]."""
    before = time.perf_counter()
    process = subprocess.Popen(
        [sys.executable, "-m", "hereabouts.cli", *map(str, words)],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    _, status, usage = os.wait4(process.pid, 0)
    if status:
        sys.exit(f"{words[0]} fails")
    return usage.ru_maxrss / 1024, time.perf_counter() - before


def measure(arguments: argparse.Namespace) -> int:
    """Print the table."""
    sys.stdout.write(HEADER)
    for times in arguments.times:
        with tempfile.TemporaryDirectory(dir=arguments.scratch) as folder:
            count, bag = times * arguments.frames, Path(folder) / "long.mcap"
            for _ in write_bag(played(arguments.recording, count), bag):
                pass
            words: dict[str, list[object]] = {
                "info": ["info", bag],
                "convert": ["convert", bag, "-o", Path(folder) / "long.bag"],
                "map": ["map", bag, "--into", Path(folder) / "long.map"],
            }
            for name in arguments.commands:
                memory, seconds = peak(words[name])
                size = bag.stat().st_size / 1e6
                row = f"| {name} | {count} | {size:.0f} | {memory:.0f} | {seconds:.0f} |\n"
                sys.stdout.write(row)
                sys.stdout.flush()
    return 0


def main() -> int:
    """Parse the command line."""
    parser = parser_of("benchmarks.long_bag", __doc__)
    parser.add_argument("recording", type=Path)
    parser.add_argument("--frames", type=int, default=1125)
    parser.add_argument("--times", type=int, nargs="+", default=(1, 4, 16))
    parser.add_argument("--commands", nargs="+", choices=COMMANDS, default=COMMANDS)
    parser.add_argument("--scratch", type=Path, help="folder for bags and maps")
    return run_benchmark(parser, measure)


if __name__ == "__main__":
    sys.exit(main())

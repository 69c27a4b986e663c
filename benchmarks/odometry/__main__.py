"""Poses estimated from images against true ones: recordings at several rates, and their faults.

python -m benchmarks.odometry ../shared/data/rgbd/redkitchen ../shared/data/rgbd/icl_livingroom
python -m benchmarks.odometry RECORDING --faults --limit 100
python -m benchmarks.odometry --houses 1 --alike
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator

import numpy as np

from benchmarks.odometry.accuracy import accuracy
from benchmarks.odometry.faults import FAULTS
from benchmarks.odometry.houses import alike_rooms, house_tour
from lab.command_line import parser_of
from perception.frames import Frame
from perception.sources.recording import open_recording
from perception.sources.recording_options import RecordingOptions, Selection

RATES = {"every": slice(None), "2nd": slice(None, None, 2), "4th": slice(None, None, 4)}
BACKWARDS = slice(None, None, -1)


def main() -> None:
    """Print a line for each recording and rate, or fault."""
    parser = parser_of("benchmarks.odometry", __doc__)
    parser.add_argument("recordings", nargs="*", metavar="RECORDING", help="with true poses")
    parser.add_argument("--houses", type=int, nargs="+", default=(), help="seeds, instead")
    parser.add_argument("--way", type=float, default=100.0, help="of the drive through a house [m]")
    parser.add_argument(
        "--alike", action="store_true", help="a row of rooms that look alike, instead"
    )
    parser.add_argument("--faults", action="store_true", help="faults instead of rates")
    parser.add_argument("--only", nargs="*", help="names of faults or rates")
    parser.add_argument("--limit", type=int, help="frames of each recording")
    given = parser.parse_args()
    for seed in given.houses:
        _print_cases(f"house {seed}", house_tour(seed, given.way), given)
    if given.alike:
        print(f"rooms that look alike\n  {accuracy(alike_rooms()).row()}", flush=True)  # noqa: T201
    for path in given.recordings:
        options = RecordingOptions(check=False, selection=Selection(limit=given.limit))
        recording = open_recording(path, options)
        _print_cases(recording.name, list(recording.frames()), given)


def _print_cases(title: str, frames: list[Frame], given: argparse.Namespace) -> None:
    print(title)  # noqa: T201
    for name, some in _cases(frames, given.faults, given.only):
        print(f"  {name:16} {accuracy(some).row()}", flush=True)  # noqa: T201


def _cases(
    frames: list[Frame], faults: bool, only: list[str] | None
) -> Iterator[tuple[str, list[Frame]]]:
    rates = {} if faults else RATES | {"backwards": BACKWARDS}
    for name in rates:
        if only is None or name in only:
            yield name, frames[rates[name]]
    for name, fault in FAULTS.items() if faults else ():
        if only is None or name in only:
            yield name, fault(list(frames), np.random.default_rng(1))


if __name__ == "__main__":
    main()

"""Whether one recording makes one map, whatever file it is in and however many threads compute it.

    python -m benchmarks.same_map RECORDING [--every N]

Converts the recording to a ROS 1 bag, a ROS 2 bag of SQLite and an MCAP file, and the ROS 1 bag by
`rosbags-convert` to a ROS 2 bag of MCAP; maps each, and the folder with more threads, by
`hereabouts map` in a process of its own. Maps are compared quad by quad, times included; left out
is when the map was made. Prints Markdown rows; exit code 1 where a map differs.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from lab.command_line import run as run_benchmark

HEREABOUTS = (sys.executable, "-m", "hereabouts.cli")
STARTED = "2026-11-22T10:00:00Z"  # of recordings whose stamps count from zero
BASE = "https://example.org/map/"
MADE = "<http://purl.org/dc/terms/created>"  # the run's own time
#: threads of numpy and of networks: one each, and what differs from that
ONE_THREAD = {"OMP_NUM_THREADS": "1", "HEREABOUTS_THREADS": "1"}
THREADS = (
    ("2 threads a network", {"HEREABOUTS_THREADS": "2"}),
    ("2 threads of numpy", {"OMP_NUM_THREADS": "2"}),
)
HEADER = "| recording | MB | frames | quads | other quads | SHA-256 |\n|---|---|---|---|---|---|\n"


def hereabouts(*words: object, **variables: str) -> None:
    """Run a command; its notes are shown only where it fails."""
    environment = os.environ | ONE_THREAD | variables
    done = subprocess.run([*HEREABOUTS, *map(str, words)], env=environment, capture_output=True)
    if done.returncode:
        sys.exit(done.stderr.decode())


def copies(recording: Path, folder: Path, every: int) -> Iterator[tuple[str, Path]]:
    """The recording in each kind of file, made when it is asked for."""
    name = recording.resolve().name
    for number, (kind, file) in enumerate(
        (
            ("ROS 1 bag", f"{name}.bag"),
            ("ROS 2 bag, SQLite", name),
            ("MCAP file", f"{name}.mcap"),
        )
    ):
        path = folder / str(number) / file
        path.parent.mkdir()
        hereabouts("convert", recording, "-o", path, "--every", every, "--started", STARTED)
        yield kind, path
    path = folder / "converted" / name
    path.parent.mkdir()
    source = folder / "0" / f"{name}.bag"
    words = ("--src", source, "--dst", path, "--dst-storage", "mcap")
    program = (sys.executable, "-m", "rosbags.convert")
    subprocess.run([*program, *map(str, words)], check=True, capture_output=True)
    yield "ROS 2 bag, MCAP (rosbags-convert)", path


def quads(recording: Path, name: str, folder: Path, *options: object, **variables: str) -> set[str]:
    """All quads of the recording's map, as lines of N-Quads."""
    folder.mkdir()
    into, out = folder / f"{name}.map", folder / "map.nq"
    hereabouts(
        "map", recording, "--into", into, "--name", name, "--base", BASE, "--started", STARTED,
        *options, **variables,
    )  # fmt: skip
    hereabouts("export", into, "-o", out, "--no-ontology")
    return {line for line in out.read_text(encoding="utf-8").splitlines() if MADE not in line}


def row(kind: str, path: Path, found: set[str], wanted: set[str]) -> str:
    """One recording's row; `frames` are those that its map has applied."""
    files = path.rglob("*") if path.is_dir() else [path]
    size = sum(file.stat().st_size for file in files if file.is_file()) / 1e6
    frames = next(line.split('"')[1] for line in found if "framesApplied" in line)
    digest = hashlib.sha256("\n".join(sorted(found)).encode()).hexdigest()
    other = len(found ^ wanted)
    return f"| {kind} | {size:.0f} | {frames} | {len(found)} | {other} | {digest[:16]} |\n"


def compare(arguments: argparse.Namespace) -> int:
    """Print the table."""
    recording, every = arguments.recording, arguments.every
    name, same = recording.resolve().name, True
    with tempfile.TemporaryDirectory(dir=arguments.scratch) as scratch:
        folder, number = Path(scratch), 0

        def tell(kind: str, path: Path, found: set[str]) -> None:
            nonlocal same
            same = same and found == wanted
            sys.stdout.write(row(kind, path, found, wanted))
            sys.stdout.flush()

        sys.stdout.write(HEADER)
        wanted = quads(recording, name, folder / "map", "--every", every)
        tell("folder", recording, wanted)
        for kind, path in copies(recording, folder, every):
            tell(kind, path, quads(path, name, folder / f"map-{(number := number + 1)}"))
        for kind, variables in THREADS:
            into = folder / f"map-{(number := number + 1)}"
            found = quads(recording, name, into, "--every", every, **variables)
            tell(f"folder, {kind}", recording, found)
    return 0 if same else 1


def main() -> int:
    """Parse the command line."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.same_map", description=__doc__)
    parser.add_argument("recording", type=Path)
    parser.add_argument("--every", type=int, default=1, help="of its frames")
    parser.add_argument("--scratch", type=Path, help="folder for bags and maps")
    return run_benchmark(parser, compare)


if __name__ == "__main__":
    sys.exit(main())

"""Questions of other processes to a map that is being mapped, beside the same questions at rest.

    python -m benchmarks.shared_folder RECORDING [QUESTIONS] [RATE]    (200 questions, 2 a second)

Maps the recording alone, then beside two processes that ask `QUESTIONS` questions in turn, each
opening the map anew. Prints the time of mapping [s wall, s CPU of its process], and the median and
the 95th percentile of the questions' times [s], at rest and beside the mapping.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from kg.serving.opening import open_map
from lab.command_line import parser_of

_QUESTIONS = ("objects", "places", "objects-by-category")


def main() -> None:
    """Measure, or ask as one of the two processes."""
    parser = parser_of("benchmarks.shared_folder", __doc__)
    parser.add_argument("recording")
    parser.add_argument("questions", nargs="?", type=int, default=200)
    parser.add_argument("rate", nargs="?", type=float, default=2.0, help="questions a second")
    parser.add_argument("--ask", action="store_true", help="ask the map RECORDING (for itself)")
    given = parser.parse_args()
    recording, questions, pause = given.recording, given.questions, 2 / given.rate
    if given.ask:
        ask(Path(recording), questions, pause)
        return
    with tempfile.TemporaryDirectory() as folder:
        alone = _mapped(recording, Path(folder) / "alone.map")
        rest = _asking(Path(folder) / "alone.map", questions // 4, 0.1)
        _print("at rest", [float(line) for one in rest for line in one.communicate()[0].split()])
        path = Path(folder) / "beside.map"
        beside = _mapped(recording, path, asking := [(path, questions // 2, pause)])
        times = [float(line) for one in asking.pop() for line in one.communicate()[0].split()]
        _print("beside mapping", times)
    print(f"mapping alone {alone[0]:.1f} s wall, {alone[1]:.1f} s CPU")  # noqa: T201
    print(f"mapping beside {beside[0]:.1f} s wall, {beside[1]:.1f} s CPU")  # noqa: T201


def ask(path: Path, count: int, pause: float) -> None:
    """Ask `count` questions, each of the map opened anew; prints the seconds of each."""
    for number in range(count):
        began = time.perf_counter()
        with open_map(path, read_only=True) as semantic_map:
            name = _QUESTIONS[number % len(_QUESTIONS)]
            semantic_map.query(name, **({"category": "cup"} if "by" in name else {}))
        print(time.perf_counter() - began, flush=True)  # noqa: T201
        time.sleep(pause)


def _asking(path: Path, count: int, pause: float) -> list[subprocess.Popen[str]]:
    command = [sys.executable, "-m", "benchmarks.shared_folder", "--ask", str(path)]
    command += [str(count), str(2 / pause)]
    return [subprocess.Popen(command, stdout=subprocess.PIPE, text=True) for _ in range(2)]


def _mapped(recording: str, path: Path, asking: list | None = None) -> tuple[float, float]:  # type: ignore[type-arg]
    """[s] wall and CPU of mapping, while the processes of `asking` ask."""
    code = "import sys, time; from hereabouts.cli import main; main(sys.argv[1:]); "
    code += "print(time.process_time(), file=sys.stderr)"
    began = time.perf_counter()
    command = [sys.executable, "-c", code, "map", recording, "--into", str(path)]
    process = subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
    )
    if asking:
        while not (path / "store").exists():
            time.sleep(0.1)
        asking.append(_asking(*asking.pop()))
    _, errors = process.communicate()
    return time.perf_counter() - began, float(errors.split()[-1])


def _print(name: str, times: list[float]) -> None:
    middle, late = np.percentile(times, (50, 95))
    print(f"{name}: {len(times)} answers, median {middle:.3f} s, p95 {late:.3f} s")  # noqa: T201


if __name__ == "__main__":
    main()

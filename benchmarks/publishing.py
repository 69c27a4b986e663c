"""Latency of a mirror: from a robot's transaction to its copy in a SPARQL server.

    python -m benchmarks.publishing [FRAMES]        (from the repository's root; 200 of each robot)

Two robots write frames of 20 objects, 10 a second each, into maps that are served; both are
published into one Oxigraph server on loopback. Prints the time [ms] from the return of each write
to the acknowledgement of the target.
"""

from __future__ import annotations

import statistics
import tempfile
import threading
import time
from contextlib import ExitStack
from pathlib import Path

import numpy as np

from kg.maps.semantic_map import SemanticMap
from kg.model.records import MapUpdate, ObjectRecord
from kg.model.transactions import ChangeSet
from kg.serving.opening import create_map
from kg.serving.publishing import Publisher, PublishTarget
from kg.serving.server import MapServer, Settings
from lab.command_line import parser_of
from tests.conftest import running_server

OBJECTS = 20
PERIOD = 0.1  # [s] between frames


class _Timed(PublishTarget):
    """A target that remembers when each transaction was acknowledged."""

    def __init__(self, url: str) -> None:
        super().__init__(url)
        self.acknowledged_at: dict[tuple[str, int], float] = {}

    def apply(self, base: str, change: ChangeSet, acknowledged: int) -> None:
        super().apply(base, change, acknowledged)
        self.acknowledged_at[base, change.sequence] = time.perf_counter()


def _drive(robot: SemanticMap, frames: int, written: dict[tuple[str, int], float]) -> None:
    category = robot.catalogue.find("cup").iri
    names = [robot.new_object_iri() for _ in range(OBJECTS)]
    for frame in range(frames):
        objects = tuple(
            ObjectRecord(
                *(name, category, np.array([k + 0.02 * frame, 1.0, 0.5]), 2.0, 0.7),
                *(frame + 1, 1e9, 1e9 + frame),
            )
            for k, name in enumerate(names)
        )
        robot.apply(MapUpdate(objects=objects))
        written[robot.base, robot.sequence] = time.perf_counter()
        time.sleep(PERIOD)


def main() -> None:
    """Print the latencies."""
    parser = parser_of("benchmarks.publishing", __doc__)
    parser.add_argument("frames", nargs="?", type=int, default=200, help="of each robot")
    frames = parser.parse_args().frames
    written: dict[tuple[str, int], float] = {}
    with ExitStack() as opened:
        folder = Path(opened.enter_context(tempfile.TemporaryDirectory()))
        target = _Timed(opened.enter_context(running_server(folder / "target")))
        robots = [
            opened.enter_context(create_map(folder / name, base=f"urn:robots:{name}/"))
            for name in ("one", "two")
        ]
        servers = [opened.enter_context(MapServer(r, Settings(port=0))) for r in robots]
        publishers = [Publisher(server.url, target) for server in servers]
        following = [threading.Thread(target=publisher.follow) for publisher in publishers]
        driving = [threading.Thread(target=_drive, args=(r, frames, written)) for r in robots]
        for robot in robots:
            _drive(robot, 1, {})  # the copy of a map without things is never marked as complete
        for thread in following:
            thread.start()
        while any(target.acknowledged(robot.base) is None for robot in robots):
            time.sleep(0.1)
        for thread in driving:
            thread.start()
        for thread in driving:
            thread.join()
        time.sleep(3.0)
        for publisher in publishers:
            publisher.stop()
        for thread in following:
            thread.join()
    lags = sorted(
        1e3 * (target.acknowledged_at[key] - moment)
        for key, moment in written.items()
        if key in target.acknowledged_at
    )
    print(f"{len(lags)} of {len(written)} transactions followed")  # noqa: T201
    p95 = lags[int(0.95 * len(lags))]
    print(f"median {statistics.median(lags):.0f}, p95 {p95:.0f}, most {lags[-1]:.0f} ms")  # noqa: T201


if __name__ == "__main__":
    main()

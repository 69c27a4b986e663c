"""What the history costs and how quickly the past answers: `python benchmarks/history.py`.

Writes frames of 20 objects drawn from 1,000 straight into the log, so that a million observations
take minutes, then asks about the past. Prints Markdown rows.
"""

from __future__ import annotations

import argparse
import random
import sqlite3
import statistics
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from pyoxigraph import Literal, NamedNode, Quad, Store

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from kg import vocabulary as v
from kg.commits import Cause, ChangeSet
from kg.history.compaction import compact
from kg.history.log import Log
from kg.history.past import members_at, state_of, store_at

BASE = "https://w3id.org/hereabouts/maps/bench/"
CATEGORIES = 50
SEEN = 20  # objects a frame
_MAP = NamedNode(v.MAP_GRAPH)
_TIME = NamedNode(v.XSD + "dateTime")


def state(number: int, count: int, rng: random.Random) -> set[Quad]:
    """An object as the map describes it after `count` sightings."""
    stamp = Literal(time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime(1e9 + count)), datatype=_TIME)
    facts = {
        v.RDF_TYPE: NamedNode(f"{v.HERE}Kind{number % CATEGORIES}"),
        v.RDFS_LABEL: Literal(f"thing {number}"),
        v.X: Literal(round(number + rng.gauss(0, 0.05), 2)),
        v.Y: Literal(round(rng.gauss(0, 0.05), 2)),
        v.Z: Literal(round(rng.gauss(0, 0.05), 2)),
        v.CONFIDENCE: Literal(round(rng.uniform(0, 3), 2)),
        v.EXISTENCE: Literal(round(rng.uniform(0, 1), 2)),
        v.OBSERVATION_COUNT: Literal(count),
        v.LAST_SEEN: stamp,
        v.IN_PLACE: NamedNode(f"{BASE}place/{number % 7}"),
    }
    subject = NamedNode(f"{BASE}object/{number}")
    return {Quad(subject, NamedNode(p), value, _MAP) for p, value in facts.items()}


def robot(frame: int) -> set[Quad]:
    """The robot on its way."""
    subject = NamedNode(BASE + "robot")
    facts = {v.X: Literal(round(frame * 0.03, 2)), v.HEADING: Literal(frame % 628 / 100)}
    return {Quad(subject, NamedNode(p), value, _MAP) for p, value in facts.items()}


def write(log: Log, observations: int, objects: int) -> list[float]:
    """That many observations; seconds of each append."""
    rng = random.Random(1)
    now: dict[int, set[Quad]] = {}
    counts = dict.fromkeys(range(objects), 0)
    spent = []
    for frame in range(1, observations // SEEN + 1):
        added, removed = robot(frame), robot(frame - 1) if frame > 1 else set()
        start = rng.randrange(objects)
        for number in ((start + step) % objects for step in range(SEEN)):
            counts[number] += 1
            after = state(number, counts[number], rng)
            before = now.get(number, set())
            added |= after - before
            removed |= before - after
            now[number] = after
        cause = Cause("frame", note=f"bench/frame-{frame:06d}")
        change = ChangeSet(frame, 1e9 + frame, cause, tuple(added), tuple(removed))
        clock = time.perf_counter()
        log.append(change)
        spent.append(time.perf_counter() - clock)
        if frame % 500 == 0:
            log.flush()
    return spent


def timed(ask: Callable[[], object], rounds: int) -> str:
    """Median and 95th percentile of a question, in milliseconds."""
    spent = []
    for _ in range(rounds):
        clock = time.perf_counter()
        ask()
        spent.append((time.perf_counter() - clock) * 1000)
    return f"{statistics.median(spent):.2f} | {sorted(spent)[int(len(spent) * 0.95)]:.2f}"


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--observations", type=int, default=1_000_000)
    parser.add_argument("--objects", type=int, default=1000)
    arguments = parser.parse_args()
    rng = random.Random(2)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "history.sqlite"
        log = Log.open(file, BASE)
        log.begin(0, 1e9, ())
        spent = write(log, arguments.observations, arguments.objects)
        tenth = len(spent) // 10
        first, last = (statistics.median(part) * 1e3 for part in (spent[:tenth], spent[-tenth:]))
        done = compact(log)
        each = done.bytes_after / arguments.observations
        print(f"{sqlite3.sqlite_version=} {arguments.observations} observations")  # noqa: T201
        print(f"append, ms a frame: first tenth {first:.2f}, last tenth {last:.2f}")  # noqa: T201
        print(f"bytes an observation: {each:.1f} ({done.bytes_before / 1e6:.0f} MB before)")  # noqa: T201
        engine = Store()

        def any_time() -> int:
            return rng.randrange(1, log.last)

        def any_thing() -> str:
            return f"{BASE}object/{rng.randrange(arguments.objects)}"

        questions: dict[str, tuple[Callable[[], object], int]] = {
            "one object at a moment": (lambda: state_of(log, any_thing(), any_time()), 300),
            "one class at a moment": (
                lambda: members_at(log, f"{v.HERE}Kind{rng.randrange(CATEGORIES)}", any_time()),
                100,
            ),
            "the whole map at a moment": (lambda: store_at(log, engine, any_time()), 5),
        }
        for name, (ask, rounds) in questions.items():
            print(f"| {name} | {timed(ask, rounds)} |")  # noqa: T201
        log.close()


if __name__ == "__main__":
    main()

"""Cost of the history, and time of queries of past states: `python -m benchmarks.history`.

Writes frames of 20 objects of 1,000 directly into the log, so that a million observations take
minutes, and then queries past states. Prints Markdown rows.
"""

from __future__ import annotations

import random
import sqlite3
import statistics
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

from pyoxigraph import Literal, NamedNode, Quad, Store

from kg.history.point_in_time import replay, state_of
from kg.history.storage.log import HistoryLog
from kg.history.storage.maintenance import compact
from kg.knowledge.ontology.catalogue import Catalogue
from kg.maps.map_metadata import first_quads
from kg.maps.query.evaluation import Table, evaluate
from kg.maps.query.query_files import find_query
from kg.model import vocabulary as v
from kg.model.transactions import Cause, ChangeSet
from kg.rdf.literals import cell_of
from kg.rdf.quad_store import QuadStore
from kg.store.transaction_quads import sequence_quad
from lab.command_line import parser_of

BASE = "https://w3id.org/hereabouts/maps/bench/"
_TIME = NamedNode(v.XSD + "dateTime")
CATEGORIES = 50
SEEN = 20  # objects a frame
FIRST = first_quads("bench", BASE)  # ontology and common sense
KINDS = [
    c.iri
    for c in Catalogue.from_quads(q for q in FIRST if q.graph_name == v.ONTOLOGY_GRAPH).categories
    if c.kind == "object"
][:CATEGORIES]
THREE = "SELECT ?thing ?x ?y { ?thing here:x ?x ; here:y ?y ; here:existence ?e FILTER(?e > 0.9) }"
ALL = "SELECT ?p (COUNT(*) AS ?facts) { ?s ?p ?o } GROUP BY ?p"


def state(number: int, count: int, rng: random.Random) -> set[Quad]:
    """An object as the map describes it after `count` sightings."""
    stamp = Literal(time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime(1e9 + count)), datatype=_TIME)
    facts = {
        v.RDF_TYPE.value: NamedNode(KINDS[number % CATEGORIES]),
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
    facts[v.IN_CELL] = NamedNode(cell_of(float(facts[v.X].value), float(facts[v.Y].value)))
    subject = NamedNode(f"{BASE}object/{number}")
    return {Quad(subject, NamedNode(p), value, v.MAP_GRAPH) for p, value in facts.items()}


def robot(frame: int) -> set[Quad]:
    """The robot on its way."""
    subject = NamedNode(BASE + "robot")
    facts = {v.X: Literal(round(frame * 0.03, 2)), v.HEADING: Literal(frame % 628 / 100)}
    return {Quad(subject, NamedNode(p), value, v.MAP_GRAPH) for p, value in facts.items()}


def write(log: HistoryLog, observations: int, objects: int) -> list[float]:
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
    """Median and 95th percentile of a question, of the clock and of processor time [ms]."""
    clocks = time.perf_counter, time.process_time
    spent: list[list[float]] = [[], []]
    for _ in range(rounds):
        began = [clock() for clock in clocks]
        ask()
        for clock, start, each in zip(clocks, began, spent, strict=True):
            each.append((clock() - start) * 1000)
    figures = ((statistics.median(each), sorted(each)[int(len(each) * 0.95)]) for each in spent)
    return " | ".join(f"{number:.2f}" for pair in figures for number in pair)


def asked(log: HistoryLog, engine: QuadStore, sparql: str, sequence: int) -> Table:
    """The answer of the map right after a transaction, whose state is not cached."""
    return evaluate(replay(log, engine, sequence), sparql, base=BASE)


def lookups(objects: int, rng: random.Random) -> dict[str, Callable[[], str]]:
    """Queries whose predicates are known: shipped ones, and a plain one."""
    radius, kinds = (find_query(f"objects-{name}") for name in ("within-radius", "by-category"))

    def near() -> str:
        return radius.bind({"x": rng.randrange(objects), "y": 0.0}, lambda kind, text: text)

    def of_a_kind() -> str:
        return kinds.bind({"category": rng.choice(KINDS)}, lambda kind, text: text)

    return {
        "objects within 2 m of a point": near,
        "objects of a category": of_a_kind,
        "three predicates": lambda: THREE,
        "x of one object": lambda: f"SELECT ?x {{ <object/{rng.randrange(objects)}> here:x ?x }}",
        "all, by predicate": lambda: ALL,
    }


def main() -> None:
    """Measure and print."""
    parser = parser_of("benchmarks.history", __doc__)
    parser.add_argument("--observations", type=int, default=1_000_000)
    parser.add_argument("--objects", type=int, default=1000)
    arguments = parser.parse_args()
    rng = random.Random(2)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "history.sqlite"
        log = HistoryLog.open(file, BASE)
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
        engine.bulk_extend(FIRST)
        engine.add(sequence_quad(log.last))

        def any_time() -> int:
            return rng.randrange(1, log.last)

        def any_thing() -> str:
            return f"{BASE}object/{rng.randrange(arguments.objects)}"

        questions: dict[str, tuple[Callable[[], object], int]] = {
            "one object at a moment": (lambda: state_of(log, any_thing(), any_time()), 300),
        }
        for name, sparql in lookups(arguments.objects, rng).items():
            ask = partial(lambda text: asked(log, engine, text(), any_time()), sparql)
            questions[f"query: {name}"] = ask, 40
        questions |= {
            "a state replayed": (lambda: replay(log, engine, any_time()), 40),
        }
        for name, (ask, rounds) in questions.items():
            print(f"| {name} | {timed(ask, rounds)} |")  # noqa: T201
        log.close()


if __name__ == "__main__":
    main()

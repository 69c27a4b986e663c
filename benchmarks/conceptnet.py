"""ConceptNet import: Table 6.1 of the thesis, the fit of the probability, and the cost.

python -m benchmarks.conceptnet table GRAPH        lab/research/table_6_1.md, on stdout
python -m benchmarks.conceptnet ship GRAPH         kg/knowledge/placement/tables/conceptnet.csv, on
stdout python -m benchmarks.conceptnet fit GRAPH HOMES    probability over weight, in real homes
python -m benchmarks.conceptnet judge GRAPH        share of sensible relations, by verdicts of hand
python -m benchmarks.conceptnet cost FILE [LINES]  time and memory; with LINES, of a file that long

GRAPH is ConceptNet 4's graph (or any file the import reads), HOMES a folder of homes as JSON.
"""

from __future__ import annotations

import csv
import gzip
import json
import math
import multiprocessing
import os
import resource
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from kg.knowledge.conceptnet.edges import LOCATED, NEAR, probability_of
from kg.knowledge.conceptnet.importing import import_conceptnet
from kg.knowledge.conceptnet.relate import ImportedRelation
from kg.knowledge.ontology.catalogue import Catalogue
from kg.knowledge.ontology.loading import load_ontologies
from kg.model import vocabulary as v

TABLE = Path(__file__).parent / "thesis" / "table_6_1.csv"
JUDGED = Path(__file__).with_name("conceptnet_judged.csv")
#: Room labels of the homes that are another name than ours, as in docs/explanation/ontology.md.
ROOMS = {"office": "home office"}
PARAMETERS = {
    v.LOCATED_AT: LOCATED,
    v.NEAR_BY: NEAR,
}
_BINS = (
    (0, 0.01),
    (0.01, 1),
    (1, 1.01),
    (1.01, 2),
    (2, 2.01),
    (2.01, 3),
    (3, 4),
    (4, 6),
    (6, 9),
    (9, math.inf),
)


def table_6_1(graph: Path) -> str:
    """`lab/research/table_6_1.md`: the thesis' weights beside those imported from `graph`."""
    catalogue = Catalogue.from_quads(load_ontologies().quads)
    weights = {
        (catalogue.label(f.subject), catalogue.label(f.target)): f
        for f in import_conceptnet(graph).found
        if f.kind == v.LOCATED_AT
    }
    with TABLE.open(newline="") as file:
        rows = list(csv.DictReader(file))
    objects = [name for name in rows[0] if name != "place"]
    lines = [_HEAD, f"| | {' | '.join(objects)} |", "|---" * (len(objects) + 1) + "|"]
    new, lost = [], []
    for row in rows:
        cells = []
        for thing in objects:
            found, published = weights.get((thing, row["place"])), row[thing]
            cells.append(f"{_weight(found)} / {published or '-'}" if found or published else "")
            if found and not published:
                new.append(
                    f"{thing} in {row['place']} ({found.weight:.2f}, {found.probability:.2f})"
                )
            if published and not found:
                lost.append(f"{thing} in {row['place']}")
        lines.append(f"| {row['place']} | {' | '.join(cells)} |")
    lines += ["", f"Missing in the thesis, here now (weight, probability): {', '.join(new)}.", ""]
    lines += [f"In the thesis, not here: {', '.join(lost) or 'none'}.", "", _FOOT]
    return "\n".join(lines)


def ship(graph: Path) -> str:
    """The table of weights that ships, from what `graph` says of our categories."""
    catalogue = Catalogue.from_quads(load_ontologies().quads)
    rows = sorted(
        (catalogue.label(f.subject), catalogue.label(f.target), f.weight, f.weight_against)
        for f in import_conceptnet(graph).found
        if f.kind == v.LOCATED_AT and catalogue.by_iri(f.subject).kind == "object"
    )
    lines = ["object,place,weight,weight_against"]
    lines += [f"{thing},{place},{weight:g},{against:g}" for thing, place, weight, against in rows]
    return "\n".join(lines) + "\n"


def judge(graph: Path) -> Iterator[str]:
    """The share of sensible relations among those imported from `graph`, for each judged sample.

    `conceptnet_judged.csv` has a verdict of hand on each: on 140 relations of an earlier import, by
    which rules were made (develop); on 140 others of what these rules left, judged once (held out;
    10 were wrong, by which two more rules were made); and on those that then were left.
    """
    found = {(f.subject, f.kind, f.target) for f in import_conceptnet(graph).found}
    judged: dict[tuple[str, ...], tuple[str, str]] = {}
    with JUDGED.open(newline="") as file:
        for row in csv.DictReader(file):
            kind = (
                v.RDFS_SUB_CLASS_OF if row["relation"] == "subClassOf" else v.HERE + row["relation"]
            )
            key = v.HERE + row["subject"], kind, v.HERE + row["object"]
            judged[key] = row["sample"], row["sensible"]
    for sample in dict.fromkeys(sample for sample, _ in judged.values()):
        all_verdicts = [verdict for one, verdict in judged.values() if one == sample]
        verdicts = [judged[key][1] for key in found if judged.get(key, ("",))[0] == sample]
        yield f"{sample}: {all_verdicts.count('yes')} of {len(all_verdicts)} judged are sensible; "
        yield f"now found: {verdicts.count('yes')} of {len(verdicts)}\n"
    known = [judged[key][1] for key in found if key in judged]
    yield f"all: {known.count('yes') / len(known):.3f} of {len(known)} that are found and judged; "
    yield f"{len(found) - len(known)} others were not judged\n"


def _weight(found: ImportedRelation | None) -> str:
    return "-" if found is None else f"{found.weight:.2f}"


def fit(graph: Path, homes: Path) -> Iterator[str]:
    """The logistic regression of presence on ln(1 + weight), over rooms of homes.

    Over all pairs of a room and an object that the homes' annotators named anywhere: an object
    they never named was not looked for.
    """
    found = import_conceptnet(graph).found
    for kind in (v.LOCATED_AT, v.NEAR_BY):
        weight, present = _pairs(found, kind, homes)
        X = np.column_stack([np.ones(len(weight)), np.log1p(weight)])
        beta = np.zeros(2)
        for _ in range(50):
            p = 1 / (1 + np.exp(-X @ beta))
            beta += np.linalg.solve(X.T @ (X * (p * (1 - p))[:, None]), X.T @ (present - p))
        name = kind.removeprefix(v.HERE)
        yield f"{name}: {len(weight)} pairs, {present.mean():.3f} present; "
        yield f"base {beta[0]:.2f}, slope {beta[1]:.2f}\n"
        for low, high in _BINS:
            within = (weight >= low - 1e-9) & (weight < high - 1e-9)
            if within.any():
                given = np.mean([probability_of(w, PARAMETERS[kind]) for w in weight[within]])
                yield f"  weight {low:g} to {high:g}: {within.sum()} pairs, "
                yield f"{present[within].mean():.3f} present, {given:.3f} given\n"


def _pairs(
    found: tuple[ImportedRelation, ...], kind: str, homes: Path
) -> tuple[np.ndarray, np.ndarray]:
    """Net weight, 0 of unrelated pairs, and 1 where the object is in the room, for each pair."""
    catalogue = Catalogue.from_quads(load_ontologies().quads)
    net = {
        (catalogue.label(f.subject), catalogue.label(f.target)): f.weight - f.weight_against
        for f in found
        if f.kind == kind
    }
    rooms = [
        (catalogue.get(ROOMS.get(room["label"], room["label"]), "place"), room["coco"])
        for home in sorted(homes.glob("*.json"))
        for room in json.loads(home.read_text())["rooms"]
    ]
    named = sorted({thing for _, coco in rooms for thing in coco if coco[thing] > 0})
    pairs = []
    for place, coco in rooms:
        present = [thing for thing in named if coco.get(thing, 0) > 0]
        targets = present if kind == v.NEAR_BY else [place.label] if place else []
        pairs += [
            (net.get((thing, target), 0.0), thing in present)
            for target in targets
            for thing in named
            if thing != target
        ]
    weight, held = zip(*pairs, strict=True)
    return np.array(weight), np.array(held, dtype=float)


def cost(path: Path, lines: int | None) -> str:
    """Processor time and peak memory of one import; of a file of so many lines where that is given.

    The grown file repeats the lines of `path` in eleven languages and with other terms, so that one
    line in eleven is English, as in the full dump. It is never on the disk: another process writes
    it, packed, into a pipe.
    """
    with tempfile.TemporaryDirectory() as folder:
        writer = None
        if lines:
            pipe = Path(folder) / "grown.gz"
            os.mkfifo(pipe)
            writer = multiprocessing.get_context("spawn").Process(
                target=_grow, args=(path, lines, pipe), daemon=True
            )
            writer.start()
            path = pipe
        started = time.process_time()
        imported = import_conceptnet(path, Path(folder) / "out.ttl")
        seconds = time.process_time() - started
        if writer:
            writer.join()
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return (
        f"{imported.lines} lines, {imported.used} of use, {len(imported.found)} relations: "
        f"{seconds:.1f} s of a processor, {imported.lines / seconds / 1e3:.0f} thousand lines a "
        f"second, "
        f"peak {peak:.0f} MB\n"
    )


def _grow(path: Path, lines: int, into: Path) -> None:
    with gzip.open(path, "rb") as file:
        known = file.readlines()
    with gzip.open(into, "wb", compresslevel=1) as file:
        for n in range(lines):
            line = known[(n // 11) % len(known)]
            if n % 11:
                line = line.replace(b"/c/en/", b"/c/x%d/" % (n % 11))
            elif n // 11 >= len(known):  # English, of other things
                line = line.replace(b"/c/en/", b"/c/en/z%d_" % (n // 11))
            file.write(line)


_HEAD = """# Table 6.1, regenerated

Printed by `python -m benchmarks.conceptnet table GRAPH`, GRAPH being ConceptNet 4's English graph;
a test keeps it equal. The thesis (section 6.1.2) asked the web API of ConceptNet 5 for AtLocation
edges of objects, places and their synonyms, and gave up: "bed in bedroom" and others were missing.
Each cell: weight as imported here / weight as published (its text layer; the alignment of columns
is the text's). Both are on ConceptNet 5's scale: 2 sqrt(n - 1) for n votes.
"""
_FOOT = """The import also reads what has, and is part of, a place, what is near it, spellings and
lemmas ("live room"), doubtful names ("notebook") and kinds (fruit, food), as
docs/how-to/statistics.md describes.
It leaves out what too few say, and what is said of another meaning: a mouse is part of computers,
so it is where computers are, and nothing is left of it in kitchen, attic and closet. ConceptNet 4
is older than the service that the thesis asked: weights differ where people have voted since. Of
wine glasses it says only that they are at dinner and in cupboards, and that one is a dish (one vote
each): too few to pass on the places of cupboards or dishes. This page includes data from ConceptNet
5, compiled by the Commonsense Computing Initiative (CC BY-SA 4.0, conceptnet.io).
"""


def main(words: list[str]) -> None:
    """Run one of them."""
    match words:
        case ["table", graph]:
            sys.stdout.write(table_6_1(Path(graph)))
        case ["ship", graph]:
            sys.stdout.write(ship(Path(graph)))
        case ["fit", graph, homes]:
            sys.stdout.writelines(fit(Path(graph), Path(homes)))
        case ["judge", graph]:
            sys.stdout.writelines(judge(Path(graph)))
        case ["cost", path, *more]:
            sys.stdout.write(cost(Path(path), int(more[0]) if more else None))
        case _:
            sys.exit(__doc__)


if __name__ == "__main__":
    main(sys.argv[1:])

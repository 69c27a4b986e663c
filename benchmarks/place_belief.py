"""Evidence for the kind of a room: `python -m benchmarks.place_belief HOMES`.

Rooms of real homes (a folder of JSON files, benchmarks/search/homes.py) that are of one kind. Their
views are simulated, since the homes have no pictures: a classifier that gives the true kind the
probability `right` on average, by a Dirichlet draw for each room and one around that for each view,
so that what it mistakes a room for it mistakes again. Of the kinds of object in a room half are
seen, one in fifty of those that are not there, each believed with 0.5 to exist.

Rows: the thesis' two filters; the product's fusion of views, objects and the frequencies of rooms;
and that with the room's area and elongation, with its number of doors, and with both (normal and
Poisson distributions by kind, fitted to all other homes). Columns: how often the likeliest kind is
the true one, mean -ln p(true kind), expected calibration error of the likeliest kind in ten bins.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from benchmarks.search.homes import Home, read_homes
from kg.knowledge.placement.rooms import room_types
from kg.knowledge.placement.table import table_of
from kg.serving.opening import in_memory_map
from lab.command_line import run
from mapping.places.place_mapper import ObjectEvidence
from mapping.places.place_registry import PlaceRegistry
from mapping.reference.belief_filters import bayes_update, mean_update
from mapping.reference.settings import ReferenceSettings

SEEN, MISTAKEN, EXISTS = 0.5, 0.02, 0.5
_PRIOR_ROOMS: Final = 3.0  # rooms of any kind that each kind's distribution starts from
_BOUND: Final = 4.0  # of a log-likelihood ratio of a shape

Belief = Mapping[str, float]


@dataclass(frozen=True, slots=True)
class TrueRoom:
    """A room of one kind."""

    kind: str  # IRI
    log_area: float
    log_elongation: float
    doors: int
    objects: frozenset[str]  # IRIs


def true_rooms(home: Home, evidence: Evidence) -> list[TrueRoom]:
    """The rooms of a home whose label says one kind that the table knows."""
    doors = Counter(room for door in home.doors or () for room in door)
    found = []
    for number, room in enumerate(home.rooms):
        kinds = room_types(room.label, evidence.catalogue)
        if len(kinds) == 1 and kinds[0].iri in evidence.places:
            width, depth = room.floor.size
            held = (evidence.catalogue.get(name, "object") for name in room.holds)
            objects = frozenset(category.iri for category in held if category is not None)
            shape = float(np.log(width * depth)), abs(float(np.log(width / depth)))
            found.append(TrueRoom(kinds[0].iri, *shape, doors[number], objects))
    return found


class Evidence:
    """The product's fusion, on the ontology of a new map."""

    def __init__(self) -> None:
        with in_memory_map() as semantic_map:
            registry = PlaceRegistry(semantic_map, recording=None)
            self._fusion = ObjectEvidence(semantic_map, registry, ReferenceSettings(least_belief=0))
            self.catalogue = semantic_map.catalogue
            self.places = tuple(self._fusion.prior({}))
            self.objects = table_of(semantic_map.ontology.quads()).objects

    def fused(self, present: Mapping[str, float], views: Belief) -> Belief:
        """p(kind), by IRI."""
        return self._fusion.fused(present, views)


def methods(
    evidence: Evidence, views: Sequence[Belief], present: Mapping[str, float]
) -> dict[str, Belief]:
    """The belief of each method."""
    mean: Belief = {}
    bayes: Belief = {}
    for number, scores in enumerate(views):
        mean = mean_update(mean, number, scores)
        bayes = bayes_update(bayes, scores, evidence.places, ReferenceSettings().bayes_floor)
    uniform = dict.fromkeys(evidence.places, 1 / len(evidence.places))
    return {
        "mean of views (thesis)": mean or uniform,
        "Bayes filter of views (thesis)": bayes or uniform,
        "views and frequencies": evidence.fused({}, mean),
        "views, frequencies, objects": evidence.fused(present, mean),
    }


def shape_ratios(
    train: Sequence[TrueRoom], room: TrueRoom
) -> tuple[dict[str, float], dict[str, float]]:
    """Log-likelihood ratios of each kind to any room, by the room's shape and by its doors."""
    shape, doors = {}, {}
    sizes = np.array([(r.log_area, r.log_elongation) for r in train])
    numbers = np.array([r.doors for r in train])
    mean, variance, rate = sizes.mean(0), sizes.var(0), numbers.mean()
    here = np.array([room.log_area, room.log_elongation])
    for kind in {r.kind for r in train}:
        of = np.array([r.kind == kind for r in train])
        rooms = of.sum() + _PRIOR_ROOMS
        centre = (sizes[of].sum(0) + _PRIOR_ROOMS * mean) / rooms
        spread = (((sizes[of] - centre) ** 2).sum(0) + _PRIOR_ROOMS * variance) / rooms
        ratio = (here - mean) ** 2 / variance - (here - centre) ** 2 / spread
        shape[kind] = float((ratio + np.log(variance / spread)).sum() / 2)
        expected = (numbers[of].sum() + _PRIOR_ROOMS * rate) / rooms
        doors[kind] = float(room.doors * np.log(expected / rate) - expected + rate)
    return shape, doors


def weighed(belief: Belief, *ratios: Mapping[str, float]) -> Belief:
    """A belief times the likelihood ratios, which are bounded."""
    total = {c: sum(ratio.get(c, 0.0) for ratio in ratios) for c in belief}
    raised = {c: p * float(np.exp(np.clip(total[c], -_BOUND, _BOUND))) for c, p in belief.items()}
    whole = sum(raised.values())
    return {c: p / whole for c, p in raised.items()}


def simulated_views(
    truth: str,
    places: Sequence[str],
    kinds: Sequence[str],
    right: float,
    count: int,
    random: np.random.Generator,
) -> Iterator[Belief]:
    """Scene scores of `count` views of one room."""
    mean = np.full(len(places), 0.2 * (1 - right) / len(places))
    mean[[places.index(kind) for kind in kinds]] += 0.8 * (1 - right) / len(kinds)
    mean[places.index(truth)] += right
    room = random.dirichlet(3 * mean / mean.sum() + 1e-3)
    for scores in random.dirichlet(10 * room + 1e-3, count):
        yield dict(zip(places, map(float, scores), strict=True))


def calibration_error(p: NDArray[np.float64], right: NDArray[np.float64]) -> float:
    """Expected calibration error of probabilities `p` (n,) in ten bins."""
    number = np.minimum((p * 10).astype(int), 9)
    off = [abs((p - right)[number == k].sum()) for k in range(10)]
    return float(sum(off) / len(p))


def _table(
    homes: Sequence[Sequence[TrueRoom]], evidence: Evidence, right: float, count: int, draws: int
) -> Iterator[str]:
    random = np.random.default_rng(0)
    kinds = sorted({room.kind for home in homes for room in home})
    seen: dict[str, list[tuple[float, float, float]]] = defaultdict(list)
    for number, home in enumerate(homes):
        train = [room for k, other in enumerate(homes) if k != number for room in other]
        for room in home:
            shape, doors = shape_ratios(train, room)
            for _ in range(draws):
                views = list(
                    simulated_views(room.kind, evidence.places, kinds, right, count, random)
                )
                chance = [SEEN if o in room.objects else MISTAKEN for o in evidence.objects]
                drawn = zip(evidence.objects, random.random(len(chance)) < chance, strict=True)
                present = {iri: EXISTS for iri, there in drawn if there}
                beliefs = methods(evidence, views, present)
                fused = beliefs["views, frequencies, objects"]
                beliefs["... and shape"] = weighed(fused, shape)
                beliefs["... and doors"] = weighed(fused, doors)
                beliefs["... and both"] = weighed(fused, shape, doors)
                for name, belief in beliefs.items():
                    best = max(belief, key=lambda c: (belief[c], c))
                    loss = -float(np.log(max(belief.get(room.kind, 0.0), 1e-6)))
                    seen[name].append((float(best == room.kind), loss, belief[best]))
    for name, found in seen.items():
        told, loss, p = np.array(found).T
        error = calibration_error(p, told)
        scores = f"{told.mean():.3f} | {loss.mean():.3f} | {error:.3f}"
        yield f"| {count} | {right:g} | {name} | {scores} |"


def _command(arguments: argparse.Namespace) -> int:
    evidence = Evidence()
    homes = [true_rooms(home, evidence) for home in read_homes(arguments.homes)]
    header = "| views | right | belief | top-1 | log loss | ECE |"
    sys.stdout.write(f"{header}\n|---|---|---|---|---|---|\n")
    for right, count in ((0.4, 0), (0.2, 5), (0.4, 5), (0.6, 5)):
        for row in _table(homes, evidence, right, count, arguments.draws):
            sys.stdout.write(row + "\n")
    return 0


def main(argv: Sequence[str] | None = None) -> int:
    """Measure, and print the table."""
    parser = argparse.ArgumentParser(prog="benchmarks.place_belief", description=__doc__)
    parser.add_argument("homes", type=Path, metavar="HOMES")
    parser.add_argument("--draws", type=int, default=2, help="of each room's views (default: 2)")
    return run(parser, _command, argv)


if __name__ == "__main__":
    sys.exit(main())

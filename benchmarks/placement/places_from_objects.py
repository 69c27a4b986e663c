"""How much objects should count in what a place is believed to be: chosen on other homes.

    python benchmarks/placement/places_from_objects.py ../shared/data/homes

Rooms of real homes; the views of each are simulated, since the homes have no pictures: a classifier
that gives the true kind the probability `right` on average, the rest spread over the other kinds by
a draw of its own for each room. Each home is judged with the weight that had the least log loss on
all others. "statistics" is the table with the rooms of all other homes counted, "shipped" that of
the ontology and ConceptNet alone. Of the kinds of object in a room half are seen, one in fifty of
those that are not there.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from benchmarks.placement.data import Sources, TrialData, load
from benchmarks.placement.methods import one_building
from kg.knowledge.placement.belief_model import posterior, posterior_belief
from kg.knowledge.placement.settings import FITTED

WEIGHTS: Final = (0.0, 0.1, 0.25, 0.5, 0.75, 1.0)
RIGHT: Final = (0.2, 0.4, 0.6, 0.8)  # mean probability that views give the true kind
TRUST: Final = 0.9  # of the prior, the share that is the views'; the rest is uniform
DRAWS: Final = 10  # of what is seen, for each room
SEEN, MISTAKEN = 0.5, 0.02


def judged(
    data: TrialData, home: int, right: float, counted: bool, random: np.random.Generator
) -> np.ndarray:
    """(weights, rooms, 2): whether the kind was told, and -ln p(kind), for each room drawn."""
    evidence = one_building(data.sample, home)
    known = np.flatnonzero(evidence.rooms.any(0))
    nothing = np.zeros_like(evidence.rooms)
    bare = replace(evidence, rooms=nothing, rooms_with=nothing)
    table = posterior_belief(evidence if counted else bare, FITTED).mean
    found = []
    for room in data.buildings[home].rooms:
        if len(room.places) != 1 or data.places[room.places[0]] not in known:
            continue
        truth = int(np.flatnonzero(known == data.places[room.places[0]])[0])
        held = np.array([iri in room.objects for iri in data.objects])
        for _ in range(DRAWS):
            rows = np.flatnonzero(random.random(len(held)) < np.where(held, SEEN, MISTAKEN))
            present, seen = table[np.ix_(rows, known)], np.ones(len(rows), dtype=bool)
            views = viewed(truth, len(known), right, random)
            prior = TRUST * views + (1 - TRUST) / len(known)
            told = [posterior(present, seen, prior, np.full(len(rows), w)) for w in WEIGHTS]
            found.append([(float(p.argmax() == truth), -float(np.log(p[truth]))) for p in told])
    return np.array(found).transpose(1, 0, 2)


def viewed(truth: int, kinds: int, right: float, random: np.random.Generator) -> np.ndarray:
    """(kinds,) probabilities from the views of a room: a Dirichlet draw around the truth."""
    mean = np.full(kinds, (1 - right) / (kinds - 1))
    mean[truth] = right
    return random.dirichlet(3 * mean + 1e-3)


def main(folder: Path) -> None:
    """Print accuracy and log loss without objects and with them, at the weight others chose."""
    statistics = folder / "hm3d_room_object_counts.csv"
    data = load(Sources(folder, statistics))
    print("| table | views right | accuracy without | with | gain (95 %) ", end="")  # noqa: T201
    print("| log loss without | with | weights |")  # noqa: T201
    print("|---|---|---|---|---|---|---|---|")  # noqa: T201
    for counted in (True, False):
        for right in RIGHT:
            random = np.random.default_rng(0)
            homes = [judged(data, home, right, counted, random) for home in range(data.homes)]
            print(f"| {'statistics' if counted else 'shipped'} | {right:g} {row(homes)}")  # noqa: T201


def row(homes: list[np.ndarray]) -> str:
    """Without objects and with them, each home at the weight that all others chose."""
    losses = np.array([scores[:, :, 1].sum(1) for scores in homes])
    chosen = [int((losses.sum(0) - losses[n]).argmin()) for n in range(len(homes))]
    without = np.array([scores[0].sum(0) for scores in homes])
    given = np.array([scores[w].sum(0) for w, scores in zip(chosen, homes, strict=True)])
    rooms = np.array([scores.shape[1] for scores in homes])
    draws = np.random.default_rng(1).integers(0, len(homes), (2000, len(homes)))
    gains = (given - without)[draws, 0].sum(1) / rooms[draws].sum(1)
    low, high = np.percentile(gains, [2.5, 97.5])
    before, after = without.sum(0) / rooms.sum(), given.sum(0) / rooms.sum()
    used = ", ".join(f"{WEIGHTS[w]:g}" for w in sorted(set(chosen)))
    return (
        f"| {before[0]:.3f} | {after[0]:.3f} | {low:+.3f} to {high:+.3f} "
        f"| {before[1]:.3f} | {after[1]:.3f} | {used} |"
    )


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    main(Path(sys.argv[1]))

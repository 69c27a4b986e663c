"""The gate: what the default mapper must reach."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import groupby
from typing import Final

from benchmarks.rooms.houses import GOALS, HOUSES
from benchmarks.rooms.outcomes import MAPPERS, Outcome, Score, mean, score
from benchmarks.rooms.stretches import SINGLE

ECE_ROOMS: Final = 0.10
ECE_HOUSES: Final = 0.05
DEFAULT, REFERENCE = MAPPERS

Rows = dict[tuple[str, str, str], dict[str, list[Outcome]]]  # room, network, stretch -> by mapper


def in_rows(outcomes: Sequence[Outcome]) -> Rows:
    """Outcomes by room, network and stretch, and each by mapper, in the order they come."""
    rows: Rows = {}
    for one in outcomes:
        rows.setdefault(one.row, {}).setdefault(one.mapper, []).append(one)
    return rows


def means(outcomes: Sequence[Outcome]) -> dict[tuple[str, str], dict[str, Score]]:
    """(room, network) -> mapper -> mean over the stretches, single frames apart."""
    rows = in_rows([o for o in outcomes if o.room != HOUSES and o.stretch != SINGLE])
    return {
        pair: {m: mean(score(rows[row][m]) for row in group) for m in MAPPERS}
        for pair, keys in groupby(rows, key=lambda row: row[:2])
        for group in [list(keys)]
    }


def calibrated(outcomes: Sequence[Outcome], mapper: str) -> dict[str, Score]:
    """Scores of what is calibrated together: real rooms, single looks at them, houses."""
    ours = [o for o in outcomes if o.mapper == mapper]
    rooms = [o for o in ours if o.room != HOUSES]
    together = {
        "real rooms": [o for o in rooms if o.stretch != SINGLE],
        "single looks": [o for o in rooms if o.stretch == SINGLE],
        HOUSES: [o for o in ours if o.room == HOUSES],
    }
    return {name: score(some) for name, some in together.items() if some}


def violations(outcomes: Sequence[Outcome]) -> Iterator[str]:
    """One line for each demand that the default mapper does not meet."""
    for (room, network), by_mapper in means(outcomes).items():
        ours, theirs = by_mapper[DEFAULT].ap, by_mapper[REFERENCE].ap
        if ours is not None and theirs is not None and ours < theirs - 1e-9:
            yield f"{room}, {network}: average precision {ours:.3f}, the reference's {theirs:.3f}"
    for (room, senses, _), by_mapper_of_row in in_rows(outcomes).items():
        if room == HOUSES:
            yield from _missed_goals(senses, score(by_mapper_of_row[DEFAULT]))
    limits = {"real rooms": ECE_ROOMS, HOUSES: ECE_HOUSES}
    for name, found in calibrated(outcomes, DEFAULT).items():
        if name in limits and found.ece is not None and found.ece > limits[name]:
            yield f"{name}: ECE {found.ece:.3f}, at most {limits[name]:.2f}"


def _missed_goals(senses: str, found: Score) -> Iterator[str]:
    values = ("recall", found.recall), ("precision", found.precision)
    for (name, value), goal in zip(values, GOALS[senses], strict=True):
        if value is None or value < goal:
            yield f"{HOUSES}, {senses} senses: {name} {value}, at least {goal:.2f}"

"""The gate: what the default mapper must reach; and the report, beside the reference."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import groupby
from typing import Final

from benchmarks.rooms.houses import GOALS, HOUSES
from benchmarks.rooms.outcomes import (
    DEFAULT,
    MAPPERS,
    REFERENCE,
    Outcome,
    Row,
    Scores,
    mean,
    scores,
)
from benchmarks.rooms.stretches import SINGLE

REAL: Final = "real rooms"
MAX_ECE: Final = {REAL: 0.10, HOUSES: 0.05}

ByMapper = dict[str, Scores]


def _f1(found: Scores) -> float | None:
    """Harmonic mean of recall and precision within 0.3 m; 0 where nothing is in the map."""
    recall, precision = found["recall, 0.3 m"], found["precision, 0.3 m"] or 0.0
    if recall is None:
        return None
    return 2 * recall * precision / max(recall + precision, 1e-9)


#: what the default mapper must be as good in as the reference, in each room with each network
_JUDGED: Final[dict[str, Callable[[Scores], float | None]]] = {
    "AP": lambda found: found["AP"],
    "F1 within 0.3 m": _f1,
}


def violations(outcomes: Sequence[Outcome]) -> Iterator[str]:
    """One line for each demand that the default mapper does not meet."""
    for (room, network), by_mapper in _means(outcomes):
        for name, judged in _JUDGED.items():
            ours, theirs = (judged(by_mapper[mapper]) for mapper in (DEFAULT, REFERENCE))
            if ours is not None and theirs is not None and ours < theirs - 1e-9:
                yield f"{room}, {network}: {name} {ours:.3f}, the reference's is {theirs:.3f}"
    for (room, senses, _), by_mapper in _rows(outcomes):
        if room == HOUSES:
            for name, goal in zip(("recall", "precision"), GOALS[senses], strict=True):
                value = by_mapper[DEFAULT][name] or 0.0
                if value < goal:
                    yield f"{HOUSES}, {senses} senses: {name} {value:.3f}, at least {goal:.2f}"
    for name, found in _together(outcomes, DEFAULT):
        if (found["ECE"] or 0.0) > MAX_ECE.get(name, 1.0):
            yield f"{name}: ECE {found['ECE']:.3f}, at most {MAX_ECE[name]:.2f}"


def report(outcomes: Sequence[Outcome]) -> Iterator[str]:
    """Markdown: each stretch, the mean of each room and network, and calibration."""
    columns = ("room", "network", "stretch", "frames", "true", *scores(outcomes[:1]))
    yield f"| {' | '.join(columns)} |"
    yield "|" + "---|" * len(columns)
    for row, by_mapper in _rows(outcomes):
        ours = [o for o in outcomes if o.row == row and o.mapper == DEFAULT]
        counts = sum(o.frames for o in ours), sum(o.evaluation.matcher.counted for o in ours)
        yield _line((*row, *counts), by_mapper)
    for pair, by_mapper in _means(outcomes):
        yield _line((*pair, "mean", "", ""), by_mapper)
    yield ""
    for mapper in MAPPERS:
        for name, found in _together(outcomes, mapper):
            values = ", ".join(f"{key} {_cell(key, found[key])}" for key in ("ECE", "95 % ellipse"))
            yield f"- {mapper}, {name}: {values}"


def _rows(outcomes: Sequence[Outcome]) -> Iterator[tuple[Row, ByMapper]]:
    """Scores of each room, network and stretch, by mapper."""
    for row in dict.fromkeys(o.row for o in outcomes):
        ours = [o for o in outcomes if o.row == row]
        yield row, {m: scores([o for o in ours if o.mapper == m]) for m in MAPPERS}


def _means(outcomes: Sequence[Outcome]) -> Iterator[tuple[tuple[str, str], ByMapper]]:
    """Means of each real room and network over its stretches, single frames apart."""
    rows = [row for row in _rows(outcomes) if row[0][0] != HOUSES and row[0][2] != SINGLE]
    for pair, group in groupby(rows, key=lambda row: row[0][:2]):
        several = [by_mapper for _, by_mapper in group]
        yield pair, {m: mean(by_mapper[m] for by_mapper in several) for m in MAPPERS}


def _together(outcomes: Sequence[Outcome], mapper: str) -> Iterator[tuple[str, Scores]]:
    """Scores of all stretches of real rooms together, of single looks at them, of houses."""
    parts: dict[str, list[Outcome]] = {}
    for one in outcomes:
        room, _, stretch = one.row
        name = HOUSES if room == HOUSES else "single looks" if stretch == SINGLE else REAL
        if one.mapper == mapper:
            parts.setdefault(name, []).append(one)
    yield from ((name, scores(part)) for name, part in parts.items())


def _line(head: Sequence[object], by_mapper: ByMapper) -> str:
    cells = [
        " / ".join(_cell(name, by_mapper[mapper][name]) for mapper in MAPPERS)
        for name in by_mapper[DEFAULT]
    ]
    return f"| {' | '.join(map(str, (*head, *cells)))} |"


def _cell(name: str, value: float | None) -> str:
    digits = {"AP": 3, "AP, 0.3 m": 3, "ECE": 3, "ms a frame": 1, "doubles": 1, "unnamed": 1}
    return "-" if value is None else f"{value:.{digits.get(name, 2)}f}"

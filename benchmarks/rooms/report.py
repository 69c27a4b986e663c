"""The report: a Markdown table of default / reference, then calibration."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import astuple
from typing import Final

from benchmarks.rooms.gate import DEFAULT, calibrated, in_rows, means
from benchmarks.rooms.outcomes import MAPPERS, Outcome, Score, score

_COLUMNS: Final = (
    *("room", "network", "stretch", "frames", "true"),
    *("recall", "precision", "AP", "best F1", "error [m]", "ECE", "95 % ellipse", "ms a frame"),
)
_DIGITS: Final = (2, 2, 3, 2, 2, 2, 2, 1)  # of the scores


def report(outcomes: Sequence[Outcome]) -> Iterator[str]:
    """Lines: each stretch, the mean of each room and network, and calibration."""
    yield f"| {' | '.join(_COLUMNS)} |"
    yield "|" + "---|" * len(_COLUMNS)
    for row, by_mapper in in_rows(outcomes).items():
        ours = by_mapper[DEFAULT]
        counts = sum(o.frames for o in ours), sum(o.matcher.counted for o in ours)
        yield _line((*row, *counts), {m: score(some) for m, some in by_mapper.items()})
    for pair, scores in means(outcomes).items():
        yield _line((*pair, "mean", "", ""), scores)
    yield ""
    for mapper in MAPPERS:
        for name, found in calibrated(outcomes, mapper).items():
            yield f"- {mapper}, {name}: ECE {_cell(found.ece, 3)}, 95 % ellipses that hold the " + (
                f"true position {_cell(found.ellipse, 2) or 'none'}"
            )


def _line(head: Sequence[object], scores: Mapping[str, Score]) -> str:
    columns = zip(_DIGITS, *(astuple(scores[mapper]) for mapper in MAPPERS), strict=True)
    cells = [f"{_cell(ours, digits)} / {_cell(theirs, digits)}" for digits, ours, theirs in columns]
    return f"| {' | '.join(map(str, head))} | {' | '.join(cells)} |"


def _cell(value: float | None, digits: int) -> str:
    return "" if value is None else f"{value:.{digits}f}"

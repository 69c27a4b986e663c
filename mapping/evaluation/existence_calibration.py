"""Calibration of existence: how often objects of each predicted probability are true.

An object is true if it is matched at existence 0; duplicates, wrong labels and ghosts are false;
ignored ones are left out.
"""

from __future__ import annotations

from collections.abc import Iterable

from mapping.evaluation.truth_matching import Matching
from perception.evaluation.calibration import Calibration, reliability


def calibration(matchings: Iterable[Matching]) -> Calibration:
    """Calibration over all objects of one or several maps, matched at existence 0."""
    return reliability(pair for matching in matchings for pair in _outcomes(matching))


def _outcomes(matching: Matching) -> list[tuple[float, bool]]:
    """(existence, whether true) of each object that is not ignored."""
    mapped = matching.mapped
    false = (*matching.duplicates, *matching.wrong, *matching.ghosts)
    return [(mapped[pair.mapped].existence, True) for pair in matching.matched] + [
        (mapped[pair.mapped].existence, False) for pair in false
    ]

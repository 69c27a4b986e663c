"""Coverage of position ellipses: how often the true position lies in the 95 % confidence region."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mapping.evaluation.truth_matching import Matching, TruthMatcher

CHI2_95: Final = {2: 5.991, 3: 7.815}  # 95 % quantiles by degrees of freedom
_ROUNDING: Final = 0.003  # [m] standard deviation of positions stored to the centimetre


@dataclass(frozen=True, slots=True)
class Coverage:
    """Share of matched objects whose 95 % region holds the true position; None of nothing."""

    objects: int  # matched, with a covariance
    ellipse: float | None  # over the floor: x and y
    ellipsoid: float | None  # x, y and z


def coverage(maps: Iterable[tuple[Matching, TruthMatcher]]) -> Coverage:
    """Coverage over the matched objects of one or several maps."""
    errors = [
        (o.p_map - matcher.p_map[pair.true], o.covariance)
        for matching, matcher in maps
        for pair in matching.matched
        if (o := matching.mapped[pair.mapped]).covariance is not None
    ]
    return Coverage(
        objects=len(errors),
        ellipse=_share([_inside(e, c, 2) for e, c in errors if c is not None]),
        ellipsoid=_share([_inside(e, c, 3) for e, c in errors if c is not None]),
    )


def _inside(error: NDArray[np.float64], covariance: NDArray[np.float64], axes: int) -> bool:
    """Whether `error` (3,) [m] lies in the 95 % region of the first `axes` axes."""
    spread = covariance[:axes, :axes] + _ROUNDING**2 * np.eye(axes)
    squared = error[:axes] @ np.linalg.solve(spread, error[:axes])
    return bool(squared <= CHI2_95[axes])


def _share(inside: list[bool]) -> float | None:
    return sum(inside) / len(inside) if inside else None

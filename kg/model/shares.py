"""Shares and probabilities as people read them."""

from __future__ import annotations

from typing import Final

_SURE: Final = 0.999  # the greatest chance in sentences: perception may always be wrong


def chance(probability: float) -> str:
    """A chance in per cent that is never certain.

    >>> [chance(p) for p in (0.98, 1)]
    ['98 %', 'over 99 %']
    """
    return percent(min(probability, _SURE))


def percent(share: float) -> str:
    """A share or probability from 0 to 1 in per cent, with the first digit that is not 0.

    Only what is certain has 0 or 100 %.

    >>> [percent(p) for p in (0, 0.0002, 0.004, 0.05, 0.126, 0.98, 0.998, 1)]
    ['0 %', 'under 0.1 %', '0.4 %', '5 %', '13 %', '98 %', 'over 99 %', '100 %']
    """
    if 0 < share < 0.0005:
        return "under 0.1 %"
    if 0.995 <= share < 1:
        return "over 99 %"
    return f"{100 * share:.{int(share < 0.095)}f}".removesuffix(".0") + " %"

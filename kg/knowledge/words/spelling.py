"""Typing errors: the known word that a misspelt one most probably means."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable
from typing import Final

_MIN_LENGTH: Final = 5  # letters of a word that is corrected; shorter ones are too alike
_LONG: Final = 9  # letters from which two errors are accepted
_DOUBLED: Final = 0.5  # cost of a letter written twice, or once instead of twice
_SUGGESTED: Final = 2.0  # largest distance of a suggestion


def corrected(key: str, known: Iterable[str], sense: Callable[[str], Hashable]) -> str | None:
    """The nearest of the known words, or None where none is near or senses compete.

    One error is accepted in words of 5 letters, two from 9 letters on. Two words at the same
    distance that differ in `sense` leave the word undecided: a spelling alone does not tell which
    of them a person means.
    """
    if len(key) < _MIN_LENGTH:
        return None
    limit = 2.0 if len(key) >= _LONG else 1.0
    near = _near(key, known, limit)
    if not near or len({sense(word) for distance, word in near if distance == near[0][0]}) > 1:
        return None
    return near[0][1]


def suggestions(key: str, known: Iterable[str]) -> list[str]:
    """Up to three known words of a similar spelling, the nearest first."""
    limit = min(_SUGGESTED, len(key) / 3)
    return [word for _, word in _near(key, known, limit)[:3]]


def _near(key: str, known: Iterable[str], limit: float) -> list[tuple[float, str]]:
    letters = set(key)
    found = []
    for word in known:
        if abs(len(word) - len(key)) > limit or len(letters.difference(word)) > limit:
            continue
        distance = _distance(key, word, limit)
        if distance <= limit:
            found.append((distance, word))
    return sorted(found)


def _distance(one: str, other: str, limit: float) -> float:
    """Edit distance with transpositions; a doubled letter costs half; above `limit` inexact."""
    before: list[float] = []
    last = [0.0]
    for j, letter in enumerate(other):
        last.append(last[j] + (_DOUBLED if j and other[j - 1] == letter else 1.0))
    for i, letter in enumerate(one):
        removal = _DOUBLED if i and one[i - 1] == letter else 1.0
        row = [last[0] + removal]
        for j, wanted in enumerate(other):
            insertion = _DOUBLED if j and other[j - 1] == wanted else 1.0
            cost = min(last[j] + (letter != wanted), last[j + 1] + removal, row[j] + insertion)
            if i and j and letter == other[j - 1] and one[i - 1] == wanted:
                cost = min(cost, before[j - 1] + _DOUBLED)
            row.append(cost)
        if min(row) > limit:
            return min(row)
        before, last = last, row
    return last[-1]

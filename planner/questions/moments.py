"""Moments of plain questions: the state of a past day, and what changed since a moment."""

from __future__ import annotations

import re
from typing import Final

from kg.history.timestamps import instant, iso, moment

_PART: Final = re.compile(r"(.*day) (morning|afternoon|evening|night)")
#: hours when a part of a day begins and ends
_HOURS: Final = {"morning": (5, 12), "afternoon": (12, 18), "evening": (18, 24), "night": (21, 24)}
_FIRST: Final = ("since ", "in the ", "during the ", "over the ", "within the ", "after ")


def past(words: str, now: float) -> float:
    """The moment [s since 1970] that a state of the past is asked for: of a day, its last.

    Of ``yesterday evening`` as well. Raises HistoryError as `instant`.
    """
    if part := _PART.fullmatch(words.casefold()):
        return min(now, moment(instant(part[1], now)) + 3600.0 * _HOURS[part[2]][1])
    begun, text = moment(instant(words, now)), words.casefold()
    lasts = 43200.0 if text.endswith("morning") else 86400.0
    return min(now, begun + lasts) if re.search(r"(?:day|night|morning)$", text) else begun


def since(words: str, now: float) -> str:
    """As `instant`, after a preposition, too; the day before `now` for no words or ``lately``.

    Of ``yesterday evening``, its beginning.
    """
    text = words.casefold()
    for first in _FIRST:
        text = text.removeprefix(first)
    if part := _PART.fullmatch(text):
        return iso(moment(instant(part[1], now)) + 3600.0 * _HOURS[part[2]][0])
    return iso(now - 86400.0) if text in ("", "lately", "recently") else instant(text, now)

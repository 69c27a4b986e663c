"""Moments in words, as questions, commands and agents give them: ``yesterday``, ``2h``, ``#42``."""

from __future__ import annotations

import re
from collections.abc import Callable
from datetime import datetime, timedelta
from typing import Final, TypeVar

from kg.history.timestamps import duration, iso, moment
from kg.maps.semantic_map import SemanticMap
from kg.model.errors import HistoryError
from kg.model.iris import whole_number

Found = TypeVar("Found")

_HOURS: Final = {"minute": 1 / 60, "hour": 1.0, "day": 24.0, "week": 168.0, "month": 730.0}
_NUMBERS: Final = {"a": 1, "an": 1, "one": 1, "two": 2, "three": 3, "few": 3, "couple": 2, "": 1}
_SPAN: Final = re.compile(
    r"(?:last |past )?(?:(\d+|a|an|one|two|three|few|couple)(?: of)? )?"
    r"(minute|hour|day|week|month)s?(?: ago)?"
)
_FIRST: Final = ("since ", "in the ", "during the ", "over the ", "within the ", "after ")
_DAYS: Final = {"today": 0, "this morning": 0, "yesterday": 1, "last night": 1}
_WEEKDAYS: Final = ("monday", "tuesday", "wednesday", "thursday", "friday", "saturday", "sunday")
_MAX_COUNT: Final = 10_000


def instant(words: str, now: float) -> str:
    """The moment (ISO 8601 or ``#42``) that words name at `now` [s since 1970].

    Days begin at midnight of this machine's time zone; a time without a zone is in UTC. Raises
    HistoryError for other words.
    """
    text = " ".join(words.split())
    if re.fullmatch(r"#\d+", text):
        return text
    plain = text.casefold().removeprefix("the ")
    if plain == "now":
        return iso(now)
    today = datetime.fromtimestamp(now).astimezone()
    today = today.replace(hour=0, minute=0, second=0, microsecond=0)
    days = dict(_DAYS)
    for number, day in enumerate(_WEEKDAYS):
        days[day] = days[f"last {day}"] = (today.weekday() - number - 1) % 7 + 1
    if plain in days:
        return iso((today - timedelta(days=days[plain])).timestamp())
    if match := _SPAN.fullmatch(plain):
        count = _NUMBERS.get(match[1] or "") or (whole_number(match[1]) or _MAX_COUNT)
        return iso(now - 3600.0 * _HOURS[match[2]] * min(count, _MAX_COUNT))
    try:
        if re.fullmatch(r"\d+(\.\d+)?[smhdwy]( ago)?", plain):
            return iso(now - duration(plain.removesuffix(" ago")))
        return iso(moment(text.upper()))
    except (HistoryError, ValueError, OverflowError, OSError):
        raise HistoryError(
            f"no moment {text[:60]!r}; now, yesterday, today, an hour ago, the last 3 days, 2h, "
            "2026-08-01T12:30:00Z and #42 (a transaction) work"
        ) from None


def past(words: str, now: float) -> float:
    """The moment [s since 1970] that a state of the past is asked for: of a day, its last.

    Raises HistoryError as `instant`.
    """
    begun, text = moment(instant(words, now)), words.casefold()
    lasts = 43200.0 if text.endswith("morning") else 86400.0
    return min(now, begun + lasts) if re.search(r"(?:day|night|morning)$", text) else begun


def since(words: str, now: float) -> str:
    """As `instant`, after a preposition, too; the day before `now` for no words or ``lately``."""
    text = words.casefold()
    for first in _FIRST:
        text = text.removeprefix(first)
    return iso(now - 86400.0) if text in ("", "lately", "recently") else instant(text, now)


def read_since(semantic_map: SemanticMap, moment: str, read: Callable[[str], Found]) -> Found:
    """The result of `read` for a moment, or for the first that is kept where that is later.

    Raises HistoryError for the number of a transaction that is not kept.
    """
    try:
        return read(moment)
    except HistoryError:
        if moment.startswith("#"):
            raise
        return read(_first_kept(semantic_map))


def _first_kept(semantic_map: SemanticMap) -> str:
    """The first moment that a map's history keeps; #0 where that is on a server."""
    try:
        return f"#{semantic_map.history.log.floor}"
    except HistoryError:
        return "#0"

"""Moments in plain questions: ``yesterday``, ``in the last two hours``, ``since 2026-03-02``."""

from __future__ import annotations

import re
from datetime import UTC, datetime, timedelta
from typing import Final

from kg.history.timestamps import iso, moment
from kg.maps.semantic_map import SemanticMap
from kg.model.errors import HistoryError, UnknownQueryError

_HOURS: Final = {"minute": 1 / 60, "hour": 1.0, "day": 24.0, "week": 168.0, "month": 730.0}
_NUMBERS: Final = {"a": 1, "an": 1, "one": 1, "two": 2, "three": 3, "few": 3, "couple": 2, "": 1}
_SPAN: Final = re.compile(
    r"(?:last |past )?(?:(\d+|a|an|one|two|three|few|couple)(?: of)? )?"
    r"(minute|hour|day|week|month)s?(?: ago)?"
)
_FIRST: Final = ("since ", "in the ", "during the ", "over the ", "within the ", "after ")


def since(words: str, now: float) -> str:
    """The moment (ISO 8601 or ``#42``) that words name; the day before `now` for no words.

    Days begin at midnight of this machine's time zone. Raises UnknownQueryError for other words.
    """
    text = words
    for first in _FIRST:
        text = text.removeprefix(first)
    today = datetime.fromtimestamp(now).astimezone().replace(hour=0, minute=0, second=0)
    days = {"today": 0, "this morning": 0, "yesterday": 1, "last night": 1}
    if text in days:
        return iso((today - timedelta(days=days[text])).timestamp())
    if text in ("", "lately", "recently"):
        return iso(now - 86400.0)
    if match := _SPAN.fullmatch(text.removeprefix("the ")):
        count = _NUMBERS.get(match[1] or "") or int(match[1])
        return iso(now - 3600.0 * _HOURS[match[2]] * min(count, 10_000))
    if re.fullmatch(r"#\d+", text):
        return text
    try:
        return iso(moment(datetime.fromisoformat(text.upper()).replace(tzinfo=UTC)))
    except ValueError as error:
        raise UnknownQueryError(
            f"no moment {text!r}; yesterday, today, an hour ago, the last 3 days, "
            "2026-08-01T12:30 and #42 (a transaction) work"
        ) from error


def first_kept(semantic_map: SemanticMap) -> str:
    """The first moment that a map's history keeps; #0 where that is on a server."""
    try:
        return f"#{semantic_map.history.log.floor}"
    except HistoryError:
        return "#0"

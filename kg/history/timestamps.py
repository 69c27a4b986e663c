"""Parsing of moments and durations in people's notation."""

from __future__ import annotations

import math
import re
from datetime import UTC, datetime
from typing import Final

from kg.history.storage.log import HistoryLog
from kg.model.errors import HistoryError
from kg.model.iris import whole_number

#: ``#42`` or 42 (the 42nd transaction), ISO 8601 text (UTC by default), or a datetime
Instant = int | str | datetime

_SECONDS: Final = {"s": 1.0, "m": 60.0, "h": 3600.0, "d": 86400.0, "w": 604800.0, "y": 31557600.0}


def sequence_of(log: HistoryLog, when: Instant) -> int:
    """The last transaction at or before `when`.

    Raises:
        HistoryError: `when` is no moment, precedes the log, or is the number of no transaction.
    """
    if isinstance(when, str) and when.startswith("#"):
        number = whole_number(when[1:])
        when = when if number is None else number
    if isinstance(when, int):
        if not log.floor <= when <= log.last:
            raise HistoryError(
                f"no transaction #{when} is kept; there are #{log.floor} to #{log.last}"
            )
        return when
    time = moment(when, "#42 (a transaction) or ")
    if time < log.floor_time:
        began = iso(math.ceil(log.floor_time)).replace(".000", "")
        given = iso(math.floor(time)).replace(".000", "")
        raise HistoryError(f"the past before {began} is not kept, and {given} is earlier")
    return log.sequence_at(time)


def duration(text: str) -> float:
    """Seconds of ``30d``, ``12h``, ``90m``, ``45s``, ``2w`` or ``1y``; HistoryError otherwise."""
    match = re.fullmatch(r"(\d+(?:\.\d+)?)([smhdwy])", text.strip().lower())
    if match is None:
        raise HistoryError(f"no duration {text!r}; write 30d, 12h, 90m, 45s, 2w or 1y")
    return float(match[1]) * _SECONDS[match[2]]


def iso(time: float) -> str:
    """A time [s since 1970] as ISO 8601 in UTC, to the millisecond."""
    text = datetime.fromtimestamp(time, UTC).isoformat(timespec="milliseconds")
    return text.removesuffix("+00:00") + "Z"


def moment(when: str | datetime, others: str = "") -> float:
    """Seconds since 1970 of ISO 8601 text (UTC by default) or a datetime.

    Raises HistoryError for other texts; the message has `others`, which the caller takes, too.
    """
    try:
        given = datetime.fromisoformat(when) if isinstance(when, str) else when
        time = (given if given.tzinfo else given.replace(tzinfo=UTC)).timestamp()
        iso(time)  # raises for a year beyond 9999
    except (ValueError, OverflowError):
        raise HistoryError(
            f"no moment {str(when)[:60]!r}; write {others}2026-08-01T12:30:00Z"
        ) from None
    return time

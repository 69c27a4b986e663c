"""Moments and durations in people's notation, and compact names of IRIs (CURIEs)."""

from __future__ import annotations

import math
import re
import shlex
import time
from datetime import UTC, datetime, timedelta
from typing import Final

from pyoxigraph import BlankNode, Literal, NamedNode

from kg.history.storage.log import HistoryLog
from kg.model import vocabulary as v
from kg.model.errors import HistoryError, QueryParameterError
from kg.model.iris import whole_number
from kg.rdf.quad_store import Term

#: ``#42`` or 42 (the 42nd transaction), text as of `instant`, or a datetime
Instant = int | str | datetime

#: [s] of a unit of time, as people write it
_SECONDS: Final = {
    **dict.fromkeys(("s", "sec", "second", "seconds"), 1.0),
    **dict.fromkeys(("m", "min", "mins", "minute", "minutes"), 60.0),
    **dict.fromkeys(("h", "hr", "hrs", "hour", "hours"), 3600.0),
    **dict.fromkeys(("d", "day", "days"), 86400.0),
    **dict.fromkeys(("w", "week", "weeks"), 604800.0),
    **dict.fromkeys(("y", "year", "years"), 31557600.0),
}
_MONTH: Final = 730 * 3600.0  # [s] on average
_NUMBERS: Final = {"a": 1, "an": 1, "one": 1, "two": 2, "three": 3, "few": 3, "couple": 2, "": 1}
_SPAN: Final = re.compile(
    r"(?:last |past )?(?:(\d+|a|an|one|two|three|few|couple)(?: of)? )?"
    r"(minute|hour|day|week|month)s?(?: ago)?"
)
_DAYS: Final = {"today": 0, "this morning": 0, "yesterday": 1, "last night": 1}
_CLOCK: Final = re.compile(r"(?:(.+?)(?: at)? )?(\d{1,2})(?::(\d\d))?(?: ?([ap])m)?")
_WEEKDAYS: Final = ("monday", "tuesday", "wednesday", "thursday", "friday", "saturday", "sunday")
_MAX_COUNT: Final = 10_000


def sequence_of(log: HistoryLog, when: Instant, *, since: bool = False) -> int:
    """The last transaction at or before `when`; `since` a time before the log, the first one kept.

    Raises:
        HistoryError: `when` is no moment, precedes the log, or is the number of no transaction.
    """
    if isinstance(when, str):
        when = instant(when, time.time())
        number = whole_number(when.removeprefix("#"))
        when = when if number is None else number
    if isinstance(when, int):
        if not log.floor <= when <= log.last:
            raise HistoryError(
                f"no transaction #{when} is kept; there are #{log.floor} to #{log.last}"
            )
        return when
    at = moment(when)
    if at < log.floor_time:
        if since:
            return log.floor
        began = math.ceil(log.floor_time)
        kept = f"{spoken(began)} ({iso(began).replace('.000', '')})"
        raise HistoryError(f"the map knows nothing of that time: its past is kept since {kept}")
    return log.sequence_at(at)


def duration(text: str) -> float:
    """Seconds of ``30d``, ``12 h``, ``90 min``, ``45s`` or ``2 weeks``; HistoryError otherwise."""
    match = re.fullmatch(r"(\d+(?:\.\d+)?) ?([a-z]+)", text.strip().lower())
    if match is None or match[2] not in _SECONDS:
        raise HistoryError(f"no duration {text!r}; write 30d, 12h, 90min, 45s, 2w or 1y")
    return float(match[1]) * _SECONDS[match[2]]


def span(seconds: float) -> str:
    """A length of time in its largest fitting unit: ``12 h``."""
    for unit, length in (("years", 31557600.0), ("days", 86400.0), ("h", 3600.0), ("min", 60.0)):
        if seconds >= 2 * length:
            return f"{seconds / length:.0f} {unit}"
    return f"{seconds:.0f} s"


def iso(seconds: float) -> str:
    """A time [s since 1970] as ISO 8601 in UTC, to the millisecond."""
    text = datetime.fromtimestamp(seconds, UTC).isoformat(timespec="milliseconds")
    return text.removesuffix("+00:00") + "Z"


def spoken(seconds: float) -> str:
    """A time [s since 1970] as people say it: ``today at 21:02``, ``on 2026-08-01 at 9:30``.

    As of `instant`, it is that of this machine's time zone.
    """
    at = datetime.fromtimestamp(seconds).astimezone()
    days = (datetime.now().astimezone().date() - at.date()).days
    day = {0: "today", 1: "yesterday"}.get(days, f"on {at:%Y-%m-%d}")
    return f"{day} at {at:%H:%M}"


def instant(words: str, now: float) -> str:
    """The moment (ISO 8601 or ``#42``) that words name at `now` [s since 1970].

    A number of up to seven digits is that of a transaction: ``42``. Days, and times of day such as
    ``monday at 9:30``, are those of this machine's time zone; a date and time without a zone is in
    UTC. Raises HistoryError for other words.
    """
    text = " ".join(words.split())
    if re.fullmatch(r"#\d+|[0-9]{1,7}", text):  # more digits are a date: 20260801
        return f"#{text.removeprefix('#')}"
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
        return iso(now - _SECONDS.get(match[2], _MONTH) * min(count, _MAX_COUNT))
    try:
        clock = _CLOCK.fullmatch(plain)
        if clock and (clock[3] or clock[4]) and (clock[1] or "today") in days:
            hour = int(clock[2]) % 12 + 12 * (clock[4] == "p") if clock[4] else int(clock[2])
            at = today.replace(hour=hour, minute=int(clock[3] or 0))
            back = days[clock[1]] if clock[1] else at.timestamp() > now  # the last 9:30 that was
            return iso((at - timedelta(days=back)).timestamp())
        if re.fullmatch(r"\d+(\.\d+)? ?[a-z]+( ago)?", plain):
            return iso(now - duration(plain.removesuffix(" ago")))
        return iso(moment(text.upper()))
    except (HistoryError, ValueError, OverflowError, OSError):
        raise HistoryError(
            f"no moment {text[:60]!r}; now, today, yesterday at 9:30, an hour ago, "
            "the last 3 days, 2h, 2026-08-01T12:30:00Z and #42 (a transaction) work"
        ) from None


def moment(when: str | datetime) -> float:
    """Seconds since 1970 of ISO 8601 text (UTC by default) or a datetime.

    Raises HistoryError for other texts.
    """
    try:
        given = datetime.fromisoformat(when) if isinstance(when, str) else when
        seconds = (given if given.tzinfo else given.replace(tzinfo=UTC)).timestamp()
        iso(seconds)  # raises for a year beyond 9999
    except (ValueError, OverflowError):
        raise HistoryError(f"no moment {str(when)[:60]!r}; write 2026-08-01T12:30:00Z") from None
    return seconds


_BELIEF = re.compile(r"/belief/([^/]+)$")


def thing(text: str, base: str) -> NamedNode:
    """The IRI of ``object/17``, ``here:Banana``, ``a``, or an absolute IRI.

    Raises QueryParameterError for other texts.
    """
    text = text.strip()
    if text == "a":
        return v.RDF_TYPE
    if text.startswith("<") and text.endswith(">"):
        text = text[1:-1]
    prefix, colon, rest = text.partition(":")
    if colon and prefix in v.PREFIXES:
        text = v.PREFIXES[prefix] + rest
    elif not colon and re.fullmatch(
        r"(object|place|door|observation|recording|search|floor)/\S+|robot", text
    ):
        text = base + text
    try:
        return NamedNode(text)
    except ValueError:
        raise QueryParameterError(
            f"no thing {text!r}; write object/17, its label (cup 17), place/1, robot, here:Banana "
            "or an IRI"
        ) from None


def statement(text: str, base: str) -> tuple[NamedNode, NamedNode | None, Term | None]:
    """Subject, predicate and object of ``object/17 here:x 1.23``; None for omitted parts.

    A text in quotes is a string. Raises QueryParameterError for other texts.
    """
    try:
        words = shlex.split(text, posix=False)
    except ValueError:
        words = []
    if not 1 <= len(words) <= 3:
        raise QueryParameterError(
            f"no thing and no fact: {text!r}; write object/17, or 'object/17 here:inPlace place/1'"
        )
    subject = thing(words[0], base)
    predicate = thing(words[1], base) if len(words) > 1 else None
    return subject, predicate, _value(words[2], base) if len(words) > 2 else None


def _value(text: str, base: str) -> Term:
    if re.fullmatch(r"[-+]?\d+", text):
        return Literal(text, datatype=NamedNode(v.XSD + "integer"))
    if re.fullmatch(r"[-+]?\d*\.\d+([eE][-+]?\d+)?", text):
        return Literal(float(text))
    if len(text) > 1 and text[0] == text[-1] and text[0] in "\"'":
        return Literal(text[1:-1])
    if re.fullmatch(r"\d{4}-\d\d-\d\dT\S+", text):
        return Literal(text, datatype=NamedNode(v.XSD + "dateTime"))
    return thing(text, base)


def short(term: Term, base: str) -> str:
    """A term for people: ``object/17``, ``here:Chair``, ``1.23``."""
    if isinstance(term, Literal):
        return term.value
    if isinstance(term, BlankNode) or not isinstance(term, NamedNode):
        return str(term)
    text = term.value
    if text.startswith(base):
        return text[len(base) :] or "the map"
    for prefix, namespace in v.PREFIXES.items():
        if text.startswith(namespace) and "/" not in text[len(namespace) :]:
            return f"{prefix}:{text[len(namespace) :]}"
    return text.removeprefix(v.GRAPH).removeprefix(v.CELL)


def natural_order(name: str) -> tuple[str, int]:
    """Sort key of a compact name, by which object/9 comes before object/10."""
    head, _, number = name.rpartition("/")
    found = whole_number(number)
    return (name, 0) if found is None else (head, found)


def brief(value: Term, base: str) -> str:
    """A term for people in one line; for packed bytes, the number of characters."""
    if isinstance(value, Literal) and value.datatype == v.XSD_BASE64:
        return f"{len(value.value)} characters"
    return short(value, base)


def word(predicate: Term) -> str:
    """A predicate in words: ``last seen``, ``observation count``."""
    text = getattr(predicate, "value", str(predicate))
    if text == v.RDF_TYPE.value:
        return "type"
    local = re.split(r"[#/]", text)[-1]
    return re.sub(r"(?<=[a-z])(?=[A-Z])", " ", local).lower()

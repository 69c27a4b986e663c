"""Conversion between seconds since 1970-01-01 UTC and xsd:dateTime."""

from __future__ import annotations

import time
from datetime import UTC, datetime
from functools import lru_cache

from pyoxigraph import Literal, NamedNode

from kg.model import vocabulary as v

_DATE_TIME = NamedNode(v.XSD + "dateTime")


def date_time(stamp: float) -> Literal:
    """The xsd:dateTime of `stamp` [s], to the second.

    Raises:
        ValueError, OverflowError, OSError: the year is outside of 1 to 9999.
    """
    return _at_second(round(stamp))


@lru_cache(maxsize=1024)
def _at_second(second: int) -> Literal:
    moment = datetime.fromtimestamp(second, UTC)
    # strftime writes years before 1000 without their leading zeros
    return Literal(moment.strftime("%Y-%m-%dT%H:%M:%SZ").zfill(20), datatype=_DATE_TIME)


def seconds(text: str) -> float:
    """Seconds since 1970 of the lexical form of an xsd:dateTime; UTC without a time zone."""
    moment = datetime.fromisoformat(text)
    return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()


def transaction_time() -> float:
    """The current time [s] in whole milliseconds, the precision of `--at` and of the feeds."""
    return time.time_ns() // 1_000_000 / 1000


def now() -> Literal:
    """The current time."""
    return date_time(time.time())

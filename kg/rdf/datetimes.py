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

    Raises ValueError, OverflowError or OSError, as datetime does, outside of years 1 to 9999.
    """
    return _at_second(round(stamp))


@lru_cache(maxsize=1024)
def _at_second(second: int) -> Literal:
    moment = datetime.fromtimestamp(second, UTC)
    # strftime writes years before 1000 without their leading zeros
    return Literal(moment.strftime("%Y-%m-%dT%H:%M:%SZ").zfill(20), datatype=_DATE_TIME)


def seconds(text: str) -> float:
    """Seconds of the lexical form of an xsd:dateTime; without a time zone it is UTC."""
    moment = datetime.fromisoformat(text)
    return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()


def transaction_time() -> float:
    """The present time [s], in whole milliseconds: exactly what `--at` and the feeds print."""
    return time.time_ns() // 1_000_000 / 1000


def now() -> Literal:
    """The present instant."""
    return date_time(time.time())

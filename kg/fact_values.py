"""Plain values as terms of facts, quantised and checked, and what one subject says read back."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from functools import lru_cache

from pyoxigraph import Literal, NamedNode, Quad

from kg.engine import Engine
from kg.errors import InvalidFactError
from kg.times import date_time, seconds

#: predicate IRI -> objects (IRIs and lexical forms) of one subject
Properties = dict[str, list[str]]


@lru_cache(maxsize=4096)
def known_iri(iri: str) -> NamedNode:
    """An IRI that recurs: of the vocabulary, a category, a cell, a place."""
    return NamedNode(iri)


def iri_node(text: str, what: str) -> NamedNode:
    """The IRI `text`; `what` names it in the InvalidFactError raised where it is none."""
    try:
        return NamedNode(text)
    except ValueError as error:
        raise InvalidFactError(f"{what} must be an absolute IRI, got {text!r}") from error


def quantised(value: float, what: str, digits: int = 2) -> float:
    """`value` rounded to `digits`. Raises InvalidFactError where it is not finite."""
    number = float(value)
    if not math.isfinite(number):
        raise InvalidFactError(f"{what} must be a finite number, got {number}")
    return round(number, digits) + 0.0  # + 0.0: minus zero is not a second zero


def number_literal(
    value: float,
    what: str,
    *,
    digits: int = 2,
    least: float = -math.inf,
    most: float = math.inf,
) -> Literal:
    """`value` quantised. Raises InvalidFactError where it is not finite, or not within bounds."""
    number = quantised(value, what, digits)
    if not least <= number <= most:
        raise InvalidFactError(f"{what} must be within {least:g}..{most:g}, got {number:g}")
    return Literal(number)


def time_literal(stamp: float, what: str) -> Literal:
    """`stamp` [s since 1970] as xsd:dateTime. Raises InvalidFactError for what has no date."""
    try:
        return date_time(stamp)
    except (ValueError, OverflowError, OSError) as error:
        raise InvalidFactError(
            f"{what} must be seconds since 1970 within years 1 to 9999, got {stamp}"
        ) from error


def properties_of(engine: Engine, subject: str, graph: NamedNode) -> Properties:
    """What `graph` says of the thing with IRI `subject`."""
    held: Properties = {}
    for quad in engine.quads_for_pattern(NamedNode(subject), None, None, graph):
        held.setdefault(quad.predicate.value, []).append(text_of(quad.object))
    return held


def by_subject(quads: Iterable[Quad]) -> dict[str, Properties]:
    """What is said of each subject of `quads`, whatever the graph."""
    subjects: dict[str, Properties] = {}
    for subject, predicate, value, _ in quads:
        properties = subjects.setdefault(text_of(subject), {})
        properties.setdefault(predicate.value, []).append(text_of(value))
    return subjects


def text_of(term: object) -> str:
    """The IRI or the lexical form of a term."""
    return str(getattr(term, "value", term))


def first(held: Mapping[str, Sequence[str]], predicate: str, default: str) -> str:
    """The least of a property's values, so that it is the same one at every reading."""
    values = held.get(predicate)
    return min(values) if values else default


def stamp_of(held: Mapping[str, Sequence[str]], predicate: str) -> float:
    """[s since 1970] of a property that holds a time; 0 where there is none."""
    return seconds(first(held, predicate, "1970-01-01T00:00:00Z"))


def iri_order(iri: str) -> tuple[int, str]:
    """Sorts IRIs that end in numbers by these numbers."""
    return len(iri), iri

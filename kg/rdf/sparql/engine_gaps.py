"""Gaps of the SPARQL engine: its sort of mixed values, and functions that it does not have.

The engine compares two literals by value if possible, else by text. Over mixed values that is no
order (9 < 10 by value, "10" < "9a" < "9" by text), and the engine's sort panics. The rewriting
sorts by the class of a value first (blank node, IRI, number, each other datatype), so that only
comparable values are compared. SPARQL 1.1 (section 15.1) leaves the order of these classes open.
"""

from __future__ import annotations

import math
from functools import lru_cache
from itertools import pairwise
from typing import Final

from pyoxigraph import Literal, NamedNode

from kg.model import vocabulary as v
from kg.model.areas import Area
from kg.rdf.literals import area_of_polygon, point_of
from kg.rdf.quad_store import Functions
from kg.rdf.sparql.lexer import Token, tokens_of

_END: Final = ("LIMIT", "OFFSET", "VALUES")
_DIRECTIONS: Final = ("ASC", "DESC")
_XSD: Final = "http://www.w3.org/2001/XMLSchema#"
# times with and without a zone may be incomparable, and so may two xsd:duration
_WITHIN_DATATYPE: Final = (
    f"IF(!STRSTARTS(STR(DATATYPE(@)),'{_XSD}')||DATATYPE(@)=<{_XSD}string>,'',"
    f"IF(DATATYPE(@)=<{_XSD}duration>,STR(@),STR(REGEX(STR(@),'(Z|[+-][0-9][0-9]:[0-9][0-9])$'))))"
)
_CLASS: Final = (
    "(IF(isBlank(@),'0',IF(isIRI(@),'1',IF(isNumeric(@),IF(@=@,'2','3'),"
    f"IF(isLiteral(@),CONCAT('4',STR(DATATYPE(@)),' ',LANG(@),{_WITHIN_DATATYPE}),'5')))))"
)


def with_total_order(sparql: str) -> str:
    """The query with a total order over mixed values; unchanged for an unknown ORDER BY."""
    tokens = list(tokens_of(sparql))
    pieces, done = [], 0
    for at, (order, by) in enumerate(pairwise(tokens)):
        if (order.keyword, by.keyword) == ("ORDER", "BY"):
            for token, direction, expression in _keys(sparql, tokens, at + 2):
                class_key = f"{direction}{_CLASS.replace('@', expression)} "
                pieces += [sparql[done : token.start], class_key]
                done = token.start
    return "".join([*pieces, sparql[done:]])


def _keys(sparql: str, tokens: list[Token], at: int) -> list[tuple[Token, str, str]]:
    """First token, direction and expression of each key; empty if one has an unknown form."""
    keys = []
    while at < len(tokens) and tokens[at].text != "}" and tokens[at].keyword not in _END:
        first = tokens[at]
        direction = first.keyword if first.keyword in _DIRECTIONS else ""
        at += bool(direction)
        start = at
        if at < len(tokens) and tokens[at].kind in ("word", "name", "iri"):
            at += 1
        at = _after_operand(tokens, at)
        if not at:
            return []
        keys.append((first, direction, sparql[tokens[start].start : tokens[at - 1].end]))
    return keys


def _after_operand(tokens: list[Token], at: int) -> int:
    """The index after a variable or a bracketed expression; 0 for other tokens."""
    if at < len(tokens) and tokens[at].kind in ("variable", "parameter"):
        return at + 1
    if at >= len(tokens) or tokens[at].text != "(":
        return 0
    depth = 0
    for index in range(at, len(tokens)):
        text = tokens[index].text
        if text in ("{", "}"):  # EXISTS: too expensive to evaluate several times
            return 0
        depth += (text == "(") - (text == ")")
        if depth == 0:
            return index + 1
    return 0


def square_root(term: object) -> Literal | None:
    """XPath's math:sqrt; unbound for a term without a square root."""
    try:
        return Literal(math.sqrt(float(getattr(term, "value", ""))))
    except ValueError:
        return None


def within(point: object, polygon: object) -> Literal | None:
    """GeoSPARQL's geof:sfWithin for a point and a polygon in WKT; unbound for other terms."""
    spot = point_of(str(getattr(point, "value", "")))
    area = _area(str(getattr(polygon, "value", "")))
    return None if spot is None or area is None else Literal(area.contains(*spot))


@lru_cache(maxsize=1024)
def _area(text: str) -> Area | None:
    try:
        return area_of_polygon(text)
    except ValueError:
        return None


def load_libraries() -> None:
    """Import what the functions need; for processes that can load no library later."""
    square_root(Literal(2.0))
    within(Literal("POINT (1 1)"), Literal("POLYGON ((0 0, 4 0, 0 4, 0 0))"))


FUNCTIONS: Final[Functions] = {
    NamedNode(v.MATH_SQRT): square_root,
    NamedNode(v.GEOF_SF_WITHIN): within,
}

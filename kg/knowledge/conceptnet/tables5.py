"""Parser of ConceptNet 5 assertions: lines of its TSV, and edges of its web API."""

from __future__ import annotations

import json
import re
from typing import Final

from kg.knowledge.conceptnet.edges import (
    Edge,
    EdgeFilter,
    MalformedEdgeError,
    Node,
    assertion_iri,
    clean,
    columns_of,
    data_of,
    license_iri,
    number_of,
    parse_node,
    parse_relation,
    votes_of,
)

_COLUMNS: Final = 5
_MAX_WEIGHT: Final = 1e6
_NO_WEIGHT: Final = "weight is no number above 0"
_BRACKETS: Final = re.compile(r"\[\[|\]\]")


def looks_like(line: bytes) -> bool:
    """Whether a line has the form of an assertion of ConceptNet 5."""
    return line.startswith(b"/a/") and line.count(b"\t") == _COLUMNS - 1


def parse(line: bytes, language: str, wanted: EdgeFilter) -> Edge | None:
    """The assertion of a line, or None if the filter rejects it.

    Raises:
        MalformedEdgeError: the line is no valid assertion.
    """
    columns = columns_of(line, _COLUMNS)
    relation = parse_relation(columns[1].decode())
    home = b"/c/" + language.encode() + b"/"
    if relation is None or not (columns[2].startswith(home) and columns[3].startswith(home)):
        return None
    return _assertion(
        relation, columns[2].decode(), columns[3].decode(), columns[4], language, wanted
    )


def parse_edge(edge: object, language: str, wanted: EdgeFilter) -> Edge | None:
    """The assertion of an edge of the web API, or None if the filter rejects it.

    Raises:
        MalformedEdgeError: the edge is invalid.
    """
    try:
        uris = [edge[part]["@id"] for part in ("rel", "start", "end")]  # type: ignore[index]
    except (TypeError, KeyError):
        raise MalformedEdgeError("no edge") from None
    if not all(isinstance(uri, str) for uri in uris):
        raise MalformedEdgeError("no edge")
    relation = parse_relation(uris[0])
    if relation is None:
        return None
    return _assertion(relation, uris[1], uris[2], edge, language, wanted)


def _assertion(
    relation: tuple[str, bool],
    start: str,
    end: str,
    data: object,
    language: str,
    wanted: EdgeFilter,
) -> Edge | None:
    (start_language, start_node), (end_language, end_node) = _node(start), _node(end)
    if start_language != language or end_language != language:
        return None
    name, negated = relation
    if not wanted(name, start_node.term, end_node.term):
        return None
    if isinstance(data, bytes):
        data = json.loads(data, parse_constant=_reject_constant)
    properties = data_of(data)
    surface = properties.get("surfaceText")
    wording = surface if isinstance(surface, str) else f"{start_node.term} {name} {end_node.term}"
    return Edge(
        name,
        start_node,
        end_node,
        votes_of(_weight(properties.get("weight"))),
        negated,
        assertion_iri(f"Not{name}" if negated else name, start, end),
        license_iri(str(properties.get("license", ""))),
        clean(_BRACKETS.sub("", wording)),
        adds=False,
    )


def _node(uri: str) -> tuple[str, Node]:
    node = parse_node(uri)
    if node is None:
        raise MalformedEdgeError("no concept's URI")
    return node


def _weight(value: object) -> float:
    weight = number_of(value, _NO_WEIGHT)
    if not 0 < weight <= _MAX_WEIGHT:
        raise MalformedEdgeError(_NO_WEIGHT)
    return float(weight)


def _reject_constant(constant: str) -> float:
    raise MalformedEdgeError(_NO_WEIGHT)

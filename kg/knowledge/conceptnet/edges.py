"""Edges of ConceptNet: their parsers, and the strength of their evidence.

Lines of ConceptNet 5's assertions (TSV), edges of its web API, and lines of ConceptNet 4's graph
become `Edge`s. Votes and ConceptNet's weight give a probability.
"""

from __future__ import annotations

import ast
import json
import math
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final
from urllib.parse import quote, unquote

from kg.model import vocabulary as v

#: Relations that an import uses.
RELATIONS: Final = frozenset({"AtLocation", "LocatedNear", "PartOf", "HasA", "IsA", "Synonym"})
#: (relation, start term, end term) -> whether such an edge may be relevant.
EdgeFilter = Callable[[str, str, str], bool]
MAX_TEXT_LENGTH: Final = 300  # characters of a term or a surface text that are kept

_MAX_STRENGTH: Final = 1e6  # of a weight or of votes
_BRACKETS: Final = re.compile(r"\[\[|\]\]")
_RELATION4: Final = re.compile(rb"'rel': u?'(\w+)'")
_MAX_LITERAL_LENGTH: Final = 1000  # bytes; bounds the nesting of hostile input


class MalformedEdgeError(ValueError):
    """A line or an edge is no valid assertion; the message is the reason in a few words."""


@dataclass(frozen=True, slots=True)
class Node:
    """A term: ``/c/en/mouse/n/wn/animal`` is Node("mouse", "n", "animal")."""

    term: str  # words of the source, separated by spaces
    speech: str = ""  # part of speech: n, v, a, r; "": unknown
    sense: str = ""  # WordNet's topic (animal, artifact, food, ...); "": unknown


@dataclass(frozen=True, slots=True)
class Edge:
    """Assertion by a number of people (votes) that `relation` holds, or not (`negated`)."""

    relation: str  # AtLocation, IsA, ... never the negated form
    start: Node
    end: Node
    votes: float  # above 0
    negated: bool
    source: str  # IRI
    license: str  # IRI
    surface: str  # the wording in the source
    adds: bool  # whether the votes of repeated assertions add up


def is_conceptnet5(line: bytes) -> bool:
    """Whether a line has the form of an assertion of ConceptNet 5."""
    return line.startswith(b"/a/") and line.count(b"\t") == 4


def is_conceptnet4(line: bytes) -> bool:
    """Whether a line has the form of an assertion of ConceptNet 4."""
    columns = line.split(b"\t")
    return len(columns) == 3 and columns[2].startswith(b"{") and b"'rel'" in columns[2]


def parse_line5(line: bytes, language: str, wanted: EdgeFilter) -> Edge | None:
    """The assertion of a line of ConceptNet 5's TSV, or None if the filter rejects it.

    Raises:
        MalformedEdgeError: the line is no valid assertion.
    """
    _, relation, start, end, data = _columns(line, 5)
    home = b"/c/" + language.encode() + b"/"
    if parse_relation(relation.decode()) is None or not (
        start.startswith(home) and end.startswith(home)
    ):
        return None
    return _edge5(relation.decode(), start.decode(), end.decode(), data, language, wanted)


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
    return _edge5(uris[0], uris[1], uris[2], edge, language, wanted)


def parse_line4(line: bytes, language: str, wanted: EdgeFilter) -> Edge | None:
    """The assertion of a line of ConceptNet 4's graph, or None if the filter rejects it.

    The columns are start, end and a Python dictionary of freq, score and rel; all terms are
    English. An assertion with a frequency below 0 is negated.

    Raises:
        MalformedEdgeError: the line is no valid assertion.
    """
    first, second, literal = _columns(line.rstrip(b"\r"), 3)
    named = _RELATION4.search(literal)
    if language != "en" or (named and parse_relation(named[1].decode()) is None):
        return None
    start, end = clean(first.decode()), clean(second.decode())
    if named and not wanted(named[1].decode().removeprefix("Not"), start, end):
        return None  # before the dictionary is parsed, which takes longer
    if len(literal) > _MAX_LITERAL_LENGTH:
        raise MalformedEdgeError("no data in it")
    data = _data(ast.literal_eval(literal.decode()))
    relation = parse_relation(str(data.get("rel", "")))
    if relation is None or not wanted(relation[0], start, end):
        return None
    name, negated = relation
    message = "freq or score is no number"
    freq, score = (_number(data.get(key), message) for key in ("freq", "score"))
    return Edge(
        name,
        Node(start),
        Node(end),
        _positive(score, "score"),
        negated != (freq < 0),
        assertion_iri(name, start, end),
        license_iri("cc:by-sa/4.0"),
        f"{start} {'not ' if freq < 0 else ''}{name} {end}",
        adds=True,
    )


def _edge5(
    uri: str, start: str, end: str, data: object, language: str, wanted: EdgeFilter
) -> Edge | None:
    relation = parse_relation(uri)
    if relation is None:
        return None
    (start_language, start_node), (end_language, end_node) = _node(start), _node(end)
    name, negated = relation
    if (start_language, end_language) != (language, language) or not wanted(
        name, start_node.term, end_node.term
    ):
        return None
    if isinstance(data, bytes):
        data = json.loads(data)
    properties = _data(data)
    surface = properties.get("surfaceText")
    wording = surface if isinstance(surface, str) else f"{start_node.term} {name} {end_node.term}"
    return Edge(
        name,
        start_node,
        end_node,
        votes_of(_positive(properties.get("weight"), "weight")),
        negated,
        assertion_iri(f"Not{name}" if negated else name, start, end),
        license_iri(str(properties.get("license", ""))),
        clean(_BRACKETS.sub("", wording)),
        adds=False,
    )


def _columns(line: bytes, count: int) -> list[bytes]:
    columns = line.split(b"\t")
    if len(columns) != count:
        raise MalformedEdgeError("wrong number of columns")
    return columns


def _data(value: object) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise MalformedEdgeError("no data in it")
    return value


def _number(value: object, message: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise MalformedEdgeError(message)
    return value


def _positive(value: object, what: str) -> float:
    message = f"{what} is no number above 0"
    number = _number(value, message)
    if not 0 < number <= _MAX_STRENGTH:
        raise MalformedEdgeError(message)
    return float(number)


def _node(uri: str) -> tuple[str, Node]:
    """Language and node of a concept's URI."""
    parts = uri.split("/")
    if len(parts) < 4 or parts[:2] != ["", "c"] or not parts[2] or not parts[3]:
        raise MalformedEdgeError("no concept's URI")
    term = clean(unquote(parts[3]).replace("_", " "))
    speech = parts[4] if len(parts) > 4 else ""
    sense = parts[6] if len(parts) > 6 and parts[5] == "wn" else ""
    return parts[2], Node(term, speech, sense)


def parse_relation(text: str) -> tuple[str, bool] | None:
    """Relation of ``/r/AtLocation`` or ``NotIsA``, and whether it is negated; None if unused."""
    name = text.removeprefix("/r/")
    if name in RELATIONS:
        return name, False
    if name.startswith("Not") and name[3:] in RELATIONS:
        return name[3:], True
    return None


def assertion_iri(relation: str, start: str, end: str) -> str:
    """The IRI of an assertion, from the URIs (or plain terms) of its ends."""
    uri = f"/a/[/r/{relation}/,{_concept(start)}/,{_concept(end)}/]"
    return v.CONCEPTNET + quote(clean(uri), safe="/,:")


def _concept(text: str) -> str:
    return text if text.startswith("/c/") else f"/c/en/{text.replace(' ', '_')}"


def license_iri(text: str) -> str:
    """The IRI of ``cc:by-sa/4.0``; ConceptNet's own licence for an unknown text."""
    name = text.removeprefix("cc:").strip("/")
    known = name in ("by/4.0", "by-sa/4.0", "by/3.0", "by-sa/3.0")
    return f"{v.LICENSES}{name if known else 'by-sa/4.0'}/"


def clean(text: str) -> str:
    """`text` on one line, truncated, without characters that UTF-8 cannot encode."""
    line = " ".join(text[: 4 * MAX_TEXT_LENGTH].split())[:MAX_TEXT_LENGTH]
    return line.encode("utf-8", "replace").decode("utf-8")


#: Log-odds without evidence, and for each unit of ln(1 + weight): of an object in a place of the
#: category, and near another object; fitted as lab/research/conceptnet.md describes.
LOCATED: Final = (-3.65, 2.10)
NEAR: Final = (-2.08, 1.74)


def weight_of(votes: float) -> float:
    """ConceptNet 5's weight for n votes: 2 sqrt(max(n - 1, 1)) + min(n, 2) - 2."""
    return 2 * math.sqrt(max(votes - 1, 1)) + min(votes, 2) - 2


def votes_of(weight: float) -> float:
    """The votes for a weight: the inverse of `weight_of`, exact for weights above 0."""
    return weight if weight <= 2 else (weight / 2) ** 2 + 1


def probability_of(weight: float, log_odds: tuple[float, float] = LOCATED) -> float:
    """p = 1 / (1 + exp(-base - slope ln(1 + w))): the base rate at weight 0, rising towards 1.

    Args:
        weight: total weight for, less the weight against; below 0 counts as 0.
        log_odds: base and slope.
    """
    base, slope = log_odds
    return 1 / (1 + math.exp(-base - slope * math.log1p(max(weight, 0.0))))

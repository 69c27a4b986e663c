"""Edges of ConceptNet, independent of the file format, and the strength of their evidence.

Votes and ConceptNet's weight give a probability.
"""

from __future__ import annotations

import math
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


def columns_of(line: bytes, count: int) -> list[bytes]:
    """The `count` tab-separated columns of a line; raises MalformedEdgeError otherwise."""
    columns = line.split(b"\t")
    if len(columns) != count:
        raise MalformedEdgeError("wrong number of columns")
    return columns


def data_of(value: object) -> dict[str, Any]:
    """The data of an assertion, a dictionary; raises MalformedEdgeError otherwise."""
    if not isinstance(value, dict):
        raise MalformedEdgeError("no data in it")
    return value


def number_of(value: object, message: str) -> float:
    """`value`, a number and no boolean; raises MalformedEdgeError with `message` otherwise."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise MalformedEdgeError(message)
    return value


def parse_node(uri: str) -> tuple[str, Node] | None:
    """Language and node of a concept's URI; None for other texts."""
    parts = uri.split("/")
    if len(parts) < 4 or parts[:2] != ["", "c"] or not parts[2] or not parts[3]:
        return None
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
#: category, and near another object; fitted as docs/how-to/statistics.md describes.
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

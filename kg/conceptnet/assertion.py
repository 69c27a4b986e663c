"""One assertion of ConceptNet, whatever form it came in."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final
from urllib.parse import quote, unquote

from kg import vocabulary as v

#: What an import can learn something from.
RELATIONS: Final = frozenset({"AtLocation", "LocatedNear", "PartOf", "HasA", "IsA", "Synonym"})
LONGEST_TEXT: Final = 300  # characters of a term or a surface text that are kept


class Unreadable(ValueError):  # noqa: N818 - says what a line is; nobody outside sees it raised
    """A line or an edge that holds no assertion; its message is the reason, in a few words."""


@dataclass(frozen=True, slots=True)
class Node:
    """A term: ``/c/en/mouse/n/wn/animal`` is Node("mouse", "n", "animal")."""

    term: str  # words between spaces, as the source has them
    speech: str = ""  # part of speech: n, v, a, r, or not said
    sense: str = ""  # WordNet's topic (animal, artifact, food, ...), or not said


@dataclass(frozen=True, slots=True)
class Assertion:
    """`start` stands in `relation` to `end`, so many people (votes) say; or that it does not."""

    relation: str  # AtLocation, IsA, ... never the negated form
    start: Node
    end: Node
    votes: float  # above 0
    negated: bool
    source: str  # IRI
    license: str  # IRI
    surface: str  # how people worded it
    adds: bool  # whether the same assertion once more is more votes, not the same ones again


def columns_of(line: bytes, count: int) -> list[bytes]:
    """The columns between tabs; raises Unreadable where they are not so many."""
    columns = line.split(b"\t")
    if len(columns) != count:
        raise Unreadable("wrong number of columns")
    return columns


def data_of(value: object) -> dict[str, Any]:
    """The data of an assertion, by name; raises Unreadable where it is nothing of the kind."""
    if not isinstance(value, dict):
        raise Unreadable("no data in it")
    return value


def number_of(value: object, message: str) -> float:
    """A number as such; raises Unreadable with the message where it is none (nor is a truth)."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise Unreadable(message)
    return value


def parse_node(uri: str) -> tuple[str, Node] | None:
    """Language and node of a concept's URI, or None where it is none."""
    parts = uri.split("/")
    if len(parts) < 4 or parts[:2] != ["", "c"] or not parts[2] or not parts[3]:
        return None
    term = clean(unquote(parts[3]).replace("_", " "))
    speech = parts[4] if len(parts) > 4 else ""
    sense = parts[6] if len(parts) > 6 and parts[5] == "wn" else ""
    return parts[2], Node(term, speech, sense)


def parse_relation(text: str) -> tuple[str, bool] | None:
    """Relation and whether it is negated, of ``/r/AtLocation`` or ``NotIsA``; None where unused."""
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
    """``cc:by-sa/4.0`` as an IRI; ConceptNet's own licence where it is not one of those."""
    name = text.removeprefix("cc:").strip("/")
    known = name in ("by/4.0", "by-sa/4.0", "by/3.0", "by-sa/3.0")
    return f"{v.LICENSES}{name if known else 'by-sa/4.0'}/"


def clean(text: str) -> str:
    """`text` on one line, no longer than is kept, and without what UTF-8 cannot carry."""
    line = " ".join(text[: 4 * LONGEST_TEXT].split())[:LONGEST_TEXT]
    return line.encode("utf-8", "replace").decode("utf-8")

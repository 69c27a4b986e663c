"""Names that people give to things: checked, and the known category that is nearest to one."""

from __future__ import annotations

import re
import unicodedata
from typing import Final

from pyoxigraph import Literal, NamedNode

from kg.knowledge.ontology.catalogue import Catalogue, Category
from kg.knowledge.words.meaning import Meaning, understand
from kg.model import vocabulary as v
from kg.model.errors import InvalidFactError, UnknownCategoryError
from kg.rdf.quad_store import QuadStore

MAX_NAME: Final = 100  # characters
_HIDDEN: Final = frozenset(("Cc", "Cf", "Cs", "Co", "Cn", "Zl", "Zp"))  # Unicode categories
_LABEL: Final = ("a label", "cup by the sink")
_MARKUP: Final = "<>"
_NUMBER: Final = re.compile(r"[-+]?\d[\d.,]*(?:[eE][-+]?\d+)?|0[xXbB][0-9a-fA-F]+")
_ID: Final = re.compile(r"(?:object|place|door|observation|recording|search|agent)/\S+", re.I)
_IRI: Final = re.compile(r"\S+://|(?:urn|mailto|here|graph):\S", re.I)


def checked_name(text: str) -> str:
    """The name in one line with single spaces; raises InvalidFactError for what is none."""
    name = checked_line(text, "a name", "coffee machine")
    if any(mark in name for mark in _MARKUP):
        raise InvalidFactError(f"a name is plain text without < and >, got {name!r}")
    if not any(c.isalpha() for c in name) or _NUMBER.fullmatch(name):
        raise InvalidFactError(f"a name has letters, as in 'coffee machine'; got {name!r}")
    check_no_reference(name, "a name", "coffee machine")
    return name


def check_no_reference(text: str, what: str, example: str) -> None:
    """Raise InvalidFactError for the id or IRI of a thing, which is no text for people."""
    if _ID.fullmatch(text) or _IRI.match(text):
        raise InvalidFactError(
            f"{text!r} is the id of a thing; {what} such as '{example}' would work"
        )


def check_no_label(engine: QuadStore, catalogue: Catalogue, name: str) -> None:
    """Raise InvalidFactError for a new name that is, or reads like, the label of one object."""
    stem, _, number = name.rpartition(" ")
    numbered = number.isdigit() and catalogue.get(stem, "object") is not None
    labelled = [
        *engine.quads_for_pattern(None, NamedNode(v.RDFS_LABEL), Literal(name), v.MAP_GRAPH)
    ]
    if numbered or any(_is_object(engine, quad.subject) for quad in labelled):
        raise InvalidFactError(
            f"{name!r} is the label of one object, and a name says what a thing is: "
            "'coffee machine' would work, or `hereabouts assert MAP THING label TEXT`"
        )


def _is_object(engine: QuadStore, subject: object) -> bool:
    if not isinstance(subject, NamedNode):
        return False
    types = engine.quads_for_pattern(subject, v.RDF_TYPE, None, v.MAP_GRAPH)
    return all(quad.object != NamedNode(v.PLACE) for quad in types)


def checked_line(text: str, what: str, example: str) -> str:
    """A short text in one line with single spaces, such as a label or an author.

    Raises InvalidFactError where it is long or has characters that do not show.
    """
    normal = unicodedata.normalize("NFC", text[: 2 * MAX_NAME])
    line = " ".join(part for part in normal.split(" ") if part)
    if len(text) > 2 * MAX_NAME or len(line) > MAX_NAME:
        raise InvalidFactError(
            f"{what} has up to {MAX_NAME} characters, as in '{example}'; got {len(text):,}"
        )
    check_visible(line, what, example)
    return line


def check_visible(text: str, what: str, example: str) -> None:
    """Raise InvalidFactError for a text with characters that do not show, or of several lines."""
    hidden = next((c for c in text if unicodedata.category(c) in _HIDDEN), None)
    if hidden is not None:
        raise InvalidFactError(
            f"{what} has visible characters in one line, got U+{ord(hidden):04X}; '{example}' "
            "would work"
        )


def check_label(text: str) -> None:
    """Raise InvalidFactError for what is no label of one thing, whoever writes it."""
    if not text.strip():
        raise InvalidFactError("a label must have at least one character")
    check_visible(text, *_LABEL)
    check_no_reference(text, *_LABEL)


def asserted_category(catalogue: Catalogue, name: str, kind: str) -> Category:
    """The category of a `kind` ("object" or "place") with a name, or that a word means.

    Raises UnknownCategoryError, for a word of a particular kind of category as well.
    """
    if kind == "object" and catalogue.get(name, kind) is None and catalogue.get(name) is None:
        meaning = _meaning(catalogue, name)
        if meaning is not None and meaning.relation == "same":
            return meaning.categories[0]
        if meaning is not None:
            raise UnknownCategoryError(
                f"{meaning.note}; the category {meaning.categories[0].label} would work, or "
                f"`hereabouts name MAP THING '{meaning.text}'`"
            )
    return catalogue.find(name, kind=kind)


def category_of_name(catalogue: Catalogue, name: str) -> Category | None:
    """The category of objects that has a name, or means the same word; None for a new name.

    Raises InvalidFactError for the name of a kind of place.
    """
    if (known := catalogue.get(name, "object")) is not None:
        return known
    if (other := catalogue.get(name)) is not None and other.kind == "place":
        raise InvalidFactError(
            f"{name!r} is a kind of place; another name for the thing would work, as in "
            f"'{name} door'"
        )
    meaning = _meaning(catalogue, name)
    same = meaning is not None and meaning.relation == "same" and meaning.how in ("word", "folded")
    return meaning.categories[0] if same and meaning else None


def nearest_category(catalogue: Catalogue, name: str) -> Category | None:
    """The known category that includes what has a new name: "my red mug" is a cup.

    None where no single one does.
    """
    meaning = _meaning(catalogue, name)
    return None if meaning is None else meaning.categories[0]


def marked_categories(engine: QuadStore) -> dict[str, str]:
    """IRI of a category -> the mark that the ontology has for its things (here:marker)."""
    found = engine.quads_for_pattern(None, NamedNode(v.MARKER), None, v.ONTOLOGY_GRAPH)
    return {
        quad.subject.value: quad.object.value
        for quad in found
        if isinstance(quad.subject, NamedNode) and isinstance(quad.object, Literal)
    }


def _meaning(catalogue: Catalogue, name: str) -> Meaning | None:
    """The meaning of a name, where it has a single certain category."""
    try:
        meaning = understand(catalogue, name)
    except UnknownCategoryError:
        return None
    certain = meaning.how != "spelling" and meaning.relation in ("same", "narrower")
    return meaning if certain and len(meaning.categories) == 1 else None

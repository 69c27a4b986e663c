"""Compact IRIs: parsing of things and facts in people's notation, and shortening of terms."""

from __future__ import annotations

import re
import shlex

from pyoxigraph import BlankNode, Literal, NamedNode

from kg.model import vocabulary as v
from kg.model.errors import QueryParameterError
from kg.rdf.quad_store import Term

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
        r"(object|place|observation|recording|search|floor)/\S+|robot", text
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

"""Deviations of Virtuoso 7 from the SPARQL standards, and how they are handled.

It names blank nodes ``nodeID://...``, writes numbers in a lexical form of its own and booleans as 0
and 1, answers CONSTRUCT with a table where it may, takes no blank node in INSERT DATA, and compiles
no request of more than some ten thousand lines.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterable, Iterator
from itertools import islice
from typing import Final

from pyoxigraph import BlankNode, Literal, Quad, Triple

from kg.model import vocabulary as v
from kg.rdf.sparql.lexer import keywords_of

AT_ONCE: Final = 400  # quads of one request
_FORMS: Final = ("SELECT", "ASK", "CONSTRUCT", "DESCRIBE")
_LINE: Final = re.compile(r"SPARQL compiler, line (\d+): (.*)")
_BOOLEAN: Final = v.XSD + "boolean"


def is_virtuoso(server: str | None) -> bool:
    """Whether the Server header of an answer names it."""
    return (server or "").startswith("Virtuoso/")


def gives_triples(query: str) -> bool:
    """Whether it is CONSTRUCT or DESCRIBE; such an answer must be requested as triples alone."""
    form = next((word for word in keywords_of(query) if word in _FORMS), "SELECT")
    return form in _FORMS[2:]


def readable(results: bytes) -> bytes:
    """SPARQL results in JSON as the standard has them, numbers in the form a map uses."""
    content = json.loads(results)
    for row in content.get("results", {}).get("bindings", ()):
        for cell in row.values():
            if cell["type"] == "bnode":
                cell["value"] = cell["value"].removeprefix("nodeID://")
            elif "datatype" in cell:
                cell["value"] = _plain(cell["value"], cell["datatype"])
    return json.dumps(content).encode()


def plain(triple: Triple) -> Triple:
    """A triple with its number in the form a map uses."""
    value = triple.object
    if not isinstance(value, Literal) or value.language:
        return triple
    kind = value.datatype
    plain = Literal(_plain(value.value, kind.value), datatype=kind)
    return Triple(triple.subject, triple.predicate, plain)


def complaint(body: str) -> str:
    """The message of an error without the query it repeats, with its line where it has one."""
    text = " ".join(body.split("SPARQL query:")[0].split())
    found = _LINE.search(text)
    return f"error at {found[1]}:1: {found[2]}" if found else text


def _plain(text: str, datatype: str) -> str:
    if datatype == v.XSD_DOUBLE.value:
        number = float(text)
        return Literal(number).value if math.isfinite(number) else text
    if datatype == _BOOLEAN:
        return "true" if text in ("1", "true") else "false"
    return text


def loads(quads: Iterable[Quad]) -> Iterator[list[Quad]]:
    """The quads in parts that one request each can take; those with blank nodes in one of them.

    The order is kept but for these, which come first: a map is there once its last part is.
    """
    named: list[Quad] = []
    nameless: list[Quad] = []
    for quad in quads:
        blank = isinstance(quad.subject, BlankNode) or isinstance(quad.object, BlankNode)
        (nameless if blank else named).append(quad)
    if nameless:
        yield nameless
    rest = iter(named)
    while part := list(islice(rest, AT_ONCE)):
        yield part

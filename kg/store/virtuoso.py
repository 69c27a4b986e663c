"""Workarounds for deviations of Virtuoso 7 from the SPARQL standards.

Virtuoso names blank nodes ``nodeID://...``, writes numbers in its own lexical form and booleans as
0 and 1, prefers a table as the answer to CONSTRUCT, and cannot compile a request of more than about
ten thousand lines.
"""

from __future__ import annotations

import json
import math
import re
from typing import Final

from pyoxigraph import Literal, Triple

from kg.model import vocabulary as v
from kg.rdf.sparql.lexer import keywords_of

MAX_QUADS: Final = 400  # in one request
_FORMS: Final = ("SELECT", "ASK", "CONSTRUCT", "DESCRIBE")
_LINE: Final = re.compile(r"SPARQL compiler, line (\d+): (.*)")
_BOOLEAN: Final = v.XSD + "boolean"


def is_virtuoso(server: str | None) -> bool:
    """Whether the Server header of an answer names Virtuoso."""
    return (server or "").startswith("Virtuoso/")


def gives_triples(query: str) -> bool:
    """Whether the query is CONSTRUCT or DESCRIBE; its request must accept triples only."""
    form = next((word for word in keywords_of(query) if word in _FORMS), "SELECT")
    return form in _FORMS[2:]


def readable(results: bytes) -> bytes:
    """SPARQL results in standard JSON, with numbers in the lexical form of a map."""
    content = json.loads(results)
    for row in content.get("results", {}).get("bindings", ()):
        for cell in row.values():
            if cell["type"] == "bnode":
                cell["value"] = cell["value"].removeprefix("nodeID://")
            elif "datatype" in cell:
                cell["value"] = _plain(cell["value"], cell["datatype"])
    return json.dumps(content).encode()


def plain(triple: Triple) -> Triple:
    """A triple with its number in the lexical form of a map."""
    value = triple.object
    if not isinstance(value, Literal) or value.language:
        return triple
    kind = value.datatype
    plain = Literal(_plain(value.value, kind.value), datatype=kind)
    return Triple(triple.subject, triple.predicate, plain)


def complaint(body: str) -> str:
    """The error message without the repeated query, with its line if it has one."""
    text = " ".join(body.split("SPARQL query:")[0].split())
    match = _LINE.search(text)
    return f"error at {match[1]}:1: {match[2]}" if match else text


def _plain(text: str, datatype: str) -> str:
    if datatype == v.XSD_DOUBLE.value:
        number = float(text)
        return Literal(number).value if math.isfinite(number) else text
    if datatype == _BOOLEAN:
        return "true" if text in ("1", "true") else "false"
    return text

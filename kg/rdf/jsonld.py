"""Compact JSON-LD of quads: a context of prefixes and one node for each subject, in given order.

The engine's own writer has only the expanded form, which people do not read easily.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping

from pyoxigraph import BlankNode, Literal, NamedNode, Triple

from kg.model import vocabulary as v
from kg.model.iris import whole_number


def to_jsonld(triples: Iterable[Triple], prefixes: Mapping[str, str]) -> str:
    """A JSON-LD document with the triples in its default graph, in the order they come."""
    nodes: dict[str, dict[str, list[object]]] = {}
    for triple in triples:
        node = nodes.setdefault(_id(triple.subject, prefixes), {})
        if triple.predicate == v.RDF_TYPE and isinstance(triple.object, NamedNode):
            node.setdefault("@type", []).append(_id(triple.object, prefixes))
        else:
            key = _compact(triple.predicate.value, prefixes)
            node.setdefault(key, []).append(_value(triple.object, prefixes))
    graph = [
        {"@id": subject}
        | {key: values[0] if len(values) == 1 else values for key, values in node.items()}
        for subject, node in nodes.items()
    ]
    return json.dumps({"@context": dict(prefixes), "@graph": graph}, ensure_ascii=False, indent=1)


def _value(term: object, prefixes: Mapping[str, str]) -> object:
    if not isinstance(term, Literal):
        return {"@id": _id(term, prefixes)}
    if term.language:
        return {"@value": term.value, "@language": term.language}
    datatype = term.datatype.value
    if datatype == v.XSD + "string":
        return term.value
    number = whole_number(term.value) if datatype == v.XSD + "integer" else None
    if number is not None and term.value == str(number):
        return number
    return {"@value": term.value, "@type": _compact(datatype, prefixes)}


def _id(term: object, prefixes: Mapping[str, str]) -> str:
    if isinstance(term, BlankNode):
        return f"_:{term.value}"
    return _compact(term.value, prefixes) if isinstance(term, NamedNode) else str(term)


def _compact(iri: str, prefixes: Mapping[str, str]) -> str:
    matching = [(len(ns), name) for name, ns in prefixes.items() if iri.startswith(ns)]
    if not matching:
        return iri
    length, name = max(matching)
    local = iri[length:]
    # a prefixed name with // after the colon is an absolute IRI
    return iri if local.startswith("//") else f"{name}:{local}"

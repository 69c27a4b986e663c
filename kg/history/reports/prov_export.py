"""Explanations as triples of SOSA and PROV-O."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from pyoxigraph import BlankNode, Literal, NamedNode, RdfFormat, Triple, serialize

from kg.history.reports.explanation import Explanation
from kg.history.timestamps import iso
from kg.model import vocabulary as v

_CLASS: Final = {
    "fact": v.RDF_STATEMENT,
    "observation": v.SOSA_OBSERVATION,
    "model": v.SOSA_SENSOR,
    "rule": v.PROV_PLAN,
    "commit": v.PROV_ACTIVITY,
    "change": v.PROV_ACTIVITY,
    "person": v.PROV_AGENT,
}  # all other kinds: prov:Entity
_LINK: Final = {
    "commit": v.PROV_GENERATED_BY,
    "person": v.PROV_ATTRIBUTED_TO,
    "source": v.PROV_PRIMARY_SOURCE,
    "rule": v.PROV_INFLUENCED_BY,
    "change": v.PROV_INFLUENCED_BY,
}


def provenance(*reasons: Explanation) -> str:
    """Turtle with a node for each step, linked to the steps it derives from."""
    triples: dict[Triple, None] = {}
    for number, reason in enumerate(reasons):
        triples.update(dict.fromkeys(_triples(reason, f"r{number}")))
    text = serialize(triples, format=RdfFormat.TURTLE, prefixes=v.PREFIXES)
    return (text or b"").decode()


def _triples(reason: Explanation, path: str) -> Iterator[Triple]:
    node = _node(reason, path)
    yield Triple(node, v.RDF_TYPE, NamedNode(_CLASS.get(reason.kind, v.PROV_ENTITY)))
    named = v.RDFS_LABEL if reason.kind == "person" else v.RDFS_COMMENT
    yield Triple(node, NamedNode(named), Literal(reason.text))
    if reason.fact is not None:
        parts = zip((v.RDF_SUBJECT, v.RDF_PREDICATE, v.RDF_OBJECT), reason.fact, strict=True)
        for predicate, term in parts:
            yield Triple(node, NamedNode(predicate), term)
    if reason.time is not None:
        when = Literal(iso(reason.time), datatype=NamedNode(v.XSD + "dateTime"))
        yield Triple(node, NamedNode(v.PROV_ENDED_AT), when)
    for index, behind in enumerate(reason.because):
        below = f"{path}n{index}"
        yield Triple(node, NamedNode(_link(reason, behind)), _node(behind, below))
        if _link(reason, behind) == v.PROV_ASSOCIATED_WITH:
            association = BlankNode(f"{below}association")
            yield Triple(node, NamedNode(v.PROV_QUALIFIED_ASSOCIATION), association)
            yield Triple(association, v.RDF_TYPE, NamedNode(v.PROV_ASSOCIATION))
            yield Triple(association, NamedNode(v.PROV_HAS_AGENT), _node(behind, below))
        yield from _triples(behind, below)


def _node(reason: Explanation, path: str) -> NamedNode | BlankNode:
    named = reason.iri is not None and reason.kind not in ("pose", "view")
    return NamedNode(reason.iri) if named and reason.iri else BlankNode(path)


def _link(reason: Explanation, behind: Explanation) -> str:
    if reason.kind in ("commit", "change") and behind.kind == "person":
        return v.PROV_ASSOCIATED_WITH
    if reason.kind == "observation" and behind.kind == "model":
        return v.SOSA_MADE_BY_SENSOR
    if reason.kind == "was" and behind.kind == "commit":
        return v.PROV_INVALIDATED_BY
    return _LINK.get(behind.kind, v.PROV_DERIVED_FROM)

"""Agents of PROV-O: one IRI for each author of transactions and assertions."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final
from urllib.parse import quote, unquote

from pyoxigraph import Literal, NamedNode, Quad

from kg import vocabulary as v

AGENT: Final = "agent/"  # + the percent-encoded name, behind the map's IRI


def agent_iri(base: str, name: str) -> str:
    """``<base>agent/NAME``."""
    return f"{base}{AGENT}{quote(name, safe='')}"


def agent_name(base: str, iri: str) -> str:
    """The name in an agent's IRI; the inverse of `agent_iri`."""
    return unquote(iri.removeprefix(base + AGENT))


def agent_quads(base: str, name: str, graph: NamedNode) -> Iterator[Quad]:
    """Type and label of an agent."""
    node = NamedNode(agent_iri(base, name))
    yield Quad(node, NamedNode(v.RDF_TYPE), NamedNode(v.PROV_AGENT), graph)
    yield Quad(node, NamedNode(v.RDFS_LABEL), Literal(name), graph)

"""What a fleet says of itself: a page, a Service Description, VoID."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from importlib.resources import files
from typing import TypedDict
from urllib.parse import quote

from pyoxigraph import Literal, NamedNode, RdfFormat, Triple, parse

from kg import vocabulary as v
from kg.characters import shown
from kg.questions import ready_questions
from kg.server import pages
from kg.server.fleet.members import Member


class MemberState(TypedDict):
    """How a member is, for `/health` and the page; base and map are None until it was reached."""

    member: str
    status: str  # ok, away
    map: str | None
    base: str | None
    error: str | None


def front(states: Sequence[MemberState]) -> str:
    """The page of the fleet."""
    page = pages.template("fleet.html").substitute(
        head=pages.head("fleet"),
        members="".join(map(_row, states)),
        questions="".join(
            f'<option value="{escape(sparql)}">{escape(name)}: {escape(summary)}</option>'
            for name, summary, sparql in ready_questions()
        ),
    )
    return shown(page)


def service(root: str) -> list[Triple]:
    """The endpoint in terms of SPARQL 1.1 Service Description."""
    return _read("fleet-service.ttl", root)


def description(root: str, members: Sequence[Member]) -> list[Triple]:
    """The fleet as a VoID dataset, its members' maps as subsets."""
    fleet = NamedNode(f"{root}#fleet")
    triples = [
        Triple(fleet, NamedNode(v.RDF_TYPE), NamedNode(v.VOID_DATASET)),
        Triple(fleet, NamedNode(v.DCT_TITLE), Literal("A fleet of semantic maps")),
        Triple(fleet, NamedNode(v.VOID_SPARQL_ENDPOINT), NamedNode(f"{root}sparql")),
    ]
    for base, title in sorted({member.known for member in members if member.known}):
        node = NamedNode(base)
        triples += [
            Triple(fleet, NamedNode(v.VOID_SUBSET), node),
            Triple(node, NamedNode(v.RDF_TYPE), NamedNode(v.SEMANTIC_MAP)),
            Triple(node, NamedNode(v.DCT_TITLE), Literal(title)),
        ]
    return triples


def compact(iri: str) -> str:
    """An IRI as a prefixed name where a prefix fits."""
    return pages.compact(iri, iri)


def link(iri: str) -> tuple[str, str]:
    """Where the fleet shows an IRI, and what it is called."""
    return "/resource?iri=" + quote(iri, safe=""), compact(iri)


def _row(state: MemberState) -> str:
    name = escape(state["map"] or "")
    if state["base"]:
        href, _ = link(state["base"])
        name = f'<a href="{escape(href)}" title="{escape(state["base"])}">{name}</a>'
    how = escape(state["error"] or "answers")
    return f"<tr><td>{escape(state['member'])}</td><td>{name}</td><td>{how}</td></tr>"


def _read(name: str, root: str) -> list[Triple]:
    text = files("kg.server").joinpath("files", name).read_text(encoding="utf-8")
    return [quad.triple for quad in parse(text, format=RdfFormat.TURTLE, base_iri=root)]

"""Family of attacks: IRIs in uploads and updates that are relative, odd or no IRIs at all."""

from __future__ import annotations

import random
from typing import Final

from pyoxigraph import NamedNode, Quad, RdfFormat, parse

from benchmarks.attack.outcome import Outcome
from benchmarks.attack.target import Target
from kg.model import vocabulary as v

ATTEMPTS: Final = 150
_PARTS: Final = (
    "object/1", "./object/1", "../object/1", "place/2", "/object/1", "//other.example/x", "#x",
    "?q=1", "", ".", "..", "object/1/../2", "urn:x:y", "http:object/1", "object/%2e%2e/1",
    "object/ü", "object/1#", "a:b", ":x", "1", "//", "///x", "object//1", "\\u006fbject/1",
)  # fmt: skip
_BASES: Final = ("", "", "@base <http://e.example/a/b> .\n", "@base <x/> .\n", "@base <#> .\n")
_KINDS: Final = ("text/turtle", "application/n-triples", "application/ld+json", "update")
_SAYS: Final = "http://www.w3.org/2000/01/rdf-schema#comment"


def attack(target: Target) -> Outcome:
    """All that an upload reports as added is in the map, by IRIs that every reader takes."""
    total = Outcome()
    for number in range(ATTEMPTS):
        total += _one(target, number)
    dump = target.request("GET", "dump.nq")
    broken = dump is None or not _readable(dump.content)
    return total + Outcome(0, crashes=int(broken) + target.restarted(), lost=target.lost())


def _one(target: Target, number: int) -> Outcome:
    rng, text = target.rng, f"said {number}"
    kind, iri = rng.choice(_KINDS), _spelling(rng)
    if kind == "update":
        update = f"INSERT DATA {{ GRAPH {v.MAP_GRAPH} {{ <{iri}> <{_SAYS}> '{text}' }} }}"
        reply = target.request("POST", "sparql", data={"update": update})
    else:
        headers = {"Content-Type": kind}
        body = _document(kind, iri, text, rng).encode()
        reply = target.request("POST", "graphs/map", data=body, headers=headers)
    taken = reply is not None and reply.status_code < 300 and _added(reply.text)
    found = target.query(f"ASK {{ GRAPH ?g {{ ?s <{_SAYS}> '{text}' }} }}")
    lost = taken and (found is None or b"true" not in found.content)
    return Outcome(1, 0, target.crashed(), 0, int(lost), 0, target.shown(reply))


def _added(reply: str) -> bool:
    """Whether a reply says that something was added; readers of JSON-LD drop what is no IRI."""
    return '"added": 0' not in reply


def _spelling(rng: random.Random) -> str:
    iri = rng.choice(_PARTS)
    for _ in range(rng.choice((0, 0, 1, 2))):
        at = rng.randint(0, len(iri))
        iri = iri[:at] + rng.choice("/.:#?%&~@[]\u00ad\u202e1x") + iri[at:]
    return iri


def _document(kind: str, iri: str, text: str, rng: random.Random) -> str:
    if kind == "application/ld+json":
        return f'{{"@id": "{iri}", "{_SAYS}": "{text}"}}'
    base = rng.choice(_BASES) if kind == "text/turtle" else ""
    return f"{base}<{iri}> <{_SAYS}> '{text}' .".replace("'", '"')


def _readable(dump: bytes) -> bool:
    try:
        return all(_absolute(quad) for quad in parse(dump, format=RdfFormat.N_QUADS))
    except (SyntaxError, ValueError):
        return False


def _absolute(quad: Quad) -> bool:
    names = (quad.subject, quad.predicate, quad.object, quad.graph_name)
    return all(":" in name.value for name in names if isinstance(name, NamedNode))

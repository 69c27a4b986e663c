"""Family of attacks: requests that need all time, memory or stack, or break the engine."""

from __future__ import annotations

import threading
from collections.abc import Iterator

from benchmarks.attack.outcome import Outcome
from benchmarks.attack.target import SECONDS, Target

_XML = 'xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#"'
_CARTESIAN = "?a ?b ?c . ?d ?e ?f . ?g ?h ?i FILTER(STR(?a) = CONCAT(STR(?e), STR(?i)))"
_NEST = 20_000
_TRIPLES = "<<( <urn:a> <urn:b> " * _NEST + "1 " + ")>> " * _NEST
_OBJECTS = '{"urn:b": ' * _NEST + "1" + "}" * _NEST
GRACE = 15.0  # [s] that the server has to end


def attack(target: Target) -> Outcome:
    """Each request on its own, a bystander beside it; then SIGTERM during the slowest."""
    total = Outcome()
    for method, path, given in _requests():
        thread = threading.Thread(target=target.request, args=(method, path), kwargs=given)
        thread.start()
        hangs = target.hangs()
        thread.join()
        total += Outcome(1, 0, target.crashed(), hangs + target.hangs(), target.lost())
    return total + _terminated(target)


def _terminated(target: Target) -> Outcome:
    thread = threading.Thread(target=target.update, args=(runaway(),))
    thread.start()
    thread.join(SECONDS / 4)
    ended = target.ends_when_told(GRACE)
    thread.join()
    return Outcome(1, 0, target.crashed(), int(not ended), target.lost())


def runaway() -> str:
    """An update over three cartesian patterns."""
    return f"INSERT {{ ?a <urn:b> ?c }} WHERE {{ {_CARTESIAN} }}"


def _requests() -> Iterator[tuple[str, str, dict[str, object]]]:
    for text in (
        "SELECT * { GRAPH <urn:g> { ?s ?p ?o } } ORDER BY STR(?p) ?o",
        f"SELECT * {{ {_CARTESIAN} }}",
        "SELECT (GROUP_CONCAT(STR(?a)) AS ?x) { ?a ?b ?c . ?d ?e ?f }",
        "ASK " + "{" * _NEST,
        "ASK { FILTER(" + "(" * _NEST + "1",
        "ASK { ?s ?p " + "<<( ?s ?p " * _NEST,
    ):
        yield "POST", "sparql", {"data": {"query": text}}
    for text in (
        runaway(),
        "INSERT { GRAPH <urn:h> { ?s ?p ?o } } WHERE { SELECT * { GRAPH <urn:g> { ?s ?p ?o } } "
        "ORDER BY STR(?p) ?o }",
        "INSERT DATA { <urn:a> <urn:b> " + _TRIPLES + "}",
        "INSERT {} WHERE " + "{" * _NEST + "}" * _NEST,
    ):
        yield "POST", "sparql", {"data": {"update": text}}
    for kind, body in document_bombs():
        given = {"data": body, "headers": {"Content-Type": kind}}
        yield "POST", "graphs?graph=urn:uploaded", given
    yield "POST", "records", {
        "data": "[" * _NEST + "]" * _NEST, "headers": {"Content-Type": "application/json"},
    }  # fmt: skip


def document_bombs() -> list[tuple[str, bytes]]:
    """Media types and RDF documents that nest deeply, or grow without limit."""
    documents = [
        ("application/rdf+xml", _entities()),
        ("application/ld+json", '{"@id": "urn:a", "urn:b": ' + _OBJECTS + "}"),
        ("application/ld+json", "[" * _NEST + "]" * _NEST),
        ("text/turtle", "<urn:a> <urn:b> " + "(" * _NEST + ")" * _NEST + " ."),
        ("text/turtle", "<urn:a> <urn:b> " + "[ <urn:b> " * _NEST + "1" + "]" * _NEST + " ."),
        ("text/turtle", "<urn:a> <urn:b> " + _TRIPLES + " ."),
    ]
    return [(kind, text.encode()) for kind, text in documents]


def _entities() -> str:
    """RDF/XML of less than 1 kB whose entities expand to 10 GB."""
    tenfold = [(level, 10 * f"&e{level - 1};") for level in range(1, 10)]
    entities = "".join(f'<!ENTITY e{level} "{text}">' for level, text in tenfold)
    return (
        f'<!DOCTYPE r [<!ENTITY e0 "0123456789">{entities}]><rdf:RDF {_XML}>'
        '<rdf:Description rdf:about="urn:a"><b xmlns="urn:">&e9;</b></rdf:Description></rdf:RDF>'
    )

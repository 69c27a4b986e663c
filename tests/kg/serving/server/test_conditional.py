"""Conditional requests, HEAD, and documents of the map's description."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
import rdflib

if TYPE_CHECKING:
    from conftest import Served

THING, GRAPH = "object/1", "graphs/map"
PAGES = (THING, GRAPH, "resource?iri=https://w3id.org/hereabouts%23Cup")


@pytest.mark.parametrize("path", PAGES)
def test_what_a_client_has_is_not_sent_again(served: Served, path: str) -> None:
    first = served.get(path)
    tag = first.headers["ETag"]
    assert first.status_code == 200
    for given in (tag, f'"other", {tag}', "*", tag.removeprefix("W/")):
        again = served.get(path, headers={"If-None-Match": given})
        assert (again.status_code, again.content) == (304, b"")
        assert again.headers["ETag"] == tag
        assert again.headers["Vary"] == first.headers["Vary"]
        assert "Accept" in again.headers["Vary"].split(", ")
    assert served.get(path, headers={"If-None-Match": '"other"'}).status_code == 200
    served.move(1, 3.0)
    moved = served.get(path, headers={"If-None-Match": tag})
    assert moved.status_code == 200
    assert moved.headers["ETag"] != tag


@pytest.mark.parametrize("path", [*PAGES, "", "health", "metrics", "dump.nq", "sparql?query=ASK{}"])
def test_head_is_get_without_its_body(lasting: Served, path: str) -> None:
    whole, head = lasting.get(path), lasting.request("HEAD", path)
    assert head.status_code == whole.status_code == 200
    assert head.content == b""
    assert head.headers["Content-Type"] == whole.headers["Content-Type"]


@pytest.mark.parametrize("path", ["changes", "subscribe?query=ASK{}"])
def test_head_of_a_stream_ends(lasting: Served, path: str) -> None:
    served = lasting
    head = served.request("HEAD", path)
    assert head.status_code == 200
    assert head.headers["Content-Type"].startswith("text/event-stream")
    assert served.server.serving.feed.followers == 0
    assert not served.server.serving.subscriptions


def test_well_known_void_describes_the_map(lasting: Served) -> None:
    answer = lasting.get(".well-known/void", headers={"Accept": "text/turtle"})
    graph = rdflib.Graph().parse(data=answer.text, format="turtle")
    base, void = rdflib.URIRef(lasting.map.base), rdflib.Namespace("http://rdfs.org/ns/void#")
    assert (base, rdflib.RDF.type, void.Dataset) in graph
    assert (base, void.sparqlEndpoint, rdflib.URIRef(f"{lasting.url}sparql")) in graph
    (count,) = graph.objects(base, void.triples)
    assert int(str(count)) == len(lasting.get("dump.nq").text.splitlines())
    for dump in graph.objects(base, void.dataDump):
        assert lasting.get(str(dump).removeprefix(lasting.url)).status_code == 200
    front = lasting.get("", headers={"Accept": "text/turtle"})
    assert len(rdflib.Graph().parse(data=front.text, format="turtle")) == len(graph)

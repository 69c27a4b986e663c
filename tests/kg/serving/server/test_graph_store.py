"""The SPARQL 1.1 Graph Store HTTP Protocol against a running server."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING

import pytest
import rdflib
from pyoxigraph import RdfFormat, parse

if TYPE_CHECKING:
    from conftest import Served

MAP = "https://w3id.org/hereabouts/graph/map"
ASSERTIONS = "https://example.org/graphs/notes"
NOTES = f"graphs?graph={ASSERTIONS}"
CUP = "https://example.org/maps/flat/object/1"


def note(text: str) -> bytes:
    return f'<{CUP}> <{rdflib.RDFS.comment}> "{text}" .'.encode()


def notes(served: Served, graph: str = ASSERTIONS) -> set[str]:
    query = f"SELECT ?n WHERE {{ GRAPH <{graph}> {{ <{CUP}> rdfs:comment ?n }} }}"
    return {row["n"] for row in served.rows(query)}


@pytest.mark.parametrize("path", ["graphs/map", f"graphs?graph={MAP}"])
def test_graph_by_path_and_by_name(lasting: Served, path: str) -> None:
    answer = lasting.get(path)
    assert answer.headers["Content-Type"].startswith("text/turtle")
    graph = rdflib.Graph().parse(data=answer.text, format="turtle")
    assert (rdflib.URIRef(CUP), rdflib.RDFS.label, rdflib.Literal("cup 1")) in graph
    assert not list(graph.subjects(rdflib.RDFS.subClassOf))


def test_default_graph_is_the_union(lasting: Served) -> None:
    answer = lasting.get("graphs?default", headers={"Accept": "application/n-triples"})
    text = answer.text
    assert "flat/object/1" in text
    assert "SemanticMap" in text
    assert "subClassOf" in text
    lines = text.splitlines()
    assert len(lines) == len(set(lines))


def test_head_tells_whether_there_is_a_graph(lasting: Served) -> None:
    assert lasting.request("HEAD", "graphs/map").status_code == 200
    assert lasting.request("HEAD", "graphs/nowhere").status_code == 404
    assert lasting.request("HEAD", "graphs/map").content == b""


@pytest.mark.parametrize("path", ["graphs", "graphs?graph=map", "graphs?graph=a:b&default"])
def test_graph_that_is_not_named_rightly_is_a_bad_request(lasting: Served, path: str) -> None:
    assert lasting.get(path).status_code == 400


def send(served, method, path, body=None, kind="text/turtle", **more):
    """The answer to a write by the holder of the token; `more` are headers, with _ for -."""
    given = {name.replace("_", "-"): value for name, value in more.items()}
    headers = {"Content-Type": kind, **served.bearer(), **given}
    return served.request(method, path, data=body, headers=headers)


def test_put_replaces_and_post_adds_in_one_commit_each(served: Served) -> None:
    before = served.map.sequence
    assert send(served, "PUT", NOTES, note("one")).status_code == 201
    assert send(served, "PUT", NOTES, note("two")).status_code == 200
    assert notes(served) == {"two"}
    assert send(served, "POST", NOTES, note("three")).status_code == 200
    assert notes(served) == {"two", "three"}
    assert served.map.sequence == before + 3
    assert send(served, "DELETE", NOTES).ok
    assert served.get(NOTES).status_code == 404
    assert send(served, "DELETE", NOTES).status_code == 404


def test_post_to_the_default_graph_adds_to_graph_map(served: Served) -> None:
    assert send(served, "POST", "graphs?default", note("here")).ok
    assert notes(served, MAP) == {"here"}
    assert send(served, "DELETE", "graphs?default").status_code == 403


@pytest.mark.parametrize(
    ("body", "kind", "status"), [(b"<a> <b> .", "text/turtle", 400), (b"<p>", "text/html", 415)]
)
def test_body_that_does_not_parse_changes_nothing(lasting, body, kind, status):
    before = lasting.map.sequence
    assert send(lasting, "PUT", "graphs/map", body, kind).status_code == status
    assert lasting.map.sequence == before


@pytest.mark.parametrize(("ending", "form"), [("trig", RdfFormat.TRIG), ("nq", RdfFormat.N_QUADS)])
def test_dump_is_the_whole_map(lasting: Served, ending: str, form: RdfFormat) -> None:
    answer = lasting.get(f"dump.{ending}")
    assert set(parse(answer.content, format=form)) == set(lasting.map.engine)


def written(served: Served, method: str, path: str, **headers: str) -> int:
    body = None if method == "DELETE" else note("new")
    return send(served, method, path, body, **headers).status_code


@pytest.mark.parametrize("method", ["PUT", "POST", "DELETE"])
def test_nobody_writes_over_what_they_have_not_seen(served: Served, method: str) -> None:
    written(served, "PUT", NOTES)
    seen = served.get(NOTES).headers["ETag"]
    assert not seen.startswith("W/"), "If-Match takes no weak tags"
    other = served.get(NOTES, headers={"Accept": "application/n-triples"}).headers["ETag"]
    assert other != seen
    send(served, "POST", NOTES, note("another's"))
    before = served.map.sequence
    for tag in (seen, other, f'"x", {seen}', "W/" + served.get(NOTES).headers["ETag"]):
        assert written(served, method, NOTES, If_Match=tag) == 412
    assert served.map.sequence == before
    served.move(1, 2.5)  # another graph's business
    now = served.get(NOTES).headers["ETag"]
    assert written(served, method, NOTES, If_Match=f'"x", {now}') == 200
    assert served.map.sequence > before


def test_a_graph_is_made_only_where_there_is_none(served: Served) -> None:
    assert written(served, "PUT", NOTES, If_Match="*") == 412
    assert written(served, "PUT", NOTES, If_None_Match="*") == 201
    assert written(served, "PUT", NOTES, If_None_Match="*") == 412
    tag = served.get(NOTES).headers["ETag"]
    assert written(served, "POST", NOTES, If_None_Match=tag) == 412
    assert written(served, "POST", NOTES, If_None_Match='"1-ttl"') == 200
    assert written(served, "PUT", NOTES, If_Match="*") == 200
    assert written(served, "DELETE", "graphs/nowhere", If_Match="*") == 404


def test_a_write_may_be_held_to_the_whole_map(served: Served) -> None:
    tag = served.get("graphs?default").headers["ETag"]
    assert written(served, "POST", "graphs?default", If_Match=tag) == 200
    assert written(served, "POST", "graphs?default", If_Match=tag) == 412


def test_of_many_that_write_at_once_over_one_state_one_does(served: Served) -> None:
    written(served, "PUT", NOTES)
    seen = served.get(NOTES).headers["ETag"]

    def put(number: int) -> int:
        return send(served, "PUT", NOTES, note(f"of {number}"), If_Match=seen).status_code

    with ThreadPoolExecutor(8) as writers:
        told = [*writers.map(put, range(8))]
    assert sorted(told) == [200] + [412] * 7
    assert notes(served) == {f"of {told.index(200)}"}


DOCUMENTS = {
    "text/turtle": '<object/1> rdfs:comment "of the map" .',
    "application/ld+json": '{"@id": "object/1", "http://www.w3.org/2000/01/rdf-schema#comment": '
    '"of the map"}',
    "application/rdf+xml": '<rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#" '
    'xmlns:rdfs="http://www.w3.org/2000/01/rdf-schema#"><rdf:Description rdf:about="object/1">'
    "<rdfs:comment>of the map</rdfs:comment></rdf:Description></rdf:RDF>",
    "application/n-triples": f'<{CUP}> <{rdflib.RDFS.comment}> "of the map" .',
}


@pytest.mark.parametrize("form", DOCUMENTS)
@pytest.mark.parametrize(
    ("method", "graph"), [("POST", MAP), *[(m, ASSERTIONS) for m in ("POST", "PUT")]]
)
def test_a_relative_iri_of_a_body_is_the_map_s(lasting, form, method, graph):
    document = DOCUMENTS[form]
    if form == "text/turtle":
        document = f"@prefix rdfs: <{rdflib.RDFS}> . {document}"
    assert lasting.write(f"DELETE WHERE {{ GRAPH <{graph}> {{ ?s rdfs:comment ?n }} }}").ok
    answer = send(lasting, method, f"graphs?graph={graph}", document.encode(), form)
    assert answer.ok, answer.text
    assert notes(lasting, graph) == {"of the map"}


def test_a_graph_with_relative_iris_replaces_itself(lasting: Served) -> None:
    held = lasting.get("graphs/map", headers={"Accept": "application/n-triples"}).text
    relative = held.replace(f"<{lasting.map.base}", "<")
    assert "<object/1>" in relative
    answer = send(lasting, "PUT", "graphs/map", relative.encode())
    assert (answer.json()["added"], answer.json()["removed"]) == (0, 0)


def test_a_base_of_the_document_comes_before_the_map_s(served: Served) -> None:
    document = f'@base <https://example.org/maps/> . <flat/object/1> <{rdflib.RDFS.comment}> "b" .'
    assert send(served, "POST", "graphs/map", document.encode()).ok
    update = 'BASE <https://example.org/> INSERT DATA { <maps/flat/object/1> rdfs:comment "u" }'
    assert served.write(update).ok
    assert served.write('INSERT DATA { <object/1> rdfs:comment "v" }').ok
    assert notes(served, MAP) == {"b", "u", "v"}
    assert {row["n"] for row in served.rows("SELECT ?n { <object/1> rdfs:comment ?n }")} == {
        *("b", "u", "v")
    }


@pytest.mark.parametrize("path", ["dump.foo", "dump.ttl", "dump.trig.gz"])
def test_a_dump_in_another_format_is_not_there(lasting: Served, path: str) -> None:
    answer = lasting.get(path)
    assert answer.status_code == 404
    assert "/dump.trig" in answer.text


def test_many_dumps_at_once_are_all_whole(lasting: Served) -> None:
    whole = lasting.get("dump.nq").content
    with ThreadPoolExecutor(8) as threads:
        dumps = list(threads.map(lambda _: lasting.get("dump.nq"), range(8)))
    assert {answer.status_code for answer in dumps} == {200}
    assert {answer.content for answer in dumps} == {whole}
    assert whole.count(b"\n") == len(lasting.map.engine)

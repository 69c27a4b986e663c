"""Other SPARQL servers as stores."""

import json
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import suppress
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import numpy as np
import pytest
from pyoxigraph import BlankNode, Literal, QueryResultsFormat, parse_query_results

from kg.export.serialization import export_text
from kg.maps.semantic_map import SemanticMap
from kg.model import vocabulary as v
from kg.model.errors import (
    GraphError,
    MapNotFoundError,
    QueryError,
    QueryTimeoutError,
    QueryTooLargeError,
    RemoteError,
    UnreachableError,
)
from kg.model.records import Evidence, MapUpdate, ObjectRecord, PlaceRecord, RobotRecord
from kg.serving.opening import create_map, in_memory_map, open_map, open_or_create_map
from kg.store.sparql_backend import SparqlBackend
from kg.store.sparql_client import SparqlClient
from kg.store.virtuoso import complaint, gives_triples, readable
from tests.conftest import publish, running_server, running_virtuoso

BASE = "https://example.org/house/"


def chairs(semantic_map: SemanticMap, shift: float = 0.0) -> tuple[ObjectRecord, ...]:
    chair = semantic_map.catalogue.find("chair").iri
    seen = Evidence("frame-000001", "house", 5.0, (0.0, 0.0, 9.0, 9.0), 0.5, "net")
    return tuple(
        ObjectRecord(
            f"{BASE}object/{n}",
            chair,
            np.array([n + shift, 1.0, 0.5]),
            confidence=2.0,
            existence=0.5,
            observations=n,
            first_seen=1.0,
            last_seen=5.0,
            place=f"{BASE}place/1",
            evidence=seen,
        )
        for n in range(1, 6)
    )


def fill(semantic_map: SemanticMap) -> None:
    kitchen, office = (semantic_map.catalogue.find(name).iri for name in ("kitchen", "office"))
    place = f"{BASE}place/1"
    robot = RobotRecord(np.array([0.0, 1.0, 1.2]), 0.5, 5.0)
    first = PlaceRecord(place, "place 1", 0.0, 9.0, 0.0, 5.0, 1, {kitchen: 0.7, office: 0.3})
    second = PlaceRecord(place, "place 1", 0.0, 9.0, 0.0, 5.0, 2, {kitchen: 1.0})
    semantic_map.apply(MapUpdate(objects=chairs(semantic_map), places=(first,), robot=robot))
    moved = chairs(semantic_map, shift=0.25)
    semantic_map.apply(MapUpdate(objects=moved[1:], removed=(moved[0].iri,), places=(second,)))


@pytest.fixture(scope="module", params=[running_server, running_virtuoso])
def filled(request, tmp_path_factory):
    """The same map published on a server and in memory."""
    with (
        request.param(tmp_path_factory.mktemp("server")) as address,
        in_memory_map(title="house", base=BASE) as local,
    ):
        fill(local)
        publish(local, address)
        with open_map(address, read_only=True) as remote:
            yield remote, local


@pytest.fixture
def server_with_map(sparql_server: str) -> str:
    with in_memory_map(title="house", base=BASE) as local:
        publish(local, sparql_server)
    return sparql_server


@pytest.mark.parametrize(
    ("question", "parameters"),
    [
        ("objects-by-category", {"category": "food"}),
        ("objects-in-place", {"place": "1"}),
        ("objects-in-box", {"xmin": 0, "xmax": 3, "ymin": 0, "ymax": 3}),
        ("place-beliefs", {}),
        ("summary", {}),
        ("goals-known", {"category": "chair"}),
        ("goals-places", {"category": "banana"}),
        ("why-object", {"object": BASE + "object/3"}),
    ],
)
def test_shipped_questions_are_answered_alike(filled, question, parameters):
    remote, local = filled
    assert isinstance(remote.engine, SparqlBackend)
    assert remote.query(question, **parameters) == local.query(question, **parameters)


def test_a_distance_is_right_although_servers_know_no_square_root(filled):
    remote, _ = filled
    rows = remote.query("objects-within-radius", x=2.25, y=1.0, radius=2.5).records()
    assert [row["label"] for row in rows] == ["chair 2", "chair 3", "chair 4"]
    assert [row["distance"] for row in rows] == pytest.approx([0.0, 1.0, 2.0], abs=1e-6)


def test_construct_and_ask_work(filled: tuple[SemanticMap, SemanticMap]) -> None:
    remote, _ = filled
    table = remote.query("CONSTRUCT { ?o here:x ?x } WHERE { ?o a here:Chair ; here:x ?x }")
    assert len(table.rows) == 4
    assert "here:x" in table.to_turtle()
    assert remote.query("ASK { ?o a here:Sofa }").rows == ((False,),)


def test_from_narrows_what_is_read(filled: tuple[SemanticMap, SemanticMap]) -> None:
    remote, _ = filled
    query = "SELECT (COUNT(*) AS ?n) FROM graph:dataset WHERE { ?o a here:Chair }"
    assert remote.query(query).rows == ((0,),)


def test_a_published_map_is_exported_as_its_folder(filled: tuple[SemanticMap, SemanticMap]) -> None:
    remote, local = filled
    assert [o.iri for o in remote.objects()] == [f"{BASE}object/{n}" for n in range(2, 6)]
    assert remote.places() == local.places()
    there, here = (export_text(one, "ttl", ontology=False) for one in filled)
    assert there == here.removesuffix("\ngraph:dataset here:sequence 2 .\n")
    assert remote.sequence == local.sequence == 2


@pytest.mark.parametrize("write", [open_map, open_or_create_map, create_map])
@pytest.mark.parametrize("is_empty", [True, False])
def test_nobody_writes_a_map_on_a_server_of_another_make(write, is_empty, request):
    address = request.getfixturevalue("sparql_server" if is_empty else "server_with_map")
    told = f"http://someone:secret@{address.removeprefix('http://')}"
    with pytest.raises(GraphError, match=f"hereabouts publish FOLDER --to {address}$") as caught:
        write(told)
    assert "\n" not in str(caught.value)
    endpoint = SparqlClient.at(address)
    assert bool(endpoint.ask("ASK { GRAPH ?g { ?s ?p ?o } }")) is not is_empty
    endpoint.close()


def test_a_server_without_a_map_is_said_to_have_none(sparql_server: str) -> None:
    with pytest.raises(MapNotFoundError, match="no map at http://127"):
        open_map(sparql_server, read_only=True)


def test_a_reader_writes_nothing(filled: tuple[SemanticMap, SemanticMap]) -> None:
    with pytest.raises(GraphError, match="reading only"):
        fill(filled[0])


def test_a_query_that_does_not_parse_is_one_line(server_with_map: str) -> None:
    with (
        open_map(server_with_map, read_only=True) as remote,
        pytest.raises(QueryError, match="does not parse at line 2") as caught,
    ):
        remote.query("SELECT *\nWHERE { ?s ?p }")
    assert "\n" not in str(caught.value)


def test_rdflib_needs_the_store_here(filled: tuple[SemanticMap, SemanticMap]) -> None:
    with pytest.raises(GraphError, match="is on a server"):
        _ = filled[0].dataset


def test_nobody_listening_is_one_line_without_the_password() -> None:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]  # bound, so that nobody else listens there meanwhile
        with pytest.raises(UnreachableError, match=f"127.0.0.1:{port} .*refused") as caught:
            open_map(f"http://someone:secret@127.0.0.1:{port}")
    assert "secret" not in str(caught.value)


def test_an_answer_cut_off_by_a_time_limit_is_no_answer(start_server: Callable[..., str]) -> None:
    hasty = start_server("hasty", "--timeout-s", "1")
    with in_memory_map(base=BASE) as local:
        publish(local, hasty)
    with open_map(hasty, read_only=True) as semantic_map:
        # rows from the first moment on: what such a server joins beforehand, it does not break off
        runaway = "SELECT ?a ?c { ?a ?p ?b . ?c ?q ?d }"
        with pytest.raises(RemoteError, match="broke off its answer"):
            semantic_map.query(runaway)
        assert semantic_map.query("objects").rows == ()


@pytest.fixture
def chatty() -> Iterator[str]:
    """A web server that is no SPARQL server."""
    listener = socket.create_server(("127.0.0.1", 0))
    reply = b"HTTP/1.1 200 OK\r\nContent-Type: text/html\r\nContent-Length: 5\r\n\r\nhello"

    def serve() -> None:
        while True:
            try:
                connection, _ = listener.accept()
            except OSError:
                return
            with connection:
                head = b""
                while b"ASK" not in head:
                    head += connection.recv(4096)
                connection.sendall(reply.replace(b"\r\n\r\n", b"\r\nConnection: close\r\n\r\n"))

    thread = threading.Thread(target=serve, daemon=True)
    thread.start()
    yield f"http://127.0.0.1:{listener.getsockname()[1]}"
    listener.shutdown(socket.SHUT_RDWR)
    listener.close()
    thread.join()


def test_a_web_page_is_no_map(chatty: str) -> None:
    with pytest.raises(RemoteError, match="does not speak SPARQL"):
        open_map(chatty)


def cell(value: str, kind: str) -> dict[str, str]:
    return {"type": "typed-literal", "datatype": v.XSD + kind, "value": value}


def test_results_are_read_as_they_were_written() -> None:
    row = {
        "d": cell("1000000000", "double"),
        "small": cell("1e-07", "double"),
        "b": cell("1", "boolean"),
        "n": {"type": "bnode", "value": "nodeID://b10001"},
        "i": cell("3", "integer"),
        "l": {"type": "literal", "xml:lang": "en", "value": "nodeID://b10001"},
    }
    told = {"head": {"link": [], "vars": [*row]}, "results": {"bindings": [row]}}
    body = readable(json.dumps(told).encode())
    (found,) = parse_query_results(body, format=QueryResultsFormat.JSON)
    assert [found[name] for name in row] == [
        *(Literal(1e9), Literal(1e-7), Literal(True), BlankNode("b10001")),
        *(Literal(3), Literal("nodeID://b10001", language="en")),
    ]


def test_only_construct_and_describe_give_triples() -> None:
    assert gives_triples('PREFIX x: <http://select/> # ask\nCONSTRUCT { ?s ?p "select" } WHERE {}')
    assert gives_triples("DESCRIBE <urn:select>")
    assert not gives_triples("BASE <urn:construct> SELECT ?describe {}")
    assert not gives_triples("ASK { ?s ?p 'describe' }")


def test_a_complaint_names_the_line_and_not_the_query() -> None:
    said = "Virtuoso 37000 Error SP030: SPARQL compiler, line 2: syntax error\n\nSPARQL query:\nASK"
    assert complaint(said) == "error at 2:1: syntax error"
    assert complaint("Virtuoso 42000 Error SR186:  no permission").endswith("SR186: no permission")


class _Dribbling(BaseHTTPRequestHandler):
    """Sends something now and then, for longer than anybody waits."""

    ended = threading.Event()

    def do_POST(self) -> None:
        self.rfile.read(int(self.headers["Content-Length"]))
        self.send_response(200)
        self.send_header("Content-Type", "application/sparql-results+json")
        self.end_headers()
        with suppress(OSError):
            for _ in range(200):
                if self.ended.wait(0.05):
                    break
                self.wfile.write(b" " * 4096)
                self.wfile.flush()

    def log_message(self, format: str, *args: object) -> None:
        pass


def test_an_answer_that_goes_on_ends_at_the_limits_of_time_and_size() -> None:
    server = ThreadingHTTPServer(("127.0.0.1", 0), _Dribbling)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    address = f"http://127.0.0.1:{server.server_port}/sparql"
    client = SparqlClient(address, address, address)
    try:
        for seconds, size, error in (
            (0.5, 1 << 40, QueryTimeoutError),
            (600.0, 20_000, QueryTooLargeError),
        ):
            with pytest.raises(error):
                client.fetch("ASK {}", (), seconds=seconds, max_bytes=size)
    finally:
        _Dribbling.ended.set()
        client.close()
        server.shutdown()
        server.server_close()

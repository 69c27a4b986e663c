"""Web pages of elsewhere, clients that dawdle, crowds, and what is counted of them."""

from __future__ import annotations

import logging
import socket
import time
from contextlib import ExitStack, suppress
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

import pytest
import requests

from kg.serving.server import Limits
from tests.kg.serving.server.raw_answers import whole_answer

if TYPE_CHECKING:
    from collections.abc import Callable

    from conftest import Served

HERE, THERE = "https://app.example", "https://evil.example"
ASK = "sparql?query=ASK%20%7B%7D"


def allowed(answer: requests.Response) -> dict[str, str]:
    return {k.lower(): v for k, v in answer.headers.items() if k.lower().startswith("access-")}


@pytest.mark.parametrize("method", ["GET", "OPTIONS"])
def test_scripts_of_other_pages_get_nothing_by_default(lasting: Served, method: str) -> None:
    headers = {"Origin": THERE, "Access-Control-Request-Method": "POST"}
    for path in (ASK, "object/1", "graphs/map", "health"):
        answer = lasting.request(method, path, headers=headers)
        assert answer.status_code == (403 if method == "GET" else 204)
        assert allowed(answer) == {}
        assert answer.headers["Cross-Origin-Resource-Policy"] == "same-origin"


def test_scripts_of_an_allowed_origin_may_ask(serve: Callable[..., Served]) -> None:
    served = serve(allow_origins=(HERE,))
    asked = {"Access-Control-Request-Method": "POST"}
    preflight = served.request("OPTIONS", "sparql", headers={"Origin": HERE, **asked})
    assert preflight.status_code == 204
    told = allowed(preflight)
    assert told["access-control-allow-origin"] == HERE
    assert "POST" in told["access-control-allow-methods"]
    assert {"Authorization", "Content-Type"} <= set(
        told["access-control-allow-headers"].split(", ")
    )
    answer = served.get(ASK, headers={"Origin": HERE})
    assert allowed(answer)["access-control-allow-origin"] == HERE
    assert "Origin" in answer.headers["Vary"]
    assert "access-control-allow-credentials" not in allowed(answer)
    refused = served.get("nowhere", headers={"Origin": HERE})
    assert (refused.status_code, len(allowed(refused)) > 0) == (404, True)


@pytest.mark.parametrize("origin", [THERE, "null", HERE + ".evil.example", HERE.upper(), "*"])
def test_the_list_of_origins_is_exact(serve: Callable[..., Served], origin: str) -> None:
    served = serve(allow_origins=(HERE,))
    answer = served.get(ASK, headers={"Origin": origin})
    assert answer.status_code == 403
    assert allowed(answer) == {}
    assert "Origin" in answer.headers["Vary"]


def test_scripts_of_all_pages_may_read_where_the_map_is_open_to_them(serve):
    served, there = serve(allow_origins=("*", HERE)), {"Origin": THERE}
    preflight = allowed(served.request("OPTIONS", "sparql", headers=there))
    assert preflight["access-control-allow-origin"] == "*"
    assert "Authorization" not in preflight["access-control-allow-headers"]
    assert "PUT" not in preflight["access-control-allow-methods"]
    for answer in (
        served.get("object/1", headers=there),
        served.post("sparql", data={"query": "ASK {}"}, headers=there),
    ):
        assert answer.status_code == 200
        assert allowed(answer)["access-control-allow-origin"] == "*"
    fact = b"<urn:a> <urn:b> <urn:c> ."
    kind = {"Content-Type": "application/n-triples", **served.bearer()}
    for origin, status in ((THERE, 403), ("*", 403), (HERE, 200)):
        written = served.post("graphs/map", data=fact, headers=kind | {"Origin": origin})
        assert written.status_code == status
    assert allowed(served.get(ASK, headers={"Origin": HERE}))["access-control-allow-origin"] == HERE


def connect(served: Served, sent: bytes = b"") -> socket.socket:
    address = urlsplit(served.url)
    client = socket.create_connection((address.hostname, address.port), timeout=120)
    client.sendall(sent)
    return client


def answers_in_the_end(served: Served) -> bool:
    """Whether it answers; not at once, where it has others to let go of or we are too slow."""
    end = time.monotonic() + 120
    while time.monotonic() < end:
        with suppress(requests.ConnectionError):
            answer = served.get(ASK)
            if answer.status_code != 503:
                return answer.status_code == 200
        time.sleep(0.05)
    return False


HEAD = b"GET /health HTTP/1.1\r\nHost: localhost\r\n"


def test_half_a_head_is_hung_up_on_and_one_sent_byte_by_byte(serve: Callable[..., Served]) -> None:
    served = serve(limits=Limits(idle_seconds=0.5))
    parts = b"", b"GET /hea", HEAD, HEAD + b"X-A: " + b"a" * 1000
    with ExitStack() as clients:
        for client in [clients.enter_context(connect(served, part)) for part in parts]:
            assert whole_answer(client) == b""
    assert answers_in_the_end(served)
    client = connect(served)
    with pytest.raises((BrokenPipeError, ConnectionResetError)):
        for byte in (HEAD + b"X-Slow: " + b"s" * 4000).decode():
            client.sendall(byte.encode())
            time.sleep(0.02)
    client.close()
    assert answers_in_the_end(served)


def test_a_body_that_is_told_to_be_too_long_is_refused_before_it_comes(serve):
    served = serve(limits=Limits(body=1000, body_seconds=5))
    head = b"POST /sparql HTTP/1.1\r\nHost: localhost\r\nContent-Length: 1001\r\n"
    with connect(served, head + b"Content-Type: application/sparql-query\r\n\r\nASK") as client:
        assert whole_answer(client).startswith(b"HTTP/1.1 413 ")


def test_half_a_body_is_refused_in_time(serve: Callable[..., Served]) -> None:
    served = serve(limits=Limits(body_seconds=0.5))
    head = b"POST /sparql HTTP/1.1\r\nHost: localhost\r\nContent-Length: 100\r\n"
    with connect(served, head + b"Content-Type: application/sparql-query\r\n\r\nASK") as client:
        assert whole_answer(client).startswith(b"HTTP/1.1 408 ")
    assert served.get(ASK).status_code == 200


@pytest.mark.parametrize(
    "sent",
    [
        b"\x16\x03\x01\x02\x00\x01",
        b"GET\r\n\r\n",
        b"\x00" * 70_000,
        b"GET / HTTP/1.1\r\nHost: localhost\r\nTransfer-Encoding: nonsense\r\n\r\n",
        b"POST /sparql HTTP/1.1\r\nHost: localhost\r\nContent-Length: -5\r\n\r\n",
    ],
)
def test_what_is_no_http_is_refused(lasting: Served, sent: bytes) -> None:
    served = lasting
    with connect(served) as client:
        try:
            client.sendall(sent)
            client.shutdown(socket.SHUT_WR)
        except OSError:
            pass  # it was hung up on while still sending
        told = whole_answer(client)
    assert told == b"" or told.split()[1][:1] in (b"4", b"5")
    assert served.get(ASK).status_code == 200


def parsed(text: str) -> dict[str, tuple[str, dict[str, float]]]:
    """Prometheus' text format 0.0.4: family -> type, and each sample's value; strict."""
    families: dict[str, tuple[str, dict[str, float]]] = {}
    helped, name = "", ""
    for line in text.splitlines():
        if line.startswith("# HELP "):
            helped = line.split(" ", 3)[2]
            assert line.split(" ", 3)[3]
        elif line.startswith("# TYPE "):
            _, _, name, kind = line.split(" ")
            assert name == helped and name not in families
            assert kind in ("counter", "gauge", "histogram")
            families[name] = (kind, {})
        else:
            sample, _, value = line.rpartition(" ")
            bare = sample.partition("{")[0]
            ends = ("_bucket", "_sum", "_count") if families[name][0] == "histogram" else ("",)
            assert bare in {name + end for end in ends}
            assert "{" not in sample or sample.endswith('"}')
            assert sample not in families[name][1]
            families[name][1][sample] = float(value)
    return families


def test_metrics_are_prometheus_text_and_count_right(served: Served) -> None:
    for _ in range(3):
        served.get(ASK)
    served.get("a/path/of/a/stranger")
    answer = served.get("metrics")
    assert answer.headers["Content-Type"].startswith("text/plain; version=0.0.4")
    assert answer.text.endswith("\n")
    families = parsed(answer.text)
    _, requests_ = families["hereabouts_http_requests_total"]
    told = 'hereabouts_http_requests_total{route="/sparql",method="GET",status="200"}'
    assert requests_[told] == 3
    assert "stranger" not in answer.text
    kind, times = families["hereabouts_http_request_seconds"]
    assert kind == "histogram"
    buckets = [
        v
        for s, v in times.items()
        if s.startswith('hereabouts_http_request_seconds_bucket{route="/sparql"')
    ]
    assert buckets == sorted(buckets) and buckets[-1] == 3
    assert times['hereabouts_http_request_seconds_count{route="/sparql"}'] == 3
    assert families["hereabouts_objects"] == ("gauge", {"hereabouts_objects": 2.0})
    assert families["hereabouts_sequence"][1] == {"hereabouts_sequence": 1.0}


def test_the_number_of_objects_is_the_summarys(served: Served) -> None:
    gizmo = served.map.ontology.learn(["gizmo"], "object", model="net")["gizmo"]
    steps = (
        "INSERT DATA { <object/9> a here:Cup ; here:x 1 ; here:y 1 }",
        f"INSERT DATA {{ <http://example.org/mine> a <{gizmo}> ; here:x 1 ; here:y 1 }}",
        "DELETE DATA { <object/9> a here:Cup } ; INSERT DATA { <object/9> a here:Bowl }",
        'DELETE WHERE { <object/9> ?p ?o } ; INSERT DATA { <place/1> rdfs:comment "none" }',
    )
    for update, count in zip(steps, (3, 4, 4, 3), strict=True):
        assert served.write(update).status_code == 200
        (objects,) = parsed(served.get("metrics").text)["hereabouts_objects"][1].values()
        rows = served.map.query("summary").records()
        assert objects == count == sum(int(str(row["count"])) for row in rows), update


def test_the_log_has_no_token_and_no_query(served, caplog):
    with caplog.at_level(logging.DEBUG):
        served.write("INSERT DATA { GRAPH graph:map { <urn:x> rdfs:comment 'confidential' } }")
        served.get("sparql", params={"query": "SELECT * { ?confidential ?p ?o }"})
        wrong = {"Authorization": "Bearer guessed-confidential-token"}
        served.post("sparql", data={"update": "CLEAR ALL"}, headers=wrong)
        served.get("health?token=confidential")
    mine = [r.getMessage() for r in caplog.records if r.name.startswith(("hereabouts", "uvicorn"))]
    assert len(mine) >= 4
    assert any("/sparql" in line for line in mine)
    told = "\n".join(mine)
    assert "confidential" not in told
    assert served.bearer()["Authorization"].split()[1] not in told
    assert served.bearer()["Authorization"].split()[1] not in repr(served.server.settings)

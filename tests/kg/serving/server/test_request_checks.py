"""Who may ask at all: names of the server, pages elsewhere, and tokens of private maps."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import pytest
import requests

from kg.model.errors import ServerError
from kg.serving.server import BearerTokens, Settings

if TYPE_CHECKING:
    from conftest import Served

READER = "a-token-that-only-reads"
ASK = "sparql?query=ASK%20%7B%7D"
PATHS = (
    *("", ASK, "sparql", "object/1", "resource?iri=urn:x", "graphs/map", "graphs?default"),
    *("dump.trig", "dump.nq", ".well-known/void", "assertions", "log?iri=object/1", "diff?from=0"),
    *("why?iri=object/1", "timemap?iri=object/1", "changes", "changes?since=0", "health"),
    *("metrics", "subscribe?query=ASK%20%7B%7D", "queries", "find?object=cup", "nowhere/at/all"),
)


@pytest.mark.parametrize(
    ("host", "status"),
    [
        ("localhost", 200),
        ("LOCALHOST:1", 200),
        ("127.0.0.1:8008", 200),
        ("[::1]:8008", 200),
        ("evil.example", 421),
        ("127.0.0.1.evil.example", 421),
        ("10.0.0.1", 421),
        ("[::1]evil", 400),
        ("[::1]evil:80", 400),
        ("localhost:80:80", 400),
        ("localhost@evil.example", 400),
        ("local host", 400),
        ("[evil", 400),
        ("", 400),
    ],
)
def test_on_loopback_the_server_answers_to_this_machines_names(lasting, host, status):
    assert lasting.get("health", headers={"Host": host}).status_code == status


def test_another_address_of_loopback_answers_to_itself(serve: Callable[..., Served]) -> None:
    served = serve(host="127.0.0.2")
    assert served.url.startswith("http://127.0.0.2:")
    assert served.get(ASK).json()["boolean"] is True


@pytest.mark.parametrize(
    ("host", "status"),
    [
        ("maps.example.org", 200),
        ("Maps.Example.org:443", 200),
        ("192.168.7.5:8008", 200),
        ("[fd00::1]", 200),
        ("localhost", 200),
        ("evil.example", 421),
        ("maps.example.org.evil.example", 421),
    ],
)
def test_off_loopback_it_answers_to_the_names_it_was_given_and_to_addresses(serve, host, status):
    served = serve(host="0.0.0.0", public_hosts=("maps.example.org",))
    url = served.url.replace("0.0.0.0", "127.0.0.1")
    answer = requests.get(url + "health", headers={"Host": host}, timeout=60)
    assert answer.status_code == status
    assert status == 200 or "--public-host" in answer.text


CROSS = {"Sec-Fetch-Site": "cross-site", "Sec-Fetch-Mode": "no-cors"}
LINK = {"Sec-Fetch-Site": "cross-site", "Sec-Fetch-Mode": "navigate", "Sec-Fetch-Dest": "document"}


@pytest.mark.parametrize("site", ["cross-site", "same-site", "CROSS-SITE"])
@pytest.mark.parametrize("path", [ASK, "object/1", "", "dump.nq", "health", "changes"])
def test_scripts_and_pictures_of_pages_elsewhere_are_refused(lasting, path, site):
    for mode in ("no-cors", "cors"):
        headers = {"Sec-Fetch-Site": site, "Sec-Fetch-Mode": mode, "Origin": "https://evil.example"}
        assert lasting.get(path, headers=headers).status_code == 403


@pytest.mark.parametrize(
    ("host", "origin", "status"),
    [
        ("localhost", "https://evil.example", 403),
        ("localhost", "null", 403),
        ("localhost", "http://localhost:3000", 403),
        ("localhost:8008", "http://localhost", 403),
        ("localhost", "http://localhost.evil.example", 403),
        ("localhost", "file://localhost", 403),
        ("localhost", "", 403),
        ("localhost", "http://localhost", 200),
        ("localhost:80", "http://localhost", 200),
        ("Localhost:8008", "HTTP://localhost:8008", 200),
        ("localhost", "https://localhost", 200),
    ],
)
def test_without_fetch_metadata_the_origin_has_to_be_that_of_the_host(
    lasting: Served, host: str, origin: str, status: int
) -> None:
    told = {"Host": host, "Origin": origin}
    assert lasting.get("health", headers=told).status_code == status
    assert lasting.post("sparql", data={"query": "ASK {}"}, headers=told).status_code == status


@pytest.mark.parametrize("name", ["Accept", "If-None-Match", "Accept-Datetime", "X-Whatever"])
def test_long_headers_are_refused_before_they_are_parsed(lasting: Served, name: str) -> None:
    assert lasting.get("object/1", headers={name: "a/b;q=0.1," * 401}).status_code == 431
    assert lasting.get("object/1", headers={"Cookie": "a=b; " * 2000}).status_code == 200


def test_forms_and_frames_of_pages_elsewhere_are_refused(lasting: Served) -> None:
    form = lasting.post("sparql", data={"query": "ASK {}"}, headers=LINK)
    frame = lasting.get("object/1", headers=LINK | {"Sec-Fetch-Dest": "iframe"})
    assert (form.status_code, frame.status_code) == (403, 403)


def test_links_lead_to_things_but_run_no_query(lasting: Served) -> None:
    assert lasting.get("object/1", headers=LINK).status_code == 200
    assert lasting.get("", headers=LINK).status_code == 200
    assert lasting.get(ASK, headers=LINK).status_code == 403


def test_own_pages_typed_addresses_and_allowed_origins_are_answered(serve):
    served = serve(allow_origins=("https://app.example",))
    for site in ("same-origin", "none"):
        assert served.get(ASK, headers={"Sec-Fetch-Site": site}).status_code == 200
    allowed = {**CROSS, "Sec-Fetch-Mode": "cors", "Origin": "https://app.example"}
    assert served.get(ASK, headers=allowed).status_code == 200
    assert served.get(ASK, headers=allowed | {"Origin": "null"}).status_code == 403


@pytest.mark.parametrize("path", PATHS)
def test_a_private_map_tells_strangers_nothing(private: Served, path: str) -> None:
    for headers in ({}, private.bearer("a-token-that-somebody-guessed"), {"Authorization": "Bob"}):
        answer = private.get(path, headers=headers)
        assert answer.status_code == 401
        assert answer.headers["WWW-Authenticate"].startswith("Bearer")
        assert "flat" not in answer.text


@pytest.mark.parametrize("path", ["", "console"])
def test_pages_of_a_private_map_ask_for_a_token_and_tell_nothing(private, path):
    page = private.get(path, headers={"Accept": "text/html"})
    assert page.status_code == 200
    assert 'id="entry-token"' in page.text
    assert "flat" not in page.text
    admitted = private.get(path, headers={"Accept": "text/html", **private.bearer(READER)})
    assert 'id="entry-token"' not in admitted.text
    assert "flat" in admitted.text


@pytest.mark.parametrize("path", [ASK, "object/1", "graphs/map", "dump.nq", "log?iri=object/1"])
def test_a_private_map_is_read_with_either_token(private: Served, path: str) -> None:
    for headers in (private.bearer(READER), private.bearer()):
        assert private.get(path, headers=headers).status_code == 200


def test_feeds_of_a_private_map_are_followed_with_a_reading_token(private: Served) -> None:
    with private.stream("changes", {"since": 0}, **private.bearer(READER)) as stream:
        assert stream.next()[1] == "change"


def test_a_reading_token_writes_nothing(private: Served) -> None:
    before = private.map.sequence
    update = {"update": "INSERT DATA { <object/1> rdfs:comment 'x' }"}
    headers = private.bearer(READER)
    assert private.post("sparql", data=update, headers=headers).status_code == 401
    assert private.request("DELETE", "graphs/assertions", headers=headers).status_code == 401
    assert private.post("numbers", json={}, headers=headers).status_code == 401
    assert private.map.sequence == before
    assert private.write(update["update"]).status_code == 200


def test_a_token_is_for_one_of_both() -> None:
    tokens = BearerTokens((("bob", READER.encode()),))
    with pytest.raises(ServerError, match="both writes and only reads"):
        Settings(tokens=tokens, read_tokens=tokens)
    with pytest.raises(ServerError, match="--read-token-file"):
        Settings(host="0.0.0.0")
    Settings(host="0.0.0.0", read_tokens=tokens)
    with pytest.raises(ServerError, match="no name of a host"):
        Settings(public_hosts=("http://maps.example.org/",))


WRITING = [
    *[("POST", path) for path in ("sparql", "assertions", "rooms", "records", "numbers", "labels")],
    ("POST", "restore"),
    ("DELETE", "assertions?iri=object/1&property=label"),
    *[(method, "graphs/map") for method in ("PUT", "POST", "DELETE")],
]


@pytest.mark.parametrize(("method", "path"), WRITING)
def test_writing_needs_a_token_at_every_door(lasting: Served, method: str, path: str) -> None:
    before = lasting.map.sequence
    kind = {"sparql": "application/sparql-update", "graphs/map": "text/turtle"}
    headers = {"Content-Type": kind.get(path, "application/json")}
    for token in ({}, lasting.bearer("another-token-of-nobody-0")):
        answer = lasting.request(method, path, data=b"{}", headers={**headers, **token})
        assert answer.status_code == 401
        assert answer.headers["WWW-Authenticate"].startswith("Bearer")
    assert lasting.map.sequence == before


def test_a_server_without_tokens_only_reads(serve: Callable[..., Served]) -> None:
    served = serve(tokens=BearerTokens())
    before = served.map.sequence
    for method, path in WRITING:
        kind = {"Content-Type": "application/sparql-update"} if path == "sparql" else {}
        assert served.request(method, path, data=b"{}", headers=kind).status_code == 403
    assert served.get("assertions").json()["assertions"] == []
    assert served.map.sequence == before

"""Published maps: merging, and targets that fail."""

import http.server
import json
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from hereabouts.cli import main
from kg.model.errors import GraphError, MapNotFoundError, RemoteError
from kg.serving.opening import create_map, in_memory_map
from kg.serving.publishing import Publisher, PublishTarget, merged
from kg.serving.server import MapServer
from tests.conftest import running_server
from tests.kg.serving.publishing.test_publisher import NORTH, SOUTH, own, published, see, until
from tests.small_server import SMALL


def test_a_target_that_is_killed_and_started_again_is_continued(tmp_path: Path) -> None:
    with in_memory_map(title="north", base=NORTH) as north:
        see(north, "chair", 1.0)
        with MapServer(north, SMALL) as server:
            lines: list[str] = []
            with running_server(tmp_path / "target") as url:
                port = int(url.rpartition(":")[2])
                publisher = Publisher(server.url, PublishTarget(url), lines.append)
                following = threading.Thread(target=publisher.follow)
                following.start()
                for step in range(20):
                    see(north, "cup", float(step))
                until(lambda: publisher.acknowledged > 5, "nothing was published")
            for step in range(20):
                see(north, "banana", float(step))
            until(lambda: any("waits" in line for line in lines), "the death went unnoticed")
            with running_server(tmp_path / "target", port=port) as url:
                until(lambda: publisher.acknowledged == north.sequence, "not taken up again")
                assert published(url) == own(north.engine)
                publisher.stop()
                following.join()


class _Guarded(http.server.BaseHTTPRequestHandler):
    """Answers only who brings the token, and knows nothing."""

    seen: list[tuple[str, str | None]] = []  # noqa: RUF012

    def do_POST(self) -> None:
        self.rfile.read(int(self.headers["Content-Length"]))
        token = self.headers["Authorization"]
        self.seen.append((self.path, token))
        body = b'{"head": {}, "boolean": true}'
        self.send_response(200 if token == "Bearer let-me-in" else 401)
        self.send_header("Content-Type", "application/sparql-results+json")
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, *words: object) -> None:
        """Nothing."""


@pytest.fixture
def guarded() -> Iterator[str]:
    _Guarded.seen.clear()
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), _Guarded) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield f"http://127.0.0.1:{server.server_port}"
        server.shutdown()
        thread.join()


def test_the_token_of_the_file_goes_to_the_target_and_nowhere_else(guarded, tmp_path, monkeypatch):
    monkeypatch.setenv("HEREABOUTS_TOKEN", "of-the-map-0123456789")
    with pytest.raises(RemoteError, match="401"):
        PublishTarget(guarded, "wrong")
    PublishTarget(guarded, "let-me-in").close()
    assert {token for _, token in _Guarded.seen} == {"Bearer wrong", "Bearer let-me-in"}


@pytest.mark.parametrize("content", ["", "two tokens", None])
def test_a_token_file_without_one_token_is_one_line(content, tmp_path, capsys):
    file = tmp_path / "token"
    if content is not None:
        file.write_text(content)
    words = ["publish", "kitchen.map", "--to", "http://127.0.0.1:9", "--token-file", str(file)]
    assert main(words) == 1
    assert "token file" in capsys.readouterr().err


def test_a_target_that_does_not_answer_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["publish", "kitchen.map", "--to", "http://127.0.0.1:9"]) == 1
    assert "no server answers at http://127.0.0.1:9" in capsys.readouterr().err


@pytest.fixture
def north(tmp_path: Path) -> str:
    path = tmp_path / "north.map"
    with create_map(path, base=NORTH) as made:
        see(made, "cup", 1.0)
        see(made, "chair", 2.0)
    return str(path)


def test_folders_and_served_maps_are_joined_in_one_query(north: str) -> None:
    with in_memory_map(base=SOUTH) as south:
        see(south, "chair", 1.0)
        south.update('INSERT DATA { <object/1> rdfs:comment "worn" }')
        with MapServer(south, SMALL) as server, merged([north, server.url]) as both:
            query = "SELECT ?a ?b { ?a a here:Cup ; here:x ?x . ?b a here:Chair ; here:x ?x }"
            assert both.query(query).rows == ((f"{NORTH}object/1", f"{SOUTH}object/1"),)
            assert len(both.query("objects-by-category", category="chair").rows) == 2
            assert own(south.engine) <= own(both.engine)
            assert both.query("SELECT ?x { <object/1> here:x ?x }").rows == ((1.0,),)
            with pytest.raises(GraphError, match="open for reading only"):
                both.update("DELETE WHERE { ?s ?p ?o }")


def test_the_command_merges_its_members(north, tmp_path, capsys):
    south = tmp_path / "south.map"
    with create_map(south, base=SOUTH) as made:
        see(made, "cup", 3.0)
    words = ["ask", "--member", north, "--member", str(south), "--json"]
    assert main([*words, "objects-by-category", "-p", "category=cup"]) == 0
    rows = json.loads(capsys.readouterr().out)
    assert {row["object"] for row in rows} == {f"{NORTH}object/1", f"{SOUTH}object/1"}
    assert main([*words, "-e", "SELECT (COUNT(*) AS ?n) { ?o here:existence ?e }"]) == 0
    assert json.loads(capsys.readouterr().out) == [{"n": 3}]
    with pytest.raises(SystemExit):
        main([*words, "objects", "--at", "#1"])


def test_a_member_that_is_missing_or_given_twice_is_one_line(north: str, tmp_path: Path) -> None:
    with pytest.raises(MapNotFoundError):
        merged([north, str(tmp_path / "gone.map")])
    with pytest.raises(GraphError, match="is the same map as"):
        merged([north, north])

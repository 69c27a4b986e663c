"""Doors over HTTP: one check of Host, Origin and length, for the map and for the agents' tools."""

import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest
import requests

from hereabouts.agents.map_context import MapContext
from hereabouts.agents.tool_server import PATH, ToolHttpServer
from kg.serving.opening import in_memory_map
from kg.serving.server import BearerTokens, MapServer
from kg.serving.workers.local_evaluation import LimitedQueries
from tests.doors.doors import PATIENCE, RefusedError, command
from tests.small_server import SMALL

GREETING = {
    "jsonrpc": "2.0",
    "id": 1,
    "method": "initialize",
    "params": {
        "protocolVersion": "2025-06-18",
        "capabilities": {},
        "clientInfo": {"name": "a test", "version": "1"},
    },
}
SITE = "Sec-Fetch-Site"


@pytest.fixture(scope="module")
def servers() -> Iterator[tuple[str, str]]:
    """The addresses of the map's endpoint and of the agents' tools."""
    with (
        in_memory_map(title="flat") as semantic_map,
        LimitedQueries(semantic_map) as queries,
        MapServer(semantic_map, SMALL) as server,
        ToolHttpServer(MapContext(semantic_map), queries, SMALL) as tools,
    ):
        yield f"{server.url}sparql", tools.url.rstrip("/") + PATH


def asked(servers: tuple[str, str], headers: dict[str, str]) -> list[requests.Response]:
    """The answers to a good request with further headers, at both doors."""
    sparql, tools = servers
    accept = {"Accept": "application/json, text/event-stream"}
    return [
        requests.post(sparql, data={"query": "ASK {}"}, headers=headers, timeout=PATIENCE),
        requests.post(tools, json=GREETING, headers=accept | headers, timeout=PATIENCE),
    ]


@pytest.mark.parametrize(
    ("headers", "status"),
    [
        ({}, 200),
        ({"Origin": "http://localhost", "Host": "localhost"}, 200),
        ({"Origin": "http://localhost:80", "Host": "localhost"}, 200),
        ({"Origin": "https://evil.example"}, 403),
        ({"Origin": "null"}, 403),
        ({"Origin": "http://localhost:3000"}, 403),
        ({"Origin": "http://127.0.0.1.evil.example"}, 403),
        ({SITE: "cross-site"}, 403),
        ({SITE: "same-site", "Origin": "http://localhost:3000"}, 403),
        ({SITE: "Cross-Site", "Sec-Fetch-Mode": "navigate"}, 403),
        ({SITE: "same-origin", "Origin": "https://maps.example.org"}, 200),
        ({SITE: "none"}, 200),
        ({"Host": "evil.example"}, 421),
        ({"Host": "10.0.0.1"}, 421),
        ({"Host": "local host"}, 400),
        ({"Accept-Language": "en;q=0.1," * 500}, 431),
        ({"X-Long": "x" * 17_000}, 431),
    ],
)
def test_requests_of_web_pages_elsewhere_and_long_heads_are_refused(servers, headers, status):
    assert [reply.status_code for reply in asked(servers, headers)] == [status] * 2


@pytest.mark.parametrize("mode", [0o644, 0o640, 0o600])
@pytest.mark.parametrize("door", ["server", "agents", "client", "publish"])
def test_a_token_file_that_others_can_read_gets_a_line(tmp_path, door, mode, monkeypatch, caplog):
    file = tmp_path / "tokens.txt"
    nowhere = "http://127.0.0.1:9"
    file.write_text("ann a-token-of-the-tests-0123\n" if door in ("server", "agents") else "")
    if door == "client":
        file.write_text(f"{nowhere} a-token-of-the-tests-0123\n")
        monkeypatch.setenv("HEREABOUTS_TOKEN_FILE", str(file))
    file.chmod(mode)
    words = {
        "server": ("serve", tmp_path / "no.map", "--token-file", file),
        "agents": ("mcp", tmp_path / "no.map", "--http", "0", "--token-file", file),
        "client": ("assert", nowhere, "object/1", "label", "mug"),
        "publish": ("publish", tmp_path / "no.map", "--to", nowhere, "--token-file", file),
    }[door]
    with pytest.raises(RefusedError):  # for want of a map, a server, or a token
        command(*words)
    warned = [line for line in caplog.messages if str(file) in line]
    assert len(warned) == (mode != 0o600)
    assert all("chmod 600" in line for line in warned)


@pytest.mark.parametrize("guide", ["serve.md", "two-robots.md"])
def test_the_guides_make_token_files_that_nobody_else_can_read(tmp_path: Path, guide: str) -> None:
    text = (Path(__file__).parents[2] / "docs" / "how-to" / guide).read_text(encoding="utf-8")
    made = [line for line in text.splitlines() if "openssl rand" in line]
    for line in made:
        subprocess.run(["sh", "-c", line.strip()], cwd=tmp_path, check=True)
    files = list(tmp_path.iterdir())
    assert len(files) == len(made) > 0
    for file in files:
        assert file.stat().st_mode & 0o777 == 0o600
        assert BearerTokens.load(file)

"""A stand-in for ConceptNet's web API over real HTTP, as its documentation has it.

`GET /query` (rel, start, end, node; 50 edges unless told): edges by weight, descending; prefixes
match by path segment, `view` only where one page is not all, `nextPage` relative. An unknown node
is an "error" with HTTP 200; failures carry their own status.
"""

import json
import threading
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any
from urllib.parse import parse_qs, quote, urlsplit

import pytest

Edge = dict[str, Any]


@dataclass
class StandIn:
    """What the service holds, how it is to misbehave, and what it was asked."""

    edges: list[Edge]
    failures: list[tuple[int, dict[str, str]]] = field(default_factory=list)  # given out first
    asked: list[str] = field(default_factory=list)
    address: str = ""
    garbage: bytes | None = None  # said instead of any answer

    def __post_init__(self) -> None:
        self._index: dict[tuple[str, str], list[Edge]] = defaultdict(list)
        for edge in sorted(self.edges, key=lambda e: (-e["weight"], e["@id"])):
            ends = {part: prefixes(edge[part]["@id"]) for part in ("start", "end")}
            for part, uris in (*ends.items(), ("node", {*ends["start"], *ends["end"]})):
                for uri in uris:
                    self._index[part, uri].append(edge)

    def query(self, asked: dict[str, str]) -> list[Edge] | None:
        """The edges that match, by weight; None where it does not know a node."""
        keys = [(part, asked[part]) for part in ("start", "end", "node") if part in asked]
        if any(("node", uri) not in self._index for _, uri in keys):
            return None
        lists = [self._index.get(key, []) for key in keys]
        least = min(lists, key=len, default=self.edges)
        ids = [{edge["@id"] for edge in found} for found in lists]
        return [
            edge
            for edge in least
            if asked.get("rel", "/r") in prefixes(edge["rel"]["@id"])
            and all(edge["@id"] in known for known in ids)
        ]


def prefixes(uri: str) -> list[str]:
    """The URI and all that it lies under: /c/en/dog for /c/en/dog/n."""
    parts = uri.split("/")
    return ["/".join(parts[:n]) for n in range(2, len(parts) + 1)]


def edge_of(line: str) -> Edge:
    """An edge of the API from a line of the assertion TSV."""
    uri, rel, start, end, data = line.rstrip("\n").split("\t")
    nodes = {"rel": {"@id": rel}, "start": {"@id": start}, "end": {"@id": end}}
    known = json.loads(data)
    return {"@id": uri, **nodes, **{k: known.get(k) for k in ("license", "surfaceText", "weight")}}


class _Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    wbufsize = 1 << 16  # one packet an answer: two would wait for each other
    service: StandIn

    def do_GET(self) -> None:
        self.service.asked.append(self.path)
        if self.service.failures:
            status, headers = self.service.failures.pop(0)
            return self._say(status, {"error": {"status": status}}, headers)
        split = urlsplit(self.path)
        asked = {name: values[0] for name, values in parse_qs(split.query).items()}
        if split.path != "/query":
            return self._say(404, {"error": {"status": 404}}, {})
        edges = self.service.query(asked)
        if edges is None:
            return self._say(200, {"error": {"status": 404, "details": "is not a node"}}, {})
        offset, limit = int(asked.pop("offset", 0)), int(asked.pop("limit", 50))
        answer: Edge = {"@id": self.path, "edges": edges[offset : offset + limit]}
        if offset or len(edges) > limit:
            rest = "".join(f"{name}={quote(value)}&" for name, value in sorted(asked.items()))
            answer["view"] = {"@type": "PartialCollectionView"}
            if offset + limit < len(edges):
                following = f"/query?{rest}offset={offset + limit}&limit={limit}"
                answer["view"]["nextPage"] = following
        return self._say(200, answer, {})

    def _say(self, status: int, answer: Edge, headers: dict[str, str]) -> None:
        body = json.dumps(answer, ensure_ascii=False).encode()
        if self.service.garbage is not None and status == 200:
            body = self.service.garbage
        self.send_response(status)
        self.send_header("Content-Length", str(len(body)))
        for name, value in headers.items():
            self.send_header(name, value)
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, format: str, *args: object) -> None:
        """Tests are quiet."""


@pytest.fixture
def serve() -> Iterator[Callable[[list[Edge]], StandIn]]:
    """Callable: edges -> a running stand-in that holds them."""
    with ExitStack() as running:

        def start(edges: list[Edge]) -> StandIn:
            service = StandIn(edges)
            handler = type("Handler", (_Handler,), {"service": service})
            server = running.enter_context(ThreadingHTTPServer(("127.0.0.1", 0), handler))
            thread = threading.Thread(target=server.serve_forever, args=(0.01,), daemon=True)
            thread.start()
            running.callback(thread.join)
            running.callback(server.shutdown)
            service.address = f"http://127.0.0.1:{server.server_address[1]}"
            return service

        yield start


@pytest.fixture
def as_edge() -> Callable[..., Edge]:
    """Callable: (relation, start, end, weight=1.0) -> an edge of the API."""

    def edge(relation: str, start: str, end: str, weight: float = 1.0) -> Edge:
        uris = [f"/c/en/{term.replace(' ', '_')}" for term in (start, end)]
        uri = f"/a/[/r/{relation}/,{uris[0]}/,{uris[1]}/]"
        data = {"license": "cc:by/4.0", "weight": weight}
        return edge_of("\t".join([uri, f"/r/{relation}", *uris, json.dumps(data)]))

    return edge

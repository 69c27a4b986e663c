"""A stand-in for ConceptNet's web API over real HTTP, as its documentation has it.

`GET /query` (rel, start, end, node, other; 50 edges unless told) and `/c/...` (20 edges): edges by
weight, descending, prefix match by path segment, at most 10,000 matches looked at, out-of-range
numbers clamped and non-numbers ignored, `view` only where one page is not all, `nextPage` relative,
keys sorted and UTF-8 as it is, HTML for who prefers it. An unknown node is an "error" with HTTP
200; 400, 404, 429, 502 carry their own status.
"""

from __future__ import annotations

import gzip
import json
import threading
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, quote, urlsplit

import pytest

Edge = dict[str, Any]
_MATCHES = 10_000


@dataclass
class StandIn:
    """What the service holds, how it is to misbehave, and what it was asked."""

    edges: list[Edge]
    failures: list[tuple[int, dict[str, str]]] = field(default_factory=list)  # given out first
    asked: list[str] = field(default_factory=list)
    address: str = ""
    garbage: bytes | None = None  # said instead of any answer
    _index: dict[tuple[str, str], list[Edge]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        index: dict[tuple[str, str], list[Edge]] = defaultdict(list)
        for edge in sorted(self.edges, key=lambda e: (-e["weight"], e["@id"])):
            for part in ("start", "end"):
                for prefix in prefixes(edge[part]["@id"]):
                    index[part, prefix].append(edge)
                    if part == "start" or prefix not in prefixes(edge["start"]["@id"]):
                        index["node", prefix].append(edge)
        self._index = dict(index)

    def query(self, asked: dict[str, str]) -> list[Edge] | None:
        """The edges that match, by weight; None where it does not know a node."""
        keys = [(part, asked[part]) for part in ("start", "end", "node") if part in asked]
        if any(("node", uri) not in self._index for _, uri in keys):
            return None
        lists = [self._index.get(key, []) for key in keys] or [self.edges]
        least = min(lists, key=len)
        ids = [{edge["@id"] for edge in found} for found in lists]
        rel = asked.get("rel", "/r")
        return [
            edge
            for edge in least
            if rel in prefixes(edge["rel"]["@id"]) and all(edge["@id"] in known for known in ids)
        ][:_MATCHES]


def prefixes(uri: str) -> list[str]:
    """The URI and all that it lies under: /c/en/dog for /c/en/dog/n."""
    parts = uri.split("/")
    return ["/".join(parts[:n]) for n in range(2, len(parts) + 1)]


def edge_of(line: str) -> Edge:
    """An edge of the API from a line of the assertion TSV."""
    uri, rel, start, end, data = line.rstrip("\n").split("\t")
    known = json.loads(data)
    return {
        "@id": uri,
        "@type": "Edge",
        "rel": {"@id": rel, "@type": "Relation", "label": rel.removeprefix("/r/")},
        "start": node_of(start),
        "end": node_of(end),
        "dataset": known["dataset"],
        "license": known["license"],
        "sources": [{"@id": "/s/resource", "@type": "Source", **s} for s in known["sources"]],
        "surfaceText": known.get("surfaceText"),
        "weight": known["weight"],
    }


def node_of(uri: str) -> dict[str, str]:
    parts = uri.split("/")
    node = {
        "@id": uri,
        "@type": "Node",
        "label": parts[3].replace("_", " "),
        "language": parts[2],
        "term": "/".join(parts[:4]),
    }
    return node | ({"sense_label": ", ".join(parts[4:])} if len(parts) > 4 else {})


def clamped(text: str | None, default: int, low: int, high: int) -> int:
    try:
        return min(max(int(text or ""), low), high)
    except ValueError:
        return default


class _Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    wbufsize = 1 << 16  # one packet an answer: two would wait for each other
    service: StandIn

    def do_GET(self) -> None:
        self.service.asked.append(self.path)
        if self.service.failures:
            status, headers = self.service.failures.pop(0)
            return self._say(status, {"error": {"status": status, "details": "busy"}}, headers)
        split = urlsplit(self.path)
        asked = {name: values[0] for name, values in parse_qs(split.query).items()}
        if split.path in ("/query", "/search"):
            default = 50
        elif split.path.startswith("/c/"):
            asked, default = {**asked, "node": split.path}, 20
        else:
            return self._say(404, {"error": {"status": 404, "details": f"no {split.path}"}})
        edges = self.service.query(asked)
        if edges is None:
            details = f"{asked} is not a node in ConceptNet."
            return self._say(200, {"@id": self.path, "error": {"status": 404, "details": details}})
        return self._say(200, self._page(split.path, asked, edges, default))

    def _page(self, path: str, asked: dict[str, str], edges: list[Edge], default: int) -> Edge:
        offset = clamped(asked.pop("offset", None), 0, 0, 100_000)
        limit = clamped(asked.pop("limit", None), default, 1, 1000)
        answer: Edge = {
            "@context": ["http://api.conceptnet.io/ld/conceptnet5.7/context.ld.json"],
            "@id": self.path,
            "edges": edges[offset : offset + limit],
            "version": "5.8.1",
        }
        if offset or len(edges) > limit:
            answer["view"] = self._view(path, asked, offset, limit, len(edges))
        return answer

    def _view(self, path: str, asked: dict[str, str], offset: int, limit: int, n: int) -> Edge:
        rest = "".join(f"{name}={quote(value)}&" for name, value in sorted(asked.items()))

        def page(at: int) -> str:
            return f"{path}?{rest}offset={at}&limit={limit}"

        view = {
            "@id": page(offset),
            "@type": "PartialCollectionView",
            "comment": "There are more results. Follow the 'nextPage' link for more.",
            "firstPage": page(0),
            "paginatedProperty": "edges",
        }
        if offset + limit < n:
            view["nextPage"] = page(offset + limit)
        if offset:
            view["previousPage"] = page(max(0, offset - limit))
        return view

    def _say(self, status: int, answer: Edge, headers: dict[str, str] | None = None) -> None:
        text = json.dumps(answer, sort_keys=True, ensure_ascii=False, indent=2)
        html = "text/html" in self.headers.get("Accept", "") and "format=json" not in self.path
        body = (f"<html><pre>{text}</pre></html>" if html else text).encode()
        if self.service.garbage is not None and status == 200:
            body = self.service.garbage
        self.send_response(status)
        self.send_header("Content-Type", "text/html" if html else "application/json")
        self.send_header("Content-Length", str(len(body)))
        for name, value in (headers or {}).items():
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
def indoor_edges(shared: Callable[[str], Path]) -> list[Edge]:
    """ConceptNet 4's 25,142 indoor assertions as edges of the API."""
    path = shared("data/conceptnet/conceptnet4_en_indoor.cn5.tsv.gz")
    with gzip.open(path, "rt", encoding="utf-8") as lines:
        return [edge_of(line) for line in lines]


@pytest.fixture
def as_edge() -> Callable[..., Edge]:
    """Callable: (relation, start, end, weight=1.0) -> an edge of the API."""

    def edge(relation: str, start: str, end: str, weight: float = 1.0) -> Edge:
        uris = [f"/c/en/{term.replace(' ', '_')}" for term in (start, end)]
        uri = f"/a/[/r/{relation}/,{uris[0]}/,{uris[1]}/]"
        data = {"dataset": "/d/x", "license": "cc:by/4.0", "sources": [], "weight": weight}
        return edge_of("\t".join([uri, f"/r/{relation}", *uris, json.dumps(data)]))

    return edge

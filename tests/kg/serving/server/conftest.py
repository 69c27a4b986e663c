"""A real server over a small map, on a free port of this machine."""

from __future__ import annotations

import http.client
import json
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from functools import cache, partial
from pathlib import Path
from typing import Any
from urllib.parse import urlencode, urlsplit

import numpy as np
import pytest
import requests

from kg.maps.semantic_map import SemanticMap
from kg.model.records import MapUpdate, ObjectRecord, PlaceRecord
from kg.model.transactions import Cause
from kg.serving.opening import in_memory_map, open_map
from kg.serving.server import BearerTokens, Limits, MapServer, Settings
from planner.questions.answers import answer_box
from tests.kg.serving.server import browser_pages as pages

TOKEN = "a-token-of-the-tests-0123"
READER = "a-token-that-only-reads"
BASE = "https://example.org/maps/flat/"
PATIENCE = 120.0  # [s] for what comes at once, on a machine however slow
LIMITS = Limits(query_seconds=PATIENCE, workers=1)
ANN = BearerTokens((("ann", TOKEN.encode()),))


class Stream:
    """Server-sent events of a running answer."""

    def __init__(self, url: str, headers: dict[str, str]) -> None:
        whole = urlsplit(url)
        self._connection = http.client.HTTPConnection(whole.netloc, timeout=PATIENCE)
        self._connection.request("GET", f"{whole.path}?{whole.query}", headers=headers)
        self._answer = self._connection.getresponse()
        assert self._answer.status == 200, self._answer.read()
        assert self._answer.headers["Content-Type"].startswith("text/event-stream")

    def next(self) -> tuple[int, str, dict[str, object]]:
        """Number, kind and data of the next event."""
        fields: dict[str, str] = {}
        while line := self._answer.readline():
            if line == b"\n" and "data" in fields:
                return int(fields["id"]), fields["event"], json.loads(fields["data"])
            name, colon, value = line.decode().rstrip("\n").partition(": ")
            if name and colon:
                fields[name] = value
        raise EOFError("the stream ended")

    def close(self) -> None:
        self._answer.close()
        self._connection.close()

    def __enter__(self) -> Stream:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()


@dataclass(frozen=True)
class Served:
    """A running server and the map behind it."""

    map: SemanticMap
    server: MapServer
    seen: list[int] = field(default_factory=lambda: [0])

    @property
    def url(self) -> str:
        return self.server.url

    def get(self, path: str, **given: object) -> requests.Response:
        return self.request("GET", path, **given)

    def post(self, path: str, **given: object) -> requests.Response:
        return self.request("POST", path, **given)

    def request(self, method: str, path: str, **given: object) -> requests.Response:
        given.setdefault("timeout", PATIENCE)
        # as a client that writes with a token and reads without one: it reads what it wrote
        headers = {"Here-Sequence": str(self.seen[0])} if path.startswith("sparql") else {}
        given["headers"] = headers | given.get("headers", {})  # type: ignore[operator]
        answer = requests.request(method, self.url + path, **given)  # type: ignore[arg-type]
        if method not in ("GET", "HEAD"):
            self.seen[0] = max(self.seen[0], int(answer.headers.get("Here-Sequence", 0)))
        return answer

    def write(self, update: str, **given: object) -> requests.Response:
        headers = {"Content-Type": "application/sparql-update", **self.bearer()}
        return self.post("sparql", data=update.encode(), headers=headers, **given)

    def rows(self, query: str) -> list[dict[str, str]]:
        """Bindings as plain texts, asked over HTTP."""
        answer = self.get("sparql", params={"query": query})
        assert answer.status_code == 200, answer.text
        found = answer.json()["results"]["bindings"]
        return [{name: cell["value"] for name, cell in row.items()} for row in found]

    @staticmethod
    def bearer(token: str = TOKEN) -> dict[str, str]:
        return {"Authorization": f"Bearer {token}"}

    def stream(self, path: str, params: dict[str, object] | None = None, **headers: str) -> Stream:
        """Events of a path, read as they come."""
        given = {name.replace("_", "-"): value for name, value in headers.items()}
        return Stream(f"{self.url}{path}?{urlencode(params or {})}", given)

    def move(self, number: int, x: float) -> None:
        """The mapper sees an object elsewhere."""
        self.put(number, "cup", x, 0.5)

    def put(self, number: int, label: str, x: float, y: float) -> None:
        """The mapper sees an object."""
        self.map.apply(MapUpdate(objects=(thing(self.map, number, label, x, y),)))


def thing(semantic_map: SemanticMap, number: int, label: str, x: float, y: float) -> ObjectRecord:
    return ObjectRecord(
        iri=f"{semantic_map.base}object/{number}",
        category=semantic_map.catalogue.find(label).iri,
        p_map=np.array([x, y, 0.8]),
        confidence=2.4,
        existence=0.8,
        observations=3,
        first_seen=1_700_000_000.0,
        last_seen=1_700_000_060.0,
        place=semantic_map.place_iri(1),
    )


@contextmanager
def furnished() -> Iterator[SemanticMap]:
    """A kitchen with a cup and a chair."""
    with in_memory_map(title="flat <1>", base=BASE) as semantic_map:
        kitchen = semantic_map.catalogue.find("kitchen").iri
        place = PlaceRecord(
            f"{BASE}place/1", "the kitchen", -1, 4, -1, 3, views=3, beliefs={kitchen: 0.8}
        )
        objects = (
            thing(semantic_map, 1, "cup", 1.0, 0.5),
            thing(semantic_map, 2, "chair", 2.0, 1.5),
        )
        update = MapUpdate(objects=objects, places=(place,))
        semantic_map.apply(update, Cause("frame", note="flat/frame-000001"))
        yield semantic_map


@pytest.fixture
def flat() -> Iterator[SemanticMap]:
    """A kitchen with a cup and a chair."""
    with furnished() as semantic_map:
        yield semantic_map


@contextmanager
def running(**settings: object) -> Iterator[Served]:
    """A running server of a flat of its own, whose clients may write with `bearer()`."""
    wanted = Settings(port=0, **{"tokens": ANN, "limits": LIMITS, **settings})  # type: ignore[arg-type]
    with furnished() as semantic_map, MapServer(semantic_map, wanted) as server:
        yield Served(semantic_map, server)


@pytest.fixture(scope="module")
def lasting() -> Iterator[Served]:
    """A server that all tests of a module share, whose clients may write with `bearer()`."""
    with running() as served:
        yield served


@pytest.fixture(scope="module")
def private() -> Iterator[Served]:
    """A server whose map is read with a token too."""
    with running(read_tokens=BearerTokens((("bob", READER.encode()),))) as served:
        yield served


@pytest.fixture
def serve(flat: SemanticMap) -> Iterator[Callable[..., Served]]:
    """Callable: settings, and limits by name -> a running server of the flat."""
    with ExitStack() as stack:

        def start(*, limits=None, planner=None, **settings):
            settings.setdefault("tokens", ANN)
            wanted = Settings(port=0, limits=limits or LIMITS, **settings)  # type: ignore[arg-type]
            server = stack.enter_context(MapServer(flat, wanted, planner=planner))
            return Served(flat, server)

        yield start


@pytest.fixture
def served(serve: Callable[..., Served]) -> Served:
    """A running server whose clients may write with `bearer()`."""
    return serve()


@pytest.fixture
def token(served: Served, monkeypatch: pytest.MonkeyPatch) -> None:
    """The token of `served` in the environment, trusted to its address."""
    monkeypatch.setenv("HEREABOUTS_TOKEN", TOKEN)
    monkeypatch.setenv("HEREABOUTS_SERVER", served.url)


@pytest.fixture
def on_disk() -> Callable[..., AbstractContextManager[Served]]:
    """Callable: folder of a map, settings by name -> its server, in a `with` statement."""

    @contextmanager
    def start(folder: Path, *, read_only: bool = False, **settings: object) -> Iterator[Served]:
        settings.setdefault("tokens", ANN)
        wanted = Settings(port=0, limits=LIMITS, **settings)  # type: ignore[arg-type]
        with (
            open_map(folder, read_only=read_only) as semantic_map,
            MapServer(semantic_map, wanted) as server,
        ):
            yield Served(semantic_map, server)

    return start


@contextmanager
def answering(semantic_map: SemanticMap) -> Iterator[Served]:
    """A server for pages, which answers questions and whose clients may write with `bearer()`."""
    tokens = BearerTokens((("ann", TOKEN.encode()),))
    settings = Settings(port=0, tokens=tokens, limits=replace(LIMITS, workers=1))
    with MapServer(semantic_map, settings, planner=partial(answer_box, semantic_map)) as server:
        yield Served(semantic_map, server)


@pytest.fixture(scope="module")
def shown() -> Iterator[Served]:
    """A server of the flat, for the pages of a module that change nothing."""
    with furnished() as semantic_map, answering(semantic_map) as served:
        yield served


@pytest.fixture
def own(flat: SemanticMap) -> Iterator[Served]:
    """A server of a flat that one test changes."""
    with answering(flat) as served:
        yield served


RUNNING = ExitStack()  # the browser


@cache
def started_browser() -> Any:
    """Headless Chromium, which runs until the last test of this folder."""
    sync_api = pytest.importorskip("playwright.sync_api", reason="pip install playwright")
    if pages.CHROMIUM is None:
        pytest.skip("Chromium is not installed: apt-get install chromium")
    playwright = RUNNING.enter_context(sync_api.sync_playwright())
    RUNNING.callback(started_browser.cache_clear)
    options = {"executable_path": pages.CHROMIUM, "args": list(pages.ARGUMENTS)}
    return RUNNING.enter_context(playwright.chromium.launch(**options))


@pytest.hookimpl(trylast=True)
def pytest_runtest_teardown(nextitem: pytest.Item | None) -> None:
    """Stop the browser after the last test here: its event loop is in the way of others."""
    if nextitem is None or Path(__file__).parent not in nextitem.path.parents:
        RUNNING.close()


@contextmanager
def page_opener(request: pytest.FixtureRequest) -> Iterator[pages.OpenPage]:
    """Callable: path and fragment, a server (else `shown`) -> its page, once it is ready.

    A script of its own runs before those of the page.

    At the end no page may have had an error, or asked any other host.
    """
    wrong: list[str] = []
    browser = started_browser()

    with ExitStack() as stack:

        def open_one(path="", of=None, *, ready="html[data-ready]", script="", **options):
            url = (of or request.getfixturevalue("shown")).url
            ours = (url, f"blob:{url}")
            context = browser.new_context(**{"viewport": pages.VIEWPORT, **options})
            page = stack.enter_context(context).new_page()
            if script:
                page.add_init_script(script)
            page.set_default_timeout(pages.PATIENCE)
            page.on("console", lambda m: wrong.append(m.text) if pages.is_fault(m) else None)
            page.on("pageerror", lambda error: wrong.append(str(error)))
            page.on("dialog", lambda dialog: wrong.append(f"a dialog: {dialog.message}"))
            page.on("request", lambda r: None if r.url.startswith(ours) else wrong.append(r.url))
            page.goto(f"{url}{path}")
            page.wait_for_selector(ready)
            return page

        yield open_one
    assert wrong == []


@pytest.fixture
def open_page(request: pytest.FixtureRequest) -> Iterator[pages.OpenPage]:
    """`page_opener`, whose pages are closed after a test."""
    with page_opener(request) as opened:
        yield opened

"""Doors: all ways in which somebody queries or updates a map, each as one function.

A test that is parametrised over `READING` or `UPDATING`, or over the doors of `stating_doors`,
shows that a rule holds at every door, and not only at the one where somebody asked for it.
"""

import asyncio
import contextlib
import io
import json
import os
import shutil
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final
from urllib.error import HTTPError

import pyoxigraph
import rdflib
import requests
from mcp import Client
from mcp.server import MCPServer
from rdflib.plugins.stores.sparqlstore import SPARQLStore, SPARQLUpdateStore

from hereabouts.agents.map_context import MapContext
from hereabouts.agents.tool_server import tool_server
from hereabouts.cli import main
from kg.maps.query.evaluation import Table
from kg.maps.semantic_map import SemanticMap
from kg.model import vocabulary as v
from kg.model.errors import HereaboutsError
from kg.serving.opening import create_map, open_map
from kg.serving.server import BearerTokens, Limits, MapServer, Settings
from kg.serving.workers.local_evaluation import LimitedQueries

TOKEN: Final = "a-token-of-the-tests-0123"
PATIENCE: Final = 120.0  # [s] for what comes at once, on a machine however slow
PREFIXES: Final = "".join(f"PREFIX {name}: <{iri}>\n" for name, iri in v.PREFIXES.items())


class RefusedError(Exception):
    """A door refused; the text is the one line that it gave."""


@dataclass(frozen=True)
class House:
    """One map at all its doors: served as it is open here, and as a closed copy of its folder."""

    map: SemanticMap
    server: MapServer
    agents: MCPServer[Any]
    folder: Path
    furnished: int
    """The number of the last transaction of the closed copy."""

    @property
    def live(self) -> Path:
        """The folder of the map that is open here."""
        return Path(self.map.store.where)

    @property
    def sparql(self) -> str:
        return f"{self.server.url}sparql"

    @property
    def bearer(self) -> dict[str, str]:
        return {"Authorization": f"Bearer {TOKEN}"}


@contextmanager
def open_house(scratch: Path, fill: Callable[[SemanticMap], object]) -> Iterator[House]:
    """A map that `fill` furnished, served with a token for writing."""
    live, closed = scratch / "live.map", scratch / "closed.map"
    with create_map(live, base="https://example.org/maps/house/") as made:
        fill(made)
        furnished = made.sequence
    shutil.copytree(live, closed)
    tokens = BearerTokens((("ann", TOKEN.encode()),))
    settings = Settings(port=0, tokens=tokens, limits=Limits(query_seconds=PATIENCE, workers=2))
    with (
        open_map(live) as semantic_map,
        LimitedQueries(semantic_map) as queries,
        MapServer(semantic_map, settings) as server,
    ):
        context = MapContext(semantic_map, lambda: "ann")
        yield House(semantic_map, server, tool_server(context, queries), closed, furnished)


def command(*words: object) -> str:
    """What a command prints; raises RefusedError with its line where it ends with 1 or 2."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = main([str(word) for word in words])
    if code:
        raise RefusedError(err.getvalue().strip())
    return out.getvalue()


def tool(house: House, name: str, **arguments: object) -> Any:
    """The structured answer of an agents' tool; raises RefusedError with its text."""

    async def call() -> Any:
        async with Client(house.agents) as client:
            return await client.call_tool(name, arguments)

    answer = asyncio.run(call())
    text = "".join(getattr(part, "text", "") for part in answer.content)
    if answer.is_error:
        raise RefusedError(text)
    return answer.structured_content or json.loads(text)


def answered(response: requests.Response) -> requests.Response:
    """The response; raises RefusedError with the body's line where the server refused."""
    if not response.ok:
        assert response.status_code < 500 or response.status_code == 503, response.text
        raise RefusedError(response.text)
    return response


# --- reading: which things match a pattern in which the thing is ?thing ---


def _select(pattern: str) -> str:
    return f"SELECT DISTINCT ?thing WHERE {{ {pattern} }}"


def _of_results(document: Mapping[str, Any]) -> set[str]:
    return {row["thing"]["value"] for row in document["results"]["bindings"]}


def _of_table(table: Table) -> set[str]:
    return {str(thing) for (thing,) in table.rows}


def _python(house: House, pattern: str) -> set[str]:
    return _of_table(house.map.query(_select(pattern)))


def _past(house: House, pattern: str) -> set[str]:
    with house.map.at(f"#{house.map.sequence}") as then:
        return _of_table(then.query(_select(pattern)))


def _command_line(house: House, pattern: str) -> set[str]:
    rows = json.loads(command("ask", house.folder, "-e", _select(pattern), "--json"))
    return {row["thing"] for row in rows}


def _command_line_past(house: House, pattern: str) -> set[str]:
    moment = f"#{house.furnished}"
    words = ("ask", house.folder, "-e", _select(pattern), "--json", "--at", moment)
    return {row["thing"] for row in json.loads(command(*words))}


def _beside_the_writer(house: House, pattern: str) -> set[str]:
    """The folder of the served map, as another process of the user opens it."""
    with open_map(house.live, read_only=True) as reader:
        return _of_table(reader.query(_select(pattern)))


def _command_beside_the_writer(house: House, pattern: str) -> set[str]:
    rows = json.loads(command("ask", house.live, "-e", _select(pattern), "--json"))
    return {row["thing"] for row in rows}


def _query_file(house: House, pattern: str) -> set[str]:
    file = house.folder.with_name("question.rq")
    file.write_text(_select(pattern), encoding="utf-8")
    return {row["thing"] for row in json.loads(command("ask", house.folder, file, "--json"))}


def _command_to_server(house: House, pattern: str) -> set[str]:
    rows = json.loads(command("ask", house.server.url, "-e", _select(pattern), "--json"))
    return {row["thing"] for row in rows}


def _headers(house: House) -> dict[str, str]:
    """As a client that reads what was written before."""
    return {"Accept": "application/sparql-results+json", "Here-Sequence": str(house.map.sequence)}


def _http_get(house: House, pattern: str) -> set[str]:
    given = {"query": _select(pattern)}
    answer = requests.get(house.sparql, given, headers=_headers(house), timeout=PATIENCE)
    return _of_results(answered(answer).json())


def _http_post(house: House, pattern: str) -> set[str]:
    given = {"query": _select(pattern)}
    answer = requests.post(house.sparql, given, headers=_headers(house), timeout=PATIENCE)
    return _of_results(answered(answer).json())


def _http_past(house: House, pattern: str) -> set[str]:
    given = {"query": _select(pattern), "at": f"#{house.map.sequence}"}
    answer = requests.get(house.sparql, given, headers=_headers(house), timeout=PATIENCE)
    return _of_results(answered(answer).json())


def _subscription(house: House, pattern: str) -> set[str]:
    given = {"query": _select(pattern)}
    url = f"{house.server.url}subscribe"
    headers = _headers(house) | {"Accept": "text/event-stream"}
    with requests.get(url, given, headers=headers, stream=True, timeout=PATIENCE) as answer:
        answered(answer)
        for line in answer.iter_lines():
            if line.startswith(b"data: "):
                added = json.loads(line.removeprefix(b"data: "))["added"]
                return {row["thing"]["value"] for row in added}
    raise AssertionError("the stream ended")


def _rdflib_view(house: House, pattern: str) -> set[str]:
    return {str(row[0]) for row in house.map.dataset.query(PREFIXES + _select(pattern))}


def _sparql_store(house: House, pattern: str) -> set[str]:
    graph = rdflib.Graph(SPARQLStore(house.sparql))
    return {str(row[0]) for row in graph.query(PREFIXES + _select(pattern))}


def _service(house: House, pattern: str) -> set[str]:
    """As a part of a query that another endpoint evaluates."""
    query = f"{PREFIXES} SELECT DISTINCT ?thing {{ SERVICE <{house.sparql}> {{ {pattern} }} }}"
    found = pyoxigraph.Store().query(query)
    assert isinstance(found, pyoxigraph.QuerySolutions)
    return {row["thing"].value for row in found}


def _update(house: House, pattern: str) -> set[str]:
    """The WHERE of an update marks the things, and its marks are read and removed."""
    mark = '<urn:x-test:marked> "yes"'
    house.map.update(f"INSERT {{ ?thing {mark} }} WHERE {{ {pattern} }}", by="ann")
    marked = _of_table(house.map.query(_select(f"?thing {mark}")))
    house.map.update(f"DELETE WHERE {{ ?thing {mark} }}", by="ann", confirmed=True)
    return marked


def _http_update(house: House, pattern: str) -> set[str]:
    """The same by HTTP, where a worker evaluates it."""
    mark = '<urn:x-test:marked> "yes"'
    text = f"INSERT {{ ?thing {mark} }} WHERE {{ {pattern} }}"
    _post_update(house, text)
    marked = _of_table(house.map.query(_select(f"?thing {mark}")))
    house.map.update(f"DELETE WHERE {{ ?thing {mark} }}", by="ann", confirmed=True)
    return marked


def _agents(house: House, pattern: str) -> set[str]:
    answer = tool(house, "ask_sparql", query=_select(pattern), limit=500)
    base = house.map.base
    rows = answer.get("untrusted_rows", [])
    return {text if ":" in text else base + text for (text,) in rows}


READING: Final[dict[str, Callable[[House, str], set[str]]]] = {
    "python": _python,
    "past": _past,
    "command line": _command_line,
    "command line, past": _command_line_past,
    "beside the writer": _beside_the_writer,
    "command beside the writer": _command_beside_the_writer,
    "query file": _query_file,
    "command to server": _command_to_server,
    "http get": _http_get,
    "http post": _http_post,
    "http past": _http_past,
    "subscription": _subscription,
    "rdflib view": _rdflib_view,
    "SPARQLStore": _sparql_store,
    "service": _service,
    "update": _update,
    "http update": _http_update,
    "agents": _agents,
}


# --- updating: SPARQL Update ---


def _post_update(house: House, text: str) -> None:
    headers = {"Content-Type": "application/sparql-update", **house.bearer}
    answered(requests.post(house.sparql, text.encode(), headers=headers, timeout=PATIENCE))


def _post_update_form(house: House, text: str) -> None:
    form = {"update": text}
    answered(requests.post(house.sparql, form, headers=house.bearer, timeout=PATIENCE))


def _python_update(house: House, text: str) -> None:
    with refusals():
        house.map.update(text, by="ann")


def _view_update(house: House, text: str) -> None:
    with refusals():
        house.map.dataset.update(text)


def _command_update(house: House, text: str) -> None:
    """A command at the running server, so that all doors write the same map."""
    words = ("update", house.server.url, "-e", text)
    with with_token(house):
        command(*words)


def _update_beside_the_writer(house: House, text: str) -> None:
    with refusals(), open_map(house.live) as editor:
        editor.update(text, by="ann")


def _command_update_beside_the_writer(house: House, text: str) -> None:
    command("update", house.live, "-e", text, "--by", "ann")


def _update_store(house: House, text: str) -> None:
    store = SPARQLUpdateStore(house.sparql, house.sparql, headers=house.bearer)
    try:
        store.update(PREFIXES + text)
    except HTTPError as error:
        with error:  # rdflib leaves the connection open
            raise RefusedError(error.read().decode()) from error
    except Exception as error:  # whatever the client makes of a refusal
        raise RefusedError(str(error)) from error


UPDATING: Final[dict[str, Callable[[House, str], None]]] = {
    "python": _python_update,
    "rdflib view": _view_update,
    "command line": _command_update,
    "beside the writer": _update_beside_the_writer,
    "command beside the writer": _command_update_beside_the_writer,
    "http body": _post_update,
    "http form": _post_update_form,
    "SPARQLUpdateStore": _update_store,
}


@contextmanager
def refusals() -> Iterator[None]:
    """Errors of hereabouts inside the block become RefusedError."""
    try:
        yield
    except HereaboutsError as error:
        raise RefusedError(str(error)) from error


@contextmanager
def with_token(house: House) -> Iterator[None]:
    before = dict(os.environ)
    os.environ |= {"HEREABOUTS_TOKEN": TOKEN, "HEREABOUTS_SERVER": house.server.url}
    try:
        yield
    finally:
        os.environ.clear()
        os.environ |= before

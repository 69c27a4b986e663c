"""The length of what agents read: the list of tools, every answer, pages, errors."""

import asyncio
import json
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from mcp import Client
from mcp.server import MCPServer

from hereabouts.agents.map_context import MapContext
from hereabouts.agents.tool_server import tool_server
from kg.maps.semantic_map import SemanticMap
from kg.model.records import Evidence, MapUpdate, ObjectRecord, PlaceRecord
from kg.serving.opening import in_memory_map
from kg.serving.workers.local_evaluation import LimitedQueries

LIST_TOKENS, ANSWER_TOKENS, CHARACTERS = 4000, 1500, 4  # a token is counted as four characters
LONG = 'a "quoted" \\ name, 猫, ' * 6
OBJECTS, PLACES = 60, 16
Call = tuple[str, dict[str, Any]]


@pytest.fixture(scope="module")
def crowded() -> Iterator[SemanticMap]:
    """Many places with long names, and many cups with long labels in the first of them."""
    with in_memory_map(base="https://example.org/crowded/") as semantic_map:
        cup = semantic_map.catalogue.find("cup", "object").iri
        places = tuple(
            PlaceRecord(semantic_map.place_iri(n), f"{n} {LONG}", 4.0 * n, 4.0 * n + 4, 0, 4)
            for n in range(1, PLACES + 1)
        )
        objects = tuple(
            ObjectRecord(
                iri=f"{semantic_map.base}object/{n}",
                category=cup,
                p_map=np.array([4.5 + n % 30 / 10, 0.2 + n / 100, 0.8]),
                confidence=3.0,
                existence=0.9,
                observations=3,
                first_seen=1.7e9,
                last_seen=1.7e9 + n,
                place=semantic_map.place_iri(1),
                evidence=Evidence(f"frame {LONG}", LONG, 1.7e9, (0, 0, 9, 9), 0.9, LONG),
            )
            for n in range(1, OBJECTS + 1)
        )
        semantic_map.apply(MapUpdate(places=places, objects=objects))
        for name in ("ann", LONG):
            semantic_map.assertions.add("object/1", "label", f"{name} {LONG}"[:100], by=LONG[:60])
        yield semantic_map


@pytest.fixture(scope="module")
def server(crowded: SemanticMap) -> Iterator[MCPServer[Any]]:
    with LimitedQueries(crowded) as queries:
        yield tool_server(MapContext(crowded, lambda: "agent"), queries)


def results(server: MCPServer[Any], calls: list[Call]) -> list[Any]:
    async def run() -> list[Any]:
        async with Client(server) as client:
            return [await client.call_tool(*call) for call in calls]

    return asyncio.run(run())


def tokens(result: Any) -> float:
    """Of a whole result, in which an answer stands twice: as text, and as structured content."""
    return len(result.model_dump_json(by_alias=True, exclude_none=True)) / CHARACTERS


def test_the_list_of_tools_is_short(server: MCPServer[Any]) -> None:
    async def run() -> Any:
        async with Client(server) as client:
            return await client.list_tools()

    listed = asyncio.run(run())
    assert len(listed.tools) == 17
    assert tokens(listed) <= LIST_TOKENS
    assert '"title"' not in listed.model_dump_json(by_alias=True, exclude_none=True)


def test_every_answer_is_short_and_without_empty_fields(server: MCPServer[Any]) -> None:
    calls: list[Call] = [
        ("describe_map", {}),
        ("where_is", {"what": "cup", "limit": 100}),
        ("list_things", {"limit": 100}),
        ("list_things", {"near": "object/9", "radius": 50, "limit": 100}),
        ("recent", {"limit": 100}),
        ("status", {"what": "cup"}),
        ("why", {"what": "object/1"}),
        ("history", {"what": "object/1", "limit": 100}),
        ("what_changed", {"since": "#0", "limit": 100}),
        ("route", {"to": "object/9", "x": 60, "y": 1}),
        ("find_plan", {"what": ["cup", "bed"], "limit": 100}),
        ("next_look", {"what": ["cup", "bed"], "x": 5, "y": 1}),
        ("ask_sparql", {"query": "SELECT * { ?s ?p ?o }", "limit": 500}),
        ("assert_fact", {"thing": "object/2", "property": "label", "value": LONG[:100]}),
    ]
    for call, result in zip(calls, results(server, calls), strict=True):
        assert not result.is_error, (call, result)
        assert tokens(result) <= ANSWER_TOKENS, call
        text = result.content[0].text
        assert json.loads(text) == result.structured_content
        assert "null" not in text and '""' not in text and "\n" not in text, call


@pytest.mark.parametrize(
    ("tool", "arguments", "listed", "count"),
    [
        ("list_things", {"inside": "place/1", "limit": 50}, "things", OBJECTS),
        ("where_is", {"what": "cup", "limit": 50}, "things", OBJECTS),
        ("describe_map", {}, "places", PLACES),
        ("what_changed", {"since": "#0", "limit": 100}, "things", OBJECTS + PLACES),
    ],
)
def test_pages_have_every_entry_once(server, tool, arguments, listed, count):
    async def run() -> list[str]:
        found, skip = list[str](), 0
        async with Client(server) as client:
            while skip is not None:
                result = await client.call_tool(tool, {**arguments, "skip": skip})
                page = result.structured_content or {}
                assert page["total"] == count
                found += [one["id"] for one in page[listed]]
                skip = page.get("more")
        return found

    found = asyncio.run(run())
    assert len(found) == len(set(found)) == count


def test_an_entry_that_is_too_long_is_refused_in_one_line(server: MCPServer[Any]) -> None:
    columns = " ".join(f"(?x AS ?c{n})" for n in range(60))
    query = f'SELECT {columns} {{ BIND ("{"x" * 390}" AS ?x) }}'
    (result,) = results(server, [("ask_sparql", {"query": query})])
    assert result.is_error
    assert "fewer columns" in result.content[0].text
    assert tokens(result) <= ANSWER_TOKENS

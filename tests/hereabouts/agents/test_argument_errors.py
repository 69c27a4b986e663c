"""What agents are told about arguments that are wrong, and names that are labels."""

import asyncio
import json
from collections.abc import Iterator
from typing import Any

import pytest
from mcp import Client
from mcp.server import MCPServer

from hereabouts.agents.map_context import MapContext
from hereabouts.agents.tool_server import tool_server
from kg.maps.semantic_map import SemanticMap
from kg.serving.workers.local_evaluation import LimitedQueries
from tests.planner.flat import fill


@pytest.fixture
def server(semantic_map: SemanticMap) -> Iterator[MCPServer[Any]]:
    fill(semantic_map)
    with LimitedQueries(semantic_map) as queries:
        yield tool_server(MapContext(semantic_map, lambda: "agent"), queries)


def answer(server: MCPServer[Any], tool: str, **arguments: object) -> dict[str, Any]:
    async def run() -> Any:
        async with Client(server) as client:
            return await client.call_tool(tool, arguments)

    told: dict[str, Any] = json.loads(asyncio.run(run()).content[0].text)
    return told


@pytest.mark.parametrize(
    ("tool", "arguments", "line"),
    [
        ("where_is", {"what": "x" * 5000}, "what should have at most 100 characters, got 5,000"),
        ("where_is", {"what": ""}, "what should have at least 1 character, got ''"),
        ("where_is", {"what": 5}, "what should be a text, got 5"),
        ("where_is", {}, "what is missing"),
        (
            "where_is",
            {"what": "cup", "at": "y" * 99},
            "at should have at most 40 characters, got 99",
        ),
        ("list_things", {"limit": 1000}, "limit should be less than or equal to 100, got 1000"),
        ("list_things", {"limit": "many"}, "limit should be a whole number, got 'many'"),
        (
            "list_things",
            {"x": 1e9, "y": 0},
            "x should be less than or equal to 10,000,000, got 1000000000.0",
        ),
        (
            "list_things",
            {"radius": 0, "near": "object/1"},
            "radius should be greater than 0, got 0",
        ),
        (
            "find_plan",
            {"what": ["cup", "a" * 200]},
            "entry 2 of what should have at most 100 characters",
        ),
        ("find_plan", {"what": ["cup"] * 200}, "what should have at most 5 entries, got 200"),
        ("find_plan", {"what": []}, "what should have 1 or more entries, got []"),
        ("find_plan", {"what": {"a" * 99: 1}}, "what should be a list, got {'" + "a" * 38 + " ..."),
        (
            "assert_fact",
            {"thing": "l" * 2000, "property": "label", "value": "my cup"},
            "thing should have at most 300 characters, got 2,000",
        ),
        (
            "assert_fact",
            {"thing": "object/2", "property": "label", "value": True},
            "value should be a text or a list, got True",
        ),
    ],
)
def test_a_wrong_argument_is_told_in_one_plain_line(server, tool, arguments, line):
    told = answer(server, tool, **arguments)
    assert told["error"] == "ArgumentError"
    assert told["untrusted_message"].startswith(line)
    assert len(told["untrusted_message"]) <= len(line) + 15


def test_labels_that_answers_have_are_names_of_things(server: MCPServer[Any]) -> None:
    (cup,) = answer(server, "where_is", what="cup 2")["things"]
    assert cup["id"] == "object/2"
    assert answer(server, "why", what="cup 2")["steps"][0]["untrusted_text"].startswith("cup 2 in")
    assert answer(server, "history", what="cup 2")["events"]
    near = answer(server, "list_things", near="cup 2", radius=5)["things"]
    assert [one["id"] for one in near] == ["object/1", "object/3"]
    for tool in ("where_is", "history", "why", "status"):
        told = answer(server, tool, what="cup 99")
        assert told["untrusted_message"] == "nothing has the label 'cup 99'; there are: cup 2"


def test_a_room_has_an_answer(server: MCPServer[Any]) -> None:
    told = answer(server, "where_is", what="kitchen")
    assert told["untrusted_proof"].startswith("The kitchen (place 1, 90 % sure) is ")
    assert told["things"] == []

"""An agent names things by their pictures."""

import asyncio
from pathlib import Path
from typing import Any

import numpy as np
from mcp import Client

from hereabouts.agents.map_context import MapContext
from hereabouts.agents.map_tools import MapTools
from hereabouts.agents.tool_server import tool_server
from kg.maps.object_pictures import ObjectPictures
from kg.model.records import Evidence, MapUpdate, ObjectRecord
from kg.serving.opening import create_map, in_memory_map
from kg.serving.workers.local_evaluation import LimitedQueries
from tests.planner.flat import with_unnamed

THINGS = 14


def test_an_agent_names_twelve_things_in_one_sitting(tmp_path: Path) -> None:
    with create_map(tmp_path / "den.map", base="https://example.org/den/") as semantic_map:
        cup = semantic_map.catalogue.find("cup", "object").iri
        shown = Evidence("room", "frame-1", 1e9, (0, 0, 9, 9), 0.9, "network")
        records = tuple(
            ObjectRecord(
                iri=f"{semantic_map.base}object/{n}",
                category=cup,
                p_map=np.array([n, 0.0, 0.8]),
                confidence=3.0,
                existence=0.9,
                observations=3,
                first_seen=1e9,
                last_seen=1e9,
                evidence=shown,
            )
            for n in range(1, THINGS + 1)
        )
        semantic_map.apply(MapUpdate(records))
        for n, record in enumerate(semantic_map.perceived.objects(), 1):
            ObjectPictures(tmp_path / "den.map").write(record, b"JPEG of thing %d" % n)

        async def run() -> tuple[Any, list[Any], Any]:
            with LimitedQueries(semantic_map) as queries:
                server = tool_server(MapContext(semantic_map, lambda: "agent"), queries)
                async with Client(server) as client:
                    seen = await client.call_tool("picture", {})
                    made = [
                        await client.call_tool(
                            "assert_fact",
                            {"thing": one, "property": "name", "value": f"mug of {n}"},
                        )
                        for n, one in enumerate(seen.structured_content["things"])
                    ]
                    return seen, made, await client.call_tool("picture", {})

        seen, made, rest = asyncio.run(run())
        assert [one.type for one in seen.content] == ["text", *["image"] * 12]
        assert not any(one.is_error for one in made)
        assert rest.structured_content["things"][:2] == ["object/13", "object/14"]
        labels = [semantic_map.catalogue.label(one.category) for one in semantic_map.objects()]
        assert labels == [*(f"mug of {n}" for n in range(12)), "cup", "cup"]
        assert {one.by for one in semantic_map.assertions.all()} == {"agent"}


def test_things_without_a_name_are_counted_apart() -> None:
    with in_memory_map() as flat, LimitedQueries(flat) as queries:
        tools = MapTools(MapContext(with_unnamed(flat), lambda: "agent"), queries)
        told = tools.describe_map()
    assert (told.objects, told.without_name) == (3, 3)

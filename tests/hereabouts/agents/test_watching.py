"""Resources that clients listen to, pictures and past moments, with the package's own client."""

import asyncio
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any
from urllib.parse import quote

import pytest
from mcp import Client, MCPError

from hereabouts.agents.map_context import MapContext
from hereabouts.agents.tool_server import tool_server
from hereabouts.agents.watching import MAX_WATCHED
from kg.maps.semantic_map import SemanticMap
from kg.model.records import MapUpdate
from kg.serving.opening import create_map, open_map
from kg.serving.workers.local_evaluation import LimitedQueries
from tests.hereabouts.cli.test_mcp import start, stdio
from tests.hereabouts.cli.test_serve import Process, serve
from tests.planner.flat import fill, thing

__all__ = ["serve", "start"]  # fixtures
APPLES = "hereabouts://things/apple"


@pytest.fixture
def flat(tmp_path: Path) -> Iterator[SemanticMap]:
    with create_map(tmp_path / "flat.map", base="https://example.org/flat/") as semantic_map:
        yield fill(semantic_map)


def connected(semantic_map: SemanticMap, use: Any) -> Any:
    async def run() -> Any:
        with LimitedQueries(semantic_map) as queries:
            async with Client(tool_server(MapContext(semantic_map), queries)) as client:
                return await use(client)

    return asyncio.run(run())


async def told_of_apple(client: Client, write: Any) -> tuple[str, str]:
    """What a client reads before and after it is told that `write` brought an apple."""
    before = (await client.read_resource(APPLES)).contents[0].text  # type: ignore[union-attr]
    async with client.listen(resource_subscriptions=[APPLES]) as changes:
        await asyncio.to_thread(write)
        async for change in changes:
            assert str(getattr(change, "uri", "")) == APPLES
            break
    after = (await client.read_resource(APPLES)).contents[0].text  # type: ignore[union-attr]
    return before, after


def test_a_client_is_told_when_a_thing_appears(flat: SemanticMap) -> None:
    def write() -> None:
        flat.apply(MapUpdate(objects=(thing(flat, "cup", 5.0, 1.0, 1),)))
        flat.apply(MapUpdate(objects=(thing(flat, "apple", 1.0, 1.0, 2),)))

    async def use(client: Client) -> tuple[str, str]:
        return await told_of_apple(client, write)

    before, after = connected(flat, use)
    assert '"things":[]' in before and '"untrusted_category":"apple"' in after


@pytest.mark.filterwarnings("ignore:resources/")
def test_a_client_of_an_earlier_protocol_subscribes(flat: SemanticMap) -> None:
    told = list[str]()

    async def heard(message: Any) -> None:
        if params := getattr(message, "params", None):
            told.append(str(params.uri))

    async def use(server: Any) -> None:
        async with Client(server, mode="legacy", message_handler=heard) as client:
            assert client.server_capabilities.resources.subscribe  # type: ignore[union-attr]
            await client.subscribe_resource(APPLES)  # type: ignore[deprecated]
            for number in (1, 2):
                apple = thing(flat, "apple", 1.0 + number, 1.0, number)
                await asyncio.to_thread(flat.apply, MapUpdate(objects=(apple,)))
                async with asyncio.timeout(20):
                    while len(told) < 1:
                        await asyncio.sleep(0.02)
                await client.unsubscribe_resource(APPLES)  # type: ignore[deprecated]
            with pytest.raises(MCPError, match="no category 'unicorn'"):
                await client.subscribe_resource("hereabouts://things/unicorn")  # type: ignore[deprecated]

    with LimitedQueries(flat) as queries:
        asyncio.run(use(tool_server(MapContext(flat), queries)))
    assert told == [APPLES]  # the second apple came after the end of the subscription


def test_a_client_of_a_served_map_is_told_over_stdio_and_http(tmp_path, serve, start):
    path = tmp_path / "served.map"
    with create_map(path, base="https://example.org/flat/") as semantic_map:
        fill(semantic_map)
    (tmp_path / "tokens.txt").write_text("ann a-token-of-the-tests-0123\n")
    process: Process = serve(path, "--token-file", tmp_path / "tokens.txt")
    servers = [stdio(process.url), start(process.url, "--http", "0")]
    for number, server in enumerate(servers):

        def write(number: int = number) -> None:
            with pytest.MonkeyPatch.context() as patch:
                patch.setenv("HEREABOUTS_TOKEN", "a-token-of-the-tests-0123")
                patch.setenv("HEREABOUTS_SERVER", process.url)
                with open_map(process.url) as remote:
                    apple = thing(remote, "apple", 1.0 + number, 1.0, 1)
                    remote.apply(MapUpdate(objects=(apple,)))

        async def run(server: Any = server, write: Any = write) -> tuple[str, str]:
            async with Client(server) as client:
                return await told_of_apple(client, write)

        before, after = asyncio.run(run())
        assert f'"total":{number}' in before and f'"total":{number + 1}' in after
    assert process.end() == 0


def test_a_client_is_told_when_one_thing_moves_and_when_it_goes(flat: SemanticMap) -> None:
    cup = replace(thing(flat, "cup", 5.0, 1.0, 1), iri=f"{flat.base}object/2")

    async def use(client: Client) -> list[str]:
        uri, seen = "hereabouts://things/cup%202", list[str]()
        for update in (MapUpdate(objects=(cup,)), MapUpdate(removed=(cup.iri,))):
            async with client.listen(resource_subscriptions=[uri]) as changes:
                await asyncio.to_thread(flat.apply, update)
                async for change in changes:
                    assert str(getattr(change, "uri", "")) == uri
                    break
            uri = "hereabouts://things/object%2F2"  # a label goes with its thing
            seen.append((await client.read_resource(uri)).contents[0].text)  # type: ignore[union-attr]
        return seen

    moved, gone = connected(flat, use)
    assert '"x":5' in moved and '"total":1' in moved
    assert '"things":[]' in gone and '"total":0' in gone


def test_wrong_resources_are_refused_in_one_line(flat: SemanticMap) -> None:
    kinds = [one for one in flat.catalogue.categories if one.kind == "object"]
    many = [f"hereabouts://things/{quote(one.label)}" for one in kinds]
    wrong = [["hereabouts://things/unicorn"], ["file:///etc/passwd"], many[: MAX_WATCHED + 1]]

    async def use(client: Client) -> list[str]:
        messages = []
        for uris in wrong:
            with pytest.raises(MCPError) as caught:
                async with client.listen(resource_subscriptions=uris):
                    pass
            messages.append(str(caught.value))
        async with client.listen(resource_subscriptions=many[:MAX_WATCHED]) as changes:
            assert len(changes.honored.resource_subscriptions or ()) == MAX_WATCHED
        return messages

    unknown, other, too_many = connected(flat, use)
    assert "no category 'unicorn'" in unknown and "\n" not in unknown
    assert "hereabouts://things/{what}" in other
    assert f"{MAX_WATCHED} resources" in too_many


def test_past_moments_answer_as_they_were(flat: SemanticMap) -> None:
    then = f"#{flat.sequence}"
    cup = replace(thing(flat, "cup", 9.0, 1.0, 2), iri=f"{flat.base}object/2")
    flat.apply(MapUpdate(objects=(cup,)))
    flat.apply(MapUpdate(objects=(thing(flat, "apple", 1.0, 1.0, 1),)))

    async def use(client: Client) -> list[Any]:
        calls = [
            ("where_is", {"what": "cup", "at": then}),
            ("list_things", {"what": "apple", "at": then}),
            ("status", {"what": "apple", "at": then}),
            ("where_is", {"what": "cup", "at": "#99"}),
        ]
        return [await client.call_tool(*call) for call in calls]

    before, apples, status, unknown = connected(flat, use)
    assert before.structured_content["things"][0]["x"] == 3.0
    assert before.structured_content["map"]["sequence"] == int(then[1:])
    assert apples.structured_content["total"] == 0
    assert status.structured_content["status"] != "present"
    assert "no transaction #99" in unknown.content[0].text

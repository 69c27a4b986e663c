"""Searches by agents: next_look and report_look, with the package's own client."""

import asyncio
import math
from collections.abc import Awaitable, Callable, Iterator
from typing import Any

import numpy as np
import pytest
from mcp import Client
from mcp.server import MCPServer

from hereabouts.agents.map_context import MapContext
from hereabouts.agents.search_tools import MAX_SEARCHES, OpenSearch, OpenSearches
from hereabouts.agents.tool_server import tool_server
from hereabouts.demo.house_demo import HIDDEN, layout_of
from kg.maps.semantic_map import SemanticMap
from kg.model.records import MapUpdate, ObjectRecord, PlaceRecord
from kg.serving.opening import in_memory_map
from kg.serving.workers.local_evaluation import LimitedQueries
from mapping.frames.projection import to_map
from mapping.reference.depth_histogram import localise
from mapping.reference.settings import ReferenceSettings
from planner.execution.protocol import (
    Aborted,
    Arrived,
    Detected,
    DetectedFrame,
    DetectionsMessage,
    GoTo,
    LookAround,
    RobotPose,
)
from planner.simulation.house import House, furnished_house
from planner.simulation.house_robot import SimulatedHouseRobot, TimedPose
from tests.planner.flat import fill, thing

START = TimedPose(8.4, 4.7, 0.0, 0.0)
Call = Callable[..., Awaitable[dict[str, Any]]]


@pytest.fixture
def flat() -> Iterator[SemanticMap]:
    with in_memory_map() as semantic_map:
        yield fill(semantic_map)


def served(semantic_map: SemanticMap, use: Callable[[Call], Awaitable[Any]]) -> Any:
    """What `use` returns, given a way to call the tools of a map."""

    async def run(server: MCPServer[Any]) -> Any:
        async with Client(server) as client:

            async def call(tool: str, **arguments: Any) -> dict[str, Any]:
                found = await client.call_tool(tool, arguments)
                if found.is_error:
                    raise ValueError(found.content[0].text)  # type: ignore[union-attr]
                return dict(found.structured_content or {})

            return await use(call)

    with LimitedQueries(semantic_map) as queries:
        return asyncio.run(run(tool_server(MapContext(semantic_map), queries)))


def known_house(house: House) -> SemanticMap:
    """A map of the rooms and large things of a house."""
    semantic_map = in_memory_map()
    find = semantic_map.catalogue.find
    places = tuple(
        PlaceRecord(
            *(semantic_map.place_iri(place.number), place.label),
            *(place.area.xmin, place.area.xmax, place.area.ymin, place.area.ymax),
            views=9,
            beliefs={find(room.category, "place").iri: 0.9},
        )
        for place, room in zip(layout_of(house).places, house.rooms, strict=True)
    )
    large = {"refrigerator", "dining table", "bed", "couch", "tv", "toilet", "sink"}
    objects = tuple(
        ObjectRecord(
            iri=f"{semantic_map.base}object/{number}",
            category=find(item.label, "object").iri,
            p_map=np.array([item.x, item.y, item.z]),
            confidence=3.0,
            existence=0.95,
            observations=9,
            first_seen=0.0,
            last_seen=0.0,
        )
        for number, item in enumerate(house.objects, start=1)
        if item.label in large
    )
    semantic_map.apply(MapUpdate(places=places, objects=objects))
    return semantic_map


def looked_around(robot: SimulatedHouseRobot, look: dict[str, Any]) -> list[Any] | None:
    """What a look of the robot shows; None where it cannot get there."""
    begin = look["heading"] - look["extent"] / 2
    robot.send(GoTo(1, look["x"], look["y"], begin))
    while not isinstance(message := robot.receive(1.0), Arrived):
        if message is None or isinstance(message, Aborted):
            return None
    robot.send(LookAround(2, look["extent"], look["extent"]))
    while (message := robot.receive(1.0)) is not None:
        if isinstance(message, DetectionsMessage) and message.id == 2:
            return [one for view in message.views for one in located(view)]
    return None


def located(view: DetectedFrame) -> Iterator[Detected]:
    """What a picture shows, with positions."""
    found, settings = view.detections, ReferenceSettings()
    for box, score, label in zip(found.xyxy, found.score, found.label, strict=True):
        p_cam = localise(view.frame, box, settings, None)
        if p_cam is not None:
            p_map = to_map(view.frame.T_map_cam, p_cam)
            yield Detected(label, float(score), *p_map.tolist())


def test_an_agent_finds_a_thing_in_the_house_by_the_tools_alone() -> None:
    house = furnished_house().with_objects([HIDDEN])
    robot = SimulatedHouseRobot(house, START, seed=3)

    async def agent(call: Call) -> tuple[dict[str, Any], Any]:
        x, y, step, apple = START.x, START.y, await call("where_is", what="apple"), None
        assert step["things"] == []
        words: dict[str, Any] = {"what": ["apple"]}
        for _ in range(40):
            step = await call("next_look", x=x, y=y, **words)
            words = {"search": step["search"]}
            if "look" not in step:
                break
            seen = looked_around(robot, step["look"])
            apples = [one for one in seen or () if one.label == "apple" and one.score > 0.5]
            apple = max(apples, key=lambda one: one.score, default=None)
            found = [{"what": "apple", "x": apple.x, "y": apple.y}] if apple else []
            step = await call("report_look", found=found, reached=seen is not None, **words)
            x, y = (float(c) for c in robot.driven[-1])
        return step, apple

    with known_house(house) as semantic_map:
        sequence = semantic_map.sequence
        step, apple = served(semantic_map, agent)
        assert semantic_map.sequence == sequence
    assert (step["state"], step.get("look"), step["untrusted_wanted"]) == ("found", None, [])
    assert math.dist((apple.x, apple.y), (HIDDEN.x, HIDDEN.y)) < 0.5


def test_looks_in_vain_are_not_proposed_again_and_lower_what_is_left(flat: SemanticMap) -> None:
    async def agent(call: Call) -> list[dict[str, Any]]:
        steps = [await call("next_look", what=["apple"], x=6, y=1)]
        search = steps[0]["search"]
        while steps[-1].get("look") and len(steps) < 60:
            await call("report_look", search=search)
            steps.append(await call("next_look", search=search, x=6, y=1))
        return steps

    steps = served(flat, agent)
    *looks, last = steps
    assert (last["state"], last.get("look")) == ("given up", None)
    assert [step["looks_reported"] for step in steps] == list(range(len(steps)))
    left = [step["left"] for step in steps]
    assert left == sorted(left, reverse=True)
    assert left[-1] < 0.2 * left[0]
    places = {step["look"]["untrusted_place"] for step in looks}
    assert places >= {"kitchen", "bedroom"}
    assert looks[0]["look"] != looks[1]["look"]


def test_the_way_to_a_look_that_is_not_reached_is_avoided(flat: SemanticMap) -> None:
    async def agent(call: Call) -> tuple[dict[str, Any], dict[str, Any]]:
        first = await call("next_look", what=["apple"], x=6, y=1)
        await call("report_look", search=first["search"], reached=False)
        return first, await call("next_look", search=first["search"], x=6, y=1)

    first, second = served(flat, agent)
    assert (second["looks_reported"], second["left"]) == (0, pytest.approx(first["left"], abs=0.05))
    ends = [(step["look"]["x"], step["look"]["y"]) for step in (first, second)]
    assert math.dist(*ends) > 0.3


def test_what_others_write_into_the_map_is_taken_up(flat: SemanticMap) -> None:
    search = OpenSearch(flat, ["apple"])
    pose = RobotPose(6.0, 1.0, 0.0)
    assert search.next(pose) is not None
    search.report([], reached=True)
    flat.apply(MapUpdate(objects=(thing(flat, "apple", 1.0, 1.0, 1),)))
    look = search.next(pose)
    assert look is not None
    assert any(why.startswith("apple") for why in look.why)
    assert search.looks == 1


def test_errors_say_what_would_work_and_teach_the_search_nothing(flat: SemanticMap) -> None:
    async def agent(call: Call) -> list[str]:
        step = await call("next_look", what=["apple", "cup"], x=6, y=1)
        name = step["search"]
        wrong: list[tuple[str, dict[str, Any]]] = [
            ("report_look", {"search": "other"}),
            ("report_look", {"search": name, "found": [{"what": "dog", "x": 1, "y": 1}]}),
            ("next_look", {"x": 6, "y": 1}),
            ("next_look", {"what": ["apple"], "search": name}),
        ]
        messages = []
        for tool, arguments in wrong:
            with pytest.raises(ValueError) as caught:
                await call(tool, **arguments)
            messages.append(str(caught.value))
        after = await call("report_look", search=name, found=[{"what": "mug", "x": 3, "y": 1}])
        assert (after["untrusted_wanted"], after["looks_reported"]) == (["apple"], 1)
        with pytest.raises(ValueError) as caught:
            await call("report_look", search=name)
        return [*messages, str(caught.value)]

    unknown, unwanted, neither, both, twice = served(flat, agent)
    assert "next_look with `what` begins one" in unknown
    assert "report apple or cup" in unwanted
    assert "give `what`" in neither and "give `what`" in both
    assert "ask next_look" in twice


def test_the_searches_kept_are_bounded(flat: SemanticMap) -> None:
    searches = OpenSearches(max_searches=2)
    names = [searches.add(OpenSearch(flat, ["cup"])).name for _ in range(2)]
    searches.get(names[0])
    searches.add(OpenSearch(flat, ["cup"]))
    assert searches.get(names[0]).name == names[0]
    with pytest.raises(Exception, match="dropped for later ones"):
        searches.get(names[1])
    assert MAX_SEARCHES < 100

"""Tasks of an agent, each solved by three calls at most; and questions with no answer."""

import asyncio
import base64
import math
from collections.abc import Awaitable, Callable, Iterator
from dataclasses import replace
from typing import Any

import pytest
from mcp import Client
from mcp.server import MCPServer

from hereabouts.agents.map_context import MapContext
from hereabouts.agents.tool_server import tool_server
from kg.maps.object_pictures import ObjectPictures
from kg.model.records import DepartedRecord, Evidence, MapUpdate, PlaceViews, Relation
from kg.serving.opening import create_map
from kg.serving.workers.local_evaluation import LimitedQueries
from tests.planner.flat import fill, thing

MAX_CALLS = 3
NOT_KNOWN = "not known"
JPEG = b"\xff\xd8\xff\xe0 a small picture \xff\xd9"
Call = Callable[..., Awaitable[dict[str, Any]]]


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[MCPServer[Any]]:
    """A kitchen and a bedroom that were viewed, and a third place that nobody looked at.

    Transaction 2 moves the cup beside the bed, takes the vase away, and brings a book onto the bed.
    """
    path = tmp_path_factory.mktemp("tasks") / "flat.map"
    with create_map(path, title="our flat", base="https://example.org/flat/") as flat:
        fill(flat)
        vase = replace(thing(flat, "vase", 3.5, 3.5, 1), existence=0.9)
        flat.apply(MapUpdate(objects=(vase,)))
        seen = Evidence("frame-000007", "tour", 100.0, (10, 20, 30, 40), 0.9, "detector")
        bed, cup = (f"{flat.base}object/{n}" for n in (3, 2))
        on_bed = (Relation("on", bed, 0.9),)
        book = replace(thing(flat, "book", 7.0, 2.0, 2, 100.0), relations=on_bed, evidence=seen)
        gone = DepartedRecord(
            *(vase.iri, vase.category, vase.p_map, 0.9, 4), first_seen=0, last_seen=0, found_gone=90
        )
        views = PlaceViews(0.98, 0.9, 100.0)
        flat.apply(
            MapUpdate(
                objects=(replace(thing(flat, "cup", 6.0, 3.0, 2, 100.0), iri=cup), book),
                places=tuple(replace(one, viewed=views) for one in flat.places()[:2]),
                departed=(gone,),
                removed=(vase.iri,),
            )
        )
        assert flat.store.path is not None
        ObjectPictures(flat.store.path).write(book, JPEG)
        with LimitedQueries(flat) as queries:
            yield tool_server(MapContext(flat, lambda: "agent"), queries)


def solved(server: MCPServer[Any], task: Callable[[Call], Awaitable[Any]]) -> Any:
    """The agent's answer; an error of a tool is "not known"."""

    async def run() -> Any:
        calls = 0
        async with Client(server) as client:

            async def call(tool: str, **arguments: Any) -> dict[str, Any]:
                nonlocal calls
                calls += 1
                assert calls <= MAX_CALLS
                found = await client.call_tool(tool, arguments)
                if found.is_error:
                    return {"error": found.content[0].text}  # type: ignore[union-attr]
                pictures = [one.data for one in found.content if one.type == "image"]
                return {**(found.structured_content or {}), "pictures": pictures}

            return await task(call)

    return asyncio.run(run())


def one(tool: str, read: Callable[[dict[str, Any]], Any], **arguments: Any) -> Any:
    """The task of one call."""

    async def task(call: Call) -> Any:
        return read(await call(tool, **arguments))

    return task


def ids(answer: dict[str, Any], listed: str = "things") -> list[str]:
    return [entry["id"] for entry in answer[listed]]


async def note_on_a_room(call: Call) -> Any:
    await call("assert_fact", thing="the kitchen", property="note", value="wet floor")
    places = (await call("describe_map"))["places"]
    return [(p["untrusted_note"], p["untrusted_note_by"]) for p in places if "untrusted_note" in p]


async def same_room_as_bed(call: Call) -> Any:
    bed = (await call("where_is", what="bed"))["things"][0]
    place = (await call("list_things", x=bed["x"], y=bed["y"], radius=0.1))["place"]
    return (await call("list_things", inside=place, what="cup"))["total"]


async def way_to_the_cup(call: Call) -> Any:
    cup = (await call("where_is", what="mug"))["things"][0]["id"]
    way = await call("route", to=cup, x=1, y=1)
    return way["reachable"], len(way["doors"]), 4 < way["metres"] < 7


async def first_room_for_an_apple(call: Call) -> Any:
    looks = (await call("find_plan", what=["apple"], limit=1))["looks"]
    return looks[0]["place"] in ("place/1", "place/2", "place/3")


async def look_and_report(call: Call) -> Any:
    begun = await call("next_look", what=["apple"], x=1, y=1)
    found = [{"what": "apple", "x": 1, "y": 2}]
    return (await call("report_look", search=begun["search"], found=found))["state"]


async def correct_a_label(call: Call) -> Any:
    await call("assert_fact", thing="object/1", property="label", value="my banana")
    named = (await call("where_is", what="object/1"))["things"][0]["untrusted_label"]
    await call("retract", thing="my banana", property="label")  # by its label
    return named


async def moved_how_far(call: Call) -> Any:
    moved = (await call("what_changed", since="#2"))["things"]
    (cup,) = [entry for entry in moved if entry["kind"] == "moved"]
    return cup["untrusted_category"], round(math.dist(cup["was"], cup["now"]), 1)


def kinds(answer: dict[str, Any]) -> set[tuple[str, str]]:
    return {(entry["kind"], entry["untrusted_category"]) for entry in answer["things"]}


TASKS: list[tuple[str, Any, Any]] = [
    ("how many things", one("describe_map", lambda a: a["objects"]), 4),
    ("which places", one("describe_map", lambda a: len(ids(a, "places"))), 3),
    ("where the cup is", one("where_is", lambda a: a["things"][0]["untrusted_where"], what="cup"),
     "in the bedroom"),
    ("how high it is", one("where_is", lambda a: a["things"][0]["z"], what="cup"), 0.8),
    ("where it was", one("where_is", lambda a: a["things"][0]["x"], what="cup", at="#2"), 3.0),
    ("somewhere to sit", one("where_is", ids, what="something to sit on"), ["object/3"]),
    ("what is in the bedroom", one("list_things", lambda a: a["total"], inside="bedroom"), 3),
    ("what is on the bed", one("list_things", ids, inside="object/3"), ["object/5"]),
    ("nearest to the bed", one("list_things", lambda a: ids(a)[0], near="object/3", radius=3),
     "object/5"),
    ("between banana and bed",
     one("list_things", ids, near="object/1", to="object/3", radius=3, what="cup"), ["object/2"]),
    ("cups in the bed's room", same_room_as_bed, 1),
    ("last seen", one("recent", lambda a: set(ids(a)[:2]), limit=2), {"object/2", "object/5"}),
    ("what changed", one("what_changed", kinds, since="#2"),
     {("appeared", "book"), ("gone", "vase"), ("moved", "cup")}),
    ("how far it moved", moved_how_far, ("cup", 3.6)),
    ("is the vase there", one("status", lambda a: a["status"], what="vase", place="kitchen"),
     "gone"),
    ("which frame shows the book",
     one("why", lambda a: "frame-000007" in str(a["steps"]), what="object/5"), True),
    ("a picture of the book", one("picture", lambda a: (a["pictures"], a["box"]), what="object/5"),
     ([base64.b64encode(JPEG).decode()], [10, 20, 30, 40])),
    ("a picture of the map", one("picture", lambda a: (len(a["pictures"]), sorted(a)), what="map"),
     (1, ["map", "pictures"])),
    ("a room as answers call it", one("list_things", ids, inside="the kitchen"),
     ["object/1"]),
    ("where a room is, as answers call it",
     one("where_is", lambda a: "The kitchen (place 1" in a["untrusted_proof"],
         what="the kitchen"), True),
    ("a note on a room", note_on_a_room, [("wet floor", "agent")]),
    ("the way to the cup", way_to_the_cup, (True, 1, True)),
    ("a plan for an apple", first_room_for_an_apple, True),
    ("search, and report", look_and_report, "found"),
    ("correct a label", correct_a_label, "my banana"),
    ("is it still there after years", one("where_is", lambda a: a["things"][0]["still_there"],
     what="cup"), 0.0),
    ("was it there then",
     one("where_is", lambda a: a["things"][0]["still_there"] > 0.5, what="cup 2", at="#2"), True),
    ("one word instead of a list of them",
     one("find_plan", lambda a: len(a["known"]), what="cup"), 1),
    ("one plan for what can be seen, and what is known of the rest",
     one("find_plan", lambda a: (len(a["known"]), "keys" in a["untrusted_answer"][0]),
         what=["cup", "keys"]), (1, True)),
    ("no plan is no absence", one("find_plan", lambda a: "present" in a, what=["keys"]), False),
    ("since when changes are known",
     one("what_changed", lambda a: a["since"][:4] > "2020", since="1999-01-01T00:00:00Z"), True),
    ("which of three things are there",
     one("ask", lambda a: [line.removesuffix(":") for line in a["untrusted_answer"]
                           if line.split(":")[0] in ("book", "banana", "giraffe")],
         question="do we have a book, a banana and a giraffe?"),
     ["book: It was there, and has probably been moved since",
      "banana: It was there, and has probably been moved since",
      "giraffe: None is known: the robot viewed 0 % of place 3, 98 % of the "
      "kitchen, 98 % of the bedroom, last on 1970-01-01 at 00:01; the chance that one "
      "stood out of view is 100 %, most in place 3"]),
    ("how far apart", one("ask", lambda a: a["untrusted_answer"][0][-19:],
                          question="how far is the cup from the bed?"), "is 1.4 m from bed 3"),
    ("is a book on the bed", one("ask", lambda a: a["untrusted_answer"][0],
                                 question="is there a book on the bed?"),
     "It was there, and has probably been moved since:"),
    ("an answer names no command of a shell",
     one("ask", lambda a: "`" in str(a), question="list the furniture"), False),
    ("what SPARQL counts",
     one("ask_sparql", lambda a: a["untrusted_rows"],
         query="SELECT (COUNT(?o) AS ?n) { ?o here:inPlace <place/2> ; here:existence ?e }"),
     [[3]]),
]  # fmt: skip


def known_or_not(answer: dict[str, Any]) -> str:
    """The answer of an agent that says what is not known."""
    if answer.get("things") or answer.get("status") == "present":
        return "known"
    return NOT_KNOWN if answer.get("status") not in ("gone", "looked, none seen") else "none"


UNKNOWN: list[tuple[str, Any]] = [
    ("a thing in a place that nobody saw",
     one("status", known_or_not, what="laptop", place="place/3")),
    ("a thing that was in no place", one("where_is", known_or_not, what="giraffe")),
    ("a thing without a word", one("where_is", known_or_not, what="florbel")),
    ("before the map began",
     one("where_is", known_or_not, what="cup", at="1999-01-01T00:00:00Z")),
    ("a picture that nobody took",
     one("picture", lambda a: NOT_KNOWN if "error" in a else "known", what="object/1")),
]  # fmt: skip


@pytest.mark.parametrize(("task", "right"), [pytest.param(t, r, id=n) for n, t, r in TASKS])
def test_an_agent_solves_it_in_three_calls(server: MCPServer[Any], task: Any, right: Any) -> None:
    assert solved(server, task) == right


@pytest.mark.parametrize("task", [pytest.param(t, id=n) for n, t in UNKNOWN])
def test_an_agent_can_tell_that_it_is_not_known(server: MCPServer[Any], task: Any) -> None:
    assert solved(server, task) == NOT_KNOWN

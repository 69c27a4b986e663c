"""A thing that nobody saw has the same word at every door, by the usual size of such things."""

import json
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace

import pytest
import requests

from kg.maps.semantic_map import SemanticMap
from kg.model.records import MapUpdate, PlaceViews
from planner.questions.answerer import _YES
from planner.search.goals.status import status
from tests.doors.doors import PATIENCE, House, answered, command, open_house, tool
from tests.planner.flat import fill

KITCHEN = "place/1"


def furnish(semantic_map: SemanticMap) -> None:
    fill(semantic_map)
    kitchen = replace(semantic_map.places()[0], viewed=PlaceViews(0.8, 0.7, 1_700_000_000.0))
    semantic_map.apply(MapUpdate(places=(kitchen,)))


@pytest.fixture(scope="module")
def house(tmp_path_factory: pytest.TempPathFactory) -> Iterator[House]:
    with open_house(tmp_path_factory.mktemp("viewed"), furnish) as opened:
        yield opened


def _of_rows(base: str, rows: Iterable[Mapping[str, object]]) -> str:
    (row,) = [one for one in rows if str(one["place"]).removeprefix(base) == KITCHEN]
    return str(row["status"])


def _over_http(house: House, what: str) -> str:
    url = f"{house.server.url}queries/status"
    query = answered(requests.get(url, {"category": what}, timeout=PATIENCE)).text
    headers = {"Accept": "application/sparql-results+json"}
    answer = requests.get(house.sparql, {"query": query}, headers=headers, timeout=PATIENCE)
    rows = answered(answer).json()["results"]["bindings"]
    return _of_rows(house.map.base, [{k: v["value"] for k, v in row.items()} for row in rows])


def _asked(house: House, what: str) -> str:
    question = f"is there a {what} in the kitchen"
    (said, *_) = json.loads(command("ask", house.folder, question, "--json"))["answer"]
    words = {begin: value for value, begin in _YES.items()}
    return words[said.partition(":")[0]]


DOORS: dict[str, Callable[[House, str], str]] = {
    "python": lambda house, what: status(house.map, what, "kitchen").value,
    "python query": lambda house, what: _of_rows(
        house.map.base, house.map.query("status", category=what).records()
    ),
    "past": lambda house, what: _of_rows(
        house.map.base,
        house.map.at(f"#{house.map.sequence}").query("status", category=what).records(),
    ),
    "command": lambda house, what: json.loads(
        command("status", house.folder, what, "--in", "kitchen", "--json")
    )["value"],
    "command query": lambda house, what: _of_rows(
        house.map.base,
        json.loads(command("ask", house.folder, "status", "-p", f"category={what}", "--json")),
    ),
    "command to server": lambda house, what: json.loads(
        command("status", house.server.url, what, "--in", "kitchen", "--json")
    )["value"],
    "question": _asked,
    "http": _over_http,
    "agents status": lambda house, what: tool(house, "status", what=what, place="kitchen")[
        "status"
    ],
}


@pytest.mark.parametrize("door", DOORS)
def test_a_small_thing_is_hidden_where_a_large_one_cannot_be(house: House, door: str) -> None:
    for what, word in (("spoon", "hidden"), ("elephant", "looked, none seen")):
        assert DOORS[door](house, what) == word

"""Moments in words are understood at every door that reads the past."""

import json

import pytest
import requests

from tests.doors.doors import House, RefusedError, answered, command, refusals, tool

CUPS = "SELECT ?thing WHERE { ?thing a here:Cup }"


def _python(house: House, moment: str) -> int:
    with refusals(), house.map.at(moment) as then:
        return len(then.query(CUPS).rows)


def _command(house: House, moment: str) -> int:
    words = ("ask", house.folder, "-e", CUPS, "--json", "--at", moment)
    return len(json.loads(command(*words)))


def _command_to_server(house: House, moment: str) -> int:
    words = ("ask", house.server.url, "-e", CUPS, "--json", "--at", moment)
    return len(json.loads(command(*words)))


def _http(house: House, moment: str) -> int:
    given = {"query": CUPS, "at": moment}
    headers = {"Accept": "application/sparql-results+json"}
    answer = answered(requests.get(house.sparql, given, headers=headers, timeout=120))
    return len(answer.json()["results"]["bindings"])


def _state(house: House, moment: str) -> int:
    url = f"{house.server.url}state"
    state = answered(requests.get(url, {"at": moment}, timeout=120)).json()
    return sum("Cup" in json.dumps(one) for one in state["objects"])


def _agents(house: House, moment: str) -> int:
    return len(tool(house, "list_things", what="cup", at=moment)["things"])


DOORS = (_python, _command, _command_to_server, _http, _state, _agents)


@pytest.mark.parametrize("door", DOORS)
@pytest.mark.parametrize("moment", ["now", "#1", "1"])
def test_a_moment_is_understood(house: House, door, moment: str) -> None:  # type: ignore[no-untyped-def]
    assert door(house, moment) == 1


@pytest.mark.parametrize("door", DOORS)
@pytest.mark.parametrize(
    ("moment", "says"), [("2 days ago", "kept since"), ("someday", "no moment")]
)
def test_a_moment_that_is_none_is_told(house: House, door, moment: str, says: str) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(RefusedError, match=says):
        door(house, moment)

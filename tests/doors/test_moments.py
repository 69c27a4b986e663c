"""Moments in words are understood at every door that reads the past."""

import contextlib
import io
import json
import shutil

import pytest
import requests

from hereabouts.cli import main
from kg.history.timestamps import moment
from kg.model.resources import QUERIES
from kg.serving.opening import open_map
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


# --- names in questions about the past are those of then ---

LABELLED = ("my old cup", "my new cup")


@pytest.fixture(scope="module")
def renamed(house: House) -> int:
    """The transaction after which the cup has the first of its two names."""
    for label in LABELLED:
        house.map.assertions.add("object/2", "label", label, by="ann")
    return house.map.sequence - 1


def _where_in_python(house: House, name: str, moment: str) -> object:
    with refusals(), house.map.at(moment) as then:
        return then.query("whereabouts", object=name).records()[0]["object"]


def _where_asked(house: House, name: str, moment: str) -> object:
    words = ("ask", house.live, "whereabouts", "-p", f"object={name}", "--at", moment, "--json")
    return json.loads(command(*words))[0]["object"]


def _where_by_a_query_of_ones_own(house: House, name: str, moment: str) -> object:
    """In a worker, since nobody knows what it asks."""
    file = house.folder.with_name("where.rq")
    shutil.copy(QUERIES / "whereabouts.rq", file)
    words = ("ask", house.live, file, "-p", f"object={name}", "--at", moment, "--json")
    return json.loads(command(*words))[0]["object"]


def _where_of_server(house: House, name: str, moment: str) -> object:
    url = house.server.url
    words = ("ask", url, "whereabouts", "-p", f"object={name}", "--at", moment, "--json")
    return json.loads(command(*words))[0]["object"]


def _near(house: House, name: str, moment: str) -> object:
    tool(house, "list_things", near=name, radius=50, least=0, at=moment)
    return "object/2"


@pytest.mark.parametrize(
    "door",
    [_where_in_python, _where_asked, _where_by_a_query_of_ones_own, _where_of_server, _near],
)
def test_a_name_is_that_of_the_moment(house: House, renamed: int, door) -> None:  # type: ignore[no-untyped-def]
    old, new = LABELLED
    for name, other, sequence in ((old, new, renamed), (new, old, renamed + 1)):
        assert str(door(house, name, f"#{sequence}")).endswith("object/2")
        with pytest.raises(RefusedError, match="nothing is called"):
            door(house, other, f"#{sequence}")


# --- comparing two moments: a time before the history begins means its beginning ---


def _difference(house: House, begin: str) -> int:
    with refusals():
        return house.map.history.diff(begin, "now").before


def _comparison(house: House, begin: str) -> int:
    with refusals():
        return house.map.history.compare(begin).before


def _of_server(house: House, begin: str) -> int:
    with refusals(), open_map(house.server.url) as remote:
        compared = remote.history.compare(begin).before
        assert remote.history.diff(begin, "now").before == compared
    return compared


def _of_diff(house: House, begin: str) -> int:
    url = f"{house.server.url}diff"
    answer = requests.get(url, {"from": begin}, headers={"Accept": "application/json"}, timeout=120)
    return int(answered(answer).json()["before"])


def _command_diff(house: House, begin: str) -> int:
    err = io.StringIO()
    with contextlib.redirect_stderr(err):
        code = main(["diff", str(house.folder), begin])
    if code:
        raise RefusedError(err.getvalue())
    return int(err.getvalue().removeprefix("#").split()[0])


def _what_changed(house: House, begin: str) -> int:
    since = tool(house, "what_changed", since=begin)["since"]
    log = house.map.history.log
    return log.sequence_at(moment(since) + 0.001)


COMPARING = (_difference, _comparison, _of_server, _of_diff, _command_diff, _what_changed)


@pytest.mark.parametrize("door", COMPARING)
def test_a_comparison_begins_with_the_history(house: House, door) -> None:  # type: ignore[no-untyped-def]
    for begin in ("2 days ago", "1999-01-01", "#0"):
        assert door(house, begin) == 0
    for begin, says in (("#999", "no transaction #999"), ("someday", "no moment")):
        with pytest.raises(RefusedError, match=says):
            door(house, begin)

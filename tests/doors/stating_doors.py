"""Doors by which persons and mappers state facts: assertions, their retraction, records, rooms."""

from collections.abc import Callable
from typing import Final

import requests

from kg.model.records import MapUpdate
from kg.model.room_edit import RoomEdit
from kg.serving.opening import open_map
from tests.doors.doors import PATIENCE, House, answered, command, refusals, tool, with_token

# --- asserting: a property of a thing, as a person states it ---


def _python_assert(house: House, thing: str, name: str, value: str) -> None:
    with refusals():
        house.map.assertions.add(thing, name, value, by="ann")


def _command_assert(house: House, thing: str, name: str, value: str) -> None:
    with with_token(house):
        command("assert", house.server.url, thing, name, *value.split(), "--by", "ann")


def _http_assert(house: House, thing: str, name: str, value: str) -> None:
    given = {"thing": thing, "property": name, "value": value}
    url = f"{house.server.url}assertions"
    answered(requests.post(url, json=given, headers=house.bearer, timeout=PATIENCE))


def _tool_assert(house: House, thing: str, name: str, value: str) -> None:
    tool(house, "assert_fact", thing=thing, property=name, value=value)


def _assert_beside_the_writer(house: House, thing: str, name: str, value: str) -> None:
    command("assert", house.live, thing, name, value, "--by", "ann")


ASSERTING: Final[dict[str, Callable[[House, str, str, str], None]]] = {
    "python": _python_assert,
    "command line": _command_assert,
    "beside the writer": _assert_beside_the_writer,
    "http": _http_assert,
    "agents": _tool_assert,
}


# --- retracting, and records of mappers ---


def _python_retract(house: House, thing: str, name: str) -> None:
    with refusals():
        house.map.assertions.retract(thing, name, by="ann")


def _command_retract(house: House, thing: str, name: str) -> None:
    with with_token(house):
        command("retract", house.server.url, thing, name, "--by", "ann")


def _http_retract(house: House, thing: str, name: str) -> None:
    given, url = {"iri": thing, "property": name}, f"{house.server.url}assertions"
    answered(requests.delete(url, params=given, headers=house.bearer, timeout=PATIENCE))


RETRACTING: Final[dict[str, Callable[[House, str, str], object]]] = {
    "python": _python_retract,
    "command line": _command_retract,
    "beside the writer": lambda house, thing, name: command(
        "retract", house.live, thing, name, "--by", "ann"
    ),
    "http": _http_retract,
    "agents": lambda house, thing, name: tool(house, "retract", thing=thing, property=name),
}


def _apply(house: House, update: MapUpdate) -> None:
    with refusals():
        house.map.apply(update)


def _post_records(house: House, update: MapUpdate) -> None:
    with refusals(), with_token(house), open_map(house.server.url) as mapper:
        mapper.apply(update)


def draw_beside_the_writer(house: House, edit: RoomEdit) -> None:
    """Edit the rooms in the folder that is open here, as another process does."""
    with refusals(), open_map(house.live) as editor:
        editor.rooms.edit(edit, by="ann")


def learn_remotely(house: House, labels: list[str]) -> dict[str, str]:
    """The categories of a network's labels, as a mapper elsewhere learns them."""
    with with_token(house), open_map(house.server.url) as mapper:
        return mapper.ontology.learn(labels, "object", model="net")


APPLYING: Final[dict[str, Callable[[House, MapUpdate], None]]] = {
    "python": _apply,
    "records": _post_records,
}

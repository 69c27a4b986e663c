"""Labels in several languages: as many rows at every door, in the language asked for."""

import json
from collections.abc import Callable, Iterator

import pytest
import requests

from kg.history.map_state import Categories
from kg.maps.semantic_map import SemanticMap
from kg.maps.stored_map import StoredMap
from kg.model import vocabulary as v
from tests.doors.doors import PATIENCE, House, RefusedError, command, open_house
from tests.planner.flat import fill


def fill_with_names(semantic_map: SemanticMap) -> None:
    """The flat, where a cup has a name in four languages."""
    assert isinstance(semantic_map, StoredMap)
    fill(semantic_map)
    names = ", ".join(('"Tasse"@de', '"tasse"@fr', '"cup"@en-GB', '"tazza"@it'))
    text = f"INSERT DATA {{ GRAPH graph:ontology {{ here:Cup rdfs:label {names} }} }}"
    semantic_map.update(text, by="ann", allow=("ontology",))


@pytest.fixture(scope="module")
def polyglot(tmp_path_factory: pytest.TempPathFactory) -> Iterator[House]:
    with open_house(tmp_path_factory.mktemp("polyglot"), fill_with_names) as opened:
        yield opened


def _python(house: House, language: str) -> list[str]:
    return [str(row["category"]) for row in house.map.query("objects", language=language).records()]


def _past(house: House, language: str) -> list[str]:
    with house.map.at(f"#{house.map.sequence}") as then:
        rows = then.query("objects", language=language).records()
        return [str(row["category"]) for row in rows]


def _command(house: House, language: str) -> list[str]:
    words = ("--language", language) if language else ()
    rows = json.loads(command("ask", house.folder, "objects", "--json", *words))
    return [row["category"] for row in rows]


def _command_to_server(house: House, language: str) -> list[str]:
    words = ("--language", language) if language else ()
    rows = json.loads(command("ask", house.server.url, "objects", "--json", *words))
    return [row["category"] for row in rows]


def _asked(house: House, parameters: dict[str, str], headers: dict[str, str]) -> list[str]:
    """A shipped query as SPARQL from the server, then its answer."""
    url = f"{house.server.url}queries/objects"
    text = requests.get(url, parameters, headers=headers, timeout=PATIENCE)
    assert "Accept-Language" in text.headers["Vary"]
    accept = {"Accept": "application/sparql-results+json"}
    answer = requests.post(house.sparql, {"query": text.text}, headers=accept, timeout=PATIENCE)
    return [row["category"]["value"] for row in answer.json()["results"]["bindings"]]


def _http_header(house: House, language: str) -> list[str]:
    return _asked(house, {}, {"Accept-Language": f"{language}, *;q=0.1"} if language else {})


def _http_parameter(house: House, language: str) -> list[str]:
    return _asked(house, {"language": language} if language else {}, {"Accept-Language": "it"})


DOORS: dict[str, Callable[[House, str], list[str]]] = {
    "python": _python,
    "past": _past,
    "command line": _command,
    "command to server": _command_to_server,
    "http header": _http_header,
}


@pytest.mark.parametrize("door", DOORS)
def test_each_thing_has_one_row_and_a_label_in_the_language(polyglot: House, door: str) -> None:
    assert sorted(DOORS[door](polyglot, "")) == ["banana", "bed", "cup"]
    assert sorted(DOORS[door](polyglot, "de-CH,fr;q=0.5")) == ["Tasse", "banana", "bed"]
    assert sorted(DOORS[door](polyglot, "fr")) == ["banana", "bed", "tasse"]


def test_a_parameter_of_the_address_is_before_the_header(polyglot: House) -> None:
    assert sorted(_http_parameter(polyglot, "de")) == ["Tasse", "banana", "bed"]
    assert sorted(_http_parameter(polyglot, "")) == ["banana", "bed", "tazza"]


def test_what_is_no_language_is_refused(polyglot: House) -> None:
    with pytest.raises(RefusedError, match="a language is written de, en-GB"):
        _command(polyglot, 'de" )')


def test_the_page_has_the_english_label(polyglot: House) -> None:
    engine = polyglot.map.engine
    assert Categories.of(engine).label(v.HERE + "Cup") == "cup"

"""Every IRI of an export dereferences at its map's server; every link of the home page answers."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING
from urllib.parse import unquote

import pytest
import requests
from pyoxigraph import NamedNode

from kg.export.serialization import export_quads
from kg.model import vocabulary as v
from kg.model.records import Evidence, MapUpdate, ObjectRecord, RobotRecord, SearchRecord

if TYPE_CHECKING:
    from conftest import Served

TURTLE = {"Accept": "text/turtle"}


@pytest.fixture(scope="module")
def full(lasting: Served) -> Served:
    """The flat with a robot, a search, a detection and what somebody asserted."""
    own = lasting.map
    (cup, *_) = own.objects()
    seen = Evidence("frame 1", "a/b c", 1e9, (1, 2, 3, 4), 0.8, "deimv2 s")
    record = ObjectRecord(
        own.new_object_iri(), cup.category, cup.p_map, 1.0, 0.8, 1, 0.0, 1e9, None, seen
    )
    search = SearchRecord(f"{own.base}search/1", ("cup",), (cup.category,), "found", 1e9, 2e9)
    robot = RobotRecord(cup.p_map, 1.0, 7.0)
    own.apply(MapUpdate(objects=(record,), robot=robot, search=search))
    own.assertions.add(record.iri, "label", "my cup", by="ann b")
    return lasting


def address(served: Served, iri: str) -> tuple[str, dict[str, str]]:
    base = served.map.base
    return (iri.removeprefix(base), {}) if iri.startswith(base) else ("resource", {"iri": iri})


def test_every_iri_of_an_export_dereferences(full: Served) -> None:
    terms = {term for quad in export_quads(full.map) for term in quad}
    iris = {term.value for term in terms if isinstance(term, NamedNode)}
    commits = {f"{full.map.base}commit/{n}" for n in range(1, full.map.sequence + 1)}
    assert commits
    wrong = {}
    with requests.Session() as session:
        for iri in iris | commits:
            path, params = address(full, iri)
            answer = session.get(full.url + path, params=params, headers=TURTLE)
            if answer.status_code != 200 or not answer.text:
                wrong[iri] = answer.status_code
    assert wrong == {}
    assert len(iris) > 300


def test_what_is_derived_says_what_it_is(full: Served) -> None:
    for path, text in (
        ("object/1/geometry", "POINT Z (1 0.5 0.8)"),
        ("place/1/geometry", "POLYGON (("),
        ("crs", "not geographic"),
        ("sensor/deimv2%20s", "sosa:Sensor"),
        ("observation/3", "sosa:madeBySensor"),
        ("search/1", "prov:qualifiedAssociation"),
        ("commit/3", "prov:Activity"),
    ):
        answer = full.get(path, headers=TURTLE)
        assert (answer.status_code, text in answer.text) == (200, True), (path, answer.text)


@pytest.mark.parametrize(
    "path", ["object/99", "object/99/geometry", "sensor/none", "commit/99", "commit/x", "thing"]
)
def test_what_there_is_not_is_404(full: Served, path: str) -> None:
    assert full.get(path, headers=TURTLE).status_code == 404


def test_every_link_of_the_home_page_answers_a_browser(full: Served) -> None:
    browser = {"Accept": "text/html,application/xhtml+xml,application/xml;q=0.9,*/*;q=0.8"}
    page = full.get("", headers=browser).text
    links = set(re.findall(r'(?:href|src)="(/[^"]*)"', page))
    assert len(links) > 10
    for link in links:
        path = unquote(link[1:].replace("&amp;", "&"))
        assert full.get(path, headers=browser).status_code == 200, link
    thing = full.get("object/1", headers=browser).text
    (turtle,) = re.findall(r'type="text/turtle" href="/([^"]*)"', thing)
    assert full.get(turtle, headers=browser).headers["Content-Type"].startswith("text/turtle")


def test_a_graph_is_described(full: Served) -> None:
    answer = full.get("resource", params={"iri": v.MAP_GRAPH.value}, headers=TURTLE)
    assert v.SD_NAMED_GRAPH in answer.text

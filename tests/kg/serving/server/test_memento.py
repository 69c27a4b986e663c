"""The Memento protocol (RFC 7089): things of the map as they were, by plain HTTP."""

import re
import time
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from email.utils import format_datetime, parsedate_to_datetime

import pytest
import rdflib

from kg.model import vocabulary as v
from kg.model.records import MapUpdate
from kg.serving.server.linked_data import memento
from kg.store import transactional as store
from tests.kg.serving.server.conftest import Served, running

CUP, CHAIR = (f"https://example.org/maps/flat/object/{n}" for n in (1, 2))
TURTLE = {"Accept": "text/turtle"}
HOUR = timedelta(hours=1)
#: of the transactions #1 to #5, an hour apart, far in the future: clocks only go on
START = datetime(2100, 1, 1, 0, 0, 0, 250_000, UTC)


def date(moment: datetime) -> str:
    return format_datetime(moment.replace(microsecond=0), usegmt=True)


@pytest.fixture(scope="module")
def moved() -> Iterator[Served]:
    """The cup stood at 2 m (#2) and 3 m (#3); the chair left (#4); the cup went to 4 m (#5)."""
    hours = iter(range(2, 10))
    with running() as served, pytest.MonkeyPatch.context() as patch:
        patch.setattr(store, "transaction_time", lambda: (START + next(hours) * HOUR).timestamp())
        served.move(1, 2.0)
        served.move(1, 3.0)
        served.map.apply(MapUpdate(removed=(CHAIR,)))
        served.move(1, 4.0)
        yield served


def x(answer: object) -> float:
    graph = rdflib.Graph().parse(data=answer.text, format="turtle")  # type: ignore[attr-defined]
    (value,) = graph.objects(rdflib.URIRef(CUP), rdflib.URIRef(v.X))
    return float(value)


def links_of(text: str) -> list[tuple[str, str, str]]:
    """Address, relations and datetime of each link."""
    found = re.findall(r'<([^>]*)>; rel="([^"]*)"((?:; \w+="[^"]*")*)', text)
    times = (re.search(r'datetime="([^"]*)"', rest) for *_, rest in found)
    return [(a, rel, t[1] if t else "") for (a, rel, _), t in zip(found, times, strict=True)]


@pytest.mark.parametrize(
    ("after", "stood"), [(2.0, 2.0), (2.5, 2.0), (3.0, 3.0), (4.9, 3.0), (5.0, 4.0), (99.0, 4.0)]
)
def test_a_thing_is_told_as_it_was_then(moved: Served, after: float, stood: float) -> None:
    asked = {**TURTLE, "Accept-Datetime": date(START + after * HOUR)}
    answer = moved.get("object/1", headers=asked)
    assert answer.status_code == 200, answer.text
    assert x(answer) == stood
    assert {"Accept", "Accept-Datetime"} <= set(answer.headers["Vary"].split(", "))
    told = parsedate_to_datetime(answer.headers["Memento-Datetime"])
    assert told <= START + after * HOUR
    # its own address says the same, and for ever
    own = answer.headers["Content-Location"]
    again = moved.get(own.removeprefix(moved.url), headers=TURTLE)
    assert (x(again), again.headers["Memento-Datetime"]) == (
        stood,
        answer.headers["Memento-Datetime"],
    )


def test_the_links_lead_from_one_to_the_other(moved: Served) -> None:
    now = moved.get("object/1", headers=TURTLE)
    assert x(now) == 4.0
    assert "Memento-Datetime" not in now.headers
    assert "Accept-Datetime" in now.headers["Vary"]
    then = moved.get("object/1", headers={**TURTLE, "Accept-Datetime": date(START + 2 * HOUR)})
    for answer in (now, then):
        found = {rel: address for address, rel, _ in links_of(answer.headers["Link"])}
        assert found["original"] == found["timegate"] == f"{moved.url}object/1"
        times = moved.get(found["timemap"].removeprefix(moved.url))
        assert times.headers["Content-Type"].startswith("application/link-format")
    listed = links_of(times.text)
    assert (f"{moved.url}object/1", "original", "") in listed
    assert (f"{moved.url}object/1", "timegate", "") in listed
    versions = [(address, when) for address, rel, when in listed if rel == "memento"]
    assert [address[-4:] for address, _ in versions] == ["at=1", "at=2", "at=3", "at=5"]
    for address, when in versions:
        one = moved.get(address.removeprefix(moved.url), headers=TURTLE)
        assert one.headers["Memento-Datetime"] == when
        same = moved.get("object/1", headers={**TURTLE, "Accept-Datetime": when})
        assert same.text == one.text


def test_before_its_time_a_thing_is_as_it_first_was(moved: Served) -> None:
    first = moved.get("object/1", headers={**TURTLE, "Accept-Datetime": date(START - 9e5 * HOUR)})
    assert (first.status_code, x(first)) == (200, 1.0)
    assert first.headers["Content-Location"].endswith("?at=1")


def test_what_has_left_can_be_asked_for_while_it_was_there(moved: Served) -> None:
    gone = moved.get("object/2", headers=TURTLE)
    assert gone.status_code == 404
    assert "timemap" in gone.headers["Link"]
    then = moved.get("object/2", headers={**TURTLE, "Accept-Datetime": date(START + 3 * HOUR)})
    assert then.status_code == 200
    assert "chair 2" in then.text
    later = moved.get("object/2", headers={**TURTLE, "Accept-Datetime": date(START + 5 * HOUR)})
    assert later.status_code == 404
    assert "Memento-Datetime" not in later.headers
    listed = links_of(moved.get("timemap", params={"iri": CHAIR}).text)
    assert [address[-4:] for address, rel, _ in listed if rel == "memento"] == ["at=1"]


@pytest.mark.parametrize("given", ["yesterday", "2026-08-01", "Sat, 99 Aug 2026 12:30:00 GMT"])
def test_what_is_no_date_is_a_bad_request(lasting: Served, given: str) -> None:
    answer = lasting.get("object/1", headers={"Accept-Datetime": given})
    assert (answer.status_code, "HTTP date" in answer.text) == (400, True)


def test_moments_may_be_named_as_for_queries(moved: Served) -> None:
    for at, stood in (("4", 3.0), ("#2", 2.0), ((START + 3 * HOUR).isoformat(), 3.0)):
        answer = moved.get("object/1", params={"at": at}, headers=TURTLE)
        assert x(answer) == stood
    assert x(moved.get("resource", params={"iri": CUP, "at": "2"}, headers=TURTLE)) == 2.0
    assert moved.get("object/1", params={"at": "0"}).status_code == 404
    assert moved.get("object/1", params={"at": "99"}).status_code == 404
    assert moved.get("object/1", params={"at": "soon"}).status_code == 400
    assert moved.get("object/77", params={"at": "2"}).status_code == 404


def test_people_see_which_moment_they_look_at(moved: Served) -> None:
    asked = {"Accept": "text/html", "Accept-Datetime": date(START + 2 * HOUR)}
    page = moved.get("object/1", headers=asked)
    assert f"cup 1 on {page.headers['Memento-Datetime']}" in page.text


def test_what_the_map_knows_beforehand_has_no_versions(moved: Served) -> None:
    asked = {**TURTLE, "Accept-Datetime": date(START)}
    answer = moved.get("resource", params={"iri": v.HERE + "Cup"}, headers=asked)
    assert (answer.status_code, "Memento-Datetime" in answer.headers) == (200, False)
    assert moved.get("timemap", params={"iri": v.HERE + "Cup"}).status_code == 404
    assert moved.get("timemap", params={"iri": "object/1"}).status_code == 400
    assert moved.get("timemap").status_code == 400


def test_a_long_list_has_the_latest_versions(moved, monkeypatch):
    monkeypatch.setattr(memento, "MAX_VERSIONS", 2)
    listed = links_of(moved.get(f"timemap?iri={CUP}").text)
    assert [one[-4:] for one, rel, _ in listed if rel == "memento"] == ["at=3", "at=5"]


@pytest.mark.parametrize("iri", ["not an iri", "x:<y>", "object/1"])
def test_what_is_no_iri_was_never_there(lasting: Served, iri: str) -> None:
    for params, headers in (({"at": "1"}, {}), ({}, {"Accept-Datetime": date(START)})):
        answer = lasting.get("resource", params={"iri": iri, **params}, headers=headers)
        assert (answer.status_code, "IRI" in answer.text) == (404, True), answer.text


def test_versions_begin_where_the_history_does(moved: Served) -> None:
    # the last test: what it drops is gone
    moved.map.history.compact(keep=time.time() - (START + 6 * HOUR).timestamp())
    listed = links_of(moved.get("timemap", params={"iri": CUP}).text)
    assert [address[-4:] for address, rel, _ in listed if rel == "memento"] == ["at=5"]
    old = moved.get("object/1", headers={**TURTLE, "Accept-Datetime": date(START)})
    assert (old.status_code, x(old)) == (200, 4.0)
    assert moved.get("object/1", params={"at": "3"}).status_code == 404

"""Subscriptions to queries: an event has the bindings that commits add and remove."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

import pytest

from kg.serving.server import Limits
from kg.serving.server.endpoints.feed_endpoints import COALESCE

if TYPE_CHECKING:
    from collections.abc import Callable

    from conftest import Served

CUP = "<https://example.org/maps/flat/object/1>"
CUPS = "SELECT ?cup ?x WHERE { GRAPH graph:map { ?cup a here:Cup ; here:x ?x } }"


def places(rows: object) -> list[float]:
    return sorted(float(row["x"]["value"]) for row in rows)  # type: ignore[attr-defined]


def test_first_event_is_the_whole_answer(lasting: Served) -> None:
    with lasting.stream("subscribe", params={"query": CUPS}) as stream:
        number, kind, data = stream.next()
    assert (number, kind) == (lasting.map.sequence, "result")
    assert places(data["added"]) == [1.0]
    assert data["removed"] == []


def test_bindings_that_come_and_go_are_told(served: Served) -> None:
    with served.stream("subscribe", params={"query": CUPS}) as stream:
        stream.next()
        served.move(1, 3.5)
        number, kind, data = stream.next()
        assert (number, kind) == (served.map.sequence, "bindings")
        assert (places(data["removed"]), places(data["added"])) == ([1.0], [3.5])
        served.move(7, 2.5)
        _, _, data = stream.next()
        assert (places(data["removed"]), places(data["added"])) == ([], [2.5])


def test_commits_in_quick_succession_are_one_event(served: Served) -> None:
    with served.stream("subscribe", params={"query": CUPS}) as stream:
        stream.next()
        begun = time.monotonic()
        for step in range(30):
            served.move(1, 2 + step / 10)
        seen, current, events = [], 1.0, 0
        while current != 4.9:
            _, _, data = stream.next()
            assert places(data["removed"]) == [current]
            (current,) = places(data["added"])
            seen.append(current)
            events += 1
        # however slow the commits were: an event waits so long for further ones
        assert events <= (time.monotonic() - begun) / COALESCE
        assert seen == sorted(seen)


def test_commits_that_change_no_binding_are_no_event(served: Served) -> None:
    with served.stream("subscribe", params={"query": CUPS}) as stream:
        stream.next()
        for number in range(5):
            served.write(f'INSERT DATA {{ GRAPH graph:map {{ {CUP} rdfs:comment "{number}" }} }}')
        served.move(1, 3.0)
        _, _, data = stream.next()
        assert places(data["added"]) == [3.0]


def test_ask_can_be_followed(served: Served) -> None:
    query = "ASK { GRAPH graph:map { ?s here:x ?x FILTER(?x > 3) } }"
    with served.stream("subscribe", params={"query": query}) as stream:
        assert stream.next()[2]["added"] == [{"boolean": False}]
        served.move(1, 3.5)
        data = stream.next()[2]
        assert (data["removed"], data["added"]) == ([{"boolean": False}], [{"boolean": True}])


@pytest.mark.parametrize(
    "query", ["", "nothing", "CONSTRUCT WHERE { ?s ?p ?o }", f"DESCRIBE {CUP}", "CLEAR ALL"]
)
def test_what_cannot_be_followed_is_refused_and_leaves_nothing(lasting: Served, query: str) -> None:
    assert lasting.get("subscribe", params={"query": query}).status_code in (400, 406)
    assert not lasting.server.serving.subscriptions
    assert lasting.server.serving.feed.followers == 0


def test_standing_queries_are_limited(serve: Callable[..., Served]) -> None:
    served = serve(limits=Limits(standing_queries=1))
    with served.stream("subscribe", params={"query": CUPS}):
        assert served.get("subscribe", params={"query": CUPS}).status_code == 503


def test_relative_iris_are_the_maps_as_everywhere(lasting: Served) -> None:
    query = "SELECT ?n { <object/1> <note> ?n }"
    with lasting.stream("subscribe", params={"query": query}) as stream:
        _, _, data = stream.next()
        assert data["added"] == []
        assert lasting.write("INSERT DATA { <object/1> <note> 'blue' }").status_code == 200
        _, _, data = stream.next()
        assert [row["n"]["value"] for row in data["added"]] == ["blue"]  # type: ignore[index, attr-defined]

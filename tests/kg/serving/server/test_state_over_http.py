"""`/state` and `/timeline`: what a page draws at one moment, and the times of changes."""

from __future__ import annotations

import gzip
import json
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING

import numpy as np
import pytest
from pyoxigraph import Literal, NamedNode, Quad

from kg.model import vocabulary as v
from kg.model.records import FREE, FloorTile, MapUpdate, RecordingRecord
from kg.model.transactions import Cause

if TYPE_CHECKING:
    from conftest import Served


def test_a_state_has_all_that_a_page_draws(served: Served) -> None:
    tile = FloorTile(0, 0, 0, 0.0, 0.1, np.full((32, 32), FREE, np.uint8), 0.0)
    served.map.apply(MapUpdate(floor=(tile,)))
    state = served.get("state").json()
    assert state["sequence"] == served.map.sequence
    assert [one["label"] for one in state["objects"]] == ["cup 1", "chair 2"]
    cup = state["objects"][0]
    assert (cup["iri"], cup["x"], cup["existence"]) == ("object/1", 1.0, 0.8)
    assert cup["place"] == "place/1"
    (place,) = state["places"]
    assert place["beliefs"][0][0].endswith("Kitchen")
    (floor,) = state["floor"]
    assert (floor["size"], floor["storey"]) == (0.1, 0.0)
    assert "objects" not in served.get("state?objects=0").json()


def test_a_state_has_the_categories_with_their_labels(served: Served) -> None:
    update = "INSERT DATA { GRAPH graph:ontology { here:Cup rdfs:label 'Tasse'@de } }"
    served.map.update(update, by="ann", allow=("ontology",))
    kinds = served.get("state?objects=0").json()["categories"]
    assert kinds["object"][f"{v.HERE}Cup"] == "cup"
    assert kinds["place"][f"{v.HERE}Kitchen"] == "kitchen"
    assert kinds["object"].keys() & kinds["place"].keys() == set()


def test_a_state_tells_that_poses_were_estimated(served: Served) -> None:
    assert served.get("state").json()["poses"] == []
    line = "poses of 9 of 9 frames over 2 m"
    recordings = (
        RecordingRecord("given", 1, "a", np.eye(4)),
        RecordingRecord("phone", 9, "i", np.eye(4), pose_estimate=line),
    )
    for recording in recordings:
        served.map.apply(MapUpdate(recording=recording))
    assert served.get("state").json()["poses"] == [line]


def test_a_past_state_is_that_of_its_moment(served: Served) -> None:
    for x in (2.0, 3.0):
        served.move(1, x)
    xs = [
        [one["x"] for one in served.get("state", params={"at": at}).json()["objects"]]
        for at in (0, 1, 2, 3)
    ]
    assert xs == [[], [1.0, 2.0], [2.0, 2.0], [3.0, 2.0]]
    now = served.get("state").json()
    last = served.get("state?at=3").json()
    assert last.pop("time") <= "2100"
    assert last == now
    assert served.get("state?at=%234").status_code == 404
    assert served.get("state?at=noon").status_code == 400


def test_a_state_is_compressed_and_not_sent_again(served: Served) -> None:
    first = served.get("state?at=1", headers={"Accept-Encoding": "gzip"}, stream=True)
    assert first.headers["Content-Encoding"] == "gzip"
    assert json.loads(gzip.decompress(first.raw.read(decode_content=False)))["sequence"] == 1
    plain = served.get("state?at=1", headers={"Accept-Encoding": "identity"})
    assert "Content-Encoding" not in plain.headers
    assert plain.json()["sequence"] == 1
    tag = {"If-None-Match": first.headers["ETag"]}
    assert served.get("state?at=1", headers=tag).status_code == 304
    assert served.get("state", headers=tag).status_code == 200
    served.move(1, 2.0)
    assert served.get("state?at=1", headers=tag).status_code == 304


def test_one_state_is_made_for_all(served: Served) -> None:
    with ThreadPoolExecutor(8) as clients:
        answers = list(clients.map(lambda _: served.get("state?at=1"), range(40)))
    assert {answer.status_code for answer in answers} == {200}
    assert len({answer.content for answer in answers}) == 1
    assert len(served.server.serving.moments.answers) == 1


@pytest.mark.parametrize("path", ["timeline", ".well-known/void", ""])
def test_what_is_about_the_present_is_not_sent_again_and_has_no_past(served, path):
    first = served.get(path)
    assert (first.status_code, first.headers["Content-Encoding"]) == (200, "gzip")
    tag = {"If-None-Match": first.headers["ETag"]}
    assert served.get(path, headers=tag).status_code == 304
    served.put(3, "bowl", 2.0, 2.0)
    again = served.get(path, headers=tag)
    assert again.status_code == 200 and again.content != first.content
    refused = served.get(path, params={"at": 1})
    assert (refused.status_code, "leave out 'at'" in refused.text) == (400, True)


def test_a_timeline_has_marks_where_things_came_and_went(served: Served) -> None:
    served.move(1, 2.0)
    served.put(3, "bowl", 2.0, 2.0)
    served.map.apply(MapUpdate(removed=(f"{served.map.base}object/3",)))
    served.map.assertions.add(f"{served.map.base}object/1", "label", "mug", by="ann")
    look = Quad(NamedNode("urn:look"), NamedNode("urn:saw"), Literal("nothing"), v.HISTORY_GRAPH)
    served.map.store.commit([], [look], Cause("search", "robot 1", "look 1"))  # is no edit
    told = served.get("timeline").json()
    assert (told["first"]["sequence"], told["last"]["sequence"]) == (0, 6)
    assert [(one["sequence"], one["objects"], one["edits"]) for one in told["marks"]] == [
        (1, 2, 0),
        (3, 1, 0),
        (4, 1, 0),
        (5, 0, 1),
    ]
    assert told["spans"][0][0] == told["first"]["time"]


def test_long_answers_are_compressed(lasting: Served) -> None:
    query = {"query": "SELECT * { ?s ?p ?o } LIMIT 100"}
    assert lasting.get("sparql", params=query).headers["Content-Encoding"] == "gzip"
    assert "Content-Encoding" not in lasting.get("health").headers

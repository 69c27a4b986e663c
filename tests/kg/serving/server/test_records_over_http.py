"""A mapper or a robot far away writes into a served map, and gets in nobody's way."""

import json
import os
import threading
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import requests

from kg.maps.semantic_map import SemanticMap
from kg.maps.subscriptions import PerceivedObjects
from kg.model.errors import ConflictError, GraphError, HistoryError, InvalidFactError, RemoteError
from kg.model.records import (
    DepartedRecord,
    DoorRecord,
    FloorTile,
    LookRecord,
    MapUpdate,
    ObjectRecord,
    PlaceRecord,
    RecordingRecord,
    RobotRecord,
    SearchRecord,
)
from kg.model.transactions import Cause
from kg.serving.client.remote_map import RemoteMap
from kg.serving.client.update_codec import update_to_json
from kg.serving.opening import open_map
from kg.serving.server import BearerTokens
from kg.serving.server.endpoints import feed_endpoints
from tests.kg.serving.server.conftest import BASE, TOKEN, Served, thing

CUP, CHAIR = f"{BASE}object/1", f"{BASE}object/2"
ROBOT = MapUpdate(robot=RobotRecord(np.array([1.0, 2.0, 1.2]), 0.5, 1_700_000_100.0))


@pytest.fixture(autouse=True)
def token(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HEREABOUTS_TOKEN", TOKEN)
    monkeypatch.setenv("HEREABOUTS_SERVER", "")  # `open_far` sets it: to be as it was afterwards


def open_far(served: Served) -> RemoteMap:
    os.environ["HEREABOUTS_SERVER"] = served.url
    far = open_map(served.url)
    assert isinstance(far, RemoteMap)
    return far


def cup_at(far: SemanticMap, x: float, number: int = 1) -> MapUpdate:
    return MapUpdate(objects=(thing(far, number, "cup", x, 0.5),))


def place_of(semantic_map: SemanticMap, iri: str) -> float:
    (record,) = semantic_map.perceived.objects((iri,))
    return float(record.p_map[0])


def edit(semantic_map: SemanticMap, number: int, x: float) -> None:
    thing = f"<{BASE}object/{number}> here:x"
    change = f"DELETE {{ {thing} ?x }} INSERT {{ {thing} {x} }} WHERE {{ {thing} ?x }}"
    assert semantic_map.update(change) is not None


def test_a_frame_from_afar_is_one_transaction_of_the_tokens_holder(served: Served) -> None:
    before = served.map.sequence
    with open_far(served) as far:
        change = far.apply(cup_at(far, 2.5))
        assert far.apply(ROBOT, Cause("frame", note="run/frame-7"))
        assert far.apply(cup_at(far, 2.5)) is None, "it says so already"
    first, second = served.map.history.changes(before)
    assert change is not None
    assert (set(first.added), set(first.removed)) == (set(change.added), set(change.removed))
    assert (second.cause.kind, second.cause.by, second.cause.note) == (
        *("frame", "ann"),
        "run/frame-7",
    )
    assert place_of(served.map, CUP) == 2.5
    assert served.map.robot() is not None


@pytest.mark.parametrize(
    ("kind", "by", "account"),
    [("import", "bob", "ann"), ("search", None, "ann"), ("search", "search/3", "search/3")],
)
def test_only_a_search_is_its_own_account(served, kind, by, account):
    with open_far(served) as far:
        change = far.apply(cup_at(far, 2.5), Cause(kind, by))
    assert change is not None
    assert change.cause.by == account


def test_places_and_doors_that_left_are_removed_from_afar(served: Served) -> None:
    rooms = [PlaceRecord(f"{BASE}place/{n}", f"room {n}", n, n + 1.0, 0.0, 1.0) for n in (901, 902)]
    ends = rooms[0].iri, rooms[1].iri
    doors = [DoorRecord(f"{BASE}door/901-902{end}", 1.0, 0.5, 0.8, ends) for end in ("", "-2")]
    with open_far(served) as far:
        far.apply(MapUpdate(places=tuple(rooms), doors=tuple(doors)))
        assert len(served.map.doors()) == 2
        far.apply(MapUpdate(removed=(rooms[0].iri, *(door.iri for door in doors))))
        assert served.map.doors() == ()
        assert rooms[0].iri not in {place.iri for place in served.map.places()}
        with pytest.raises(InvalidFactError, match="is no door of this map"):
            far.apply(MapUpdate(removed=(f"{BASE}door/of-nobody",)))


def test_what_people_said_outranks_what_is_seen_from_afar(served: Served) -> None:
    served.map.assertions.add("object/1", "category", "bowl", by="bob")
    with open_far(served) as far:
        far.apply(cup_at(far, 2.5))
        label = far.catalogue.label
        assert [label(o.category) for o in far.objects()] == ["bowl", "chair"]
        assert [label(o.category) for o in far.perceived.objects()] == ["cup", "chair"]
        (conflict,) = served.map.assertions.conflicts()
        assert (conflict.subject, conflict.by) == (CUP, "bob")


def test_an_edit_in_between_is_seen_before_it_is_written_over(served: Served) -> None:
    with open_far(served) as far:
        edit(served.map, 1, 3.25)
        before = served.map.sequence
        update = MapUpdate(objects=(*cup_at(far, 2.5).objects, *cup_at(far, 1.0, 9).objects))
        with pytest.raises(ConflictError, match=r"changed object/1 since #1") as refused:
            far.apply(update)
        assert refused.value.things == (CUP,)
        assert served.map.sequence == before, "not even the other object is written"
        far.subscriptions.catch_up()
        assert far.apply(update)
        assert place_of(served.map, CUP) == 2.5


def test_what_was_deleted_in_between_is_not_brought_back_unseen(served: Served) -> None:
    with open_far(served) as far:
        objects = PerceivedObjects(far)
        served.map.update("DELETE WHERE { <object/1> ?p ?o }")
        with pytest.raises(ConflictError):
            far.apply(cup_at(far, 2.5))
        assert objects.refresh() >= {CUP}
        assert list(objects) == [CHAIR]


def test_what_left_is_remembered_and_found_again_from_afar(served: Served) -> None:
    with open_far(served) as far:
        (cup,) = far.perceived.objects((CUP,))
        seen = cup.first_seen, cup.last_seen, cup.last_seen + 5
        left = DepartedRecord(CUP, cup.category, cup.p_map, 0.9, cup.observations, *seen)
        far.apply(MapUpdate(removed=(CUP,), departed=(left,)))
        assert [held.iri for held in far.departed()] == [CUP]
        assert [held.iri for held in served.map.departed((CUP, CHAIR))] == [CUP]
        far.apply(cup_at(far, 4.0))
        assert (place_of(served.map, CUP), served.map.departed()) == (4.0, ())


def test_an_edit_of_something_else_is_in_nobodys_way_and_is_heard_of(served: Served) -> None:
    with open_far(served) as far:
        objects = PerceivedObjects(far)
        edit(served.map, 2, 3.25)
        assert far.apply(cup_at(far, 2.5))
        with pytest.raises(ConflictError, match="object/2"):  # it was not read since
            far.apply(MapUpdate(removed=(CHAIR,)))
        touched = objects.refresh()
        assert CHAIR in touched and CUP not in touched, "its own frames a mapper knows"
        assert objects[CHAIR].p_map[0] == 3.25
        assert far.apply(MapUpdate(removed=(CHAIR,)))


def test_ones_own_frames_are_never_in_the_way(served: Served) -> None:
    with open_far(served) as far:
        for number in range(20):
            edit(served.map, 2, 2.1 + number / 10)
            assert far.apply(cup_at(far, 1.1 + number / 10))
        assert place_of(served.map, CUP) == 3.0


def test_what_is_written_in_a_block_is_held_to_what_was_there_when_it_began(served: Served) -> None:
    with open_far(served) as far:
        objects = PerceivedObjects(far)
        with far.hold():
            edit(served.map, 1, 3.25)
            objects.refresh()  # too late: what follows from the block's beginning is written
            with pytest.raises(ConflictError, match="object/1"):
                far.apply(cup_at(far, 2.5))
        with far.hold():
            objects.refresh()
            assert objects[CUP].p_map[0] == 3.25
            assert far.apply(cup_at(far, 2.5))


def test_two_robots_and_the_server_never_take_the_same_number(served: Served) -> None:
    with open_far(served) as one, open_far(served) as other:
        iris = [m.new_object_iri() for _ in range(5) for m in (one, other, served.map)]
    assert len(set(iris)) == 15
    with pytest.raises(ConflictError), open_far(served) as one, open_far(served) as other:
        one.apply(cup_at(one, 1.0, 50))
        other.apply(cup_at(other, 2.0, 50))


def test_mappers_side_by_side_lose_nothing_of_each_other(served: Served) -> None:
    """Each counts up one object of its own and one they share, in turns as they come."""
    rounds, errors = 6, list[BaseException]()

    def count(number: int) -> None:
        try:
            with open_far(served) as far:
                objects = PerceivedObjects(far)
                for _ in range(rounds):
                    for iri in (f"{BASE}object/{number}", CUP):
                        raise_one(far, objects, iri)
        except BaseException as error:  # noqa: BLE001  it is the test's to tell
            errors.append(error)

    def raise_one(far: RemoteMap, objects: PerceivedObjects, iri: str) -> None:
        while True:
            with far.hold():
                objects.refresh()
                record = replace(objects[iri], observations=objects[iri].observations + 1)
                with suppress(ConflictError):
                    far.apply(MapUpdate(objects=(record,)))
                    objects[iri] = record
                    return

    with open_far(served) as far:
        far.apply(MapUpdate(objects=(thing(far, 11, "cup", 0, 0), thing(far, 12, "cup", 3, 2))))
    threads = [threading.Thread(target=count, args=(n,)) for n in (11, 12)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert errors == []
    counts = {o.iri: o.observations for o in served.map.objects()}
    assert counts[CUP] == 3 + 2 * rounds
    assert counts[f"{BASE}object/11"] == counts[f"{BASE}object/12"] == 3 + rounds


def test_labels_nobody_knows_become_categories_of_the_served_map(served: Served) -> None:
    with open_far(served) as far, open_far(served) as other:
        assert other.catalogue.get("gizmo") is None  # read before, and cached
        found = far.ontology.learn(["gizmo", "cup", "\u200b"], "object", model="net")
        assert found["cup"] == far.catalogue.find("cup").iri
        assert served.map.catalogue.find("gizmo").iri == far.catalogue.find("gizmo").iri
        assert "\u200b" not in found
        sequence = served.map.sequence
        assert far.ontology.learn(["gizmo"], "object", model="net") == {"gizmo": found["gizmo"]}
        assert served.map.sequence == sequence
        other.subscriptions.catch_up()
        assert other.catalogue.find("gizmo").provisional


def test_changes_are_told_from_any_number_on(served, monkeypatch):
    monkeypatch.setattr(feed_endpoints, "PAGE", 12)
    for n in range(30):  # more than two pages hold
        served.map.apply(ROBOT if n % 2 else cup_at(served.map, n / 10))
    with open_far(served) as far:
        for since in (0, 1, 13, served.map.sequence):
            here, there = list(served.map.history.changes(since)), list(far.history.changes(since))
            assert [c.sequence for c in there] == [c.sequence for c in here]
            assert [(c.time, c.cause, set(c.added)) for c in there] == [
                (c.time, c.cause, set(c.added)) for c in here
            ]
        with pytest.raises(HistoryError, match="not at 9999"):
            list(far.history.changes(9999))


def test_a_reader_is_answered_by_what_it_has_heard_of(served: Served) -> None:
    with open_far(served) as far:
        for n in range(10):
            served.map.apply(cup_at(served.map, n / 10))  # by the server's own mapper, unasked
            far.subscriptions.catch_up()
            assert place_of(far, CUP) == n / 10
    ask = {"query": "ASK {}"}
    for number, status in (("99999", 412), ("one", 400), ("1", 200)):
        answer = served.get("sparql", params=ask, headers={"Here-Sequence": number})
        assert answer.status_code == status


def body(**changed: Any) -> dict[str, Any]:
    cause = {"kind": "frame", "by": None, "note": ""}
    return {"update": update_to_json(ROBOT), "cause": cause, "seen": None, "own": [], **changed}


SEARCH = SearchRecord(CUP, ("cup",), (BASE,), "running", 1.0)


def look(name: str = "search/1/look/1", of: str = f"{BASE}search/1") -> LookRecord:
    return LookRecord(BASE + name, of, 1, 1.0, (1.0, 1.0), 0.5, 0.5, (BASE,))


def tile(column: int = 0) -> FloorTile:
    return FloorTile(0, column, 0, 0.0, 0.05, np.zeros((64, 64), np.uint8), 1e9)


def recording(frames: int) -> RecordingRecord:
    return RecordingRecord("run", frames, "frame-1", np.eye(4), "")


@pytest.mark.parametrize(
    ("status", "told"),
    [
        (400, b"{"),
        (400, b"[" * 100_000),
        (400, b"\xff"),
        (400, []),
        (400, {"update": {}}),
        (400, body(seen=-1)),
        (400, body(seen="1")),
        (400, body(own=[True])),
        (400, body(own=3)),
        (400, body(cause={"kind": "assert", "by": None, "note": ""})),
        (400, body(cause={"kind": "frame", "by": 3, "note": ""})),
        (400, body(cause={"kind": "search", "by": "\ud800", "note": ""})),
        (400, body(cause={"kind": "search", "by": "bob", "note": "he was not asked"})),
        (422, body(update={})),
        (422, body(update={**update_to_json(ROBOT), "removed": ["object/1"]})),
        (422, body(update={**update_to_json(ROBOT), "removed": [f"{BASE}robot"]})),
        (422, body(update={**update_to_json(ROBOT), "removed": [BASE]})),
        (422, body(update=update_to_json(MapUpdate(search=SEARCH)))),
        (422, body(update=update_to_json(MapUpdate(looks=(look("search/1"),))))),
        (422, body(update=update_to_json(MapUpdate(looks=(look("search/1/look/../2"),))))),
        (422, body(update=update_to_json(MapUpdate(looks=(look(of=CUP),))))),
        (422, body(update=update_to_json(MapUpdate(looks=(look(), look()))))),
        (409, body(seen=999, update=update_to_json(MapUpdate(removed=(CUP,))))),
    ],
)
def test_what_cannot_be_written_is_told_in_one_line_and_changes_nothing(lasting, status, told):
    before = lasting.map.sequence
    data = told if isinstance(told, bytes) else json.dumps(told).encode()
    headers = {"Content-Type": "application/json", **lasting.bearer()}
    answer = lasting.post("records", data=data, headers=headers)
    assert answer.status_code == status, answer.text
    assert answer.text.count("\n") == 1
    assert lasting.map.sequence == before


@pytest.mark.parametrize("path", ["records", "labels", "assertions"])
def test_json_too_deep_to_be_shown_is_refused_in_one_line(lasting: Served, path: str) -> None:
    told = {
        "records": json.dumps(body(seen="deep")),
        "labels": json.dumps({"labels": [], "kind": "deep", "model": "net"}),
        "assertions": json.dumps({"thing": CUP, "property": "position", "value": "deep"}),
    }[path]
    headers = {"Content-Type": "application/json", **lasting.bearer()}
    for depth in (40, *range(900, 1000, 10)):
        data = told.replace('"deep"', "[" * depth + "]" * depth)
        answer = lasting.post(path, data=data.encode(), headers=headers)
        assert answer.status_code == 400
        assert answer.text.count("\n") == 1


def of_kind(semantic_map: SemanticMap, kind: str) -> ObjectRecord:
    category = semantic_map.catalogue.find(kind).iri
    return replace(thing(semantic_map, 1, "cup", 0, 0), category=category)


@pytest.mark.parametrize(
    "update",
    [
        lambda m: MapUpdate(objects=(thing(m, 10**18, "cup", 0, 0),)),
        lambda m: MapUpdate(objects=(thing(m, 10**15 - 1, "cup", 0, 0),)),
        lambda m: MapUpdate(removed=(f"{BASE}object/01",)),
        lambda m: MapUpdate(objects=(thing(m, 1, "cup", float("nan"), 0),)),
        lambda m: MapUpdate(objects=(thing(m, 1, "cup", 0, 0), thing(m, 1, "cup", 1, 0))),
        lambda m: MapUpdate(objects=(of_kind(m, "kitchen"),)),
        lambda m: MapUpdate(floor=(tile(), tile())),
        lambda m: MapUpdate(floor=(tile(1 << 53),)),
        lambda m: MapUpdate(recording=recording(-1)),
    ],
)
def test_records_that_make_no_facts_are_the_same_error_from_afar(lasting, update):
    before = lasting.map.sequence
    with open_far(lasting) as far, pytest.raises(InvalidFactError) as refused:
        far.apply(update(far))
    assert "\n" not in str(refused.value)
    assert lasting.map.sequence == before


def test_a_label_and_the_name_of_a_network_have_an_end(lasting: Served) -> None:
    for labels, model in ((["x" * 501], "net"), (["gadget"], "m" * 501)):
        told = {"labels": labels, "kind": "object", "model": model}
        assert lasting.post("labels", json=told, headers=lasting.bearer()).status_code == 200
    texts = "SELECT ?text { ?made a owl:Class ; rdfs:label|rdfs:comment ?text }"
    assert 200 <= max(len(str(row[0])) for row in lasting.map.query(texts).rows) < 300


def test_who_may_not_write_may_not_map(serve, served, monkeypatch):
    for path in ("records", "numbers", "labels"):
        assert served.get(path, headers=served.bearer()).status_code == 404
        assert served.post(path, data=b"x", headers=served.bearer()).status_code == 415
    with (
        open_map(serve(tokens=BearerTokens()).url) as far,
        pytest.raises(RemoteError, match="only reads"),
    ):
        far.apply(ROBOT)
    with (
        open_map(served.url, read_only=True) as far,
        pytest.raises(GraphError, match="reading only"),
    ):
        far.apply(ROBOT)
    monkeypatch.delenv("HEREABOUTS_TOKEN")
    with open_far(served) as far, pytest.raises(RemoteError, match="HEREABOUTS_TOKEN"):
        far.new_object_iri()


def test_changes_as_json_say_from_where(lasting: Served) -> None:
    def changes(**params: object) -> requests.Response:
        return lasting.get("changes", params=params, headers={"Accept": "application/json"})

    assert changes().status_code == 400
    assert changes(since="x").status_code == 400
    now = lasting.map.sequence
    assert changes(since=now).json() == {"sequence": now, "more": False, "changes": []}
    gone = changes(since=now + 1)
    assert (gone.status_code, gone.json()["error"]) == (410, "HistoryError")

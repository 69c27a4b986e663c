"""The holder of a token edits the rooms of a served map."""

from __future__ import annotations

import pytest

from kg.model.errors import InvalidFactError
from kg.model.room_edit import RoomEdit
from kg.serving.opening import open_map
from tests.kg.serving.server.conftest import TOKEN, Served


def test_rooms_are_edited_over_http(served: Served, monkeypatch):
    monkeypatch.setenv("HEREABOUTS_TOKEN", TOKEN)
    monkeypatch.setenv("HEREABOUTS_SERVER", served.url)
    (place,) = served.map.places()
    x, y = place.area.centre
    with open_map(served.url) as far:
        short = place.iri.removeprefix(far.base)
        line = ((x, place.ymin), (x, place.ymax))
        far.rooms.edit(RoomEdit("split", (short,), line, "pantry"))
        assert len(far.places()) == 2
        with pytest.raises(InvalidFactError, match="does not divide"):
            far.rooms.edit(RoomEdit("split", (short,), ((x + 99, y), (x + 99, y + 1))))
        far.rooms.edit(RoomEdit("undo"))
        assert len(far.places()) == 1


@pytest.mark.parametrize(
    "body",
    [
        {"kind": 3, "places": [], "points": [], "name": ""},
        {"kind": "split", "places": "place/1", "points": [], "name": ""},
        {"kind": "draw", "places": [], "points": [[0, 1, 2]], "name": ""},
        {"kind": "draw", "places": [], "points": [[0, 1e9]], "name": ""},
        {"kind": "undo"},
    ],
)
def test_a_body_of_another_shape_is_refused_in_one_line(served: Served, body):
    headers = {**served.bearer(), "Content-Type": "application/json"}
    answer = served.post("rooms", json=body, headers=headers)
    assert answer.status_code == 400 and answer.text.count("\n") <= 1


def test_without_a_token_nothing_is_edited(served: Served):
    body = {"kind": "undo", "places": [], "points": [], "name": ""}
    assert served.post("rooms", json=body).status_code == 401

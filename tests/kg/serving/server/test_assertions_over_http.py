"""What people say of things, said to a running server: by HTTP, from Python, by command."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable, Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import TYPE_CHECKING

import pytest
import rdflib

from hereabouts.cli import main
from kg.model.errors import (
    GraphError,
    InvalidFactError,
    QueryParameterError,
    RemoteError,
    UnknownCategoryError,
)
from kg.model.room_edit import RoomEdit
from kg.model.transactions import ChangeSet
from kg.model.vocabulary import HERE
from kg.serving.client.remote_map import RemoteHistory
from kg.serving.client.served_server import ServedClient as FarServer
from kg.serving.opening import open_map
from kg.serving.server import Limits

if TYPE_CHECKING:
    from conftest import Served

CUP = "https://example.org/maps/flat/object/1"
BOWL = {"thing": "object/1", "property": "category", "value": "bowl"}
TAKE_BACK = {"iri": "object/1", "property": "category"}


def say(served: Served, **told: object) -> object:
    return served.post("assertions", json={**BOWL, **told}, headers=served.bearer())


def test_what_is_said_is_believed_until_it_is_taken_back(served: Served) -> None:
    made = say(served)
    assert made.status_code == 201, made.text
    told = made.json()
    assert told["sequence"] == served.map.sequence == int(made.headers["Here-Sequence"])
    assert (told["assertion"]["value"], told["assertion"]["by"]) == (HERE + "Bowl", "ann")
    assert told["assertion"]["contradicted"] is True
    (cup,) = (o for o in served.map.objects() if o.iri == CUP)
    assert cup.category == HERE + "Bowl"
    (change,) = served.map.history.changes(told["sequence"] - 1)
    assert (change.cause.kind, change.cause.by) == ("assert", "ann")
    assert served.get(made.headers["Location"].lstrip("/")).status_code == 200

    again = say(served, value="cup")
    assert again.status_code == 200, "it was said before, and is now said otherwise"
    taken = served.request("DELETE", "assertions", params=TAKE_BACK, headers=served.bearer())
    assert taken.status_code == 200, taken.text
    assert served.map.assertions.all() == ()
    assert taken.json()["removed"] > 0


def test_a_thing_gets_a_name_that_is_new(served: Served) -> None:
    made = say(served, property="name", value="my red mug")
    assert made.status_code == 201, made.text
    (cup,) = (o for o in served.map.objects() if o.iri == CUP)
    assert served.map.catalogue.label(cup.category) == "my red mug"
    assert made.headers["Location"].endswith("/category")
    refused = say(served, property="name", value="<b>")
    assert refused.status_code == 422 and "plain text" in refused.text


def test_the_mapper_keeps_to_what_was_said_from_afar(served: Served) -> None:
    say(served, property="position", value=[3, 2, 0.5])
    served.move(1, 1.2)
    (cup,) = (o for o in served.map.objects() if o.iri == CUP)
    assert cup.p_map.tolist() == [3.0, 2.0, 0.5]
    (said,) = served.get("assertions").json()["assertions"]
    assert said["perceived"] == "1.2 0.5 0.8"


def test_what_was_said_is_listed_with_its_conflicts(served: Served) -> None:
    say(served)
    say(served, property="label", value="Grandma's bowl")
    say(served, thing="place/1", property="category", value="kitchen")
    told = served.get("assertions").json()
    assert told["sequence"] == served.map.sequence
    assert [(a["thing"].rpartition("flat/")[2], a["property"]) for a in told["assertions"]] == [
        ("place/1", "category"),
        ("object/1", "category"),
        ("object/1", "label"),
    ]
    (conflict,) = served.get("assertions?conflicts=1").json()["assertions"]
    assert (conflict["perceived"], conflict["since"]) == (HERE + "Cup", conflict["time"])
    of_place = served.get("assertions", params={"iri": "place/1"}).json()["assertions"]
    assert [a["value"] for a in of_place] == [HERE + "Kitchen"]
    text = served.get("assertions?conflicts=1", headers={"Accept": "text/turtle"}).text
    graph = rdflib.Graph().parse(data=text, format="turtle")
    assert {str(x) for x in graph.objects(None, rdflib.URIRef(HERE + "assertedValue"))} == {
        HERE + "Bowl"
    }
    assert rdflib.Literal("ann") in set(graph.objects(None, rdflib.RDFS.label))


def test_a_list_a_client_has_is_not_sent_again(served: Served) -> None:
    tag = served.get("assertions").headers["ETag"]
    assert served.get("assertions", headers={"If-None-Match": tag}).status_code == 304
    say(served)
    assert served.get("assertions", headers={"If-None-Match": tag}).status_code == 200


@pytest.mark.parametrize(
    ("told", "status", "says"),
    [
        ({"value": "bowll"}, 422, "did you mean bowl"),
        ({"property": "colour"}, 422, "category, position, extent, existence, label"),
        ({"property": "existence", "value": "perhaps"}, 422, "present or absent"),
        ({"property": "position", "value": [1, 2, float("inf")]}, 422, "finite"),
        ({"property": "position", "value": [10**400, 2, 3]}, 422, "finite"),
        ({"property": "position", "value": [1, 2]}, 422, "three finite numbers"),
        ({"value": {"a": 1}}, 400, "metres"),
        ({"value": True}, 400, "metres"),
        ({"value": "\ud800"}, 400, "metres"),
        ({"thing": "object/99"}, 422, "no object or place"),
        ({"thing": "object/<1>"}, 422, "no thing"),
        ({"thing": ""}, 400, "'thing'"),
        ({"by": "bob"}, 400, "thing, property, value"),
    ],
)
def test_what_cannot_be_said_changes_nothing(lasting, told, status, says):
    before = lasting.map.sequence
    body = json.dumps({**BOWL, **told})
    headers = {"Content-Type": "application/json", "Accept": "application/json"}
    answer = lasting.post("assertions", data=body, headers={**headers, **lasting.bearer()})
    assert answer.status_code == status, answer.text
    assert answer.headers["Content-Type"] == "application/problem+json"
    assert says in answer.json()["detail"]
    assert lasting.map.sequence == before


@pytest.mark.parametrize("body", [b"", b"{", b"[]", b'"x"', b"[" * 100_000, b'{"thing": 1}'])
def test_bodies_that_are_no_assertion(lasting: Served, body: bytes) -> None:
    headers = {"Content-Type": "application/json", **lasting.bearer()}
    assert lasting.post("assertions", data=body, headers=headers).status_code == 400
    headers["Content-Type"] = "text/turtle"
    assert lasting.post("assertions", data=body, headers=headers).status_code == 415


def test_taking_back_what_nobody_said(lasting: Served) -> None:
    def take_back(**given: str) -> int:
        answer = lasting.request("DELETE", "assertions", params=given, headers=lasting.bearer())
        return answer.status_code

    assert take_back(iri="object/2", property="label") == 422
    assert take_back(iri="object/2", property="colour") == 422
    assert take_back(iri="object/2") == 400
    assert take_back(iri="object/<2>", property="label") == 422


def test_saying_needs_a_token_and_a_body_of_some_size(serve: Callable[..., Served]) -> None:
    served = serve(limits=Limits(body=1000))
    before = served.map.sequence
    assert served.post("assertions", json=BOWL).status_code == 401
    wrong = served.bearer("another-token-of-nobody-0")
    assert served.post("assertions", json=BOWL, headers=wrong).status_code == 401
    assert served.request("DELETE", "assertions", params=TAKE_BACK).status_code == 401
    assert say(served, property="label", value="x" * 1000).status_code == 413
    assert served.map.sequence == before


def assert_recorded(served: Served, change: ChangeSet) -> None:
    (kept,) = served.map.history.changes(change.sequence - 1)
    assert (change.sequence, change.time, change.cause) == (kept.sequence, kept.time, kept.cause)
    assert (set(change.added), set(change.removed)) == (set(kept.added), set(kept.removed))


@pytest.mark.usefixtures("token")
def test_a_served_map_is_written_from_python_as_its_folder_is(served: Served) -> None:
    with open_map(served.url) as far:
        change = far.assertions.add("object/1", "category", "bowl", by="nobody")
        assert_recorded(served, change)
        assert far.assertions.all() == served.map.assertions.all()
        assert far.assertions.all("object/1")[0].by == "ann", "the holder of the token says so"
        assert [a.subject for a in far.assertions.conflicts()] == [CUP]
        far.assertions.add("object/2", "position", (3.5, 2, 0.1), by="nobody")
        positions = {o.iri: o.p_map.tolist() for o in far.objects()}
        assert positions == {CUP: [1.0, 0.5, 0.8], f"{far.base}object/2": [3.5, 2.0, 0.1]}
        retracted = far.assertions.retract("object/1", "category")
        assert retracted.cause.kind == "retract"
        done = far.update("INSERT DATA { <object/9> a here:Cup ; here:x 1 ; here:y 1 }")
        assert_recorded(served, done)
        assert far.update("DELETE WHERE { <object/77> ?p ?o }") is None
        assert far.sequence == served.map.sequence


@pytest.mark.usefixtures("token")
def test_what_the_server_refuses_is_the_same_error_from_afar(served: Served) -> None:
    before = served.map.sequence
    with open_map(served.url) as far:
        with pytest.raises(UnknownCategoryError, match="did you mean bowl"):
            far.assertions.add("object/1", "category", "bowll", by="ann")
        with pytest.raises(InvalidFactError, match="is not asserted"):
            far.assertions.retract("object/1", "label")
        with pytest.raises(InvalidFactError, match="history"):
            far.update("INSERT DATA { GRAPH graph:history { <object/9> a here:Cup } }")
        with pytest.raises(InvalidFactError, match="finite"):
            far.assertions.add("object/1", "position", (1.0, float("nan"), 0.0), by="ann")
        with pytest.raises(GraphError, match="is served"):
            far.ontology.replace((), whole=True)
        for ask in (far.history.events, far.history.explain, far.update, far.assertions.all):
            with pytest.raises(QueryParameterError, match="Unicode"):
                tuple(ask("\udcff"))
    with (
        open_map(served.url, read_only=True) as far,
        pytest.raises(GraphError, match="reading only"),
    ):
        far.assertions.add("object/1", "category", "bowl", by="ann")
    assert served.map.sequence == before


@pytest.mark.usefixtures("token")
def test_the_commands_take_a_server_for_a_folder(served, capsys):
    assert main(["assert", served.url, "object/1", "category", "bowl", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["by"], told["value"], told["contradicted"]) == ("ann", HERE + "Bowl", True)
    assert main(["ask", served.url, "conflicts", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)[0]["by"] == "ann"
    assert main(["retract", served.url, "object/1", "category", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["by"] == "ann"
    assert served.map.assertions.all() == ()
    update = "INSERT DATA { <object/9> a here:Cup ; here:x 1 ; here:y 1 }"
    assert main(["update", served.url, "-e", update, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["sequence"] == served.map.sequence
    assert main(["assert", served.url, "object/1", "category", "bowll"]) == 1
    assert "did you mean bowl" in capsys.readouterr().err


class _Alike(BaseHTTPRequestHandler):
    """Answers everything as `/health` does."""

    def do_GET(self) -> None:
        body = b'{"base": "https://example.org/", "sequence": 7, "change": {}, "because": []}'
        self.send_response(200)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    do_DELETE = do_GET  # noqa: N815  so the library has it

    def log_message(self, *_: object) -> None:
        """Say nothing."""


@pytest.fixture
def alike() -> Iterator[str]:
    with ThreadingHTTPServer(("127.0.0.1", 0), _Alike) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield f"http://127.0.0.1:{server.server_address[1]}"
        server.shutdown()
        thread.join()


def test_answers_of_another_make_are_one_line(alike: str) -> None:
    far = FarServer.at(alike)
    assert far is not None and far.sequence == 7
    history = RemoteHistory(far)
    for ask in (
        lambda: tuple(history.events("object/1")),
        lambda: history.diff("1", "2"),
        lambda: history.compare("1"),
        lambda: history.explain("object/1"),
        lambda: far.sequence_at("1"),
        lambda: far.delete("assertions", iri="object/1", property="label"),
    ):
        with pytest.raises(RemoteError, match="not of this version of `hereabouts serve`"):
            ask()


@pytest.mark.usefixtures("token")
def test_rooms_are_edited_over_http(served: Served) -> None:
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
def test_a_body_of_another_shape_is_refused_in_one_line(lasting, body):
    answer = lasting.post("rooms", json=body, headers=lasting.bearer())
    assert answer.status_code == 400 and answer.text.count("\n") <= 1

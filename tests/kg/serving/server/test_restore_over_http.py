"""Large deletions and restorations over HTTP: refused, confirmed, undone, and seen by others."""

import pytest
from pyoxigraph import Quad

from kg.maps.semantic_map import SemanticMap
from kg.maps.update.validation import DeletionLimit
from kg.model import vocabulary as v
from kg.model.errors import HistoryError, UnconfirmedDeletionError
from kg.serving.opening import open_map
from tests.kg.serving.server.conftest import TOKEN, Served

EVERYTHING = "DELETE WHERE { ?s ?p ?o }"
CONFIRMED = {"Here-Confirm": "delete"}


@pytest.fixture
def guarded(served: Served, monkeypatch: pytest.MonkeyPatch) -> Served:
    """A served map, of two objects and a place, that asks before more than one of them goes."""
    monkeypatch.setenv("HEREABOUTS_TOKEN", TOKEN)
    monkeypatch.setenv("HEREABOUTS_SERVER", served.url)
    served.map.deletion_limit = DeletionLimit(share=0.5, count=1)
    return served


def facts(semantic_map: SemanticMap) -> set[Quad]:
    return {quad for quad in semantic_map.engine if quad.predicate.value != v.SEQUENCE}


def test_a_large_deletion_is_refused_in_one_line_unless_confirmed(guarded: Served) -> None:
    before = facts(guarded.map)
    refused = guarded.write(EVERYTHING)
    assert refused.status_code == 428
    assert "3 of 3 objects and places" in refused.text and "Here-Confirm: delete" in refused.text
    assert refused.text.count("\n") == 1
    removal = {"headers": guarded.bearer()}
    assert guarded.request("DELETE", "graphs/map", **removal).status_code == 428
    replacing = {"headers": {**guarded.bearer(), "Content-Type": "text/turtle"}, "data": ""}
    assert guarded.request("PUT", "graphs/map", **replacing).status_code == 428
    assert facts(guarded.map) == before
    confirmed = {"headers": {**guarded.bearer(), **CONFIRMED}}
    assert guarded.request("DELETE", "graphs/map", **confirmed).status_code == 200
    assert not guarded.map.objects()


def test_another_value_of_the_header_is_no_confirmation(guarded: Served) -> None:
    headers = {"Content-Type": "application/sparql-update", **guarded.bearer()}
    answer = guarded.post("sparql", data=EVERYTHING, headers={**headers, "Here-Confirm": "please"})
    assert answer.status_code == 400
    assert len(guarded.map.objects()) == 2


def test_from_afar_a_large_deletion_is_the_same_error(guarded: Served) -> None:
    with open_map(guarded.url) as far:
        with pytest.raises(UnconfirmedDeletionError, match="3 of 3"):
            far.update(EVERYTHING)
        assert far.update(EVERYTHING, confirmed=True) is not None


def test_a_served_map_is_restored_from_afar_and_subscribers_see_it(guarded: Served) -> None:
    before, number = facts(guarded.map), guarded.map.sequence
    cups = {"query": "SELECT ?cup { ?cup a here:Cup }"}
    with open_map(guarded.url) as far, guarded.stream("subscribe", cups) as events:
        events.next()
        far.update(EVERYTHING, confirmed=True)
        assert events.next()[0] == number + 1
        done = far.restore(f"#{number}")
        assert events.next()[0] == number + 2
        assert facts(guarded.map) == before
        assert (done.objects_back, done.places_back, done.sequence) == (2, 1, number + 2)
        assert len(far.objects()) == 2, "who restored reads the restored map"
    (change,) = guarded.map.history.changes(number + 1)
    assert (change.cause.kind, change.cause.by) == ("restore", "ann")


def test_a_dry_run_and_a_part_from_afar(guarded: Served) -> None:
    number = guarded.map.sequence
    with open_map(guarded.url) as far:
        far.update("DELETE WHERE { <object/1> ?p ?o }")
        assert far.restore(number, dry_run=True).objects_back == 1
        assert len(far.objects()) == 1
        assert far.restore(number, only=["object/1"]).objects_back == 1
        with pytest.raises(HistoryError):
            far.restore(number + 40)


@pytest.mark.parametrize(
    "body",
    [
        "{}",
        "[]",
        '{"to": 1, "only": [], "dry_run": false}',
        '{"to": "#1", "only": "objects", "dry_run": false}',
        '{"to": "#1", "only": ["nothing of the kind"], "dry_run": false}',
        '{"to": "someday", "only": [], "dry_run": false}',
    ],
)
def test_what_is_no_restoration_is_a_bad_request(guarded: Served, body: str) -> None:
    headers = {"Content-Type": "application/json", **guarded.bearer()}
    assert guarded.post("restore", data=body, headers=headers).status_code == 400

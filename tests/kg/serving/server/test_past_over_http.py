"""The past of a map that is being served: asked, compared, told, explained."""

from collections.abc import Iterator
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
import rdflib
from pyoxigraph import Quad

from hereabouts.cli import main
from kg.history.reports.events import comparison_text, difference_text, log_text, reasons_text
from kg.history.timestamps import iso
from kg.model import vocabulary as v
from kg.model.errors import HistoryError, QueryParameterError, QueryTimeoutError
from kg.model.records import MapUpdate
from kg.serving.client.record_codec import comparison_from_json
from kg.serving.opening import open_map
from kg.serving.server import Limits, MapServer, Settings
from tests.kg.serving.server.conftest import Served, running, thing

CUP, CHAIR = (f"https://example.org/maps/flat/object/{n}" for n in (1, 2))
COMMANDS = (
    ("log", "object/2"),
    ("log", "object/1", "--last", "1", "--json"),
    ("diff", "#2", "#5"),
    ("diff", "#2"),
    ("diff", "#2", "#5", "--json"),
    ("diff", "#2", "#5", "--facts"),
    ("why", "object/1 here:x"),
    ("why", "object/2", "--format", "ttl"),
    ("ask", "objects", "--at", "#3", "--format", "csv"),
)
X = f"SELECT ?x {{ <{CUP}> <{v.X}> ?x }}"


def xs(served: Served, at: object, **more: object) -> list[float]:
    answer = served.get("sparql", params={"query": X, "at": at}, **more)
    assert answer.status_code == 200, answer.text
    return [float(row["x"]["value"]) for row in answer.json()["results"]["bindings"]]


@pytest.fixture(scope="module")
def moved() -> Iterator[Served]:
    """The cup stood at 1 m, then at 2, 3 and 4 m; the chair left with the last."""
    with running() as served:
        for x in (2.0, 3.0):
            served.move(1, x)
        served.map.apply(MapUpdate(removed=(CHAIR,)))
        served.move(1, 4.0)
        yield served


def test_a_query_is_answered_as_it_was(moved: Served) -> None:
    assert moved.map.sequence == 5
    assert [xs(moved, at) for at in range(6)] == [[], [1.0], [2.0], [3.0], [3.0], [4.0]]
    answer = moved.get("sparql", params={"query": X, "at": "#2"})
    assert answer.headers["Here-Sequence"] == "2"


def test_the_past_may_be_named_by_time_and_in_a_form(moved: Served) -> None:
    times = {change.sequence: change.time for change in moved.map.history.changes()}
    for number in (2, 3, 5):
        same = max(n for n, time in times.items() if time == times[number])
        with moved.map.at(same) as then:
            (x,) = (float(o.p_map[0]) for o in then.objects() if o.iri == CUP)
        assert xs(moved, iso(times[number])) == [x]
    assert xs(moved, "2100-01-01") == [4.0]
    form = moved.post("sparql", data={"query": X, "at": "3"})
    assert [row["x"]["value"] for row in form.json()["results"]["bindings"]] == ["3"]


@pytest.mark.parametrize(
    ("at", "status", "says"),
    [
        ("someday", 400, "no moment"),
        ("yesterday", 404, "its past is kept since"),
        ("-1", 400, "no moment"),
        ("9" * 30, 400, "no moment"),
        ("0001-01-01T00:00:00+23:00", 400, "no moment"),
        ("2001-01-01", 404, "its past is kept since"),
        ("99", 404, "there are #0 to #1"),
    ],
)
def test_moments_that_cannot_be_asked_for(lasting: Served, at: str, status: int, says: str) -> None:
    for path, params in (("sparql", {"query": X, "at": at}), ("diff", {"from": "0", "to": at})):
        answer = lasting.get(path, params=params, headers={"Accept": "application/json"})
        assert answer.status_code == status, answer.text
        assert says in answer.json()["detail"]


def test_the_past_cannot_be_written(moved: Served) -> None:
    headers = {"Content-Type": "application/sparql-update", **moved.bearer()}
    update = "DELETE WHERE { <object/1> ?p ?o }"
    assert moved.post("sparql?at=2", data=update, headers=headers).status_code == 400
    form = {"update": update, "at": "2"}
    assert moved.post("sparql", data=form, headers=moved.bearer()).status_code == 400
    assert moved.map.sequence == 5


def test_limits_hold_in_the_past(moved: Served) -> None:
    limits = Limits(query_seconds=120.0, result=200, workers=1)
    with MapServer(moved.map, Settings(port=0, limits=limits)) as server:
        check_limits(Served(moved.map, server))


def check_limits(small: Served) -> None:
    assert xs(small, 2) == [2.0]
    everything = {"query": "SELECT * { ?s ?p ?o }", "at": 2}
    assert small.get("sparql", params=everything).status_code == 503
    assert small.get("log", params={"iri": "object/1"}).status_code == 503
    outside = "SELECT * { SERVICE <http://127.0.0.1:1/> { ?s ?p ?o } }"
    assert small.get("sparql", params={"query": outside, "at": 2}).status_code == 400
    bomb = "SELECT (COUNT(*) AS ?n) { ?a ?b ?c . ?d ?e ?f . ?g ?h ?i . ?j ?k ?l }"
    with pytest.raises(QueryTimeoutError):
        small.server.serving.pool.run(bomb, at=2, timeout=0.5)
    assert xs(small, 3) == [3.0]
    assert [xs(small, at) for at in (3, 2, 2, 3)] == [[3.0], [2.0], [2.0], [3.0]]
    for graph, found in (("urn:other", False), (v.MAP_GRAPH.value, True)):
        asked = {"query": f"ASK FROM <{graph}> {{ ?s ?p ?o }}", "at": 2}
        assert small.get("sparql", params=asked).json()["boolean"] is found
    one = {"query": "ASK { ?s ?p ?o }", "at": 2, "default-graph-uri": v.DATASET_GRAPH.value}
    assert small.get("sparql", params=one).json()["boolean"] is True


def test_the_copy_of_a_history_in_memory_goes_with_the_server(served: Served) -> None:
    assert xs(served, 1) == [1.0]
    history = served.server.serving.pool._history
    assert history is not None
    file = Path(history.request()["log"])
    assert file.is_file()
    served.server.stop()
    assert not file.parent.exists()


@pytest.mark.parametrize("read_only", [False, True])
def test_every_moment_of_a_map_on_disk_is_as_its_folder_has_it(written, frame, on_disk, read_only):
    with written(12) as semantic_map:
        base, folder = semantic_map.base, Path(semantic_map.store.where)
        semantic_map.update(
            "INSERT DATA { GRAPH graph:commonsense { here:Cup here:isA here:Chair } }",
            allow=("commonsense",),
        )
        semantic_map.apply(frame(12, removed=(f"{base}object/2",)))
        states = {n: set(semantic_map.at(n).engine) for n in (0, 1, 7, 12, 13, 14)}
    with on_disk(folder, read_only=read_only) as served, open_map(served.url) as far:
        for number, quads in states.items():
            with far.at(number) as then:
                assert set(then.engine) == quads, number
        assert list(far.history.events("object/2")) == list(served.map.history.events("object/2"))
        assert set(far.history.diff(3, 13).added) == set(served.map.history.diff(3, 13).added)


def test_a_past_that_is_dropped_meanwhile_is_not_half_told(written, on_disk):
    with written(6) as semantic_map:
        folder = Path(semantic_map.store.where)
    with on_disk(folder, read_only=False) as served:
        pool = served.server.serving.pool
        assert pool.run("ASK {}", at=2).sequence == 2
        served.map.history.compact(keep=0.0)
        with pytest.raises(HistoryError, match="no longer kept"):
            pool.run("ASK {}", at=3)
        answer = served.get("sparql?query=ASK{}&at=2")
        assert (answer.status_code, "#6 to #6" in answer.text) == (404, True)


def test_a_things_history_is_told(moved: Served) -> None:
    here = list(moved.map.history.events("object/1"))
    told = moved.get("log", params={"iri": "object/1"}).json()
    assert [entry["sequence"] for entry in told] == [1, 2, 3, 5]
    assert told[-1]["changes"] == list(here[-1].changes)
    assert told[0]["kind"] == "frame"
    last = moved.get("log", params={"iri": CUP, "last": 2}, headers={"Accept": "text/plain"})
    assert last.text == log_text(here[-2:])
    assert "x 3 -> 4" in last.text
    for params, status in (
        ({}, 400),
        ({"iri": "object/77"}, 400),
        ({"iri": "a b"}, 400),
        ({"iri": "object/1", "last": "x"}, 400),
    ):
        assert moved.get("log", params=params).status_code == status
    assert moved.get("log?iri=robot", headers={"Accept": "image/png"}).status_code == 406


def test_a_history_without_changes_of_counters_begins_with_the_first(served: Served) -> None:
    cup = thing(served.map, 1, "cup", 1.0, 0.5)
    for count in range(4, 12):
        served.map.apply(MapUpdate(objects=(replace(cup, observations=count),)))
    last = {"iri": "object/1", "last": 3}
    assert [one["told"] for one in served.get("log", params=last).json()] == [[], [], []]
    (first,) = served.get("log", params={**last, "told": 1}).json()
    assert first["told"][0] == "new: cup"


def test_two_moments_are_compared(moved: Served) -> None:
    here = moved.map.history.compare(2, 5)
    assert [(one.kind, one.iri) for one in here.changes] == [
        ("gone", "object/2"),
        ("moved", "object/1"),
    ]
    assert comparison_from_json(moved.get("diff?from=2").json()) == here
    text = moved.get("diff?from=2&to=5", headers={"Accept": "text/plain"}).text
    assert text == comparison_text(here)
    assert "moved cup 1: 2.00, 0.50, 0.80 -> 4.00, 0.50, 0.80" in text
    assert [one["kind"] for one in moved.get("diff?from=2&far=3").json()["changes"]] == ["gone"]
    for refused in ("diff?to=2", "diff?from=2&far=near", "diff?from=2&far=-1"):
        assert moved.get(refused).status_code == 400


def test_the_facts_of_two_moments_are_compared(moved: Served) -> None:
    here = moved.map.history.diff(2, 5)
    told = moved.get("diff", params={"from": "2", "to": "#5", "facts": "1"}).json()
    assert (told["before"], told["after"]) == (2, 5)
    assert set(told["added"]) == {f"{quad} ." for quad in here.added}
    text = moved.get("diff?from=2&to=5&facts=1", headers={"Accept": "text/plain"}).text
    assert text == difference_text(here, moved.map.base)
    back = moved.get("diff?from=5&to=2&facts=1").json()
    assert set(back["removed"]) == set(told["added"])


def test_a_fact_is_explained(moved: Served) -> None:
    params = {"what": "object/1 here:x"}
    (reason,) = moved.get("why", params=params).json()
    assert reason["text"] == "cup 1: x 4"
    assert reason["fact"][0] == f"<{CUP}>"
    text = moved.get("why", params=params, headers={"Accept": "text/plain"}).text
    assert text == reasons_text(moved.map.history.explain("object/1 here:x"))
    assert "written: transaction #5" in text
    gone = moved.get("why", params={"iri": "object/2"}).json()
    assert gone[0]["text"] == "chair 2 is no longer in the map"
    turtle = moved.get("why", params=params, headers={"Accept": "text/turtle"}).text
    graph = rdflib.Graph().parse(data=turtle, format="turtle")
    assert rdflib.URIRef(v.PROV_ACTIVITY) in set(graph.objects(None, rdflib.RDF.type))
    for wrong in ({}, {"iri": "object/1", "what": "robot"}, {"iri": "object/77"}):
        assert moved.get("why", params=wrong).status_code == 400


def test_the_past_is_asked_from_python_as_that_of_a_folder(moved: Served) -> None:
    with open_map(moved.url) as far:
        for at in (1, "#3", datetime.now(UTC)):
            here, there = moved.map.objects(at=at), far.objects(at=at)
            assert [o.iri for o in there] == [o.iri for o in here]
            assert np.array_equal([o.p_map for o in there], [o.p_map for o in here])
        assert [p.label for p in far.places(at=0)] == []
        with far.at("#2") as then:
            assert then.query("summary").rows == moved.map.at(2).query("summary").rows
            assert then.sequence == 2
        assert far.history.state_of(CUP, 2) == moved.map.history.state_of(CUP, 2)
        assert list(far.history.events("object/2")) == list(moved.map.history.events("object/2"))
        assert far.history.explain("object/2") == moved.map.history.explain("object/2")
        assert far.history.explain("object/1 here:x") == moved.map.history.explain(
            "object/1 here:x"
        )
        assert set_of(far.history.diff(2, "#5").removed) == set_of(
            moved.map.history.diff(2, 5).removed
        )
        with pytest.raises(HistoryError, match="there are #0 to #5"):
            far.at(6)
        with pytest.raises(QueryParameterError, match="knows nothing"):
            list(far.history.events("object/77"))


def set_of(quads: tuple[Quad, ...]) -> set[Quad]:
    assert len(set(quads)) == len(quads)
    return set(quads)


def test_commands_on_the_past_take_a_server_for_a_folder(written, frame, on_disk, capsys):
    def said(address: object) -> list[tuple[str, str]]:
        told = []
        for words in COMMANDS:
            assert main([words[0], str(address), *words[1:]]) == 0
            told.append(tuple(capsys.readouterr()))
        return told

    with written(5) as semantic_map:
        folder = Path(semantic_map.store.where)
        semantic_map.apply(frame(5, removed=(f"{semantic_map.base}object/2",)))
    here = said(folder)
    assert all(out for out, _ in here)
    with on_disk(folder, read_only=True) as served:
        assert said(served.url) == here


def test_a_transaction_of_a_person_is_an_activity_with_an_agent(served: Served) -> None:
    served.map.assertions.add(f"{served.map.base}object/1", "label", "my cup", by="ann")
    asked = {"what": "object/1 rdfs:label"}
    answer = served.get("why", params=asked, headers={"Accept": "text/turtle"})
    assert answer.status_code == 200, answer.text
    graph = rdflib.Graph().parse(data=answer.text, format="turtle")
    commit = rdflib.URIRef(f"{served.map.base}commit/2")
    assert graph.value(commit, rdflib.RDF.type) == rdflib.URIRef(v.PROV_ACTIVITY)
    association = graph.value(commit, rdflib.URIRef(v.PROV_QUALIFIED_ASSOCIATION))
    agent = graph.value(association, rdflib.URIRef(v.PROV_HAS_AGENT))
    assert agent == graph.value(commit, rdflib.URIRef(v.PROV_ASSOCIATED_WITH))
    assert graph.value(agent, rdflib.RDF.type) == rdflib.URIRef(v.PROV_AGENT)


def test_an_author_is_one_resource_in_explanations_and_transactions(served: Served) -> None:
    cup = f"{served.map.base}object/1"
    sparql = f"INSERT DATA {{ GRAPH graph:map {{ <{cup}> rdfs:comment 'chipped' }} }}"
    served.map.update(sparql, by="bob / b")
    agent = rdflib.URIRef(f"{served.map.base}agent/bob%20%2F%20b")
    turtle = {"Accept": "text/turtle"}
    why = served.get("why", params={"what": "object/1 rdfs:comment"}, headers=turtle)
    commit = rdflib.URIRef(f"{served.map.base}commit/2")
    for answer in (why, served.get("commit/2", headers=turtle)):
        graph = rdflib.Graph().parse(data=answer.text, format="turtle")
        assert graph.value(commit, rdflib.URIRef(v.PROV_ASSOCIATED_WITH)) == agent
    answer = served.get("agent/bob%20%2F%20b", headers=turtle)
    assert answer.status_code == 200, answer.text
    graph = rdflib.Graph().parse(data=answer.text, format="turtle")
    assert graph.value(agent, rdflib.RDFS.label) == rdflib.Literal("bob / b")
    assert served.get("agent/nobody", headers=turtle).status_code == 404

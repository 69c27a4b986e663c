"""Several maps behind one address: folders, a map's own server, and a server of another make."""

from __future__ import annotations

import csv
import io
import json
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest
import rdflib
import requests
from pyoxigraph import RdfFormat, parse

from kg.errors import GraphError
from kg.history.instants import iso
from kg.records import MapUpdate, ObjectRecord
from kg.semantic_map import SemanticMap
from kg.server import FleetServer, Limits, MapServer, Settings

PATIENCE = 120.0  # [s] for what comes at once, on a machine however slow
AWAY = "http://127.0.0.1:9"
BASE = "https://example.org/"
PATIENT = Settings(port=0, limits=Limits(query_seconds=PATIENCE))
E = "SELECT ?e { ?o a here:Cup ; here:existence ?e }"
RUNAWAY = "SELECT (SUM(STRLEN(STR(?a))) AS ?n) {?a ?b ?c. ?d ?e ?f. ?g ?h ?i. ?j ?k ?l}"


def fill(semantic_map: SemanticMap, label: str, *existences: float) -> None:
    category = semantic_map.catalogue.find(label).iri
    objects = tuple(
        ObjectRecord(
            semantic_map.new_object_iri(), category, np.array([n, 0, 0]), 1, share, 1, 0, 0
        )
        for n, share in enumerate(existences)
    )
    semantic_map.apply(MapUpdate(objects=objects))


class Fleet:
    """A running fleet's server, asked over HTTP."""

    def __init__(self, server: FleetServer, members: list[str]) -> None:
        self.server, self.members = server, members

    def get(self, path: str, accept: str = "*/*", **params: object) -> requests.Response:
        address, headers = self.server.url + path, {"Accept": accept}
        return requests.get(address, params=params, headers=headers, timeout=PATIENCE)  # type: ignore[arg-type]

    def ask(self, query: str, accept: str = "text/csv", **params: object) -> requests.Response:
        return self.get("sparql", accept, query=query, **params)

    def rows(self, query: str, **params: object) -> list[list[str]]:
        answer = self.ask(query, **params)
        assert answer.status_code == 200, answer.text
        return list(csv.reader(io.StringIO(answer.text)))


@pytest.fixture(scope="module")
def members(tmp_path_factory: pytest.TempPathFactory) -> Iterator[list[str]]:
    """A folder with two cups, and a served map with two cups and a chair."""
    folder = tmp_path_factory.mktemp("fleet")
    for name in ("north", "south"):
        with SemanticMap.create(folder / name, base=f"{BASE}{name}/") as made:
            fill(made, "cup", *((0.9, 0.3) if name == "north" else (0.6, 0.8)))
            fill(made, "chair", *([0.5] if name == "south" else []))
    with (
        SemanticMap.open(folder / "south", read_only=True) as south,
        MapServer(south, PATIENT) as server,
    ):
        yield [str(folder / "north"), server.url.rstrip("/")]


@pytest.fixture(scope="module")
def fleet(members: list[str]) -> Iterator[Fleet]:
    with FleetServer(members, PATIENT) as server:
        yield Fleet(server, members)


@pytest.fixture
def start() -> Iterator[Callable[..., Fleet]]:
    """Callable: members, and limits by name -> a fleet of them."""
    with ExitStack() as running:

        def run(*members: str, **limits: object) -> Fleet:
            limits = {"query_seconds": PATIENCE, **limits}
            settings = Settings(port=0, limits=Limits(**limits))  # type: ignore[arg-type]
            return Fleet(running.enter_context(FleetServer(members, settings)), list(members))

        yield run


def test_rows_say_whose_they_are_and_order_and_limit_hold_over_all(fleet: Fleet) -> None:
    north, south = fleet.members
    assert fleet.rows(f"{E} ORDER BY DESC(?e) LIMIT 3") == [
        ["member", "e"],
        [north, "0.9"],
        [south, "0.8"],
        [south, "0.6"],
    ]
    assert fleet.rows(f"{E} ORDER BY ?member ?e LIMIT 1") == [["member", "e"], [north, "0.3"]]
    assert len(fleet.rows(E)) == 5


@pytest.mark.parametrize("how", ["get", "form", "direct"])
def test_the_protocol_holds_for_a_fleet(fleet: Fleet, how: str) -> None:
    url, query = fleet.server.url + "sparql", "ASK { ?o a here:Chair }"
    graph = {"default-graph-uri": "https://w3id.org/hereabouts/graph/map"}
    if how == "get":
        answer = requests.get(url, params={"query": query, **graph}, timeout=PATIENCE)
    elif how == "form":
        answer = requests.post(url, data={"query": query, **graph}, timeout=PATIENCE)
    else:
        kind = {"Content-Type": "application/sparql-query"}
        answer = requests.post(url, params=graph, data=query, headers=kind, timeout=PATIENCE)
    assert answer.json()["boolean"] is True
    other = {"default-graph-uri": "https://w3id.org/hereabouts/graph/dataset"}
    assert fleet.ask(query, "application/json", **other).json()["boolean"] is False


@pytest.mark.parametrize(
    "accept",
    [
        "application/sparql-results+json",
        "application/sparql-results+xml",
        "text/csv",
        "text/tab-separated-values",
    ],
)
def test_tables_in_every_format(fleet: Fleet, accept: str) -> None:
    answer = fleet.ask(f"{E} ORDER BY ?e", accept)
    assert answer.headers["Content-Type"].partition(";")[0] == accept
    assert answer.headers["Vary"] == "Accept"
    found = [answer.text.index(f"{share}") for share in (0.3, 0.6, 0.8, 0.9)]
    assert found == sorted(found)
    assert all(member in answer.text for member in fleet.members)


@pytest.mark.parametrize(
    "accept", ["text/turtle", "application/rdf+xml", "application/ld+json", "application/n-triples"]
)
def test_triples_of_all_members_are_one_graph(fleet: Fleet, accept: str) -> None:
    answer = fleet.ask("CONSTRUCT { ?o a ?c } WHERE { ?o a ?c ; here:existence ?e }", accept)
    assert answer.headers["Content-Type"].partition(";")[0] == accept
    quads = parse(answer.content, format=RdfFormat.from_media_type(accept))
    things = {str(quad.subject).strip("<>") for quad in quads}
    assert things == {f"{BASE}north/object/{n}" for n in (1, 2)} | {
        f"{BASE}south/object/{n}" for n in (1, 2, 3)
    }


def test_blank_nodes_of_different_members_stay_apart(fleet: Fleet) -> None:
    answer = fleet.ask("CONSTRUCT { [] rdfs:label 'x' } WHERE {}", "application/n-triples")
    assert len(answer.text.splitlines()) == 2
    rows = fleet.rows("SELECT ?b WHERE { BIND(BNODE() AS ?b) }")
    assert len({row[1] for row in rows[1:]}) == 2


def test_counts_are_each_members_own_or_total(fleet: Fleet) -> None:
    north, south = fleet.members
    query = "SELECT (COUNT(?o) AS ?n) (MAX(?e) AS ?most) { ?o a here:Cup ; here:existence ?e }"
    assert sorted(fleet.rows(query)[1:]) == sorted([[north, "2", "0.9"], [south, "2", "0.8"]])
    assert fleet.rows(query, total=1) == [["n", "most"], ["4", "0.9"]]


def test_totals_by_group_in_their_own_order(fleet: Fleet) -> None:
    query = (
        "PREFIX : <https://w3id.org/hereabouts#> # LIMIT 9\n"
        "SELECT ?c (COUNT(*) AS ?n) (MIN(?e) AS ?low) (SUM(?e) AS ?all) WHERE "
        "{ ?o a ?c ; :existence ?e } GROUP BY ?c ORDER BY DESC(?n) LIMIT "
    )
    here = "https://w3id.org/hereabouts#"
    head, *rows = fleet.rows(query + "5", total=1)
    assert head == ["c", "n", "low", "all"]
    assert [row[:3] for row in rows] == [[f"{here}Cup", "4", "0.3"], [f"{here}Chair", "1", "0.5"]]
    assert float(rows[0][3]) == pytest.approx(2.6)
    assert len(fleet.rows(query + "1", total=1)) == 2


def test_totals_where_a_member_has_nothing(fleet: Fleet) -> None:
    query = "SELECT (COUNT(*) AS ?n) (MIN(?e) AS ?low) { ?o a here:Chair ; here:existence ?e }"
    assert fleet.rows(query, total=1) == [["n", "low"], ["1", "0.5"]]
    nothing = query.replace("Chair", "Banana")
    assert fleet.rows(nothing, total=1) == [["n", "low"], ["0", ""]]
    counted = "SELECT (COUNT(*) AS ?n) { ?o a here:Banana }"
    assert fleet.rows(counted, total=1) == [["n"], ["0"]]


@pytest.mark.parametrize(
    "query",
    [
        "SELECT (AVG(?e) AS ?n) { ?o here:existence ?e }",
        "SELECT (COUNT(DISTINCT ?e) AS ?n) { ?o here:existence ?e }",
        "SELECT (COUNT(*) + 1 AS ?n) { ?o here:existence ?e }",
        "SELECT (COUNT(*) AS ?n) { ?o a ?c ; here:existence ?e } GROUP BY ?c",
        "SELECT ?c (COUNT(*) AS ?n) { ?o a ?c } GROUP BY ?c HAVING(COUNT(*) > 1)",
        "SELECT (COUNT(*) AS ?n) { ?o here:existence ?e } ORDER BY COUNT(?e)",
        "SELECT ?e { ?o here:existence ?e }",
        "ASK {}",
    ],
)
def test_totals_that_cannot_be_put_together_are_refused(fleet: Fleet, query: str) -> None:
    answer = fleet.ask(query, total=1)
    assert answer.status_code == 400
    assert "totals" in answer.text
    assert answer.text.count("\n") == 1


@pytest.mark.parametrize(
    ("query", "why"),
    [
        (f"{E} OFFSET 1", "OFFSET"),
        (f"{E} ORDER BY ?o LIMIT 1", "needs ?o among the selected"),
        ("SELECT ?member { ?member a here:Cup }", "the fleet's own column"),
        ("CONSTRUCT WHERE { ?s ?p ?o } LIMIT 1", "LIMIT of CONSTRUCT"),
        ("SELECT ?e {", "cannot be answered"),
        ("SELECT * { SERVICE <http://127.0.0.1:1/> { ?s ?p ?o } }", "SERVICE"),
        ("SELECT * FROM <file:///etc/passwd> { ?s ?p ?o }", "FROM"),
        ("CLEAR ALL", "update"),
        (f"{E} #{'x' * 200_000}", "200,000 characters"),
        ("ASK {FILTER(" + "!" * 150_000 + "true)}", ""),
    ],
    ids=lambda text: text[:20],
)
def test_what_cannot_be_asked_of_a_fleet_reaches_no_member(
    fleet: Fleet, query: str, why: str
) -> None:
    answer = requests.post(fleet.server.url + "sparql", data={"query": query}, timeout=PATIENCE)
    assert 400 <= answer.status_code < 600
    assert answer.status_code in (400, 403) or query.startswith("ASK {FILTER(!")
    assert why in answer.text
    assert len(fleet.rows(E)) == 5


def test_a_fleet_only_reads(fleet: Fleet) -> None:
    url = fleet.server.url + "sparql"
    kind = {"Content-Type": "application/sparql-update"}
    for answer in (
        requests.post(url, data={"update": "CLEAR ALL"}, timeout=PATIENCE),
        requests.post(url, data="CLEAR ALL", headers=kind, timeout=PATIENCE),
        requests.get(url, params={"update": "CLEAR ALL"}, timeout=PATIENCE),
    ):
        assert answer.status_code == 403
        assert "only reads" in answer.text
    assert (
        requests.put(fleet.server.url + "graphs/map", data="", timeout=PATIENCE).status_code == 404
    )


@pytest.mark.parametrize("path", ["timemap", "changes", "subscribe"])
def test_what_each_map_has_of_its_own_is_not_a_fleets(fleet: Fleet, path: str) -> None:
    answer = fleet.get(path, iri="object/1")
    assert answer.status_code == 404
    assert f"ask the map it is about ({', '.join(fleet.members)})" in answer.text


@pytest.fixture(scope="module")
def remembering(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Fleet]:
    """Two maps with a past: a folder, and a served map; in each somebody said something."""
    folder = tmp_path_factory.mktemp("remembering")
    for name in ("east", "west"):
        with SemanticMap.create(folder / name, base=f"{BASE}{name}/") as made:
            fill(made, "cup", 0.9)
            made.assert_("object/1", "category", "bowl", by=f"ann of {name}")
            fill(made, "chair", 0.5)
    with (
        SemanticMap.open(folder / "west", read_only=True) as west,
        MapServer(west, PATIENT) as served,
        FleetServer([str(folder / "east"), served.url.rstrip("/")], PATIENT) as server,
    ):
        yield Fleet(server, [str(folder / "east"), served.url.rstrip("/")])


@pytest.mark.parametrize("number", [0, 1], ids=["folder", "server"])
def test_the_owner_of_a_thing_tells_its_past(remembering: Fleet, number: int) -> None:
    name, member = ("east", "west")[number], remembering.members[number]
    cup = f"{BASE}{name}/object/1"
    log = remembering.get("log", "application/json", iri=cup, last=1)
    assert (log.status_code, log.headers["Here-Member"]) == (200, member)
    assert [entry["by"] for entry in log.json()] == [f"ann of {name}"]
    assert f"by ann of {name}" in remembering.get("log", "text/plain", iri=cup).text
    for params in ({"iri": cup}, {"what": f"{cup} a here:Bowl"}, {"what": f"<{cup}>"}):
        why = remembering.get("why", "text/plain", **params)
        assert (why.status_code, f"ann of {name}" in why.text) == (200, True), why.text
    assert b"wasAssociatedWith" in remembering.get("why", "text/turtle", iri=cup).content
    diff = remembering.get("diff", "application/json", member=member, **{"from": 1, "to": "#2"})
    assert (diff.status_code, diff.json()["before"], diff.json()["after"]) == (200, 1, 2)
    short = remembering.get("log", "application/json", iri="object/1", member=member)
    assert len(short.json()) == 2


def test_what_was_said_is_told_by_all_or_by_its_owner(remembering: Fleet) -> None:
    told = remembering.get("assertions", "application/json").json()["assertions"]
    assert [(a["member"], a["by"]) for a in told] == [
        (remembering.members[0], "ann of east"),
        (remembering.members[1], "ann of west"),
    ]
    for given in ({"iri": f"{BASE}west/object/1"}, {"member": remembering.members[1]}):
        told = remembering.get("assertions", **given).json()["assertions"]
        assert [a["by"] for a in told] == ["ann of west"]
    assert remembering.get("assertions", iri=f"{BASE}west/object/9").json()["assertions"] == []
    conflicts = remembering.get("assertions", conflicts=1).json()["assertions"]
    assert len(conflicts) == 2  # perception still believes in cups
    assert remembering.get("assertions", "text/turtle").status_code == 406


def test_a_fleet_is_asked_how_it_was(remembering: Fleet) -> None:
    with SemanticMap.open(remembering.members[0], read_only=True) as east:
        began = max(change.time for change in east.changes(0))
    with SemanticMap.open(remembering.members[1]) as west:
        first = min(change.time for change in west.changes(0))
        last = max(change.time for change in west.changes(0))
    count = "SELECT (COUNT(*) AS ?n) { ?o here:existence ?e }"
    for time, counts in ((first, ["2", "1"]), (max(last, began), ["2", "2"])):
        rows = remembering.rows(count, at=iso(time))
        assert [row[1] for row in rows[1:]] == counts


@pytest.mark.parametrize(
    ("status", "path", "given", "said"),
    [
        (400, "log", {}, "needs iri="),
        (400, "why", {}, "needs iri="),
        (400, "log", {"iri": "object/1"}, "give its whole IRI, or member="),
        (400, "why", {"what": "object/1 here:x"}, "give its whole IRI, or member="),
        (400, "assertions", {"iri": "object/1"}, "give its whole IRI, or member="),
        (400, "assertions", {"iri": f"{BASE}east/a b"}, "no thing"),
        (400, "log", {"iri": f"{BASE}east/object/99"}, "knows nothing of object/99"),
        (404, "log", {"iri": "urn:nobody"}, "no map of this fleet can tell /log of that"),
        (400, "why", {"iri": "https://w3id.org/hereabouts#Cup"}, "several maps can tell"),
        (400, "diff", {"from": 1, "to": 2}, "add member=, one of"),
        (404, "diff", {"from": 1, "to": 2, "member": "north"}, "no member 'north'; there are"),
        (400, "sparql", {"query": "ASK {}", "at": "3"}, "asked at a time"),
        (400, "sparql", {"query": "ASK {}", "at": "yesterday"}, "asked at a time"),
        (404, "sparql", {"query": "ASK {}", "at": "1999-01-01"}, "not kept"),
        (400, "resource", {"iri": f"{BASE}east/object/1", "at": "3"}, "ask one map"),
    ],
)
def test_what_is_not_clear_is_said_in_one_line(
    remembering: Fleet, status: int, path: str, given: dict[str, object], said: str
) -> None:
    answer = remembering.get(path, **given)
    assert (answer.status_code, said in answer.text) == (status, True), answer.text
    assert answer.text.count("\n") == 1


def test_a_plain_server_among_them_says_what_it_has_not(
    start: Callable[..., Fleet], start_server: Callable[..., str]
) -> None:
    address = start_server("plain")
    with SemanticMap.create(address, base=f"{BASE}plain/") as plain:
        fill(plain, "cup", 0.5)
    fleet = start(address)
    for path, given in (
        ("log", {"iri": f"{BASE}plain/object/1"}),
        ("assertions", {}),
        ("sparql", {"query": "ASK {}", "at": "2026-01-01T00:00:00Z"}),
    ):
        answer = fleet.get(path, **given)
        assert (answer.status_code, "a plain SPARQL server" in answer.text) == (404, True)
    assert fleet.get("health").json()["status"] == "ok", "it is not away for that"


def test_a_fleet_is_told_nothing(fleet: Fleet) -> None:
    said = {"thing": "object/1", "property": "category", "value": "bowl"}
    refused = requests.post(fleet.server.url + "assertions", json=said, timeout=PATIENCE)
    assert (refused.status_code, "write to the member" in refused.text) == (403, True)


def test_a_member_that_is_away_is_no_silently_short_answer(
    members: list[str], start: Callable[..., Fleet]
) -> None:
    fleet = start(*members, AWAY)
    refused = fleet.ask(E)
    assert refused.status_code == 502
    assert f"no answer from {AWAY}: no server answers" in refused.text
    assert members[0] not in refused.text
    parts = fleet.ask(E, partial=1)
    assert parts.status_code == 200
    assert parts.headers["Here-Missing"] == AWAY
    assert len(parts.text.splitlines()) == 5
    health = fleet.get("health")
    assert health.status_code == 200
    assert health.json()["status"] == "partial"
    assert [m["status"] for m in health.json()["members"]] == ["ok", "ok", "away"]
    assert "hereabouts_members_away 1" in fleet.get("metrics").text
    assert "hereabouts_partial_answers_total 1" in fleet.get("metrics").text
    assert AWAY in fleet.get("", "text/html").text
    assert fleet.get("resource", iri="https://w3id.org/hereabouts#Cup").status_code == 502


def test_who_comes_back_is_a_member_again(start: Callable[..., Fleet], tmp_path: Path) -> None:
    late = str(tmp_path / "late.map")
    fleet = start(late)
    assert fleet.ask(E).status_code in (502, 503)
    assert fleet.get("health").status_code == 503
    with SemanticMap.create(late) as made:
        fill(made, "cup", 0.4)
    assert fleet.rows(E) == [["member", "e"], [late, "0.4"]]
    assert fleet.get("health").json()["status"] == "ok"


def test_a_server_of_another_make_is_a_member(
    members: list[str], start: Callable[..., Fleet], sparql_server: str
) -> None:
    with SemanticMap.create(sparql_server, base=f"{BASE}east/") as made:
        fill(made, "cup", 0.7)
    fleet = start(members[0], sparql_server)
    rows = fleet.rows(f"{E} ORDER BY DESC(?e)")
    assert rows[1:] == [[members[0], "0.9"], [sparql_server, "0.7"], [members[0], "0.3"]]
    answer = fleet.get("resource", "text/turtle", iri=f"{BASE}east/object/1")
    assert "here:Cup" in answer.text


def test_a_runaway_query_is_killed_in_folders_and_the_fleet_answers_on(
    members: list[str], start: Callable[..., Fleet]
) -> None:
    fleet = start(members[0], query_seconds=5.0)
    assert fleet.get("health").status_code == 200
    statuses: list[int] = []
    bomb = threading.Thread(target=lambda: statuses.append(fleet.ask(RUNAWAY).status_code))
    bomb.start()
    assert len(fleet.rows(E)) == 3
    bomb.join()
    assert statuses == [504]
    assert len(fleet.rows(E)) == 3


def test_a_thing_is_shown_by_its_owner_and_a_class_by_all(fleet: Fleet) -> None:
    thing = fleet.get("resource", "text/turtle", iri=f"{BASE}south/object/3")
    graph = rdflib.Graph().parse(data=thing.text, format="turtle")
    kinds = set(graph.objects(rdflib.URIRef(f"{BASE}south/object/3"), rdflib.RDF.type))
    assert rdflib.URIRef("https://w3id.org/hereabouts#Chair") in kinds
    kind = fleet.get("resource", "text/turtle", iri="https://w3id.org/hereabouts#Cup").text
    assert f"{BASE}north/object/1" in kind
    assert f"{BASE}south/object/1" in kind
    page = fleet.get("resource", "text/html", iri=f"{BASE}north/object/1")
    assert "/resource?iri=" in page.text
    assert fleet.get("resource", iri=f"{BASE}north/object/99").status_code == 404
    assert fleet.get("resource").status_code == 400


def test_a_fleet_describes_itself(fleet: Fleet) -> None:
    service = rdflib.Graph().parse(data=fleet.get("sparql", "text/turtle").text, format="turtle")
    sd = rdflib.Namespace("http://www.w3.org/ns/sparql-service-description#")
    url = rdflib.URIRef(fleet.server.url + "sparql")
    assert (url, rdflib.RDF.type, sd.Service) in service
    void = rdflib.Graph().parse(data=fleet.get(".well-known/void", "text/turtle").text)
    subsets = void.objects(None, rdflib.URIRef("http://rdfs.org/ns/void#subset"))
    assert {str(subset) for subset in subsets} == {f"{BASE}north/", f"{BASE}south/"}
    page = fleet.get("", "text/html").text
    assert all(member in page for member in fleet.members)
    assert fleet.get("changes").status_code == 404


def test_a_password_in_an_address_is_never_shown(start: Callable[..., Fleet]) -> None:
    fleet = start("http://ann:sesame-opens@127.0.0.1:9")
    for path in ("health", "", "metrics", "sparql?query=ASK%20%7B%7D"):
        assert "sesame" not in fleet.get(path, "text/html, */*").text
    assert "127.0.0.1:9" in json.dumps(fleet.get("health").json())


def test_a_fleet_needs_members_each_once(members: list[str]) -> None:
    for given in ([], members * 2):
        with pytest.raises(GraphError, match="each once"):
            FleetServer(given, Settings(port=0))
    server = FleetServer([AWAY], Settings(port=0))
    with pytest.raises(GraphError, match="no answer from http://127"):
        server.away()

"""The W3C's SPARQL 1.1 Protocol tests, each case under its name.

Source: w3c/rdf-tests, sparql/sparql11/protocol/manifest.ttl, all 34 approved cases. Two things
differ, on purpose. A case that begins with CLEAR ALL or DROP ALL clears a graph of its own or none:
a map that loses its ontology is no map, so that is refused (the last test). And
`query_multiple_dataset` names its two graphs as two parameters, where the manifest has escaped the
& between them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    import requests
    from conftest import Served

DATA = [f"http://kasei.us/2009/09/sparql/data/data{number}.rdf" for number in range(4)]
QUERY, UPDATE = "application/sparql-query", "application/sparql-update"
BOOLEANS = ("application/sparql-results+xml", "application/sparql-results+json")
TABLES = (*BOOLEANS, "text/csv", "text/tab-separated-values")
GRAPHS = ("text/turtle", "application/rdf+xml", "application/n-triples", "application/ld+json")
DC = "http://purl.org/dc/terms/BibliographicResource"
PREFIXES = "PREFIX foaf: <http://xmlns.com/foaf/0.1/>"


@pytest.fixture
def loaded(lasting: Served) -> Served:
    """The test suite's data: a graph a file, that says of itself that it is a document."""
    data = " ".join(f"GRAPH <{g}> {{ <{g}> a <http://xmlns.com/foaf/0.1/Document> }}" for g in DATA)
    answer = lasting.write(f"INSERT DATA {{ {data} }}")
    assert answer.status_code == 200, answer.text
    return lasting


def direct(served: Served, text: str, kind: str = QUERY, **graphs: object) -> requests.Response:
    params = {name.replace("_", "-"): value for name, value in graphs.items()}
    headers = {"Content-Type": kind, **served.bearer()}
    return served.post("sparql/", data=text.encode(), params=params, headers=headers)


def is_true(answer: requests.Response) -> None:
    assert answer.status_code == 200, answer.text
    assert answer.headers["Content-Type"].partition(";")[0] in BOOLEANS
    assert answer.json()["boolean"] is True


def refused(answer: requests.Response) -> None:
    assert 400 <= answer.status_code < 500, answer.text


def done(answer: requests.Response) -> None:
    assert 200 <= answer.status_code < 400, answer.text


def test_query_post_form(loaded: Served) -> None:
    given = {"default-graph-uri": DATA[0]}
    is_true(loaded.post("sparql/", params=given, data={"query": "ASK {}"}))


BOTH = f"ASK {{ <{DATA[1]}> a ?type . <{DATA[2]}> a ?type . }}"
NAMED = f"GRAPH ?g1 {{ <{DATA[1]}> a ?type }} GRAPH ?g2 {{ <{DATA[2]}> a ?type }}"


def test_query_dataset_default_graphs_get(loaded: Served) -> None:
    given = {"query": BOTH, "default-graph-uri": DATA[1:3]}
    is_true(loaded.get("sparql/", params=given))
    given["default-graph-uri"] = DATA[1:2]
    assert loaded.get("sparql/", params=given).json()["boolean"] is False


def test_query_dataset_default_graphs_post(loaded: Served) -> None:
    is_true(direct(loaded, BOTH, default_graph_uri=DATA[1:3]))
    assert direct(loaded, BOTH, default_graph_uri=DATA[2:4]).json()["boolean"] is False


def test_query_dataset_named_graphs_post(loaded: Served) -> None:
    is_true(direct(loaded, f"ASK {{ {NAMED} }}", named_graph_uri=DATA[1:3]))
    alone = direct(loaded, f"ASK {{ {NAMED} }}", named_graph_uri=DATA[1])
    assert alone.json()["boolean"] is False


def test_query_dataset_named_graphs_get(loaded: Served) -> None:
    given = {"query": f"ASK {{ {NAMED} }}", "named-graph-uri": DATA[1:3]}
    is_true(loaded.get("sparql/", params=given))


def test_query_dataset_full(loaded: Served) -> None:
    query = f"ASK {{ <{DATA[3]}> a ?type {NAMED} }}"
    is_true(direct(loaded, query, default_graph_uri=DATA[3], named_graph_uri=DATA[1:3]))
    turned = direct(loaded, query, default_graph_uri=DATA[1], named_graph_uri=DATA[2:4])
    assert turned.json()["boolean"] is False


def test_query_multiple_dataset(loaded: Served) -> None:
    query = f"ASK FROM <{DATA[3]}> {{ {NAMED} }}"
    is_true(direct(loaded, query, named_graph_uri=DATA[1:3]))


def test_query_get(loaded: Served) -> None:
    given = {"query": "ASK {}", "default-graph-uri": DATA[0]}
    is_true(loaded.get("sparql/", params=given))


def kind_of(served: Served, query: str) -> str:
    answer = direct(served, query, default_graph_uri=DATA[0])
    done(answer)
    return answer.headers["Content-Type"].partition(";")[0]


@pytest.mark.parametrize(
    ("query", "kinds"),
    [
        ("SELECT (1 AS ?value) {}", TABLES),
        ("ASK {}", BOOLEANS),
        ("DESCRIBE <http://example.org/>", GRAPHS),
        ("CONSTRUCT { <s> <p> 1 } WHERE {}", GRAPHS),
    ],
)
def test_query_content_type(loaded: Served, query: str, kinds: tuple[str, ...]) -> None:
    assert kind_of(loaded, query) in kinds


def copied(target: str, where: str = "?s a foaf:Document") -> str:
    """An update that has what `where` finds in a graph of its own."""
    return f"{PREFIXES} INSERT {{ GRAPH <{target}> {{ ?s a <{DC}> }} }} WHERE {{ {where} }}"


def holds(target: str, has: list[str], lacks: list[str]) -> str:
    wanted = " . ".join(f"<{s}> a <{DC}>" for s in has)
    others = " ".join(
        f"FILTER NOT EXISTS {{ GRAPH <{target}> {{ <{s}> a <{DC}> }} }}" for s in lacks
    )
    return f"ASK {{ GRAPH <{target}> {{ {wanted} }} {others} }}"


def test_update_dataset_default_graph(loaded: Served) -> None:
    target = "http://example.org/protocol-update-dataset-test/"
    done(direct(loaded, copied(target), UPDATE, using_graph_uri=DATA[1]))
    is_true(direct(loaded, holds(target, DATA[1:2], DATA[2:])))


def test_update_dataset_default_graphs(loaded: Served) -> None:
    target = "http://example.org/protocol-update-dataset-graphs-test/"
    done(direct(loaded, copied(target), UPDATE, using_graph_uri=DATA[1:3]))
    is_true(direct(loaded, holds(target, DATA[1:3], DATA[3:])))


def test_update_dataset_named_graphs(loaded: Served) -> None:
    target = "http://example.org/protocol-update-dataset-named-graphs-test/"
    update = copied(target, "GRAPH ?g { ?s a foaf:Document }")
    done(direct(loaded, update, UPDATE, using_named_graph_uri=DATA[1:3]))
    is_true(direct(loaded, holds(target, DATA[1:3], DATA[3:])))


def test_update_dataset_full(loaded: Served) -> None:
    target = "http://example.org/protocol-update-dataset-full-test/"
    update = (
        f"{PREFIXES} INSERT {{ GRAPH <{target}> {{ ?s <http://example.org/in> ?in }} }} WHERE {{ "
        "{ GRAPH ?g { ?s a foaf:Document } BIND(?g AS ?in) } UNION "
        "{ ?s a foaf:Document BIND('default' AS ?in) } }"
    )
    given = {"using_graph_uri": DATA[1], "using_named_graph_uri": DATA[2]}
    done(direct(loaded, update, UPDATE, **given))
    is_true(
        direct(
            loaded,
            f"ASK {{ GRAPH <{target}> {{ <{DATA[1]}> <http://example.org/in> 'default' . "
            f"<{DATA[2]}> <http://example.org/in> <{DATA[2]}> }} "
            f"FILTER NOT EXISTS {{ GRAPH <{target}> {{ <{DATA[3]}> ?p ?o }} }} }}",
        )
    )


def cleared(served: Served) -> None:
    is_true(direct(served, f"ASK {{ FILTER NOT EXISTS {{ GRAPH <{DATA[1]}> {{ ?s ?p ?o }} }} }}"))


def test_update_post_form(loaded: Served) -> None:
    form = {"update": f"CLEAR GRAPH <{DATA[1]}>"}
    done(loaded.post("sparql/", data=form, headers=loaded.bearer()))
    cleared(loaded)


def test_update_post_direct(loaded: Served) -> None:
    done(direct(loaded, f"CLEAR GRAPH <{DATA[1]}>", UPDATE))
    cleared(loaded)


def test_update_base_uri(loaded: Served) -> None:
    graph = "http://example.org/protocol-base-test/"
    data = f"GRAPH <{graph}> {{ <http://example.org/s> rdfs:seeAlso <test> }}"
    done(direct(loaded, f"CLEAR SILENT GRAPH <{graph}> ; INSERT DATA {{ {data} }}", UPDATE))
    (row,) = loaded.rows(f"SELECT ?o {{ GRAPH <{graph}> {{ <http://example.org/s> ?p ?o }} }}")
    assert row["o"] == f"{loaded.map.base}test"
    is_true(direct(loaded, "ASK { <object/1> a here:Cup }"))


def test_query_post_direct(loaded: Served) -> None:
    is_true(direct(loaded, "ASK {}"))


CLEAR = f"CLEAR GRAPH <{DATA[1]}>"
FORM = "application/x-www-form-urlencoded"
#: name of a case -> method, type of the body, body, parameters
BAD: dict[str, tuple[str, str | None, bytes, dict[str, object]]] = {
    "bad_query_method": ("PUT", None, b"", {"query": "ASK {}", "default-graph-uri": DATA[0]}),
    "bad_multiple_queries": ("GET", None, b"", {"query": ["ASK {}", "SELECT * {}"]}),
    "bad_query_wrong_media_type": ("POST", "text/plain", b"ASK {}", {}),
    "bad_query_missing_form_type": ("POST", None, b"query=ASK%20%7B%7D", {}),
    "bad_query_missing_direct_type": ("POST", None, b"ASK {}", {}),
    "bad_query_non_utf8": ("POST", f"{QUERY}; charset=UTF-16", "ASK {}".encode("utf-16"), {}),
    "bad_query_syntax": ("GET", None, b"", {"query": "ASK {"}),
    "bad_update_get": ("GET", None, b"", {"update": CLEAR}),
    "bad_multiple_updates": ("POST", FORM, f"update={CLEAR}&update={CLEAR}".encode(), {}),
    "bad_update_wrong_media_type": ("POST", "text/plain", CLEAR.encode(), {}),
    "bad_update_missing_form_type": ("POST", None, b"update=CLEAR%20NAMED", {}),
    "bad_update_non_utf8": ("POST", f"{UPDATE}; charset=UTF-16", CLEAR.encode("utf-16"), {}),
    "bad_update_syntax": ("POST", FORM, b"update=CLEAR%20XYZ", {}),
}


@pytest.mark.parametrize("name", BAD)
def test_what_is_refused(loaded: Served, name: str) -> None:
    method, kind, body, params = BAD[name]
    headers = loaded.bearer() | ({} if kind is None else {"Content-Type": kind})
    answer = loaded.request(method, "sparql/", data=body, params=params, headers=headers)
    assert kind is not None or "Content-Type" not in answer.request.headers
    unchanged(loaded, answer)


def unchanged(served: Served, answer: requests.Response) -> None:
    refused(answer)
    is_true(direct(served, f"ASK {{ GRAPH <{DATA[1]}> {{ ?s a ?type }} }}"))


def test_bad_update_dataset_conflict(loaded: Served) -> None:
    update = (
        f"WITH <{DATA[1]}> DELETE {{ ?s a ?type }} INSERT {{ ?s a <{DC}> }} WHERE {{ ?s a ?type }}"
    )
    unchanged(loaded, direct(loaded, update, UPDATE, using_named_graph_uri=DATA[2]))
    is_true(
        direct(
            loaded,
            f"ASK {{ FILTER NOT EXISTS {{ <{DATA[1]}> a <{DC}> }} }}",
            default_graph_uri=DATA[1],
        )
    )


@pytest.mark.parametrize("update", ["CLEAR ALL", "DROP ALL", "CLEAR NAMED"])
def test_the_whole_map_is_not_cleared_by_one_word(loaded: Served, update: str) -> None:
    answer = direct(loaded, update, UPDATE)
    assert answer.status_code == 403
    assert "an update may not write" in answer.text
    is_true(direct(loaded, f"ASK {{ here:Cup rdfs:label ?label . <{DATA[1]}> a ?type }}"))

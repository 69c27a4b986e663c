"""`/why` as PROV-O: a transaction of somebody has a qualified association with an agent."""

from __future__ import annotations

from typing import TYPE_CHECKING

import rdflib

from kg.model import vocabulary as v

if TYPE_CHECKING:
    from conftest import Served


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

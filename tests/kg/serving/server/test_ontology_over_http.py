"""An ontology taken into a map that is being served: no restart, and the old one where refused."""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
import rdflib
import requests
from pyoxigraph import NamedNode, Quad, RdfFormat, serialize

from kg.knowledge.ontology.import_closure import load_with_imports
from kg.knowledge.ontology.loading import load_ontologies
from kg.model import vocabulary as v
from kg.model.errors import OntologyError, RemoteError
from kg.model.transactions import Cause
from kg.model.vocabulary import HERE, OWL_AXIOM, PREFIXES
from kg.serving.reloading import ontology_at, reload
from kg.serving.workers.ontology_worker import OntologyDocument, replace_ontology
from tests.waiting import until

if TYPE_CHECKING:
    from conftest import Served

TURTLE = """<urn:mine> a owl:Ontology ; rdfs:label "mine" ; rdfs:comment "Ours." ;
    owl:imports <https://w3id.org/hereabouts/ontology/commonsense> ;
    owl:versionInfo "1" ; dct:license <urn:free> .
here:Mug a owl:Class ; rdfs:subClassOf here:Cup ; rdfs:label "mug" ; rdfs:comment "A cup." ;
    here:locatedAt here:Kitchen .
[] a owl:Axiom ; owl:annotatedSource here:Mug ; owl:annotatedProperty here:locatedAt ;
    owl:annotatedTarget here:Kitchen ; here:probability 0.6e0 ; dct:source "us" .
"""
QUERY = "SELECT ?p { ?r here:relationSubject here:Mug ; here:relationProbability ?p }"


@pytest.fixture
def mine(tmp_path: Path) -> Path:
    path = tmp_path / "mine.ttl"
    names = "".join(f"@prefix {name}: <{iri}> .\n" for name, iri in PREFIXES.items())
    path.write_text(names + TURTLE)
    return path


@pytest.mark.usefixtures("token")
def test_a_served_map_goes_on_with_the_new_ontology(served: Served, mine: Path) -> None:
    before = served.map.sequence
    assert served.rows(QUERY) == []
    with served.stream("changes", {"since": before}) as events:
        done = reload(served.url, mine)
        assert [str(change) for change in done.changes] == [
            "+ category 'mug' added under cup",
            "+ ontology 'mine' added",
            "+ mug located at kitchen 0.6 added ('us')",
        ]
        assert (done.sequence, done.removed) == (before + 1, 0)
        number, _, told = events.next()
        assert number == before + 1
        assert told["cause"]["kind"] == "ontology"  # type: ignore[index]
    # the reload was by the holder of a token: others see it within a second
    until(lambda: [float(row["p"]) for row in served.rows(QUERY)] == [0.6], seconds=30)
    assert served.map.catalogue.find("mug").iri == HERE + "Mug"
    served.map.update("INSERT DATA { <https://example.org/m> a here:Mug ; here:x 1 ; here:y 1 }")
    assert [record.category for record in served.map.objects("mug")] == [HERE + "Mug"]
    assert reload(served.url, mine).changes == ()
    assert served.map.sequence == before + 2


@pytest.mark.usefixtures("token")
def test_a_refused_ontology_leaves_a_served_map_as_it_is(served: Served, mine: Path) -> None:
    before = set(served.map.engine)
    mine.write_text(mine.read_text().replace("0.6e0", "6"))
    with pytest.raises(OntologyError, match=r"mine\.ttl, line \d+: here:Mug .*between 0 and 1"):
        reload(served.url, mine)
    headers = {"Content-Type": "text/turtle", **served.bearer()}
    answer = served.request("PUT", "graphs/ontology", data=mine.read_bytes(), headers=headers)
    assert answer.status_code == 422
    assert set(served.map.engine) == before


@pytest.mark.usefixtures("token")
def test_a_cycle_of_a_thousand_classes_is_refused_at_once_however_it_comes(served, mine):
    before = set(served.map.engine)
    classes = "".join(
        f"here:C{i} a owl:Class ; rdfs:label 'c {i}' ; rdfs:subClassOf here:C{(i + 1) % 1000} .\n"
        for i in range(1000)
    )
    headers = {"Content-Type": "text/turtle", **served.bearer()}
    answer = served.request(
        "PUT", "graphs/ontology", data=mine.read_text() + classes, headers=headers
    )
    assert (answer.status_code, "superclasses of one another" in answer.text) == (422, True)
    with pytest.raises(OntologyError, match="superclasses of one another"):
        served.map.update(
            f"INSERT DATA {{ GRAPH graph:ontology {{ {classes} }} }}", allow=["ontology"]
        )
    assert set(served.map.engine) == before


def test_a_map_that_holds_a_cycle_opens_and_is_mended(served: Served) -> None:
    one, other = NamedNode(HERE + "Cup"), NamedNode(HERE + "Mug")
    below = NamedNode(v.RDFS_SUB_CLASS_OF)
    cycle = [
        Quad(one, below, other, v.ONTOLOGY_GRAPH),
        Quad(other, below, one, v.ONTOLOGY_GRAPH),
        Quad(one, NamedNode(v.IS_A), other, v.COMMONSENSE_GRAPH),
    ]
    served.map.store.commit([], cycle, Cause("update"))
    served.map.ontology.reread()
    assert served.map.catalogue.find("cup").iri == one.value
    served.map.ontology.replace(load_ontologies().quads, whole=True)
    assert not set(cycle) & set(served.map.engine)


def test_a_server_wants_a_token(served, mine, monkeypatch):
    monkeypatch.delenv("HEREABOUTS_TOKEN", raising=False)
    with pytest.raises(RemoteError, match=r"\(401\).*into HEREABOUTS_TOKEN"):
        reload(served.url, mine)
    assert served.rows(QUERY) == []


def test_a_trial_of_a_served_map_changes_nothing(served: Served, mine: Path) -> None:
    before = served.map.sequence
    done = reload(served.url, mine, dry=True)
    assert len(done.changes) == 3
    assert served.map.sequence == before


def test_a_served_ontology_is_read_with_blank_nodes(served: Served) -> None:
    text = served.get("graphs/ontology", headers={"Accept": "application/n-triples"}).text
    graph = rdflib.Graph().parse(data=text, format="nt")
    axioms = list(graph.subjects(rdflib.RDF.type, rdflib.URIRef(OWL_AXIOM)))
    assert axioms
    assert all(isinstance(axiom, rdflib.BNode) for axiom in axioms)
    assert set(ontology_at(served.url).quads) == set(served.map.ontology.quads())


def test_what_goes_is_said_to_go(served: Served, mine: Path) -> None:
    def put(quads: object, query: str) -> tuple[int, str]:
        body = serialize([q.triple for q in quads], format=RdfFormat.N_TRIPLES)  # type: ignore[attr-defined]
        headers = {"Content-Type": "application/n-triples", **served.bearer()}
        answer = served.request("PUT", f"graphs/ontology{query}", data=body, headers=headers)
        return answer.status_code, answer.text

    shipped = load_ontologies().quads
    served.map.ontology.replace(load_with_imports(mine).quads, whole=True)
    status, text = put(shipped, "")
    assert (status, "leaves out <urn:mine>" in text) == (422, True)
    assert put(shipped, "?whole=perhaps")[0] == 400
    assert put(shipped, "?whole=true")[0] == 200


def _classes(count: int, above: Callable[[int], str]) -> str:
    return "".join(
        f'<urn:c:{n}> a owl:Class ; rdfs:label "c {n}" ; rdfs:comment "One." ; '
        f"rdfs:subClassOf {above(n)} .\n"
        for n in range(count)
    )


#: a limit of each kind; those of `check_quads` have their own tests
HOSTILE = {
    "chain": (_classes(300, lambda n: f"<urn:c:{n + 1}>"), "at most 100 levels"),
    "relations": (
        "".join(
            f"here:Cup here:nearBy {', '.join(f'<urn:c:{k}:{n}>' for n in range(3000))} .\n"
            for k in range(4)
        ),
        "12,",
    ),
    "statements": (
        "<urn:c> here:nothing " + ", ".join(str(n) for n in range(160_000)) + " .",
        "at most 150,000",
    ),
    "text": (f'<urn:c> rdfs:comment "{"x" * 200_000}" .', "200,000 characters"),
    "blank nodes": ("_:a rdfs:seeAlso _:b . _:b rdfs:seeAlso _:a .", "point at each other"),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_an_ontology_beyond_the_limits_is_refused_by_name(lasting: Served, name: str) -> None:
    text, reason = HOSTILE[name]
    before = lasting.map.sequence
    answer = _put(lasting, text)
    assert (answer.status_code, reason in answer.text) == (422, True), answer.text
    assert "\n" not in answer.text.strip()
    assert lasting.map.sequence == before
    assert lasting.write("INSERT DATA { GRAPH <urn:g> { <urn:a> rdfs:label 'b' } }").ok


def test_others_write_while_an_ontology_is_checked(served: Served) -> None:
    taken: list[requests.Response] = []
    text = _classes(1500, lambda _: "here:Object")
    thread = threading.Thread(target=lambda: taken.append(_put(served, text)))
    thread.start()
    written = 0
    while thread.is_alive():
        number = f"<urn:a:{written}>"
        assert served.write(f"INSERT DATA {{ GRAPH <urn:g> {{ {number} rdfs:label 'b' }} }}").ok
        written += 1
    thread.join()
    assert taken[0].status_code == 200, taken[0].text
    # the replacement is the last transaction but one, or earlier: the others did not wait for it
    assert written > 3
    assert served.map.catalogue.find("c 7").iri == "urn:c:7"


def test_an_ontology_that_loses_a_category_used_meanwhile_is_refused(served: Served) -> None:
    """The map begins to use a category after the snapshot on which the replacement was planned."""
    assert _put(served, _classes(1, lambda _: "here:Object")).ok
    worker = served.server.serving.pool.ontologies
    document = OntologyDocument(_shipped(), RdfFormat.N_TRIPLES, served.map.base, whole=True)

    def meanwhile() -> None:
        category = "<object/9> a <urn:c:0> ; here:x 1e0 ; here:y 1e0 ; here:inPlace <place/1>"
        served.map.update(f"INSERT DATA {{ {category} }}", by="ann")

    uses = iter([meanwhile])
    with pytest.raises(OntologyError, match="the map uses urn:c:0"):
        replace_ontology(
            worker, served.map, document, by="ann", check=lambda: next(uses, lambda: None)()
        )


def _shipped() -> bytes:
    quads = load_ontologies().quads
    return serialize([q.triple for q in quads], format=RdfFormat.N_TRIPLES) or b""


def _put(served: Served, turtle: str) -> requests.Response:
    """The shipped ontology with some more, sent as a client that knows nothing of limits."""
    names = "".join(f"@prefix {name}: <{iri}> .\n" for name, iri in PREFIXES.items())
    return served.request(
        "PUT",
        "graphs/ontology?whole=true",
        data=_shipped() + names.encode() + turtle.encode(),
        headers={"Content-Type": "text/turtle", **served.bearer()},
    )

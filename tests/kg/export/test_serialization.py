"""Exported files parse again to the same triples, and carry geometries other tools read."""

import math
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import rdflib
from pyoxigraph import BlankNode, Literal, NamedNode, Quad, RdfFormat, Store
from rdflib.compare import isomorphic

from kg.export.serialization import FORMATS, export_map, export_quads, export_text
from kg.maps.semantic_map import SemanticMap
from kg.model.errors import GraphError
from kg.model.records import Evidence, MapUpdate, ObjectRecord, PlaceRecord, RobotRecord
from kg.model.vocabulary import ASSERTIONS_GRAPH, INFERRED_GRAPH
from kg.serving.opening import in_memory_map
from kg.store.folder import write_atomically
from tests.kg.conftest import canonical

NATIVE = {
    "ttl": RdfFormat.TURTLE,
    "trig": RdfFormat.TRIG,
    "nq": RdfFormat.N_QUADS,
    "nt": RdfFormat.N_TRIPLES,
    "jsonld": RdfFormat.JSON_LD,
    "rdfxml": RdfFormat.RDF_XML,
}
AWKWARD = 'two .\n lines,\ta tab .\n@prefix and "quotes" \\ <é>'


@pytest.fixture
def chart() -> SemanticMap:
    chart = in_memory_map(title=AWKWARD, base="http://example.org/lab/")
    kitchen, chair = (chart.catalogue.find(name).iri for name in ("kitchen", "chair"))
    seen = Evidence("frame 1", "a/b c", 1.0, (1, 2, 3, 4), 0.8, "detector")
    where, place = np.array([1.25, -2.0, 0.5]), chart.place_iri(1)
    record = ObjectRecord(chart.new_object_iri(), chair, where, 1.0, 0.83, 1, 0.0, 1.0, place, seen)
    record = replace(record, extent=np.array([0.5, 0.4, 0.9]), yaw=math.pi / 2)
    room = PlaceRecord(place, "room", 0, 4, -3, 4.5, 3, {kitchen: 0.81})
    robot = RobotRecord(np.zeros(3), 1.0, 7.0)
    chart.apply(MapUpdate(objects=(record,), places=(room,), robot=robot))
    said = NamedNode("http://example.org/said")
    graph = ASSERTIONS_GRAPH
    chart.engine.add(Quad(NamedNode(record.iri), said, Literal("mine", language="en"), graph))
    chart.engine.add(Quad(BlankNode(), said, BlankNode(), graph))
    return chart


@pytest.mark.parametrize("form", FORMATS)
def test_every_format_reads_back_as_the_same_triples(chart, tmp_path, form):
    path = tmp_path / f"lab{FORMATS[form][0]}"
    export_map(chart, path, ontology=False)
    back = Store()
    back.load(path=str(path), format=NATIVE[form])
    quads = export_quads(chart, ontology=False)
    if form not in ("trig", "nq"):
        quads = [Quad(*quad.triple) for quad in quads]
    else:  # which say what is inferred by its graph
        inferred = set(back.quads_for_pattern(None, None, None, INFERRED_GRAPH))
        assert inferred
        assert inferred == set(chart.engine.quads_for_pattern(None, None, None, INFERRED_GRAPH))
        back.remove_graph(INFERRED_GRAPH)
    assert canonical(back) == canonical(quads)
    counted = export_map(chart, path)
    whole = Store()
    whole.load(path=str(path), format=NATIVE[form])
    assert len(whole) == len({quad.triple for quad in whole}) == counted


@pytest.mark.parametrize(
    ("form", "alias"),
    [("ttl", "turtle"), ("nq", "N-Quads"), ("jsonld", "json-ld"), ("rdfxml", "xml")],
)
def test_formats_go_by_the_names_of_other_tools(chart: SemanticMap, form: str, alias: str) -> None:
    assert export_text(chart, alias) == export_text(chart, form)


# rdflib's own JSON-LD reader still builds the class that rdflib deprecates
@pytest.mark.filterwarnings("ignore:ConjunctiveGraph is deprecated:DeprecationWarning")
@pytest.mark.parametrize(
    ("form", "name"), [("ttl", "turtle"), ("jsonld", "json-ld"), ("rdfxml", "xml")]
)
def test_rdflib_reads_the_same_graph(chart: SemanticMap, form: str, name: str) -> None:
    def read(text: str, syntax: str) -> rdflib.Graph:
        return rdflib.Graph().parse(data=text, format=syntax)

    expected = read(export_text(chart, "nt", ontology=False), "nt")
    assert isomorphic(read(export_text(chart, form, ontology=False), name), expected)


def test_geometries_name_the_frame_of_the_map(chart: SemanticMap) -> None:
    text = export_text(chart, "ttl", ontology=False)
    crs = "<http://example.org/lab/crs>"
    assert f'"{crs} POINT Z (1.25 -2 0.5)"^^geo:wktLiteral' in text
    turned = "1.45 -2.25, 1.45 -1.75, 1.05 -1.75, 1.05 -2.25, 1.45 -2.25"
    assert f'"{crs} POLYGON (({turned}))"^^geo:wktLiteral' in text
    assert "geo:hasBoundingBox" in text
    assert f'"{crs} POLYGON ((0 -3, 4 -3, 4 4.5, 0 4.5, 0 -3))"^^geo:wktLiteral' in text


def test_turtle_is_short_to_read_and_the_same_each_time(chart: SemanticMap) -> None:
    text = export_text(chart, "ttl", ontology=False)
    assert text == export_text(chart, "ttl", ontology=False)
    assert "owl:Class" not in text and "here:WineGlass a owl:Class" in export_text(chart, "ttl")
    assert "\nobject:1 a geo:Feature , here:Chair ;\n" in text
    assert "here:existence 0.83e0 ;" in text


@pytest.mark.parametrize("arguments", [("lab.txt",), ("lab.ttl", "turtel")])
def test_unknown_formats_are_told_which_there_are(chart, tmp_path, arguments):
    with pytest.raises(GraphError, match="ttl, trig, nq, nt, jsonld, rdfxml"):
        export_map(chart, tmp_path / arguments[0], *arguments[1:])
    assert list(tmp_path.iterdir()) == []


def test_a_path_that_cannot_be_written_is_one_line(chart: SemanticMap, tmp_path: Path) -> None:
    with pytest.raises(GraphError, match="cannot write"):
        export_map(chart, tmp_path / "missing" / "lab.ttl")


def test_pipes_are_written_to_and_links_kept(tmp_path: Path) -> None:
    pipe, link, real = tmp_path / "pipe", tmp_path / "link.ttl", tmp_path / "real.ttl"
    os.mkfifo(pipe)
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    write_atomically(pipe, "text")
    assert os.read(reader, 9) == b"text"
    os.close(reader)
    assert pipe.is_fifo()
    link.symlink_to(real)
    write_atomically(link, "text")
    assert link.is_symlink()
    assert real.read_text() == "text"

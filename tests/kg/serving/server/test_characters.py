"""Characters that XML cannot hold: refused at the door, and in no XML that leaves an older map."""

import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import networkx as nx
import pytest
import rdflib
import requests
from hypothesis import given
from hypothesis import strategies as st
from pyoxigraph import Literal, NamedNode, Quad

from kg.export.serialization import export_map, export_text
from kg.maps.semantic_map import SemanticMap
from kg.model import vocabulary as v
from kg.model.errors import InvalidFactError
from kg.model.records import MapUpdate, PlaceRecord
from kg.rdf.literals import XmlPieces, in_xml, shown, unwritable
from kg.serving.opening import in_memory_map
from kg.serving.server import Limits, MapServer, Settings
from tests.kg.serving.server.conftest import BASE, PATIENCE, Served, furnished

BAD = "\x00\x01\x08\x0b\x0c\x0e\x1f\ufffe\uffff"
TEXT = f"a{BAD}b"
INSTEAD = "a" + "\ufffd" * len(BAD) + "b"
FINE = "tab\there, lines\nand\rmore, \x7f\x85\u2028\ufffd\U0001f34c & <b>"
FORBIDDEN = re.compile("[\x00-\x08\x0b\x0c\x0e-\x1f\ufffe\uffff]")
PATIENT = Settings(port=0, limits=Limits(query_seconds=PATIENCE))


@pytest.mark.parametrize("character", BAD)
def test_each_is_found_replaced_and_named(character: str) -> None:
    text = f"tea {character} cup"
    assert unwritable(text) == f"U+{ord(character):04X}"
    assert shown(text) == "tea \ufffd cup"
    assert in_xml(text.encode()) == "tea \ufffd cup".encode()
    assert unwritable(FINE) is None and shown(FINE) == FINE


def test_a_half_of_a_pair_is_none_either() -> None:
    assert unwritable("\ud800") == "U+D800"
    with pytest.raises(ValueError, match="str"):
        Literal("\ud800")  # so no map can hold one


@given(st.text(st.sampled_from(FINE + BAD + "\uffef\uffc0")), st.lists(st.integers(0, 60)))
def test_a_document_in_pieces_is_the_same_wherever_it_is_cut(text: str, cuts: list[int]) -> None:
    body, pieces = text.encode(), XmlPieces()
    at = [0, *sorted(min(cut, len(body)) for cut in cuts), len(body)]
    told = [pieces.take(body[start:end]) for start, end in pairwise(at)]
    assert b"".join([*told, pieces.rest()]) == in_xml(body)


@pytest.mark.parametrize("character", BAD)
def test_nothing_that_writes_lets_one_in(flat: SemanticMap, character: str) -> None:
    label = f"tea{character}cup"
    escaped = "".join(f"\\U{ord(c):08X}" for c in label)
    place = PlaceRecord(f"{BASE}place/2", label, 0, 1, 0, 1)
    before = flat.sequence, set(flat.engine)
    for write in (
        lambda: flat.update(f"INSERT DATA {{ <object/1> rdfs:comment '{escaped}' }}"),
        lambda: flat.assertions.add("object/1", "label", label, by="ann"),
        lambda: flat.assertions.add("object/1", "category", "bowl", by=label),
        lambda: flat.apply(MapUpdate(places=(place,))),
    ):
        with pytest.raises(InvalidFactError, match=re.escape(f"U+{ord(character):04X}")) as refused:
            write()
        assert "\n" not in str(refused.value)
    assert (flat.sequence, set(flat.engine)) == before
    flat.update(f"INSERT DATA {{ <object/1> rdfs:comment '''{FINE}''' }}")
    with in_memory_map(title=label) as titled:
        assert titled.description.title == "tea\ufffdcup"
    learnt = flat.ontology.learn([label], "object", model="net")
    assert unwritable(flat.catalogue.label(learnt[label])) is None


def spoil(semantic_map: SemanticMap) -> None:
    """Have a map hold what an older version let in."""
    graph = v.MAP_GRAPH
    for thing in ("object/1", "place/1"):
        node = NamedNode(f"{semantic_map.base}{thing}")
        old = semantic_map.store.native.quads_for_pattern(node, NamedNode(v.RDFS_LABEL), None)
        for quad in list(old):
            semantic_map.store.native.remove(quad)
        semantic_map.store.native.extend(
            [
                Quad(node, NamedNode(v.RDFS_LABEL), Literal(TEXT), graph),
                Quad(node, NamedNode(v.RDFS_COMMENT), Literal(FINE), graph),
            ]
        )


@pytest.fixture(scope="module")
def old() -> Iterator[Served]:
    with furnished() as semantic_map:
        spoil(semantic_map)
        with MapServer(semantic_map, PATIENT) as server:
            yield Served(semantic_map, server)


def texts(body: bytes) -> set[str]:
    """All that stands between tags, as a real parser reads it."""
    return {element.text or "" for element in ET.fromstring(body).iter()}


def got(url: str, path: str, accept: str, **params: object) -> bytes:
    answer = requests.get(
        url + path,
        params=params,  # type: ignore[arg-type]
        headers={"Accept": accept},
        timeout=PATIENCE,
    )
    assert answer.status_code == 200, answer.text
    assert answer.headers["Content-Type"].partition(";")[0] == accept
    return answer.content


LABELS = "SELECT ?l ?c { ?o rdfs:label ?l ; rdfs:comment ?c }"
SAID = "{ ?o rdfs:label ?l ; rdfs:comment ?c }"
TRIPLES = f"CONSTRUCT {SAID} WHERE {SAID}"
XML = [
    ("sparql", "application/sparql-results+xml", {"query": LABELS}),
    ("sparql", "application/xml", {"query": LABELS}),
    ("sparql", "text/xml", {"query": LABELS}),
    ("sparql", "application/rdf+xml", {"query": TRIPLES}),
    ("sparql", "application/xml", {"query": TRIPLES}),
    ("resource", "application/rdf+xml", {"iri": f"{BASE}object/1"}),
]


@pytest.mark.parametrize(
    ("path", "accept", "params"), [*XML, ("graphs/map", "application/rdf+xml", {})]
)
def test_what_is_served_as_xml_is_xml(old, path, accept, params):
    found = texts(got(old.url, path, accept, **params))
    assert INSTEAD in found
    assert FINE in found, "all that XML can hold arrives as it was"


def test_a_long_answer_is_xml_to_its_end(old: Served) -> None:
    query = "SELECT ?l { ?o here:x ?x ; rdfs:label ?l ; rdfs:comment ?m . ?a ?b ?c } LIMIT 3000"
    rows = ET.fromstring(got(old.url, "sparql", "application/sparql-results+xml", query=query))
    assert len(list(rows.iter("{http://www.w3.org/2005/sparql-results#}result"))) == 3000


def test_exports_are_read_by_others(old: Served, tmp_path: Path) -> None:
    export_map(old.map, tmp_path / "old.rdf")
    assert FINE in texts((tmp_path / "old.rdf").read_bytes())
    thing = rdflib.URIRef(f"{BASE}object/1")
    for form, name in (("ttl", "turtle"), ("nt", "nt")):
        graph = rdflib.Graph().parse(data=export_text(old.map, form, ontology=False), format=name)
        assert str(graph.value(thing, rdflib.RDFS.comment)) == FINE, form
        assert str(graph.value(thing, rdflib.RDFS.label)) == TEXT, form
    nx.write_graphml(old.map.network(), tmp_path / "old.graphml")
    assert INSTEAD in texts((tmp_path / "old.graphml").read_bytes())


@pytest.mark.parametrize("page", ["", "object/1", "place/1"])
def test_pages_hold_none(old: Served, page: str) -> None:
    told = got(old.url, page, "text/html").decode()
    assert FORBIDDEN.search(told) is None
    assert ("\ufffd" in told) == bool(page)  # the live map's page is filled by its script

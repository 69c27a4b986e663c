"""A well-made map and ontology pass; each kind of bad fact is found and named."""

import re
import shutil
from collections.abc import Callable
from pathlib import Path

import pyoxigraph
import pytest
from pyoxigraph import Literal, NamedNode, Quad, RdfFormat

from kg.knowledge.ontology.catalogue import Catalogue
from kg.knowledge.ontology.lint import check_map, check_ontologies, check_quads
from kg.knowledge.ontology.loading import compile_commonsense, load_ontologies
from kg.model import vocabulary as v
from kg.model.errors import OntologyError
from kg.model.resources import ONTOLOGIES
from tests.shipped_ontology import QUADS as ONTOLOGY

BASE = "https://example.org/map/"
RELATION = "object/1/relation/inside/2"
PREFIXES = "".join(f"@prefix {name}: <{iri}> .\n" for name, iri in v.PREFIXES.items())
SOUND = (
    PREFIXES
    + f"@base <{BASE}> .\n"
    + """
graph:map {
<object/1> a here:Cup ; rdfs:label "cup 1" ;
    here:x 1.23e0 ; here:y -0.4e0 ; here:z 0.81e0 ;
    here:inCell <https://w3id.org/hereabouts/cell/0_-1> ; here:inPlace <place/1> ;
    here:confidence 2.4e0 ; here:existence 0.8e0 ; here:observationCount 14 ;
    here:firstSeen "2024-05-01T10:00:00Z"^^xsd:dateTime ;
    here:lastSeen "2024-05-01T10:00:09Z"^^xsd:dateTime ;
    here:explainedBy <observation/1> .
<observation/1> a sosa:Observation ; sosa:hasFeatureOfInterest <object/1> ;
    sosa:resultTime "2024-05-01T10:00:03Z"^^xsd:dateTime ; here:frame "frame-000056" ;
    here:fromRecording <recording/kitchen> ; here:box "213 303.5 263 355" ;
    here:score 0.83e0 ; here:model "some detector" .
<place/1> a here:Place , bot:Space , here:Kitchen ; rdfs:label "place 1" ;
    here:xMin -2e0 ; here:xMax 3e0 ; here:yMin -2e0 ; here:yMax 2e0 ; here:x 0.5e0 ; here:y 0e0 ;
    here:viewCount 27 ; here:hasBelief <place/1/belief/Kitchen> .
<place/1/belief/Kitchen> a here:PlaceBelief ; here:ofCategory here:Kitchen ; here:belief 0.81e0 .
<object/2> a here:Bowl ; rdfs:label "bowl 2" ; here:x 1.2e0 ; here:y -0.4e0 ; here:z 0.8e0 ;
    here:inCell <https://w3id.org/hereabouts/cell/0_-1> ; here:confidence 1e0 ;
    here:existence 0.8e0 ; here:observationCount 4 ;
    here:firstSeen "2024-05-01T10:00:00Z"^^xsd:dateTime ;
    here:lastSeen "2024-05-01T10:00:09Z"^^xsd:dateTime .
<object/1> here:inside <object/2> ; here:hasRelation <object/1/relation/inside/2> .
<object/1/relation/inside/2> a here:SpatialRelation ; here:ofRelation here:inside ;
    here:relatedTo <object/2> ; here:relationProbability 0.9e0 .
<robot> a here:Robot ; here:x 0e0 ; here:y 0e0 ; here:z 1.2e0 ; here:heading -1.5e0 ;
    here:lastSeen "2024-05-01T10:00:09Z"^^xsd:dateTime .
}
graph:dataset {
<> a here:SemanticMap , void:Dataset ; dct:title "kitchen" ; here:nextObject 2 ;
    dct:created "2024-05-01T10:00:00Z"^^xsd:dateTime .
<recording/kitchen> a here:Recording ; rdfs:label "kitchen" ; here:framesApplied 57 ;
    here:lastFrame "frame-000056" ; here:transform "1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1" .
}
"""
)


def map_of(trig: str) -> list[Quad]:
    facts = pyoxigraph.parse(trig, format=RdfFormat.TRIG)
    return [*facts, *ONTOLOGY, *compile_commonsense(ONTOLOGY)]


def test_a_sound_map_has_no_findings() -> None:
    assert check_map(map_of(SOUND)) == []


BAD = [
    ("here:x 1.23e0", 'here:x "NaN"^^xsd:double', "object/1", "one here:x is needed, a finite"),
    ("here:x 1.23e0", "here:x 1.23e0 , 1.5e0", "object/1", "exactly one here:x is needed"),
    ("here:z 0.81e0", "here:z 1", "object/1", "here:z is needed, a finite double"),
    ("a here:Cup", "a <urn:mine:Grail>", "object/1", "needs a class that is a here:Object"),
    ("here:inPlace <place/1>", "here:inPlace <place/2>", "object/1", "one place of the map"),
    ("here:confidence 2.4e0", "here:confidence 0e0", "object/1", "a double above 0"),
    ("here:existence 0.8e0", "here:existence 1.2e0", "object/1", "between 0 and 1"),
    ("here:observationCount 14", "here:observationCount 0", "object/1", "of 1 to"),
    ("10:00:00Z", "10:00:30Z", "object/1", "here:firstSeen must not be after here:lastSeen"),
    ("Interest <object/1>", "Interest <object/9>", "observation/1", "object of the map"),
    ("here:score 0.83e0", "here:score 83e0", "observation/1", "exactly one here:score"),
    ("303.5 263 355", "263 355", "observation/1", "four numbers in a string"),
    ("here:xMin -2e0", "here:xMin 8e0", "place/1", "here:xMin must be less than here:xMax"),
    ("here:viewCount 27", "here:viewCount -1", "place/1", "an integer of at least 0"),
    ("here:belief 0.81e0", "here:belief 1.2e0", "place/1/belief/Kitchen", "between 0 and 1"),
    ("Category here:Kitchen", "Category here:Cup", "place/1/belief/Kitchen", "a place categ"),
    ("here:heading -1.5e0 ;", "", "robot", "exactly one here:heading is needed"),
    ('"1 0 0 0 0', '"0 0 0 0', "recording/kitchen", "sixteen numbers in a string"),
    ("here:inside <object/2>", "here:inside <place/1>", "object/1", "one object of the map"),
    ("here:inside <object/2>", "here:on <object/2> , <object/1>", "object/1", "at most one"),
    (
        "here:ofRelation here:inside",
        "here:ofRelation here:nearBy",
        RELATION,
        "exactly one here:ofR",
    ),
    ("relatedTo <object/2>", "relatedTo <object/7>", RELATION, "an object of the map"),
    ("0.9e0 .", "9e0 .", RELATION, "between 0 and 1"),
]


def test_each_bad_fact_is_found_where_it_is() -> None:
    """Each of many sound maps has one bad fact; they are checked together."""
    facts = []
    for number, (good, bad, *_) in enumerate(BAD):
        assert good in SOUND
        trig = SOUND.replace(good, bad, 1).replace(f"@base <{BASE}>", f"@base <{BASE}{number}/>")
        facts += pyoxigraph.parse(trig, format=RdfFormat.TRIG)
    findings = check_map([*facts, *ONTOLOGY, *compile_commonsense(ONTOLOGY)])
    for number, (_, bad, focus, message) in enumerate(BAD):
        of_map = [f for f in findings if f.focus.startswith(f"{BASE}{number}/")]
        wanted = f"{BASE}{number}/{focus}"
        assert [f for f in of_map if f.focus == wanted and message in f.message], (bad, of_map)
        assert {f.severity for f in of_map} == {"violation"}


def test_a_finding_shows_what_was_found() -> None:
    findings = check_map(map_of(SOUND.replace("here:belief 0.81e0", "here:belief 1.2e0")))
    assert [str(finding) for finding in findings] == [
        f"violation: {BASE}place/1/belief/Kitchen: a place belief needs exactly one here:belief,"
        " a double between 0 and 1 (found 1.2e0)"
    ]


@pytest.mark.parametrize(
    "graph", [v.MAP_GRAPH.value, v.HISTORY_GRAPH.value, v.ASSERTIONS_GRAPH.value]
)
def test_a_term_no_ontology_declares_is_found_in_any_graph(graph: str) -> None:
    cup, colour = NamedNode(BASE + "object/1"), v.HERE + "colour"
    fact = Quad(cup, NamedNode(colour), Literal("blue"), NamedNode(graph))
    (finding,) = check_map([*map_of(SOUND), fact])
    assert (finding.focus, finding.value) == (cup.value, colour)
    assert finding.message.startswith("the ontology declares no such term")


def test_a_category_people_added_to_the_maps_ontology_is_accepted() -> None:
    mine = f"""{PREFIXES} graph:ontology {{ here:Grail a owl:Class ; rdfs:subClassOf here:Cup . }}
        graph:commonsense {{ here:Grail here:isA here:Grail , here:Cup , here:Object . }}"""
    added = list(pyoxigraph.parse(mine, format=RdfFormat.TRIG))
    facts = map_of(SOUND.replace("a here:Cup", "a here:Grail"))
    assert check_map([*facts, *added]) == []


def test_an_ontology_changed_and_not_compiled_is_found() -> None:
    mine = f"{PREFIXES} graph:ontology {{ here:Cup here:locatedAt here:Attic . }}"
    added = list(pyoxigraph.parse(mine, format=RdfFormat.TRIG))
    (finding,) = check_map([*map_of(SOUND), *added])
    assert finding.focus == v.COMMONSENSE_GRAPH.value
    assert finding.message.startswith("lacks 4 facts")


def test_a_map_without_an_ontology_is_found() -> None:
    (finding,) = check_map(pyoxigraph.parse(SOUND, format=RdfFormat.TRIG))
    assert finding.focus == v.ONTOLOGY_GRAPH.value
    assert "no ontology" in finding.message


def test_the_shipped_ontologies_have_no_findings() -> None:
    assert check_ontologies() == []


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A copy of the shipped ontologies, to spoil."""
    return Path(shutil.copytree(ONTOLOGIES, tmp_path / "ontologies"))


MUG = "here:{0} a owl:Class ; rdfs:subClassOf here:Cup ; "
FLAWS = [
    (MUG.format("Mug1") + 'rdfs:comment "."', "Mug1", "needs an rdfs:label", "violation"),
    (MUG.format("Mug2") + 'rdfs:label "mug"', "Mug2", "should have an rdfs:comment", "warning"),
    (MUG.format("Mug3") + 'rdfs:label "cup"', "Mug3", "has the label of here:Cup", "warning"),
    ("here:Cup here:locatedAt here:Bowl", "Cup", "point at a place category", "violation"),
    ("here:Cup here:nearBy here:Kitchen", "Cup", "point at an object category", "violation"),
    ("here:Mgu here:locatedAt here:Kitchen", "Mgu", "must be a declared class", "violation"),
    ("here:Cup here:locatedAt here:Kichen", "Cup", "declares no such term", "violation"),
    ("here:nearBy a owl:ObjectProperty", "nearBy", "annotation and object", "violation"),
    ("here:nearBy here:probability 0.3", "nearBy", "number between 0 and 1", "violation"),
    ("here:Bowl rdfs:subClassOf here:Office", "Bowl", "kind of here:Object and", "violation"),
    ('here:Cup skos:note "x"', "", "used that no ontology declares", "violation"),
]


@pytest.mark.parametrize("flaws", [FLAWS[:7], FLAWS[7:]], ids=["of terms", "of properties"])
def test_each_flaw_of_an_ontology_is_found(folder, flaws):
    turtle = "".join(f"{turtle} .\n" for turtle, *_ in flaws)
    (folder / "mine.ttl").write_text(f"{PREFIXES}\n{turtle}")
    findings = check_ontologies(folder)
    for _, focus, message, severity in flaws:
        iri = v.HERE + focus if focus else v.PREFIXES["skos"] + "note"
        assert [
            f for f in findings if (f.focus, f.severity) == (iri, severity) and message in f.message
        ], message


def test_a_relation_without_a_source_is_a_warning_and_a_bad_probability_is_not(folder):
    (folder / "mine.ttl").write_text(
        PREFIXES
        + """here:Cup here:locatedAt here:Attic .
        [] a owl:Axiom ; owl:annotatedSource here:Cup ; owl:annotatedProperty here:locatedAt ;
            owl:annotatedTarget here:Attic ; here:probability "NaN"^^xsd:double ."""
    )
    findings = {f.message: f.severity for f in check_ontologies(folder)}
    assert findings["a probability should say where it comes from (dct:source)"] == "warning"
    assert findings["here:probability must be one number between 0 and 1"] == "violation"
    assert any(message.startswith("here:Cup here:locatedAt here:Attic") for message in findings)


def test_an_ontology_without_a_proper_header_is_found(folder: Path) -> None:
    (folder / "mine.ttl").write_text(f"{PREFIXES} <urn:mine> a owl:Ontology .")
    messages = {(f.message, f.severity) for f in check_ontologies(folder) if f.focus == "urn:mine"}
    assert messages == {
        (f"an ontology should have {what}", "warning")
        for what in ("an rdfs:label", "an rdfs:comment", "an owl:versionInfo", "a dct:license")
    }


def test_a_restriction_drawn_in_an_editor_needs_no_label(folder: Path) -> None:
    (folder / "mine.ttl").write_text(
        PREFIXES + "here:Cup rdfs:subClassOf [ a owl:Class ; owl:unionOf ( here:Bowl here:Cup ) ] ."
    )
    assert check_ontologies(folder) == []


def test_what_the_documentation_shows_passes_and_is_found(folder: Path) -> None:
    page = ONTOLOGIES.parent / "docs" / "explanation" / "ontology.md"
    relation, tea_bowl = re.findall(r"```turtle\n(.*?)```", page.read_text(), re.DOTALL)
    (folder / "mine.ttl").write_text(tea_bowl)
    assert check_ontologies(folder) == []
    assert Catalogue.from_quads(load_ontologies(folder).quads).find("teeschale").kind == "object"
    shown = compile_commonsense(pyoxigraph.parse(PREFIXES + relation, format=RdfFormat.TURTLE))
    assert len(shown) == 5
    assert set(shown) <= set(compile_commonsense(ONTOLOGY))


def test_shapes_that_do_not_parse_are_named(folder: Path) -> None:
    (folder / "shapes.ttl").write_text("these are no shapes")
    with pytest.raises(OntologyError, match=r"shapes\.ttl"):
        check_ontologies(folder)


def classes(count: int, below: Callable[[int], list[int]]) -> list[Quad]:
    """`count` classes, class i below those of `below(i)`."""
    lines = [PREFIXES]
    for i in range(count):
        above = "".join(f" ; rdfs:subClassOf here:C{k}" for k in below(i))
        lines.append(f"here:C{i} a owl:Class ; rdfs:label 'c {i}' ; rdfs:comment '-'{above} .")
    facts = pyoxigraph.parse("\n".join(lines), format=RdfFormat.TURTLE)
    return [*ONTOLOGY, *(Quad(q.subject, q.predicate, q.object, v.ONTOLOGY_GRAPH) for q in facts)]


@pytest.mark.parametrize(
    ("count", "below", "message"),
    [
        (3, lambda i: [(i + 1) % 3], "superclasses of one another: .*C0.* under .*C1"),
        (500, lambda i: [(i + 1) % 500], "superclasses of one another"),
        (101, lambda i: [i - 1] if i else [], "at most 100 levels"),
        (
            1500,
            lambda i: [i // 30 * 30 - k for k in range(1, 31)] if i >= 30 else [],
            "100,000 pairs",
        ),
        (10_001, lambda _: [], "at most 10,000 would work"),
    ],
)
def test_a_hierarchy_that_would_fill_the_map_is_refused(count, below, message):
    quads = classes(count, below)
    (finding,) = check_quads(quads)
    assert re.search(message, finding.message)
    with pytest.raises(OntologyError, match=message):
        compile_commonsense(quads)


def test_a_term_with_hundreds_of_labels_is_refused() -> None:
    label = NamedNode(v.RDFS_LABEL)
    more = [Quad(NamedNode(v.OBJECT), label, Literal(str(n)), v.ONTOLOGY_GRAPH) for n in range(300)]
    (finding,) = check_quads([*ONTOLOGY, *more])
    assert finding.message == f"<{v.OBJECT}> has more than 200 labels"


def test_a_hierarchy_of_as_many_levels_as_may_be_is_sound() -> None:
    quads = classes(100, lambda i: [i - 1] if i else [])
    assert [f for f in check_quads(quads) if f.severity != "warning"] == []

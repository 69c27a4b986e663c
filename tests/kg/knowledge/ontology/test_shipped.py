"""The shipped ontologies, their terms and their page."""

import re
import shutil
from collections import Counter, defaultdict
from collections.abc import Iterator
from pathlib import Path

import pytest
from pyoxigraph import NamedNode, RdfFormat, Store, parse

from hereabouts.cli import main
from kg.knowledge.ontology import catalogue
from kg.knowledge.ontology.catalogue import Catalogue, StoredCatalogue, shipped_ontology
from kg.knowledge.ontology.declared_terms import absent_terms
from kg.knowledge.ontology.lint import check_map
from kg.knowledge.ontology.loading import superclasses
from kg.knowledge.placement.surveys import RoomType, similarity
from kg.knowledge.words.tables import word_table
from kg.maps.semantic_map import SemanticMap
from kg.model import vocabulary as v
from kg.model.resources import ONTOLOGIES
from kg.serving.opening import in_memory_map
from tests.shipped_ontology import CATALOGUE, QUADS


@pytest.fixture
def edited(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of the shipped ontologies, in their place."""
    folder = tmp_path / "ontologies"
    shutil.copytree(ONTOLOGIES, folder)
    monkeypatch.setattr(catalogue, "ONTOLOGIES", folder)
    return folder


def test_a_new_map_holds_the_compiled_ontology_and_knows_its_categories() -> None:
    for _ in range(2):  # compiled, and from the cache
        with in_memory_map() as home:
            assert home.catalogue == Catalogue.from_store(home.engine)
            assert check_map(home.store.native) == []


def test_an_edit_of_the_files_is_seen_by_the_next_map(edited: Path) -> None:
    assert shipped_ontology() is shipped_ontology()
    assert shipped_ontology().catalogue.get("teasmade") is None
    objects = edited / "objects.ttl"
    more = "here:Teasmade a owl:Class ; rdfs:subClassOf here:Object ; rdfs:label 'teasmade' ."
    objects.write_text(f"{objects.read_text()}\n{more}\n")
    assert shipped_ontology().catalogue.find("teasmade").iri == v.HERE + "Teasmade"


def test_categories_read_while_the_ontology_changes_are_read_again() -> None:
    old, new = Store(), Store()
    with in_memory_map() as home:
        new.bulk_extend(home.engine)
    engines = iter([old, new])

    def changes_meanwhile() -> Store:
        engine = next(engines)
        if engine is old:
            catalogue.forget()
        return engine

    catalogue = StoredCatalogue(changes_meanwhile)
    assert catalogue().categories == ()
    assert catalogue().find("cup").kind == "object"
    assert catalogue() is catalogue()


@pytest.fixture(scope="module")
def empty() -> Iterator[SemanticMap]:
    with in_memory_map() as made:
        yield made


@pytest.mark.parametrize(
    ("query", "lines"),
    [
        ("SELECT ?x { ?x a here:Cup ; rdfs:label ?e }", ()),
        (
            "SELECT ?x { ?x a here:Cup ; here:existence ?e }",
            ("no statement of the map has the property here:existence",),
        ),
        ("SELECT ?x { ?x geo:hasGeometry ?g }", ("has geo:hasGeometry, though exports may",)),
        ("ASK { GRAPH graph:mpa { ?x a here:Cup } }", ("no graph graph:mpa; it has graph:",)),
        ("ASK { GRAPH graph:ontology { ?x a owl:Class } }", ()),
        ("PREFIX h: <https://w3id.org/hereabouts#> ASK { ?x a h:Cpu }", ("mean here:Cup",)),
        ("ASK { ?x a <http://w3id.org/hereabouts#Cup> }", ("mean here:Cup",)),
        ("ASK { ?x rdfs:lable ?y }", ("mean rdfs:label",)),
        ("ASK { ?x rdfs:label ?y FILTER(geof:sfWithin(?y, '1'^^xsd:decimal)) }", ()),
        ("PREFIX e: <urn:e:> ASK { ?x e:foo 1 }", ("no statement of the map has <urn:e:foo>",)),
        (
            "SELECT ?x { ?x a here:Cupp }",
            ("no ontology declares here:Cupp; did you mean here:Cup",),
        ),
        ("ASK { ?x <https://w3id.org/hereabouts#existance> 1 }", ("here:existance; did you mean",)),
        ("ASK { ?x here:qqqq here:qqqq }", ("no ontology declares here:qqqq",)),
        ("ASK { ?x rdfs:label 'here:Cupp' # here:Cupp\n }", ()),
    ],
)
def test_what_no_ontology_declares_is_named(empty, query, lines):
    found = absent_terms(query, empty.engine)
    assert len(found) == len(lines)
    for line, start in zip(found, lines, strict=True):
        assert start in line


def test_ask_warns_and_takes_variables_as_parameters(tmp_path, capsys):
    from kg.serving.opening import create_map
    from tests.planner.flat import fill

    with create_map(tmp_path / "flat.map") as semantic_map:
        fill(semantic_map)
    path = str(tmp_path / "flat.map")
    assert main(["ask", path, "-e", "SELECT ?x { ?x a here:Cupp }"]) == 0
    assert "did you mean here:Cup" in capsys.readouterr().err
    query = "SELECT ?x ?c { ?x a ?c ; here:existence ?e }"
    assert main(["ask", path, "-e", query, "-p", "c=here:Cup"]) == 0
    out, err = capsys.readouterr()
    assert "1 row" in err
    assert "here:Cup" in out
    assert main(["ask", path, "-e", query, "-p", "kind=here:Cup"]) == 1
    assert "neither $kind nor ?kind is used" in capsys.readouterr().err
    assert main(["find", "banana", path]) == main(["find", path, "banana"])  # in any order


ABOVE = superclasses(QUADS)
SKOS = v.PREFIXES["skos"]
WORDNET = "http://purl.org/vocabularies/princeton/wn30/synset-{}-noun-{}"


#: (subject, predicate, object) as texts
STATED = [
    (getattr(q.subject, "value", ""), q.predicate.value, getattr(q.object, "value", ""))
    for q in QUADS
]


def objects(subject: str, predicate: str) -> list[str]:
    return [o for s, p, o in STATED if (s, p) == (subject, predicate)]


def test_each_category_has_a_definition_of_its_own() -> None:
    of = {subject: text for subject, p, text in STATED if p == v.RDFS_COMMENT}
    definitions = Counter(of[c.iri] for c in CATALOGUE.categories)
    assert max(definitions.values()) == 1
    for category in CATALOGUE.categories:
        text = of[category.iri]
        assert 3 <= len(text.split()) <= 25, text
        assert text.endswith("."), text
        assert not re.search("networks|detectors", text), text


def test_each_term_says_which_ontology_defines_it() -> None:
    ours = {s for s, p, _ in STATED if p == v.RDF_TYPE.value and s.startswith(v.HERE)}
    headers = {s for s, _, o in STATED if o == v.OWL_ONTOLOGY}
    for term in ours:
        (ontology,) = objects(term, v.RDFS_DEFINED_BY)
        assert ontology in headers, term


def test_each_place_is_indoors_or_outdoors_and_no_wider_kind_is_a_category() -> None:
    indoors, outdoors = v.HERE + "IndoorPlace", v.HERE + "OutdoorPlace"
    places = [c for c in CATALOGUE.categories if c.kind == "place"]
    assert len(places) == 205
    for place in places:
        assert (indoors in ABOVE[place.iri]) is not (outdoors in ABOVE[place.iri]), place.label
    kinds = {up for place in places for up in ABOVE[place.iri]} - {v.PLACE, v.BOT_SPACE}
    wider = kinds - {place.iri for place in places}
    assert len(wider) == 15
    assert all(CATALOGUE.by_iri(kind) is None for kind in wider)
    home = {place.label for place in places if v.HERE + "HomePlace" in ABOVE[place.iri]}
    assert {"kitchen", "bedroom", "shower", "corridor", "yard"} <= home
    assert not {"office", "restaurant", "hotel room"} & home


def test_wider_kinds_do_not_make_places_alike() -> None:
    kitchen, bedroom = (CATALOGUE.find(name, "place") for name in ("kitchen", "bedroom"))
    others = [RoomType(one.iri, one.label) for one in (kitchen, bedroom)]
    found = similarity([kitchen.iri, bedroom.iri], others, CATALOGUE, ABOVE)
    assert found.tolist() == [[1, 0], [0, 1]]


def test_a_concept_is_the_exact_match_of_one_category() -> None:
    exact = Counter(o for _, p, o in STATED if p == SKOS + "exactMatch")
    assert max(exact.values()) == 1
    for iri in exact:
        assert re.fullmatch(
            r"http://purl\.org/vocabularies/princeton/wn30/synset-[\w'-]+-noun-[1-9]\d*"
            r"|http://www\.wikidata\.org/entity/Q[1-9]\d*"
            r"|http://www\.ease-crc\.org/ont/SOMA\.owl#[A-Z][A-Za-z]+",
            iri,
        ), iri


def test_links_to_wordnet_agree_with_the_words_that_mean_a_category() -> None:
    synsets: dict[str, set[str]] = defaultdict(set)
    for sense in word_table().senses.values():
        if sense.relation == "same":
            word, _, number = sense.synset.rsplit(".", 2)
            synsets[sense.categories[0]].add(WORDNET.format(word, int(number)))
    linked = {
        c.label: {
            iri for name in ("exactMatch", "closeMatch") for iri in objects(c.iri, SKOS + name)
        }
        for c in CATALOGUE.categories
        if c.kind == "object"
    }
    apart = {label for label in synsets if not synsets[label] & linked[label]}
    # a category is the bound book and not its text, and any sink and not only a washbasin
    assert apart == {"book", "sink"}


THING = """
<urn:1> a here:UnnamedThing ; here:inPlace <urn:2> ; here:existence 0.9e0 ; here:beside <urn:3> ;
    here:hasRelation <urn:4> ; here:inCell <urn:5> ; here:explainedBy <urn:6> .
<urn:3> a here:Cup ; here:beside <urn:1> .
<urn:4> a here:SpatialRelation ; here:relatedTo <urn:3> .
<urn:7> a here:Look ; here:found <urn:8> . <urn:8> a here:DepartedObject ; here:x 1e0 .
"""


@pytest.mark.parametrize("thing", ["urn:1", "urn:8"])
def test_a_reasoner_takes_no_unnamed_or_departed_thing_for_an_object(thing: str) -> None:
    prefix = f"@prefix here: <{v.HERE}> ."
    facts = [*parse(prefix + THING, format=RdfFormat.TURTLE)]
    properties = {q.predicate.value for q in facts if q.subject == NamedNode(thing)}
    values = {q.predicate.value for q in facts if q.object == NamedNode(thing)}
    inferred = [objects(name, v.RDFS_DOMAIN) for name in properties]
    inferred += [objects(name, v.RDFS_RANGE) for name in values]
    assert v.OBJECT not in {iri for found in inferred for iri in found}

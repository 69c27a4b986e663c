"""What an ontology says is used by maps, or a warning says that it is not."""

from pathlib import Path

import pytest

from kg.knowledge.ontology.catalogue import Catalogue
from kg.knowledge.ontology.diagnostics import finding_line, inspect
from kg.knowledge.ontology.diff import changes
from kg.knowledge.ontology.import_closure import load_with_imports
from kg.knowledge.ontology.loading import load_ontologies, superclasses
from kg.knowledge.ontology.relations import relations
from kg.knowledge.ontology.unused import MAX_ALIKE
from kg.model import vocabulary as v
from kg.model.errors import OntologyError
from kg.serving.opening import in_memory_map

PREFIXES = "".join(f"@prefix {name}: <{iri}> .\n" for name, iri in v.PREFIXES.items())
HEADER = """@prefix ex: <https://example.org/home#> .
<urn:home> a owl:Ontology ; rdfs:label "home" ; rdfs:comment "Ours." ; owl:versionInfo "1" ;
    dct:license <urn:free> ; owl:imports <https://w3id.org/hereabouts/ontology/commonsense> .
"""
KUMQUAT = """ex:Kumquat a owl:Class ; rdfs:subClassOf here:Food , here:Object ;
    rdfs:label "kumquat" ; rdfs:comment "A fruit." .
"""
AXIOM = """[] a owl:Axiom ; owl:annotatedSource ex:Kumquat ; owl:annotatedProperty {} ;
    owl:annotatedTarget here:Kitchen ; here:probability 0.7 ; dct:source "us" .
"""
NAMED = 'ex:Kumquat a owl:Class ; rdfs:subClassOf here:Food ; rdfs:comment "A fruit." ; '
EX = "https://example.org/home#"


def written(folder: Path, turtle: str) -> Path:
    path = folder / "home.ttl"
    path.write_text(PREFIXES + HEADER + turtle)
    return path


def told(folder: Path, turtle: str) -> list[str]:
    """The findings as lines, with their severity."""
    ontology = load_with_imports(written(folder, turtle))
    return [f"{f.severity}: {finding_line(f, ontology.files)}" for f in inspect(ontology)]


def test_what_stands_in_another_form_is_used(tmp_path: Path) -> None:
    """A class under a supercategory alone is an object; an axiom alone states its relation."""
    fruit = """ex:Fruit a owl:Class ; rdfs:subClassOf here:Food ; rdfs:label "fruit" ;
        rdfs:comment "Fruit." .\n"""
    turtle = fruit + KUMQUAT.replace("here:Food , here:Object", "ex:Fruit")
    turtle += AXIOM.format("here:locatedAt")
    quads = load_with_imports(written(tmp_path, turtle)).quads
    assert {v.OBJECT, v.HERE + "Food"} <= {*superclasses(quads)[EX + "Kumquat"]}
    assert Catalogue.from_quads(quads).find("kumquat", "object").iri == EX + "Kumquat"
    (found,) = (one for one in relations(quads) if one.subject == EX + "Kumquat")
    assert (found.target, found.probability) == (v.HERE + "Kitchen", 0.7)
    assert told(tmp_path, turtle) == []


def test_names_lose_line_ends_at_every_way_into_a_map(tmp_path: Path) -> None:
    turtle = NAMED + 'rdfs:label " Kum\\n quat \\n" ; owl:deprecated true .'
    name, _ = told(tmp_path, turtle)
    assert "it is read as 'Kum quat'" in name
    with in_memory_map() as semantic_map:
        done = semantic_map.ontology.replace(load_with_imports(tmp_path / "home.ttl").quads)
        assert [warning.focus for warning in done.warnings] == [EX + "Kumquat"]  # to its writer
        assert semantic_map.catalogue.find("kum quat").label == "Kum quat"
        assert done.changes[0].words == "category 'Kum quat' added under food and object"


WARNED = (
    ("ex:Kumquat owl:equivalentClass here:Orange .", "owl:equivalentClass is not used"),
    ("ex:Kumquat owl:sameAs here:Orange .", "owl:sameAs is not used"),
    ("ex:Kumquat owl:deprecated true .", "owl:deprecated is not used"),
    (
        "ex:Kumquat owl:deprecated true ; <http://purl.obolibrary.org/obo/IAO_0100001> "
        "here:Orange .",
        "owl:deprecated is not used",
    ),
    ("ex:Kumquat a owl:NamedIndividual , here:Food .", "is an individual of here:Food"),
    ("ex:Kumquat rdfs:lable 'x' .", "rdfs:lable is not used; did you mean rdfs:label?"),
    ("ex:Kumquat here:carries 'on' .", "here:carries is used with here:on and here:inside"),
    ("ex:Kumquat here:backHeight 'tall' .", "here:backHeight is used with a number"),
    ("ex:Kumquat skos:altLabel 'orange' .", "'orange', which means here:Orange"),
    ("ex:Kumquat rdfs:label 'dwarf citrus' .", "has 2 labels without a language"),
    (
        "ex:Kumquat rdfs:subClassOf [ a owl:Class ; owl:unionOf ( here:Apple here:Orange ) ] .",
        "no superclass that has no name is used",
    ),
    (
        "[] a owl:Class ; owl:intersectionOf ( here:Food here:Apple ) ; "
        "rdfs:subClassOf ex:Kumquat .",
        "an axiom about a class without a name is not used",
    ),
    (
        "ex:in a owl:AnnotationProperty ; rdfs:subPropertyOf here:locatedAt ; "
        "rdfs:label 'in' ; rdfs:comment 'In.' .",
        "rdfs:subPropertyOf is not used; state here:locatedAt",
    ),
    (
        "ex:in a owl:ObjectProperty ; owl:inverseOf here:inPlace ; rdfs:label 'in' ; "
        "rdfs:comment 'In.' .",
        "owl:inverseOf is not used",
    ),
    (
        "ex:Room a owl:Class ; rdfs:label 'rumpus' ; rdfs:comment 'A room.' .",
        "is under neither here:Object nor here:Place",
    ),
)
REFUSED = (
    (
        "ex:Kumquat rdfs:subClassOf [ a owl:Restriction ; owl:onProperty here:locatedAt ; "
        "owl:someValuesFrom here:Kitchen ] .",
        "has a restriction on here:locatedAt, an annotation property",
    ),
    (
        "here:Orange owl:disjointWith here:Apple . "
        "ex:Kumquat rdfs:subClassOf here:Orange , here:Apple .",
        "is a kind of here:Apple and of here:Orange",
    ),
    ("ex:Kumquat here:locatetAt here:Kitchen .", "did you mean here:locatedAt?"),
    ("ex:Kumquat skos:altLable 'x' .", "did you mean skos:altLabel?"),
    ("ex:Kumquat rdfs:subClassOf <http://w3id.org/hereabouts#Fruit> .", "not declared one"),
    ("ex:Kumquat rdfs:subClassOf <http://w3id.org/hereabouts#Food> .", "mean here:Food?"),
    ("ex:Kumquat skos:altLabel ' ' .", "has an empty name"),
    ("ex:Kumquat here:locatedAt 'kitchen' .", "here:locatedAt must point at a place"),
)


def all_told(folder: Path, cases: tuple[tuple[str, str], ...]) -> list[str]:
    """The findings of one document with all cases, each about a class of its own."""
    text = ""
    for number, (turtle, _) in enumerate(cases):
        both = KUMQUAT.replace('"kumquat"', f'"kumquat {number}"') + turtle
        text += both.replace("ex:Kumquat", f"ex:K{number}").replace("ex:in ", f"ex:in{number} ")
    return told(folder, text)


def test_a_warning_tells_what_is_not_used(tmp_path: Path) -> None:
    lines = all_told(tmp_path, WARNED)
    for turtle, warning in WARNED:
        assert any(warning in line for line in lines), turtle
    assert [line for line in lines if not line.startswith("warning: home.ttl, line ")] == []


def test_what_cannot_be_meant_is_refused(tmp_path: Path) -> None:
    lines = [line for line in all_told(tmp_path, REFUSED) if line.startswith("violation: ")]
    for turtle, violation in REFUSED:
        assert any(violation in line for line in lines), turtle


def test_labels_of_other_languages_only_are_told(tmp_path: Path) -> None:
    (line,) = told(tmp_path, NAMED + 'rdfs:label "Zwergorange"@de .')
    assert "has no English label" in line
    assert "'Zwergorange'" in line


def test_many_warnings_about_one_property_are_counted(tmp_path: Path) -> None:
    many = "".join(f"ex:Kumquat owl:sameAs ex:k{n} .\n" for n in range(MAX_ALIKE + 5))
    lines = told(tmp_path, KUMQUAT + many)
    assert len(lines) == MAX_ALIKE + 1
    assert any("and 5 more statements of owl:sameAs are not used" in line for line in lines)


def test_an_import_that_a_document_lacks_is_told() -> None:
    from kg.knowledge.ontology.unused import unresolved_imports

    shipped = load_ontologies().quads
    assert unresolved_imports(shipped) == []
    some = [q for q in shipped if "ontology/places" not in str(q.subject)]
    assert {f.value for f in unresolved_imports(some)} == {v.PLACES_ONTOLOGY}


def test_a_class_that_got_another_iri_is_renamed_and_nothing_else_changes(tmp_path: Path) -> None:
    old = load_with_imports(written(tmp_path, KUMQUAT + AXIOM.format("here:locatedAt"))).quads
    text = (tmp_path / "home.ttl").read_text().replace("ex:Kumquat", "ex:Marumi")
    (tmp_path / "home.ttl").write_text(text)
    new = load_with_imports(tmp_path / "home.ttl").quads
    (change,) = changes(old, new)
    assert str(change) == f"~ category 'kumquat' renamed from {EX}Kumquat to {EX}Marumi"


def test_a_used_class_that_got_another_iri_is_refused_with_it() -> None:
    from kg.model.records import MapUpdate, PlaceRecord

    with in_memory_map() as semantic_map:
        kitchen = semantic_map.catalogue.find("kitchen", "place").iri
        place = PlaceRecord(semantic_map.place_iri(1), "p", 0.0, 4.0, 0.0, 4.0, 5, {kitchen: 0.9})
        semantic_map.apply(MapUpdate(places=(place,)))
        quads = [
            type(q)(
                *(
                    type(term)(EX + "Galley") if getattr(term, "value", "") == kitchen else term
                    for term in q
                )
            )
            for q in semantic_map.ontology.quads()
        ]
        with pytest.raises(OntologyError, match=r"uses here:Kitchen.* is <.*#Galley> there"):
            semantic_map.ontology.replace(quads)


def test_json_ld_is_read_as_such_whatever_the_ending(tmp_path: Path) -> None:
    import rdflib

    graph = rdflib.Graph().parse(written(tmp_path, KUMQUAT))
    for name in ("home.jsonld", "home.owl"):
        graph.serialize(tmp_path / name, format="json-ld")
        quads = load_with_imports(tmp_path / name).quads
        assert Catalogue.from_quads(quads).find("kumquat").iri == EX + "Kumquat"
    (tmp_path / "far.jsonld").write_text('{"@context": "https://schema.org", "name": "x"}')
    with pytest.raises(OntologyError, match="a remote @context is not fetched"):
        load_with_imports(tmp_path / "far.jsonld")

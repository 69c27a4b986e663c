"""An edited ontology is read with its imports, judged by file and line, told in words, taken in."""

import re
from pathlib import Path

import pytest
from pyoxigraph import Literal, NamedNode, Quad, RdfFormat, parse

from kg.export.serialization import export_ontology
from kg.knowledge.ontology.diagnostics import check_valid, inspect
from kg.knowledge.ontology.diff import changes
from kg.knowledge.ontology.import_closure import load_with_imports
from kg.knowledge.ontology.lint import check_map
from kg.knowledge.ontology.loading import compile_commonsense
from kg.knowledge.ontology.reasoning import load_world, world_quads
from kg.maps.semantic_map import SemanticMap
from kg.maps.stored_map import StoredMap
from kg.model import vocabulary as v
from kg.model.errors import OntologyError
from kg.rdf.skolem import anonymous, named
from kg.serving.opening import create_map, in_memory_map
from kg.store.transactional import TransactionalStore
from tests.shipped_ontology import QUADS as SHIPPED

PREFIXES = "".join(
    f"@prefix {name}: <{v.PREFIXES[name]}> .\n"
    for name in ("here", "owl", "rdfs", "xsd", "skos", "dct")
)
HEADER = """<urn:mine> a owl:Ontology ;
    owl:imports <https://w3id.org/hereabouts/ontology/commonsense> ;
    rdfs:label "mine" ; rdfs:comment "Ours." ; owl:versionInfo "1" ; dct:license <urn:free> .
"""
MUG = """here:Mug a owl:Class ; rdfs:subClassOf here:Cup ; rdfs:label "mug" ;
    skos:altLabel "Becher"@de ; rdfs:comment "A cup." ; here:locatedAt here:Office .
[] a owl:Axiom ; owl:annotatedSource here:Mug ; owl:annotatedProperty here:locatedAt ;
    owl:annotatedTarget here:Office ; here:probability 0.6e0 ; dct:source "us" .
"""
ONTOLOGIES = v.CORE_ONTOLOGY.rpartition("/")[0]
BY_HAND = """INSERT DATA { GRAPH graph:commonsense {
    <https://w3id.org/hereabouts/relation/locatedAt/Cup/HomeOffice> a here:LocatedAtRelation ;
        here:relationSubject here:Cup ; here:relationTarget here:HomeOffice ;
        here:relationProbability 0.3e0 ; dct:source "Ada" } }"""


@pytest.fixture
def mine(tmp_path: Path) -> Path:
    return written(tmp_path, MUG)


def written(folder: Path, turtle: str, header: str = HEADER) -> Path:
    path = folder / "mine.ttl"
    path.write_text(PREFIXES + header + turtle)
    return path


def words(old: object, new: object) -> list[str]:
    return [str(change) for change in changes(old, new)]  # type: ignore[arg-type]


def with_turtle(turtle: str) -> tuple[Quad, ...]:
    graph = v.ONTOLOGY_GRAPH
    extra = parse(PREFIXES + turtle, format=RdfFormat.TURTLE)
    return (*SHIPPED, *(Quad(q.subject, q.predicate, q.object, graph) for q in extra))


def test_a_file_brings_along_what_it_imports_from_beside_it_and_from_what_is_shipped(
    mine: Path, tmp_path: Path
) -> None:
    (tmp_path / "rooms.ttl").write_text(PREFIXES + "<urn:rooms> a owl:Ontology .")
    with mine.open("a") as file:
        file.write("<urn:mine> owl:imports <urn:rooms> .")
    names = [path.name for path in load_with_imports(mine).files]
    assert names[0] == "mine.ttl"
    assert set(names) == {
        *("mine.ttl", "rooms.ttl", "commonsense.ttl"),
        *("objects.ttl", "places.ttl", "hereabouts.ttl"),
    }


def test_the_catalog_leads_to_a_file_of_another_name_in_another_folder(tmp_path: Path) -> None:
    (tmp_path / "deep").mkdir()
    (tmp_path / "deep" / "x.ttl").write_text(PREFIXES + "<urn:rooms> a owl:Ontology .")
    (tmp_path / "catalog-v001.xml").write_text(
        '<catalog xmlns="urn:oasis:names:tc:entity:xmlns:xml:catalog"><group prefer="public">'
        '<uri id="1" name="urn:rooms" uri="deep/x.ttl"/></group></catalog>'
    )
    path = written(tmp_path, "", "<urn:a> a owl:Ontology ; owl:imports <urn:rooms> .")
    assert [p.name for p in load_with_imports(path).files] == ["mine.ttl", "x.ttl"]


def test_an_import_that_is_nowhere_is_named(tmp_path: Path) -> None:
    path = written(tmp_path, "", "<urn:a> a owl:Ontology ; owl:imports <urn:lost> .")
    with pytest.raises(OntologyError, match=r"mine\.ttl imports urn:lost, which is not at hand"):
        load_with_imports(path)


@pytest.mark.parametrize(
    ("name", "text", "complaint"),
    [
        ("a.ttl", "@prefix a: <urn:a> .\n\na:b a:c\n", "line 4: "),
        ("a.owl", "<?xml version='1.0'?>\n<r:RDF xmlns:r='urn:x'>\n<a></b></r:RDF>", "line 3: "),
        ("a.owl", "<?xml version='1.0'?>\n<Ontology xmlns='urn:x'/>", "line 1: this is OWL/XML"),
        ("a.owl", "Prefix(:=<urn:a>)\nOntology()", "line 1: this is OWL functional syntax"),
        ("a.owl", "Prefix: a: <urn:a>\nOntology: <urn:a>", "line 1: this is Manchester syntax"),
    ],
)
def test_what_does_not_parse_is_refused_with_its_line(tmp_path, name, text, complaint):
    (tmp_path / name).write_text(text)
    with pytest.raises(OntologyError) as error:
        load_with_imports(tmp_path / name)
    assert str(error.value).startswith(f"{tmp_path / name}, {complaint}")


def test_turtle_saved_under_the_ending_of_protege_is_read(mine: Path) -> None:
    renamed = mine.rename(mine.with_suffix(".owl"))
    assert load_with_imports(renamed).quads[0].graph_name == v.ONTOLOGY_GRAPH
    assert inspect(load_with_imports(renamed)) == []


@pytest.mark.parametrize(
    ("turtle", "complaint"),
    [
        (
            "here:Mug a owl:Class ; rdfs:subClassOf here:Cup .",
            "here:Mug: a term needs an rdfs:label",
        ),
        ("here:Cup here:locatedAt here:Fork .", "here:Cup: here:locatedAt must point at"),
        ("here:Cup rdfs:subClassOf here:Crockery .", "is used as a class and not declared one"),
        ("here:Cup a rdfs:Datatype .", "here:Cup: is a class and a datatype"),
        ("rdf:type a owl:ObjectProperty ; rdfs:label 'x' .", "cannot be declared anew"),
        ('here:Cup rdfs:comment "x"^^xsd:double .', "holds a text that is no xsd:double"),
        ("here:Cup here:heldBy here:Fork .", "the ontology declares no such term"),
        (MUG.replace("0.6e0", "1.6e0"), "must be one number between 0 and 1"),
    ],
)
def test_what_is_badly_made_is_refused_with_its_line_and_the_reason(tmp_path, turtle, complaint):
    header = f"@prefix rdf: <{v.PREFIXES['rdf']}> .\n{HEADER}"
    path = written(tmp_path, turtle, header)
    with pytest.raises(OntologyError) as error:
        check_valid(load_with_imports(path))
    message = str(error.value)
    assert complaint in message
    assert "\n" not in message
    at = len((PREFIXES + header).splitlines()) + (3 if "Axiom" in turtle else 1)
    assert f"mine.ttl, line {at}: " in message


def test_a_contradiction_is_refused_where_hermit_is_asked(tmp_path: Path) -> None:
    both = """here:Odd a owl:Class ; rdfs:label "odd" ;
        rdfs:subClassOf here:Cup , [ a owl:Class ; owl:complementOf here:Cup ] ."""
    ontology = load_with_imports(written(tmp_path, both))
    assert [f for f in inspect(ontology) if f.severity == "violation"] == []
    with pytest.raises(OntologyError, match=r"line 10: here:Odd: can have no members"):
        check_valid(ontology, reason=True)


def test_changes_are_told_in_words() -> None:
    new = with_turtle(MUG)
    told = [
        "+ category 'mug' added under cup, also called 'Becher'",
        "+ mug located at office 0.6 added ('us')",
    ]
    assert words(SHIPPED, new) == told
    back = words(new, SHIPPED)
    assert back == ["- category 'mug' removed", "- mug located at office 0.6 removed"]
    assert words(new, tuple(reversed(new))) == []


def test_what_changes_about_a_known_term_is_told() -> None:
    old = with_turtle("")
    cup = NamedNode(v.HERE + "Cup")
    label = Quad(cup, NamedNode(v.RDFS_LABEL), Literal("cup"), v.ONTOLOGY_GRAPH)
    assert label in old
    rest = tuple(q for q in with_turtle('here:Cup rdfs:label "teacup" .') if q != label)
    assert words(old, rest) == ["~ label of cup changed from 'cup' to 'teacup'"]
    for turtle, told in (
        ('here:Cup skos:altLabel "Tasse"@de .', "+ synonym 'Tasse' (de) of cup added"),
        (
            "here:Cup rdfs:subClassOf here:Food .",
            "~ cup moved from under object to food and object",
        ),
        ("here:Cup rdfs:seeAlso here:Fork .", "+ 1 other statement about cup added"),
        ("here:Cup owl:disjointWith here:Fork .", "+ 1 other statement about cup added"),
    ):
        assert words(old, with_turtle(turtle)) == [told]
    stronger = with_turtle(
        "[] a owl:Axiom ; owl:annotatedSource here:Cup ; owl:annotatedProperty here:locatedAt ;"
        'owl:annotatedTarget here:Attic ; here:probability 0.1e0 ; dct:source "us" .'
        "here:Cup here:locatedAt here:Attic ."
    )
    again = tuple(
        Quad(q.subject, q.predicate, Literal(0.4), q.graph_name)
        if q.predicate.value == v.PROBABILITY and q.object.value == "0.1e0"
        else q
        for q in stronger
    )
    told_again = "~ probability of cup located at attic changed from 0.1 to 0.4"
    assert words(stronger, again) == [told_again]


def test_statistics_of_rooms_are_told_in_words() -> None:
    def counted(held: int) -> tuple[Quad, ...]:
        return with_turtle(
            "<https://w3id.org/hereabouts/statistics/ours/Kitchen/Oven> a here:RoomStatistics ; "
            "here:statisticsObject here:Oven ; here:statisticsPlace here:Kitchen ; "
            f'here:roomCount 5 ; here:roomsWithObject {held} ; dct:source "ours" .'
        )

    assert words(SHIPPED, counted(3)) == ["+ oven in 3 of 5 rooms that are kitchen ('ours') added"]
    assert words(counted(3), counted(4)) == [
        "- oven in 3 of 5 rooms that are kitchen ('ours') removed",
        "+ oven in 4 of 5 rooms that are kitchen ('ours') added",
    ]


def test_blank_nodes_have_names_made_of_what_is_said_and_lose_them_again() -> None:
    once = named(SHIPPED)
    assert not any("_:" in str(q.subject) for q in once)
    assert set(named(anonymous(once))) == set(once)
    assert set(named(reversed(SHIPPED))) == set(once)
    assert compile_commonsense(once) == compile_commonsense(SHIPPED)
    more = set(named(with_turtle(MUG)))
    assert set(once) < more


def test_blank_nodes_in_a_circle_are_refused() -> None:
    circle = parse("_:a <urn:p> _:b . _:b <urn:p> _:a .", format=RdfFormat.TURTLE)
    with pytest.raises(OntologyError, match="in a circle"):
        named(circle)


def test_an_ontology_is_taken_in_as_one_transaction_that_history_remembers(mine: Path) -> None:
    with in_memory_map() as semantic_map:
        before = semantic_map.sequence
        heard = []
        semantic_map.subscriptions.listen(heard.append)
        taken = semantic_map.ontology.replace(load_with_imports(mine).quads, by="ann")
        assert taken.commit is not None
        assert semantic_map.sequence == before + 1
        assert [change.cause.kind for change in heard] == ["ontology"]
        assert (heard[0].cause.by, "mug" in heard[0].cause.note) == ("ann", True)
        assert semantic_map.catalogue.find("Becher").label == "mug"
        assert check_map(semantic_map.engine) == []
        then = semantic_map.at(before)
        assert then.catalogue.get("Becher") is None
        assert set(compile_commonsense(then.ontology.quads())) == set(compile_commonsense(SHIPPED))


def test_what_people_wrote_into_common_sense_survives(mine: Path, tmp_path: Path) -> None:
    with in_memory_map() as semantic_map:
        semantic_map.update(BY_HAND, by="ada", allow=("commonsense",))
        mug = load_with_imports(mine).quads
        semantic_map.ontology.replace(mug)
        assert rows(semantic_map, "cup")["home office"] == 0.3
        theirs = written(tmp_path, MUG + MUG.partition(" .\n[]")[0].replace("Mug", "Jug") + " .")
        theirs.write_text(
            theirs.read_text()
            + "here:Cup here:locatedAt here:HomeOffice .\n[] a owl:Axiom ;"
            + "owl:annotatedSource here:Cup ; owl:annotatedProperty here:locatedAt ;"
            + 'owl:annotatedTarget here:HomeOffice ; here:probability 0.9e0 ; dct:source "x" .'
        )
        taken = semantic_map.ontology.replace(load_with_imports(theirs).quads)
        assert taken.kept == (v.RELATION + "locatedAt/Cup/HomeOffice",)
        assert rows(semantic_map, "cup")["home office"] == 0.3
        assert check_map(semantic_map.engine) == []
        semantic_map.ontology.replace(mug)
        assert rows(semantic_map, "cup")["home office"] == 0.3


def rows(semantic_map: SemanticMap, category: str) -> dict[str, float]:
    found = semantic_map.query("located-at", category=category).rows
    return {str(row[1]): float(str(row[2])) for row in found}


def test_a_probability_edited_twice_stands_once(tmp_path: Path) -> None:
    with in_memory_map() as semantic_map:
        for probability in ("0.6e0", "0.7e0", "0.65"):
            turtle = MUG.replace("0.6e0", probability)
            semantic_map.ontology.replace(load_with_imports(written(tmp_path, turtle)).quads)
            assert rows(semantic_map, "mug") == {"office": float(probability)}
        semantic_map.ontology.replace(SHIPPED, whole=True)
        assert semantic_map.catalogue.get("becher") is None
        fresh = {q for q in in_memory_map().engine if "dataset" not in str(q.graph_name)}
        assert {q for q in semantic_map.engine if "dataset" not in str(q.graph_name)} == fresh


@pytest.mark.parametrize(
    ("turtle", "complaint"),
    [
        (MUG.replace("0.6e0", "2"), "must be one number between 0 and 1"),
        (MUG.replace('rdfs:label "mug" ;', ""), "a term needs an rdfs:label"),
    ],
)
def test_an_invalid_ontology_leaves_the_map_as_it_is(tmp_path, turtle, complaint):
    with in_memory_map() as semantic_map:
        before = set(semantic_map.engine)
        with pytest.raises(OntologyError, match=complaint):
            semantic_map.ontology.replace(load_with_imports(written(tmp_path, turtle)).quads)
        assert set(semantic_map.engine) == before


def test_categories_the_map_speaks_of_and_terms_it_is_written_in_must_stay() -> None:
    with in_memory_map(base="https://example.org/m/") as semantic_map:
        semantic_map.update(
            "INSERT DATA { <https://example.org/c> a here:Cup ; here:x 1 ; here:y 2 }"
        )
        before = set(semantic_map.engine)
        without = [q for q in SHIPPED if v.HERE + "Cup>" not in f"{q.subject} {q.object}"]
        axioms = {q.subject for q in SHIPPED if v.HERE + "Cup>" in str(q.object)}
        with pytest.raises(OntologyError, match="uses here:Cup, which it does not declare"):
            semantic_map.ontology.replace(q for q in without if q.subject not in axioms)
        with pytest.raises(OntologyError, match="lacks here:heading, which maps are written in"):
            semantic_map.ontology.replace(q for q in SHIPPED if "#heading>" not in str(q.subject))
        assert set(semantic_map.engine) == before


def test_an_ontology_without_what_the_map_is_made_of_is_refused_unless_it_is_the_whole(mine):
    named_parts = "> , <".join(f"{ONTOLOGIES}/{part}" for part in ("objects", "places"))
    commonsense = f"{ONTOLOGIES}/commonsense"
    mine.write_text(mine.read_text().replace(commonsense, named_parts))
    lacking = load_with_imports(mine).quads
    with in_memory_map() as semantic_map:
        before = set(semantic_map.engine)
        with pytest.raises(OntologyError, match=r"leaves out <.*/commonsense> of the map"):
            semantic_map.ontology.replace(lacking)
        assert set(semantic_map.engine) == before
        semantic_map.ontology.replace(lacking, whole=True)
        assert rows(semantic_map, "banana") == {}


def test_a_map_made_when_ontologies_had_blank_nodes_takes_one_in(mine: Path) -> None:
    with in_memory_map() as new:
        rest = [q for q in new.engine if q.graph_name != v.ONTOLOGY_GRAPH]
    old = StoredMap(TransactionalStore.in_memory([*rest, *SHIPPED]))
    old.ontology.replace(load_with_imports(mine).quads)
    assert rows(old, "mug") == {"office": 0.6}
    assert not any("_:" in str(q) for q in old.engine)
    assert check_map(old.engine) == []


@pytest.mark.parametrize("ending", ["ttl", "owl", "nt"])
def test_an_exported_ontology_is_whole_and_has_one_header(tmp_path: Path, ending: str) -> None:
    path = tmp_path / f"out.{ending}"
    with in_memory_map(base="https://example.org/m/") as semantic_map:
        export_ontology(semantic_map, path)
        again = load_with_imports(path)
        heads = [q.subject.value for q in again.quads if q.object == NamedNode(v.OWL_ONTOLOGY)]
        assert heads == ["https://example.org/m/ontology"]
        assert inspect(again) == []
        assert set(compile_commonsense(again.quads)) == set(compile_commonsense(SHIPPED))


def test_an_edit_by_owlready2_is_taken_in() -> None:
    with in_memory_map() as semantic_map:
        ontology = semantic_map.ontology.quads()
        world = load_world(ontology)
        assert words(ontology, world_quads(world, ontology)) == []
        office, located_at = world[v.HERE + "Office"], world[v.LOCATED_AT]
        with world.get_ontology(v.HERE):
            mug = type(world[v.HERE + "Cup"])("Mug", (world[v.HERE + "Cup"],), {})
        mug.label, mug.comment = ["mug"], ["A cup with a handle."]
        located_at[mug] = [office]
        world[v.PROBABILITY][mug, located_at, office] = [0.6]
        world[v.DCT_SOURCE][mug, located_at, office] = ["us"]
        taken = semantic_map.ontology.replace(world_quads(world, ontology), by="a program")
        assert [change.words for change in taken.changes] == [
            "category 'mug' added under cup",
            "mug located at office 0.6 added ('us')",
        ]
        assert rows(semantic_map, "mug") == {"office": 0.6}


def test_the_python_example_of_the_documentation_runs(tmp_path, monkeypatch, capsys):
    page = Path(__file__).resolve().parents[4] / "docs" / "how-to" / "protege.md"
    (example,) = re.findall(r"```python\n(.*?)```", page.read_text(), re.DOTALL)
    create_map(tmp_path / "kitchen.map").close()
    monkeypatch.chdir(tmp_path)
    exec(compile(example, str(page), "exec"), {})
    assert capsys.readouterr().out.splitlines() == [
        "+ category 'mug' added under cup",
        "+ mug located at office 0.6 added",
    ]

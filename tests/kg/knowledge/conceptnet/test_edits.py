"""The file an import writes: the same each time, and what people did to it stays."""

import json
import os
import re
from pathlib import Path

import pyoxigraph
import pytest
import rdflib
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from kg.knowledge.conceptnet.importing import ConceptNetImport, import_conceptnet
from kg.knowledge.ontology.lint import check_ontologies
from kg.knowledge.ontology.loading import compile_commonsense, load_ontologies
from kg.knowledge.ontology.relations import CategoryRelation, relations
from kg.model import vocabulary as v
from kg.model.errors import ConceptNetError, GraphError
from kg.model.resources import ONTOLOGIES

DATA = [
    *(("cup", "AtLocation", "kitchen", 9), ("cup", "AtLocation", "office", 3)),
    *(("bed", "AtLocation", "bedroom", 12), ("fork", "LocatedNear", "knife", 4)),
    *(("banana", "IsA", "food", 5), ("bed", "AtLocation", "bedroom", -1)),
]


def data(path: Path, rows: list[tuple[str, str, str, int]]) -> Path:
    path.write_text(
        "".join(
            f"{start}\t{end}\t"
            f"{{'freq': {5 if n > 0 else -5}, 'score': {abs(n)}, 'rel': u'{rel}'}}\n"
            for start, rel, end, n in rows
        )
    )
    return path


@pytest.fixture
def graph(tmp_path: Path) -> Path:
    return data(tmp_path / "graph", DATA)


@pytest.fixture
def into(tmp_path: Path) -> Path:
    """A file beside the shipped ontologies, as somebody would keep it."""
    folder = tmp_path / "mine"
    folder.mkdir()
    for path in ONTOLOGIES.glob("*.ttl"):
        (folder / path.name).write_bytes(path.read_bytes())
    return folder / "conceptnet.ttl"


def update(graph: Path, into: Path, *, dry_run: bool = False) -> ConceptNetImport:
    return import_conceptnet(graph, into, ontologies=into.parent, dry_run=dry_run)


def said(imported: ConceptNetImport) -> set[tuple[str, str, str]]:
    return {
        (c.what, c.subject.removeprefix(v.HERE), c.target.removeprefix(v.HERE))
        for c in imported.changes
    }


def relation(folder: Path, subject: str, target: str) -> CategoryRelation | None:
    ends = (v.HERE + subject, v.HERE + target)
    found = [r for r in relations(load_ontologies(folder).quads) if (r.subject, r.target) == ends]
    return found[0] if found else None


def block(text: str, subject: str, target: str) -> str:
    """What the file says of one relation."""
    start = text.index(f"here:{subject} here:locatedAt here:{target} .")
    return text[start : text.index(" .\n\n", start) + 4]


def test_importing_twice_changes_nothing(graph: Path, into: Path) -> None:
    assert update(graph, into, dry_run=True).changes
    assert not into.exists()
    first = update(graph, into)
    assert first.written
    assert ("added", "Cup", "Kitchen") in said(first)
    before = into.read_bytes()
    second = update(graph, into)
    assert not second.written
    assert second.changes == ()
    assert into.read_bytes() == before


def test_the_order_of_the_source_does_not_matter(tmp_path: Path) -> None:
    for name, rows in (("one", DATA), ("two", DATA[::-1])):
        import_conceptnet(data(tmp_path / "graph", rows), tmp_path / f"{name}.ttl")
    assert (tmp_path / "one.ttl").read_bytes() == (tmp_path / "two.ttl").read_bytes()


def test_the_file_is_a_well_made_ontology_that_says_whose_data_it_is(graph, into):
    update(graph, into)
    assert check_ontologies(into.parent) == []
    text = into.read_text()
    assert "compiled by the Commonsense Computing Initiative" in text
    assert "<https://creativecommons.org/licenses/by-sa/4.0/>" in text
    assert len(rdflib.Graph().parse(into)) == len(set(pyoxigraph.parse(path=str(into))))


def test_an_import_stands_beside_the_shipped_relations_and_does_not_change_them(graph, into):
    shipped = compile_commonsense(load_ontologies().quads)
    update(graph, into)
    assert set(shipped) <= set(compile_commonsense(load_ontologies(into.parent).quads))
    cup = relation(into.parent, "Cup", "Kitchen")
    assert cup is not None
    assert cup.probability == 0.2
    of_people, imported = cup.evidence
    assert (of_people.stated, of_people.probability, of_people.weight) == (True, 0.2, None)
    assert (imported.stated, imported.weight, imported.weight_against) == (False, 5.657, 0.0)
    assert imported.sources == (
        "https://conceptnet.io/a/%5B/r/AtLocation/,/c/en/cup/,/c/en/kitchen/%5D",
    )
    bed = relation(into.parent, "Bed", "Bedroom")
    assert bed is not None
    assert bed.evidence[-1].weight_against == 1.0
    fork = relation(into.parent, "Fork", "Knife")  # which the import alone states
    assert fork is not None
    assert not fork.evidence[0].stated
    assert fork.probability == fork.evidence[0].probability > 0


def test_a_probability_changed_by_hand_stays_and_rules(graph: Path, into: Path) -> None:
    update(graph, into)
    text = into.read_text()
    old = block(text, "Cup", "Office")
    new = re.sub(r"here:probability \S+", "here:probability 0.6", old)
    assert new != old
    into.write_text(text.replace(old, new))
    edited = update(graph, into)
    assert ("yours", "Cup", "Office") in said(edited)
    data(graph, [*DATA, ("cup", "AtLocation", "office", 30)])
    update(graph, into)
    cup = relation(into.parent, "Cup", "Office")
    assert cup is not None
    assert (cup.probability, cup.evidence[0].stated) == (0.6, True)
    before = into.read_bytes()
    update(graph, into)
    assert into.read_bytes() == before


def test_a_relation_removed_by_hand_stays_away(graph: Path, into: Path) -> None:
    update(graph, into)
    text = into.read_text()
    into.write_text(text.replace(block(text, "Cup", "Office"), ""))
    for _ in range(3):
        assert ("left out", "Cup", "Office") in said(update(graph, into))
    assert relation(into.parent, "Cup", "Office") is None


def test_what_people_added_stays_blank_nodes_and_header_too(graph: Path, into: Path) -> None:
    update(graph, into)
    mine = """
        @prefix here: <https://w3id.org/hereabouts#> .
        @prefix owl: <http://www.w3.org/2002/07/owl#> .
        @prefix rdfs: <http://www.w3.org/2000/01/rdf-schema#> .
        @prefix dct: <http://purl.org/dc/terms/> .
        <https://w3id.org/hereabouts/ontology/conceptnet> rdfs:seeAlso <https://example.org/> .
        here:Mug a owl:Class ; rdfs:subClassOf here:Cup ; rdfs:label "mug \\"of mine\\""@en ;
            rdfs:comment "Mine." .
        here:Mug here:locatedAt here:Office .
        [] a owl:Axiom ; owl:annotatedSource here:Mug ; owl:annotatedProperty here:locatedAt ;
            owl:annotatedTarget here:Office ; here:probability 0.6e0 ; dct:source "me" .
    """
    into.write_text(into.read_text() + mine)
    ours = {str(q) for q in pyoxigraph.parse(mine, format=pyoxigraph.RdfFormat.TURTLE)}
    named = {line for line in ours if "_:" not in line}
    for rows in (DATA, DATA[:2], [*DATA, ("knife", "AtLocation", "pantry", 5)]):
        update(data(graph, rows), into)
        kept = {str(q) for q in pyoxigraph.parse(path=str(into))}
        assert named <= kept
        mug = relation(into.parent, "Mug", "Office")
        assert mug is not None
        assert mug.probability == 0.6
        before = into.read_bytes()
        assert not update(graph, into).written
        assert into.read_bytes() == before
    assert check_ontologies(into.parent) == []


def test_an_editor_that_writes_everything_anew_is_no_edit(graph: Path, into: Path) -> None:
    update(graph, into)
    before = into.read_bytes()
    rdflib.Graph().parse(into).serialize(into, format="turtle")
    assert into.read_bytes() != before
    assert update(graph, into).changes == ()
    assert into.read_bytes() == before


def test_new_data_changes_adds_and_removes(graph: Path, into: Path) -> None:
    update(graph, into)
    data(graph, [("cup", "AtLocation", "kitchen", 20), ("knife", "AtLocation", "pantry", 5)])
    before = into.read_bytes()
    changed = said(update(graph, into, dry_run=True))
    assert into.read_bytes() == before
    assert ("changed", "Cup", "Kitchen") in changed
    assert ("added", "Knife", "Pantry") in changed
    assert ("removed", "Bed", "Bedroom") in changed


def test_a_file_of_somebody_else_is_refused(graph: Path, into: Path) -> None:
    theirs = into.with_name("commonsense.ttl")
    before = theirs.read_bytes()
    with pytest.raises(ConceptNetError, match="no file of this importer"):
        update(graph, theirs)
    assert theirs.read_bytes() == before
    into.write_text("here:Cup a")
    with pytest.raises(ConceptNetError, match="line 1"):
        update(graph, into)
    with pytest.raises(GraphError, match="No such file"):
        import_conceptnet(graph, into.parent / "absent" / "x.ttl")


def test_a_write_that_fails_leaves_the_file_and_no_part_of_another(graph, into, monkeypatch):
    update(graph, into)
    before = into.read_bytes()
    data(graph, DATA[:1])

    def full(descriptor: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    files = sorted(into.parent.iterdir())
    with pytest.raises(GraphError, match="No space left"):
        update(graph, into)
    assert into.read_bytes() == before
    assert sorted(into.parent.iterdir()) == files


TEXT = st.text(max_size=40) | st.sampled_from(
    ['"', "\\", '"""', "\n\n<x> <y> <z> .", "> .", "'; drop", "\ud800", "\x00", "\u2028", "]]"]
)


@settings(
    max_examples=10,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
@given(surface=TEXT, term=TEXT, license=TEXT)
def test_no_text_breaks_out_of_the_file(surface, term, license, tmp_path):
    name = term.replace("\t", " ").replace("\n", " ").replace("/", " ")
    known = json.dumps({"weight": 4.0, "license": license, "surfaceText": surface})
    rows = [
        ("/c/en/cup", "/c/en/kitchen"),
        (f"/c/en/cup/n/wn/{name}", "/c/en/kitchen"),
        (f"/c/en/cup_{name}", "/c/en/kitchen"),
    ]
    text = "".join(
        f"/a/[/r/AtLocation/,{s}/,{e}/]\t/r/AtLocation\t{s}\t{e}\t{known}\n" for s, e in rows
    )
    source, into = tmp_path / "tsv", tmp_path / "out.ttl"
    source.write_bytes(text.encode("utf-8", "surrogatepass"))
    into.unlink(missing_ok=True)
    import_conceptnet(source, into)
    triples = list(pyoxigraph.parse(path=str(into)))
    stated = {
        (t.subject.value, t.object.value) for t in triples if t.predicate.value == v.LOCATED_AT
    }
    assert stated == {(v.HERE + "Cup", v.HERE + "Kitchen")}
    allowed = {pyoxigraph.NamedNode(v.CONCEPTNET_ONTOLOGY), pyoxigraph.NamedNode(v.HERE + "Cup")}
    axioms = {t.subject for t in triples} - allowed
    assert len(axioms) == 1
    before = into.read_bytes()
    import_conceptnet(source, into)
    assert into.read_bytes() == before


def decide(review: Path, *, keep: str, subject: str, target: str) -> None:
    """Write a person's decision on one relation into a review table."""
    lines = review.read_text().splitlines()
    ends = f"here:{subject},here:locatedAt,here:{target}"
    (number,) = [n for n, line in enumerate(lines) if ends in line]
    lines[number] = f"{keep},{lines[number].partition(',')[2]}"
    review.write_text("\n".join(lines) + "\n")


def reviewed(graph: Path, into: Path, review: Path) -> ConceptNetImport:
    return import_conceptnet(graph, into, ontologies=into.parent, review=review)


def test_a_relation_dropped_in_the_review_stays_away_until_it_is_kept_again(graph, into, tmp_path):
    review = tmp_path / "review.csv"
    reviewed(graph, into, review)
    head, weakest, *_ = review.read_text().splitlines()
    assert head.startswith("keep,kept,subject,relation,object,probability,weight")
    assert "cup AtLocation office" in weakest
    decide(review, keep="No", subject="Cup", target="Office")
    assert ("left out", "Cup", "Office") in said(reviewed(graph, into, review))
    assert relation(into.parent, "Cup", "Office") is None
    assert ("left out", "Cup", "Office") in said(update(graph, into))
    assert check_ontologies(into.parent) == []
    reviewed(graph, into, review)
    decide(review, keep="yes", subject="Cup", target="Office")
    assert ("added", "Cup", "Office") in said(reviewed(graph, into, review))


def test_a_review_written_before_does_not_bring_back_what_was_removed_by_hand(
    graph: Path, into: Path, tmp_path: Path
) -> None:
    review = tmp_path / "review.csv"
    reviewed(graph, into, review)
    text = into.read_text()
    into.write_text(text.replace(block(text, "Cup", "Office"), ""))
    assert ("left out", "Cup", "Office") in said(reviewed(graph, into, review))
    assert relation(into.parent, "Cup", "Office") is None


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a,b\n1,2\n", "no review table: it has no column keep, object, relation, subject"),
        ("keep;subject;relation;object\nmaybe;a;b;c\n", "line 2: keep is 'maybe'"),
    ],
)
def test_a_table_that_is_no_review_is_refused_before_anything_is_written(
    graph: Path, into: Path, tmp_path: Path, text: str, message: str
) -> None:
    review = tmp_path / "review.csv"
    review.write_text(text)
    with pytest.raises(ConceptNetError, match=message):
        reviewed(graph, into, review)
    assert not into.exists()
    assert review.read_text() == text

"""Changes in lines, and why a fact holds."""

import re
import shutil
import zlib
from collections.abc import Callable
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pyoxigraph import BlankNode, Literal, NamedNode, Quad, RdfFormat, Triple, parse

from kg.history.reports.events import reason_sentences
from kg.history.reports.explanation import Explanation
from kg.history.reports.prov_export import provenance
from kg.history.storage import log_reader
from kg.history.storage.log_reader import (
    LineCodec,
    dictionary_for,
    lines_of,
    net,
    quads_of,
    subject_of,
)
from kg.maps.semantic_map import SemanticMap
from kg.model import vocabulary as v
from kg.model.errors import HistoryError, InvalidFactError, QueryParameterError
from kg.model.records import MapUpdate
from kg.model.transactions import Cause
from kg.serving.opening import open_map

_CODEC = LineCodec(dictionary_for("https://example.org/flat/"))
_TEXT = st.text(
    st.characters(blacklist_categories=("Cs",), blacklist_characters="\x00"), max_size=12
)
_DATATYPES = st.sampled_from(
    [v.XSD + name for name in ("double", "integer", "dateTime", "decimal", "boolean", "string")]
)
objects = st.one_of(
    st.builds(Literal, st.floats()),
    st.builds(Literal, _TEXT),
    st.builds(lambda text: Literal(text, language="en"), _TEXT),
    st.builds(lambda text, kind: Literal(text, datatype=NamedNode(kind)), _TEXT, _DATATYPES),
    st.sampled_from([NamedNode(v.HERE + "Chair"), BlankNode("b0")]),
)
subjects = st.sampled_from(
    [NamedNode(f"https://example.org/flat/{n}") for n in ("1", "1/belief/x", "10", "ä")]
    + [BlankNode("b"), BlankNode("b0")]
)
quads = st.builds(
    Quad,
    subjects,
    st.sampled_from([NamedNode(v.X), v.RDF_TYPE]),
    objects,
    st.sampled_from([v.MAP_GRAPH, v.ASSERTIONS_GRAPH]),
)
sets = st.sets(quads, max_size=12)


@given(sets, sets)
def test_a_change_comes_back_from_its_bytes(removed: set[Quad], added: set[Quad]) -> None:
    data = _CODEC.encode(lines_of(removed), lines_of(added))
    change = _CODEC.change(data)
    assert (set(quads_of(change.removed)), set(quads_of(change.added))) == (removed, added)


@given(sets, sets, subjects)
def test_one_subject_is_picked_from_a_change(removed, added, subject):
    name = str(subject).encode()
    whole, part = (lines_of(removed), lines_of(added)), _CODEC.encode
    picked = _CODEC.change_about(part(*whole), name)
    for lines, side in zip(picked, whole, strict=True):
        assert sorted(lines) == sorted(line for line in side if subject_of(line) == name)


@given(st.lists(sets, max_size=6))
def test_net_changes_lead_from_the_first_state_to_the_last(states: list[set[Quad]]) -> None:
    lines = [set(lines_of(state)) for state in (states or [set()])]
    changes = [
        _CODEC.change(_CODEC.encode(before - after, after - before))
        for before, after in pairwise(lines)
    ]
    removed, added = net(changes)
    assert (set(removed), set(added)) == (lines[0] - lines[-1], lines[-1] - lines[0])


@pytest.mark.parametrize(
    "data", [b"\x99 no such block", b"\x00", zlib.compress(b"x" * 100), _CODEC.encode([b"no quad"])]
)
def test_a_damaged_row_is_one_line(data: bytes) -> None:
    with pytest.raises(HistoryError, match=r"damaged.*history\.sqlite"):
        quads_of(_CODEC.state(data))


def test_a_row_that_unpacks_beyond_the_limit_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    line = b'<urn:a> <urn:b> "' + b"x" * 5000 + b'" .'
    data = _CODEC.encode([line])
    monkeypatch.setattr(log_reader, "MAX_TEXT", 4000)
    with pytest.raises(HistoryError, match="more than 4,000 bytes"):
        _CODEC.state(data)
    with pytest.raises(InvalidFactError, match="at most 4,000"):
        _CODEC.encode([line])


Written = Callable[[int], SemanticMap]


def _steps(reason: Explanation, kind: str) -> list[str]:
    return [step.text for _, step in reason.walk() if step.kind == kind]


def test_an_object_leads_to_its_best_sighting(written: Written) -> None:
    with written(5) as semantic_map:
        semantic_map.apply(MapUpdate(robot=semantic_map.at(1).robot()))  # not the pose of the frame
        (reason,) = semantic_map.history.explain("object/1")
    assert reason.text == "chair 1 in the kitchen at (1.04, 1) m"
    (seen,) = _steps(reason, "observation")
    assert "frame-000004 of flat" in seen and "score 0.54" in seen
    assert "1 2 7 4" in seen
    assert _steps(reason, "model") == ["detector deimv2"]
    assert _steps(reason, "pose") == ["camera at (0.4, 0, 1.2) m, heading 0.5 rad"]
    written_by = _steps(reason, "commit")
    assert any(text.startswith("transaction #1 at") for text in written_by)
    assert any("#5" in text and "flat/frame-000004" in text for text in written_by)


def test_a_number_leads_to_the_rule_and_to_the_frame_that_set_it(written: Written) -> None:
    with written(5) as semantic_map:
        (reason,) = semantic_map.history.explain("object/1 here:confidence")
        assert reason.text == "chair 1: confidence 1.5"
        assert "eq. 3.1" in _steps(reason, "rule")[0]
        (given,) = semantic_map.history.explain("object/1 here:confidence 1.50")
        assert given == reason
        (first,) = semantic_map.history.explain("object/1 here:firstSeen")
        assert "#1 " in _steps(first, "commit")[-1]


def test_a_place_leads_to_its_belief_views_and_scene_model(written: Written) -> None:
    with written(12) as semantic_map:
        (reason,) = semantic_map.history.explain("place/1")
    assert _steps(reason, "belief") == ["kitchen with 75 %"]
    (views,) = _steps(reason, "view")
    assert views.startswith("3 views of the kitchen")
    assert views.endswith("flat/frame-000000, flat/frame-000005, flat/frame-000010")
    assert _steps(reason, "model") == ["scene model rooms6"]
    assert any("eq. 3.5" in rule for rule in _steps(reason, "rule"))


def test_common_sense_leads_to_its_source(written: Written) -> None:
    with written(1) as semantic_map:
        (reason,) = semantic_map.history.explain("here:Banana here:locatedAt here:Kitchen")
        (relation,) = _steps(reason, "relation")
        assert relation.startswith("banana located at kitchen with ")
        assert len(_steps(reason, "source")) >= 1
        (banana,) = semantic_map.history.explain("here:Banana")
        assert relation in _steps(banana, "relation")
        (kind,) = semantic_map.history.explain("here:Banana rdfs:subClassOf")[:1]
        assert _steps(kind, "source") == ["the ontology"]


def test_what_a_person_said_leads_to_the_person(written: Written) -> None:
    with written(2) as semantic_map:
        chair = NamedNode(semantic_map.base + "object/1")
        said = Quad(chair, NamedNode(v.RDFS_LABEL), Literal("throne"), v.ASSERTIONS_GRAPH)
        semantic_map.store.commit([], [said], Cause("assert", by="ann", note="it is the throne"))
        (reason,) = semantic_map.history.explain("object/1 rdfs:label 'throne'")
        assert _steps(reason, "person") == ["ann"]
        assert _steps(reason, "rule") == []
        assert "assert (it is the throne)" in _steps(reason, "commit")[0]
        (whole,) = semantic_map.history.explain("object/1")
        assert "ann" in _steps(whole, "person")
        (mapped,) = semantic_map.history.explain("object/1 rdfs:label 'chair 1'")
        assert _steps(mapped, "person") == []


def test_what_a_person_said_is_theirs_also_where_the_past_is_gone(written, tmp_path):
    with written(3) as semantic_map:
        semantic_map.assertions.add("object/1", "category", "bowl", by="ann")
        semantic_map.assertions.add("object/1", "position", (1, 2, 0.5), by="bob")
        semantic_map.history.compact(keep=0)
    (tmp_path / "flat.map" / "history.sqlite").rename(tmp_path / "away")
    shutil.copytree(tmp_path / "flat.map", tmp_path / "bare.map")
    (tmp_path / "away").rename(tmp_path / "flat.map" / "history.sqlite")
    for name, written_when in (("flat", "before the history begins"), ("bare", "not known")):
        with open_map(tmp_path / f"{name}.map", read_only=True) as semantic_map:
            (reason,) = semantic_map.history.explain("object/1 a")
            (where,) = semantic_map.history.explain("object/1 here:inCell")
            (label,) = semantic_map.history.explain("object/1 here:confidence")
        (said,) = _steps(reason, "fact")[1:]
        assert said.startswith("category bowl, asserted at 2")
        assert _steps(reason, "person") == ["ann"] and _steps(where, "person") == ["bob"]
        assert not _steps(reason, "rule") and _steps(label, "rule")
        assert written_when in _steps(reason, "commit")[-1]
        assert "prov:wasAttributedTo" in provenance(reason)


def test_what_is_gone_says_why(written: Written, frame: Callable[..., MapUpdate]) -> None:
    with written(3) as semantic_map:
        semantic_map.apply(frame(3, removed=(semantic_map.base + "object/2",)))
        (reason,) = semantic_map.history.explain("object/2")
        assert reason.text == "chair 2 is no longer in the map"
        assert "eq. 3.4" in _steps(reason, "rule")[0]
        assert "#4 " in _steps(reason, "commit")[0]
        (count,) = semantic_map.history.explain("object/1 here:observationCount 2")
        assert count.text.endswith("no longer") and "#3 " in _steps(count, "commit")[0]


@pytest.mark.parametrize(
    ("what", "message"),
    [
        ("object/9", "the map holds nothing about object/9"),
        ("object/1 here:x 77.0", "the map does not hold .* of that it holds: 1.01"),
        ("chair", "no thing 'chair'; write object/17"),
        ("a b c d", "no thing and no fact"),
        ("", "no thing and no fact"),
    ],
)
def test_what_cannot_be_explained(written: Written, what: str, message: str) -> None:
    with written(2) as semantic_map, pytest.raises(QueryParameterError, match=message):
        semantic_map.history.explain(what)


def test_explanations_as_triples(written: Written) -> None:
    with written(3) as semantic_map:
        text = provenance(*semantic_map.history.explain("object/1"))
        base = semantic_map.base
    triples = [
        Triple(q.subject, q.predicate, q.object)
        for q in parse(text.encode(), format=RdfFormat.TURTLE)
    ]
    links = {(getattr(t.subject, "value", ""), t.predicate.value) for t in triples}
    assert (base + "observation/1", v.SOSA_MADE_BY_SENSOR) in links
    assert (base + "observation/1", v.PROV_GENERATED_BY) in links
    assert (base + "commit/1", v.PROV_ENDED_AT) in links
    (statement,) = {t.subject for t in triples if t.object == NamedNode(v.RDF_STATEMENT)}
    said = {t.predicate.value: t.object for t in triples if t.subject == statement}
    assert said[v.RDF_SUBJECT] == NamedNode(base + "object/1")
    assert said[v.RDF_OBJECT] == NamedNode(v.HERE + "Chair")
    assert said[v.PROV_GENERATED_BY] == NamedNode(base + "commit/1")


def test_the_log_tells_each_change_in_words(written, frame):
    with written(3) as semantic_map:
        semantic_map.apply(frame(3, removed=(semantic_map.base + "object/2",)))
        entries = list(semantic_map.history.events("object/2"))
        assert [entry.sequence for entry in entries] == [1, 2, 3, 4]
        assert "new chair" in entries[0].changes
        assert "x 2 -> 2.01" in entries[1].changes
        assert "in place the kitchen" in entries[0].changes
        assert any(
            text.startswith("best observation: box 1 2 3 4 -> 1 2 4 4")
            for text in entries[1].changes
        )
        assert entries[3].changes == ("removed", "best observation: removed")
        assert entries[3].cause.note == "flat/frame-000003"
        with pytest.raises(QueryParameterError, match="knows nothing of object/9"):
            list(semantic_map.history.events("object/9"))


@pytest.mark.parametrize(
    ("thing", "prop", "value", "facts"),
    [
        ("object/1", "category", "bed", ()),
        ("object/1", "label", "throne", ("rdfs:label 'throne'",)),
        ("object/1", "position", "2 3 0.7", ("here:x", "here:y", "here:z")),
        ("object/1", "existence", "present", ("here:existence",)),
        ("place/1", "category", "bathroom", ()),
        ("place/1", "label", "den", ("rdfs:label 'den'",)),
    ],
)
def test_a_person_is_the_reason_of_what_was_asserted_and_of_nothing_else(
    written: Written, thing: str, prop: str, value: str, facts: tuple[str, ...]
) -> None:
    with written(2) as semantic_map:
        semantic_map.assertions.add(thing, prop, value, by="ann")
        explain, node = semantic_map.history.explain, NamedNode(semantic_map.base + thing)
        (said,) = [one for one in reason_sentences(explain(thing)) if "ann" in one]
        assert re.search(r"^\S+ .+, asserted today at \d+:\d+ by ann$|: ann said so today", said)
        for fact in facts:
            (reason,) = explain(f"{thing} {fact}")
            assert _steps(reason, "person") == ["ann"], fact
        kind = semantic_map.catalogue.find(value).iri if prop == "category" else ""
        types = semantic_map.engine.quads_for_pattern(node, v.RDF_TYPE, None, v.MAP_GRAPH)
        for name in [quad.object.value for quad in types if isinstance(quad.object, NamedNode)]:
            (reason,) = explain(f"{thing} a <{name}>")
            assert bool(_steps(reason, "person")) == (name == kind), name

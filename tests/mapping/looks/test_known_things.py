import cv2
import numpy as np
import pytest
from pyoxigraph import Literal, NamedNode, Quad

from kg.model.errors import ModelError
from kg.model.records import MapUpdate
from kg.model.vocabulary import MARKER
from mapping.looks.known_things import AUTHOR, FILE, KnownThings, recognise, remember_named, taught
from mapping.mapper import Mapper
from perception.inference.markers import marker_name
from tests.mapping.looks.conftest import add_things


def names(semantic_map) -> list[str]:
    label = semantic_map.catalogue.label
    return [label(record.category) for record in semantic_map.objects()]


def test_a_named_thing_that_left_is_known_again(furnished, cut_out, make_object):
    semantic_map = furnished(("teddy bear", cut_out("teddy bear")), ("cup", cut_out("cup")))
    bear = semantic_map.objects()[0].iri
    semantic_map.assertions.add(bear, "name", "Bruno", by="ann")
    remember_named(semantic_map)
    semantic_map.apply(MapUpdate(removed=(bear,)))
    again = add_things(
        *(semantic_map, make_object),
        *(("banana", cut_out("banana")), ("teddy bear", cut_out("teddy bear", 6.0))),
    )[-1]
    (found,) = recognise(semantic_map)
    assert (found.iri, found.name) == (again, "Bruno")
    assert names(semantic_map) == ["cup", "banana", "Bruno"]
    (assertion,) = semantic_map.assertions.all(again)
    assert assertion.by == AUTHOR


def half_of(picture: bytes) -> bytes:
    """The lower half of a picture: a likeness of 0.45 for the teddy bear."""
    whole = cv2.imdecode(np.frombuffer(picture, np.uint8), cv2.IMREAD_COLOR)
    return cv2.imencode(".jpg", whole[len(whole) // 2 :])[1].tobytes()


@pytest.mark.parametrize("rival", [False, True])
def test_a_vague_likeness_counts_where_nothing_else_is_like_it(
    furnished, cut_out, make_object, rival
):
    bear = cut_out("teddy bear")
    other = half_of(cut_out("teddy bear", 4.0)) if rival else cut_out("cup")
    semantic_map = furnished(("teddy bear", bear), ("chair", other))
    named = semantic_map.objects()[0].iri
    semantic_map.assertions.add(named, "name", "Bruno", by="ann")
    remember_named(semantic_map)
    semantic_map.apply(MapUpdate(removed=(named,)))
    add_things(semantic_map, make_object, ("teddy bear", half_of(bear)), first_seen=60.0)
    assert [one.name for one in recognise(semantic_map)] == ([] if rival else ["Bruno"])


def test_a_retracted_recognition_is_not_made_again(furnished, cut_out):
    semantic_map = furnished(("cup", cut_out("cup")))
    KnownThings().with_thing(taught("my mug", [cut_out("cup", 4.0)])).save(semantic_map.store.path)
    (found,) = recognise(semantic_map)
    semantic_map.assertions.retract(found.iri, "category", by="ann")
    assert recognise(semantic_map) == ()
    assert names(semantic_map) == ["cup"]


def test_other_things_are_not_called_by_a_taught_name(furnished, cut_out):
    semantic_map = furnished(("cup", cut_out("banana")), ("cup", cut_out("wine glass")))
    KnownThings().with_thing(taught("my mug", [cut_out("cup")])).save(semantic_map.store.path)
    assert recognise(semantic_map) == ()


def test_a_name_is_given_once_and_never_instead_of_what_people_said(furnished, cut_out):
    semantic_map = furnished(("cup", cut_out("cup")), ("cup", cut_out("cup", 3.0)))
    first, second = (record.iri for record in semantic_map.objects())
    KnownThings().with_thing(taught("my mug", [cut_out("cup", 1.0)])).save(semantic_map.store.path)
    semantic_map.assertions.add(first, "category", "bowl", by="ann")
    assert [one.iri for one in recognise(semantic_map)] == [second]
    assert recognise(semantic_map) == ()


def test_a_name_that_is_taken_back_is_forgotten(furnished, cut_out):
    semantic_map = furnished(("cup", cut_out("cup")))
    (cup,) = (record.iri for record in semantic_map.objects())
    semantic_map.assertions.add(cup, "name", "my mug", by="ann")
    remember_named(semantic_map)
    assert [one.name for one in KnownThings.load(semantic_map.store.path).things] == ["my mug"]
    semantic_map.assertions.retract(cup, "category", by="ann")
    remember_named(semantic_map)
    assert KnownThings.load(semantic_map.store.path).things == ()


def marked_picture() -> bytes:
    known = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    mark = np.full((150, 150), 255, np.uint8)
    mark[40:110, 40:110] = cv2.aruco.generateImageMarker(known, 17, 70)
    return cv2.imencode(".jpg", mark)[1].tobytes()


def test_a_mark_in_the_ontology_names_a_thing(furnished, cut_out):
    semantic_map = furnished(("cup", cut_out("cup")), ("book", marked_picture()))
    suitcase = semantic_map.catalogue.find("suitcase").iri
    marks = [(suitcase, "4x4_50/17"), (semantic_map.catalogue.find("vase").iri, "nonsense")]
    added = tuple(Quad(NamedNode(c), NamedNode(MARKER), Literal(mark)) for c, mark in marks)
    semantic_map.ontology.replace((*semantic_map.ontology.quads(), *added))
    (found,) = recognise(semantic_map)
    assert (found.name, found.likeness) == ("suitcase", 1.0)
    assert names(semantic_map) == ["cup", "suitcase"]


@pytest.mark.parametrize("mark", ["4x4_50", "4x4_50/50", "4x4_50/-1", "nonsense/1", ""])
def test_a_mark_that_does_not_exist_is_refused(mark):
    with pytest.raises(ModelError, match="marks"):
        marker_name(mark)


def test_nothing_is_written_where_nobody_named_anything(furnished, cut_out):
    semantic_map = furnished(("cup", cut_out("cup")))
    before, folder = semantic_map.sequence, semantic_map.store.path
    Mapper(semantic_map).flush()
    assert semantic_map.sequence == before
    assert not (folder / FILE).exists() and not (folder / "looks.npz").exists()


def test_a_file_with_other_numbers_is_damaged(tmp_path, cut_out):
    KnownThings().with_thing(taught("my mug", [cut_out("cup")])).save(tmp_path)
    arrays = dict(np.load(tmp_path / FILE))
    for features in (np.zeros((1, 3)), np.full((1, 1280), np.nan), np.zeros(1280)):
        np.savez(tmp_path / FILE, **{**arrays, "features": features})
        with pytest.raises(ModelError, match="damaged"):
            KnownThings.load(tmp_path)


def test_the_mapper_names_known_things_at_its_end_and_tells_a_damaged_file(furnished, cut_out):
    semantic_map = furnished(("cup", cut_out("cup")))
    folder = semantic_map.store.path
    (folder / FILE).write_bytes(b"damaged")
    damaged = Mapper(semantic_map)
    damaged.flush()
    assert "damaged" in damaged.problems[0] and names(semantic_map) == ["cup"]
    KnownThings().with_thing(taught("my mug", [cut_out("cup", 4.0)])).save(folder)
    Mapper(semantic_map).flush()
    assert names(semantic_map) == ["my mug"]

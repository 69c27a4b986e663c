"""Looks of objects: by words, and of moved ones."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from kg.maps.object_pictures import MAX_VIEWS, ObjectPictures
from kg.model.errors import ModelError
from kg.model.records import Evidence, MapUpdate
from kg.model.vocabulary import UNNAMED_THING
from kg.serving.opening import in_memory_map, open_map
from mapping.looks.known_things import KnownThings, MovedLooks, recognise, taught
from mapping.looks.look_store import LOOKS, LookStore
from mapping.looks.word_looks import alike, imagenet_classes, network
from mapping.objects.settings import ObjectSettings
from mapping.objects.tracks import track_of


def encoded(rgb: np.ndarray) -> bytes:
    return cv2.imencode(".jpg", rgb)[1].tobytes()


def with_view(record, number: int):
    shown = Evidence("room", f"view-{number}", 0.0, (0.0, 0.0, 9.0, 9.0), 0.9, "network")
    object.__setattr__(record, "evidence", shown)
    return record


def test_looks_are_kept_with_the_pictures_of_each_object(furnished, cut_out):
    semantic_map = furnished(("cup", cut_out("banana")), ("cup", cut_out("teddy bear")))
    banana, bear = (record.iri for record in semantic_map.objects())
    folder = semantic_map.store.path
    first = LookStore(folder, network()).of([banana, bear])
    written = (folder / LOOKS).stat().st_mtime_ns
    again = LookStore(folder, network()).of([bear, banana])
    assert (folder / LOOKS).stat().st_mtime_ns == written  # read, not computed again
    for iri in (banana, bear):
        assert np.allclose(first[iri], again[iri], atol=0.01)
    assert first[banana].shape == (1, 2280)


@pytest.mark.parametrize("damage", [b"", b"PK\x03\x04", b"x" * 1000])
def test_a_damaged_file_of_looks_is_computed_again(furnished, cut_out, damage):
    semantic_map = furnished(("cup", cut_out("banana")))
    (banana,) = (record.iri for record in semantic_map.objects())
    folder = semantic_map.store.path
    before = LookStore(folder, network()).of([banana])
    (folder / LOOKS).write_bytes(damage)
    assert np.array_equal(LookStore(folder, network()).of([banana])[banana], before[banana])


def test_looks_of_other_sizes_are_computed_again(furnished, cut_out):
    semantic_map = furnished(("cup", cut_out("banana")))
    (banana,) = (record.iri for record in semantic_map.objects())
    folder = semantic_map.store.path
    LookStore(folder, network()).of([banana])
    arrays = dict(np.load(folder / LOOKS))
    np.savez(folder / LOOKS, **{**arrays, "rows": np.zeros((1, 3))})
    assert LookStore(folder, network()).of([banana])[banana].shape == (1, 2280)


def test_former_best_views_stay_up_to_a_limit(furnished, cut_out):
    semantic_map = furnished(("cup", cut_out("banana")))
    (record,) = semantic_map.objects()
    pictures = ObjectPictures(semantic_map.store.path)
    for number in range(6):
        pictures.write(with_view(record, number), cut_out("banana", float(number)))
    assert len(pictures.views_of(record.iri)) == MAX_VIEWS
    looks = LookStore(semantic_map.store.path, network()).of([record.iri])[record.iri]
    assert looks.shape == (MAX_VIEWS, 2280)
    pictures.remove(record.iri)
    assert LookStore(semantic_map.store.path, network()).of([record.iri]) == {}


def test_former_views_are_dropped_before_the_last_picture_of_an_object(
    furnished, cut_out, monkeypatch
):
    semantic_map = furnished(("cup", cut_out("banana")), ("cup", cut_out("cup")))
    first, second = semantic_map.objects()
    pictures = ObjectPictures(semantic_map.store.path)
    for number in range(3):
        pictures.write(with_view(second, number), cut_out("cup", float(number)))
    monkeypatch.setattr("kg.maps.object_pictures.MAX_PICTURES", 2)
    pictures.limit()
    assert len(pictures.views_of(first.iri)) == len(pictures.views_of(second.iri)) == 1


def test_a_picture_of_nothing_has_no_looks(furnished):
    grey = np.full((60, 60, 3), 128, np.uint8)
    semantic_map = furnished(("cup", encoded(grey)), ("cup", b"no picture at all"))
    iris = [record.iri for record in semantic_map.objects()]
    assert LookStore(semantic_map.store.path, network()).of(iris) == {}
    with pytest.raises(ModelError, match="shows nothing"):
        taught("grey", [encoded(grey)])


def test_things_are_ordered_by_what_a_word_means(furnished, cut_out):
    semantic_map = furnished(
        ("cup", cut_out("banana")), ("cup", cut_out("teddy bear")), ("cup", cut_out("cup"))
    )
    banana, bear, mug = (record.iri for record in semantic_map.objects())
    for synset, iri in (("banana.n.02", banana), ("teddy.n.01", bear), ("coffee_mug.n.01", mug)):
        assert alike(semantic_map, "", synset).things[0].iri == iri


def test_nothing_looks_like_a_thing_that_is_not_there(furnished, cut_out):
    semantic_map = furnished(("cup", cut_out("banana")), ("cup", cut_out("teddy bear")))
    assert alike(semantic_map, "printer", "printer.n.03").things == ()
    assert alike(semantic_map, "", "no_such_word.n.01") is None


def test_things_without_a_name_are_compared_too(furnished, cut_out):
    semantic_map = furnished(("cup", cut_out("banana")))
    (record,) = semantic_map.perceived.objects()
    semantic_map.apply(MapUpdate((replace(record, category=UNNAMED_THING),)))
    assert semantic_map.objects() == ()
    (found,) = alike(semantic_map, "banana", "banana.n.02").things
    assert found.iri == record.iri
    KnownThings().with_thing(taught("my banana", [cut_out("banana", 4.0)])).save(
        semantic_map.store.path
    )
    recognise(semantic_map)
    (named,) = semantic_map.objects()
    assert semantic_map.catalogue.label(named.category) == "my banana"
    assert semantic_map.assertions.conflicts() == ()


def test_a_map_in_memory_has_no_looks():
    with in_memory_map(base="https://example.org/map/") as semantic_map:
        assert alike(semantic_map, "banana", "banana.n.02") is None


def test_a_map_open_for_reading_can_be_asked(furnished, cut_out):
    semantic_map = furnished(("cup", cut_out("banana")))
    folder = semantic_map.store.path
    semantic_map.close()
    with open_map(folder, read_only=True) as reading:
        assert len(alike(reading, "banana", "banana.n.02").things) == 1


def test_every_class_is_one_of_the_thousand():
    classes = imagenet_classes()
    assert "wallet.n.01" in classes
    assert all(0 <= number < 1000 for numbers in classes.values() for number in numbers)


@pytest.fixture
def tracks(furnished):
    """Callable: (category, picture) ... -> looks of such a map, and tracks of its things."""

    def tracked(*things):
        semantic_map = furnished(*things)
        looks = MovedLooks(semantic_map.store.path, lambda shown: None)
        objects = semantic_map.objects()
        return looks, [track_of(one, ObjectSettings(), lambda category: None) for one in objects]

    return tracked


def test_a_thing_that_looks_the_same_is_likelier_it_than_one_that_does_not(tracks, cut_out):
    shown = [cut_out("banana"), cut_out("banana", 4.0), cut_out("other banana")]
    looks, (old, same, other) = tracks(*(("banana", picture) for picture in shown))
    assert looks.ratio(old, same, [other]) > 5 and looks.ratio(other, same, [old]) < 0.2


def test_a_thing_as_alike_as_another_one_says_little(tracks, cut_out):
    bears = [("teddy bear", cut_out("teddy bear", moved)) for moved in (0.0, 6.0, 12.0)]
    looks, (old, new, rival) = tracks(*bears)
    assert 1 / 3 < looks.ratio(old, new, [rival]) < 3


def test_without_a_picture_or_another_thing_looks_say_nothing(tracks, cut_out):
    looks, (old, new, other) = tracks(*[("cup", cut_out("cup"))] * 2, ("cup", b"damaged"))
    assert looks.ratio(old, new, []) == looks.ratio(old, new, [other]) == 1.0
    assert looks.ratio(old, other, [new]) == 1.0

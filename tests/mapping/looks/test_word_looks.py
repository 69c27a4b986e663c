from __future__ import annotations

from dataclasses import replace

from kg.model.records import MapUpdate
from kg.model.vocabulary import UNNAMED_THING
from kg.serving.opening import in_memory_map, open_map
from mapping.looks.known_things import KnownThings, recognise, taught
from mapping.looks.word_looks import imagenet_classes, things_that_look_like


def test_things_are_ordered_by_what_a_word_means(furnished, cut_out):
    semantic_map = furnished(
        ("cup", cut_out("banana")), ("cup", cut_out("teddy bear")), ("cup", cut_out("cup"))
    )
    banana, bear, mug = (record.iri for record in semantic_map.objects())
    for synset, iri in (("banana.n.02", banana), ("teddy.n.01", bear), ("coffee_mug.n.01", mug)):
        assert things_that_look_like(semantic_map, synset)[0].iri == iri


def test_nothing_looks_like_a_thing_that_is_not_there(furnished, cut_out):
    semantic_map = furnished(("cup", cut_out("banana")), ("cup", cut_out("teddy bear")))
    assert things_that_look_like(semantic_map, "printer.n.03") == ()
    assert things_that_look_like(semantic_map, "no_such_word.n.01") is None


def test_things_without_a_name_are_compared_too(furnished, cut_out):
    semantic_map = furnished(("cup", cut_out("banana")))
    (record,) = semantic_map.perceived.objects()
    semantic_map.apply(MapUpdate((replace(record, category=UNNAMED_THING),)))
    assert semantic_map.objects() == ()
    (found,) = things_that_look_like(semantic_map, "banana.n.02")
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
        assert things_that_look_like(semantic_map, "banana.n.02") is None


def test_a_map_open_for_reading_can_be_asked(furnished, cut_out):
    semantic_map = furnished(("cup", cut_out("banana")))
    folder = semantic_map.store.path
    semantic_map.close()
    with open_map(folder, read_only=True) as reading:
        assert len(things_that_look_like(reading, "banana.n.02")) == 1


def test_every_class_is_one_of_the_thousand():
    classes = imagenet_classes()
    assert "wallet.n.01" in classes
    assert all(0 <= number < 1000 for numbers in classes.values() for number in numbers)

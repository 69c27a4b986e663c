from __future__ import annotations

import cv2
import numpy as np
import pytest

from kg.maps.object_pictures import MAX_VIEWS, ObjectPictures
from kg.model.errors import ModelError
from kg.model.records import Evidence
from mapping.looks.object_looks import FILE, Looks, ObjectLooks


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
    first = ObjectLooks(folder).of([banana, bear])
    written = (folder / FILE).stat().st_mtime_ns
    again = ObjectLooks(folder).of([bear, banana])
    assert (folder / FILE).stat().st_mtime_ns == written  # read, not computed again
    for iri in (banana, bear):
        assert np.allclose(first[iri].features, again[iri].features, atol=0.01)
    assert first[banana].features.shape == (1, 1280)


@pytest.mark.parametrize("damage", [b"", b"PK\x03\x04", b"x" * 1000])
def test_a_damaged_file_of_looks_is_computed_again(furnished, cut_out, damage):
    semantic_map = furnished(("cup", cut_out("banana")))
    (banana,) = (record.iri for record in semantic_map.objects())
    folder = semantic_map.store.path
    before = ObjectLooks(folder).of([banana])
    (folder / FILE).write_bytes(damage)
    assert np.array_equal(
        ObjectLooks(folder).of([banana])[banana].features, before[banana].features
    )


def test_looks_of_other_sizes_are_computed_again(furnished, cut_out):
    semantic_map = furnished(("cup", cut_out("banana")))
    (banana,) = (record.iri for record in semantic_map.objects())
    folder = semantic_map.store.path
    ObjectLooks(folder).of([banana])
    arrays = dict(np.load(folder / FILE))
    np.savez(folder / FILE, **{**arrays, "features": np.zeros((1, 3))})
    assert ObjectLooks(folder).of([banana])[banana].features.shape == (1, 1280)


def test_former_best_views_stay_up_to_a_limit(furnished, cut_out):
    semantic_map = furnished(("cup", cut_out("banana")))
    (record,) = semantic_map.objects()
    pictures = ObjectPictures(semantic_map.store.path)
    for number in range(6):
        pictures.write(with_view(record, number), cut_out("banana", float(number)))
    assert len(pictures.views_of(record.iri)) == MAX_VIEWS
    looks = ObjectLooks(semantic_map.store.path).of([record.iri])[record.iri]
    assert looks.features.shape == (MAX_VIEWS, 1280)
    pictures.remove(record.iri)
    assert ObjectLooks(semantic_map.store.path).of([record.iri]) == {}


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
    assert ObjectLooks(semantic_map.store.path).of(iris) == {}
    with pytest.raises(ModelError, match="shows nothing"):
        Looks.of_pictures([encoded(grey)])

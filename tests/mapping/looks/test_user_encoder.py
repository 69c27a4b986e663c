"""The user's encoder: texts against real crops, absent words, and maps of other encoders."""

import csv
import os

import numpy as np
import pytest

from kg.maps.object_pictures import MAX_VIEWS, ObjectPictures
from kg.model.errors import ModelError
from kg.model.records import MapUpdate
from kg.serving.opening import open_map
from mapping.looks.look_store import ENCODED, LookStore, kept_embeddings
from mapping.looks.user_encoder import (
    check_same,
    encoder_of,
    given_words,
    listed_words,
    remembered,
    share_refused,
)
from mapping.looks.word_looks import alike, compares_texts, looks_of
from tests.encoder_files import write_colour_pair
from tests.mapping.looks.conftest import add_things

KNOWN = ["red", "green", "blue", "cup"]


@pytest.fixture(autouse=True)
def _own_cache(tmp_path, monkeypatch):
    monkeypatch.setenv("HEREABOUTS_CACHE", str(tmp_path / "cache"))


@pytest.fixture
def seen(furnished, cut_out, class_pair):
    """A map on disk with bananas, a mug and a glass, all detected as cups, and its encoder."""
    shown = ("banana", "other banana", "cup", "wine glass")
    semantic_map = furnished(*(("cup", cut_out(name)) for name in shown))
    encoder = remembered(class_pair)
    settle(semantic_map, encoder)
    return semantic_map, encoder


def settle(semantic_map, encoder, known=()):
    iris = [record.iri for record in semantic_map.objects()]
    LookStore(semantic_map.store.path, encoder, ENCODED).settle(iris, [], dict(known))


@pytest.mark.parametrize(
    ("text", "number"), [("banana", 0), ("coffee mug", 2), ("goblet", 3), ("a red wine", 3)]
)
def test_texts_order_things_by_their_looks(seen, text, number):
    semantic_map, encoder = seen
    found = alike(semantic_map, text)
    assert found.encoder == encoder.name
    assert found.things[0].iri == semantic_map.objects()[number].iri


def test_nothing_looks_like_nine_in_ten_of_fifty_absent_words(seen, shared):
    """Words of ImageNet's animals, none of which the threshold was fitted to."""
    semantic_map, encoder = seen
    with shared("bundled/words/imagenet_synsets.csv").open(encoding="utf-8") as file:
        names = [row["name"] for row in csv.DictReader(file) if int(row["index"]) < 398]
    names = [name for name in names if "-" not in name]
    words = [*[name for name in names if name not in encoder.words][::6][:49], "unicorn"]
    assert len(words) == 50 and not {*words[:-1]} & {*encoder.words}
    rows = looks_of(semantic_map, [one.iri for one in semantic_map.objects()], encoder)
    found = [encoder.scores(word, "", list(rows.values())) for word in words]
    nothing = [scores.max() < least for scores, least in found]
    assert sum(nothing) >= 45 and nothing[-1]
    assert not alike(semantic_map, "unicorn").things
    assert share_refused(list(rows.values()), encoder) >= 0.9


def test_embeddings_are_bounded_and_follow_the_pictures(seen, cut_out, class_pair):
    semantic_map, encoder = seen
    folder = semantic_map.store.path
    banana, other, *_ = (record.iri for record in semantic_map.objects())
    pictures = ObjectPictures(folder)
    before = kept_embeddings(folder, [other])[1][other]
    pictures.join(banana, other)  # as where a merge finds that both are one thing
    _, found = kept_embeddings(folder, [banana, other])
    assert {*found} == {banana} and any(np.allclose(row, before[0]) for row in found[banana])
    for number in range(6):
        record = semantic_map.objects()[0]
        object.__setattr__(record.evidence, "frame", f"view-{number}")
        pictures.write(record, cut_out("banana", float(number)))
    settle(semantic_map, encoder)
    assert len(kept_embeddings(folder, [banana])[1][banana]) == 1  # the best view; the others ...
    assert len(looks_of(semantic_map, [banana], encoder)[banana]) == MAX_VIEWS  # ... when asked for
    kept, found = kept_embeddings(folder, [banana])
    assert len(found[banana]) == MAX_VIEWS and len(kept.rows) == MAX_VIEWS + 2
    with np.load(folder / ENCODED) as data:
        assert data["rows"].dtype == np.float16
    sequence = semantic_map.sequence
    semantic_map.apply(MapUpdate(removed=(banana,)))
    assert banana not in {one.iri for one in alike(semantic_map, "banana").things}
    semantic_map.restore(f"#{sequence}")
    assert alike(semantic_map, "banana").things[0].iri == banana


def test_a_map_of_another_encoder_never_compares(seen, tmp_path):
    semantic_map, encoder = seen
    other = remembered(write_colour_pair(tmp_path / "other"), _words(tmp_path / "other"))
    with pytest.raises(ModelError, match=f"made with the encoder {encoder.name}"):
        check_same(semantic_map.store.path, other)
    rows = LookStore(semantic_map.store.path, other, ENCODED)._load(
        semantic_map.store.path / ENCODED
    )
    assert rows == {}
    assert encoder_of(semantic_map.store.path).checksum == encoder.checksum


def _words(folder) -> list[str]:
    """Texts that the small tokenizer knows, enough to fit to."""
    return [" ".join([a, b, c]) for a in KNOWN for b in KNOWN for c in KNOWN][:40]


def test_files_that_moved_or_changed_are_asked_for(tmp_path, furnished, cut_out, make_object):
    files = write_colour_pair(tmp_path / "mine")
    encoder = remembered(files, _words(tmp_path))
    semantic_map = furnished(("cup", cut_out("banana")))
    assert not compares_texts(semantic_map)
    settle(semantic_map, encoder)
    assert alike(semantic_map, "red") is not None
    from mapping.looks import user_encoder

    user_encoder._opened.clear()
    (tmp_path / "mine" / "image.onnx").touch()  # another time, and the same content
    assert alike(semantic_map, "red") is not None
    user_encoder._opened.clear()
    (tmp_path / "mine").rename(tmp_path / "moved")
    with pytest.raises(ModelError, match="models check --encoder FILE"):
        alike(semantic_map, "red")
    remembered(files.replace("mine", "moved"))
    assert alike(semantic_map, "red") is not None


def test_files_that_are_as_they_were_are_not_opened_again(tmp_path):
    files, image = write_colour_pair(tmp_path), tmp_path / "image.onnx"
    before = remembered(files, _words(tmp_path))
    state = image.stat()
    image.write_bytes(bytes(state.st_size))  # no network any more, by nothing but its content
    os.utime(image, ns=(state.st_atime_ns, state.st_mtime_ns))
    assert remembered(files).checksum == before.checksum
    image.touch()
    with pytest.raises(ModelError, match="no ONNX network"):
        remembered(files)


def test_words_to_fit_to_are_enough_and_known(tmp_path):
    files = write_colour_pair(tmp_path / "mine")
    for words in (["red", "blue"], ["unicorn"] * 50, None):
        with pytest.raises(ModelError, match="fitted to 20 to 1000 absent words"):
            remembered(files, words)
    with pytest.raises(ModelError, match=r"no file of words .*none\.txt; .* would work"):
        given_words(str(tmp_path / "none.txt"))
    words = listed_words()
    assert len(words) == len({*words}) >= 150 and words == sorted(words)


@pytest.mark.parametrize("damage", [b"", b"x" * 1000])
def test_a_damaged_file_of_embeddings_is_like_none(seen, damage):
    semantic_map, encoder = seen
    (semantic_map.store.path / ENCODED).write_bytes(damage)
    assert encoder_of(semantic_map.store.path) is None
    settle(semantic_map, encoder)
    assert alike(semantic_map, "banana").things


def test_a_map_open_for_reading_is_not_written(seen, make_object, cut_out):
    semantic_map, encoder = seen
    folder = semantic_map.store.path
    new = add_things(semantic_map, make_object, ("cup", cut_out("teddy bear")), recording="later")
    semantic_map.close()
    written = (folder / ENCODED).read_bytes()
    with open_map(folder, read_only=True) as reading:
        assert looks_of(reading, new, encoder)[new[0]].shape == (1, 1000)
    assert (folder / ENCODED).read_bytes() == written

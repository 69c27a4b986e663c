"""A map with the user's encoder, at every door: command line, questions, page and agents."""

import asyncio
import json
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from mcp import Client

from hereabouts.agents.map_context import MapContext
from hereabouts.agents.tool_server import tool_server
from hereabouts.cli import main
from kg.maps.object_pictures import MAX_VIEW_BYTES
from kg.serving.opening import open_map
from kg.serving.workers.local_evaluation import LimitedQueries
from mapping.looks.look_store import ENCODED, kept_looks
from planner.questions.answers import answer_box, answer_question
from tests.encoder_files import COLOURS, write_colour_pair
from tests.hereabouts.cli.conftest import _copy_kitchen

#: what is in the kitchen, and no word that is known here
DRINKWARE = "drinkware"
_WORDS = [f"{a} {b} {c}" for a in COLOURS for b in COLOURS for c in COLOURS][:30]


@pytest.fixture(scope="session")
def encoded_kitchen(shared, class_pair, tmp_path_factory):
    """The map of eight frames of the kitchen, with an encoder, and the cache that knows it."""
    folder = tmp_path_factory.mktemp("encoded")
    kitchen = _copy_kitchen(shared("data/rgbd/redkitchen"), folder / "kitchen")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("HEREABOUTS_CACHE", str(folder / "cache"))
        words = [
            "map",
            kitchen,
            "--no-check",
            "--into",
            folder / "kitchen.map",
            "--encoder",
            class_pair,
        ]
        assert main([str(word) for word in words]) == 0
    return folder / "kitchen.map"


@pytest.fixture
def encoded(encoded_kitchen: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of it that a test may change."""
    monkeypatch.setenv("HEREABOUTS_CACHE", str(encoded_kitchen.parent / "cache"))
    return shutil.copytree(encoded_kitchen, tmp_path / "kitchen.map")


def test_things_and_views_have_embeddings_and_describe_tells_their_size(encoded, prints):
    kept = kept_looks(encoded / ENCODED)
    assert kept is not None
    pictures = {path.name for path in (encoded / "pictures").iterdir()}
    views = {name for name in pictures if name.startswith("view-")}
    assert views and len(kept.rows) >= len(views) + 3
    assert all((encoded / "pictures" / v).stat().st_size <= MAX_VIEW_BYTES for v in views)
    told = json.loads(prints("describe", encoded, "--json"))["encoder"]
    assert told["embeddings"] == len(kept.rows) and told["bytes"] < 500_000
    assert f"{len(kept.rows)} embeddings in" in prints("describe", encoded)


def test_find_orders_by_looks_what_no_word_is_for(encoded, prints, fails):
    told = prints("find", encoded, DRINKWARE, "--from", "0,0")
    assert f"'{DRINKWARE}' is no word" in told and "look" in told and "says the encoder" in told
    whole = prints("find", encoded, "red drinkware", "--from", "0,0")
    assert prints("find", encoded, "red", "drinkware", "--from", "0,0") == whole
    assert "'red drinkware' is no word" in whole
    (answer,) = json.loads(prints("find", encoded, DRINKWARE, "--json"))["undetectable"]
    assert answer["looks_like"] and answer["encoder"]
    for view in answer["views_like"]:
        assert view["recording"] == "kitchen" and -3.2 < view["heading"] < 3.2
    assert "Nothing here looks like it" in prints("find", encoded, "unicorn", "--from", "0,0")
    assert "does not know the words" in fails("find", encoded, "чашка чая", "--from", "0,0")
    assert "100 characters, got 10,000" in fails("find", encoded, "x" * 10_000, "--from", "0,0")
    assert "kind of place" in fails("find", encoded, "kitchen", "--from", "0,0")


def test_a_known_word_is_found_as_before_and_its_looks_are_a_line_more(
    encoded: Path, kitchen_map: Path, prints: Callable[..., str]
) -> None:
    told = prints("find", encoded, "coffee mug", "--from", "0,0", "--explain")
    plain = prints("find", kitchen_map, "coffee mug", "--from", "0,0", "--explain")
    assert "'coffee mug'" in told and "says the encoder" in told
    assert "says the encoder" not in plain and "encoder" not in prints("find", kitchen_map, "cup")
    assert "says the encoder" not in prints("find", encoded, "cup")


def test_nine_in_ten_absent_words_look_like_nothing(encoded, class_pair, prints, tmp_path):
    told = json.loads(prints("models", "check", encoded, "--encoder", class_pair, "--json"))
    assert told["things"] >= 3 and told["nothing_looks_like"] >= 0.9
    words = tmp_path / "words.txt"
    words.write_text("\n".join(["zebra", "lion", "tiger", "hen"] * 9))
    for given in (words, "zebra,lion"):
        check = ["models", "check", "--encoder", class_pair, "--negatives", str(given)]
        assert main(check) == 1  # too few


def test_questions_page_and_agents_tell_the_same(encoded: Path) -> None:
    async def asked(server, tool: str, **arguments):
        async with Client(server) as client:
            return await client.call_tool(tool, arguments)

    with open_map(encoded, read_only=True) as semantic_map, LimitedQueries(semantic_map) as some:
        (line,) = answer_question(semantic_map, f"where is the {DRINKWARE}?").lines
        assert "says the encoder" in line
        for words in (f"what looks like red {DRINKWARE}?", f"etwas, das wie {DRINKWARE} aussieht"):
            said = " ".join(answer_question(semantic_map, words).lines)
            assert "look" in said and "says the encoder" in said and "does not keep" not in said
        (line,) = answer_question(semantic_map, "is there anything that looks like a unicorn").lines
        assert "Nothing here looks like 'unicorn'" in line
        for words in (DRINKWARE, f"where is the {DRINKWARE}?"):
            box = answer_box(semantic_map, [words])
            first = box["answer"][1]
            assert "says the encoder" in first
            assert any(one["name"] in first for one in box["about"] if "/object/" in one["iri"])
        server = tool_server(MapContext(semantic_map), some)
        found = asyncio.run(asked(server, "where_is", what=DRINKWARE))
        assert "says the encoder" in str(found.structured_content)
        seen = asyncio.run(asked(server, "picture", like="dining table"))
        assert not seen.is_error, seen
        assert {one.type for one in seen.content} == {"text", "image"}
        assert "heading" in str(seen.structured_content)
        nothing = asyncio.run(asked(server, "picture", like="unicorn"))
        assert nothing.is_error and "no view looks like" in str(nothing.content)


def test_labels_name_things_by_a_list_of_ones_own(encoded, prints, fails, kitchen_map):
    names = "entertainment center, dishwasher, microwave, monitor, screen, chair, zebra, unicorn"
    told = json.loads(prints("labels", encoded, names, "--json"))
    assert told["named"] and not {"zebra", "unicorn"} & {one["name"] for one in told["named"]}
    with open_map(encoded) as semantic_map:
        listed = json.loads(prints("ask", encoded, "assertions", "--json"))
        asserted = semantic_map.assertions.all()  # the label of a name that is a word, too
        assert len(listed) == len(asserted)
        made = {a.subject for a in asserted if a.by == "looks"}
        assert made == {one["iri"] for one in told["named"]}
        for iri in made:
            semantic_map.assertions.retract(iri, "category", by="ann")
    assert json.loads(prints("labels", encoded, names, "--json"))["named"] == []
    assert "has no encoder" in fails("labels", kitchen_map, "kettle")
    assert "kind of place" in fails("labels", encoded, "kitchen")


def test_embeddings_leave_only_when_they_are_asked_for(encoded, prints, fails, tmp_path):
    for name in ("map.ttl", "map.jsonld", "map.geojson", "map.nq"):
        prints("export", encoded, "-o", tmp_path / name)
        assert "embedding" not in (tmp_path / name).read_text("utf-8")
    features = tmp_path / "features.npz"
    prints("export", encoded, "-o", tmp_path / "map.nt", "--features", features)
    with np.load(features) as data:
        assert data["embedding"].shape == (len(data["iri"]), 1000)
        assert np.allclose(np.linalg.norm(data["embedding"].astype(float), axis=1), 1, atol=0.01)
    (encoded / ENCODED).unlink()
    refused = ("export", encoded, "-o", tmp_path / "map.nt", "--features", features)
    assert "keeps no embeddings" in fails(*refused)


def test_another_encoder_is_refused_and_the_map_stays(
    encoded: Path, kitchen: Path, class_pair: str, fails: Callable[..., str], tmp_path: Path
) -> None:
    other = write_colour_pair(tmp_path / "other")
    words = tmp_path / "words.txt"
    words.write_text("\n".join(_WORDS))
    assert main(["models", "check", "--encoder", other, "--negatives", str(words)]) == 0
    before = (encoded / ENCODED).read_bytes(), (encoded / "history.sqlite").read_bytes()
    again = ("map", kitchen, "--into", encoded, "--again", "--encoder")
    assert "embeddings do not compare" in fails(*again, other)
    assert "text encoder is missing" in fails(*again, other.partition(",")[0])
    assert "embeddings do not compare" in fails("models", "check", encoded, "--encoder", other)
    assert before == ((encoded / ENCODED).read_bytes(), (encoded / "history.sqlite").read_bytes())
    new = ("map", kitchen, "--into", tmp_path / "new.map", "--encoder", f"{other},{other}")
    assert "clip.onnx or image.onnx,text.onnx" in fails(*new)
    assert not (tmp_path / "new.map").exists()


def test_a_map_without_an_encoder_gets_one_by_mapping_again(
    kitchen: Path, kitchen_map: Path, class_pair: str, tmp_path: Path, prints: Callable[..., str]
) -> None:
    path = shutil.copytree(kitchen_map, tmp_path / "kitchen.map")
    prints("map", kitchen, "--no-check", "--into", path, "--encoder", class_pair)
    kept = kept_looks(path / ENCODED)
    assert kept is not None and kept.rows


def test_a_machine_without_the_encoder_tells_which_it_was(encoded, fails, tmp_path, monkeypatch):
    from mapping.looks import user_encoder

    monkeypatch.setattr(user_encoder, "_opened", {})
    monkeypatch.setenv("HEREABOUTS_CACHE", str(tmp_path / "empty"))
    line = fails("find", encoded, DRINKWARE, "--from", "0,0")
    assert "is not known on this machine; `hereabouts models check --encoder FILE`" in line

"""`hereabouts teach MAP thing`."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from hereabouts.cli import main
from kg.serving.opening import create_map


@pytest.fixture
def den(tmp_path: Path) -> Path:
    path = tmp_path / "den.map"
    create_map(path, base="http://m/").close()
    return path


def test_a_thing_is_taught_by_pictures(den, prints, shared):
    picture = shared("data/images/coco_val64/images/000000002592.jpg")
    told = json.loads(prints("teach", den, "thing", "my mug", picture, picture, "--json"))
    assert told == {"thing": "my mug", "pictures": 2, "marker": "", "known": ["my mug"]}
    told = json.loads(prints("teach", den, "thing", "my box", "--marker", "4X4_50/7", "--json"))
    assert (told["marker"], told["known"]) == ("4x4_50/7", ["my mug", "my box"])


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["my mug"], "no pictures of 'my mug'"),
        (["my mug", "missing.jpg"], "cannot read missing.jpg"),
        (["my mug", "EMPTY"], "no images in"),
        (["my mug", "GREY"], "shows nothing"),
        (["my mug", "TEXT"], "cannot be decoded"),
        (["<b>", "GREY"], "plain text"),
        (["kitchen", "GREY"], "kind of place"),
        (["my mug", "--marker", "99"], "no marks '99'"),
    ],
)
def test_bad_teaching_is_refused_in_one_line(den, tmp_path, capsys, words, message):
    files = {name: tmp_path / name for name in ("EMPTY", "GREY", "TEXT")}
    files["EMPTY"].mkdir()
    grey = np.full((50, 50, 3), 100, np.uint8)
    files["GREY"].write_bytes(cv2.imencode(".png", grey)[1].tobytes())
    files["TEXT"].write_text("no picture")
    given = [str(files.get(word, word)) for word in words]
    assert main(["teach", str(den), "thing", *given]) == 1
    error = capsys.readouterr().err
    assert message in error and error.count("\n") == 1
    assert not (den / "known_things.npz").exists()

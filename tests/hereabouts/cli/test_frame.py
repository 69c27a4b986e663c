"""Two maps of one room, laid on each other by their objects."""

import math
from pathlib import Path

import numpy as np
import pytest

from hereabouts.cli import main
from kg.model.records import MapUpdate, ObjectRecord
from kg.serving.opening import create_map, open_map
from kg.serving.publishing import merged

LABELS = ("cup", "chair", "couch", "tv", "book", "laptop", "clock", "vase", "bed", "toaster")


@pytest.fixture
def rooms(tmp_path: Path) -> tuple[str, str]:
    """The same ten things in the frames of two robots."""
    rng = np.random.default_rng(4)
    positions = rng.uniform(-4, 4, (len(LABELS), 2))
    c, s = math.cos(0.6), math.sin(0.6)
    turned = (positions - (3.0, -1.0)) @ np.array([[c, -s], [s, c]])
    for name, xy in (("one", positions), ("other", turned)):
        with create_map(tmp_path / name, base=f"https://example.org/{name}/", title=name) as made:
            things = [
                ObjectRecord(
                    made.new_object_iri(),
                    made.catalogue.find(label).iri,
                    np.array([x, y, 0.8]),
                    1.0,
                    0.9,
                    5,
                    0.0,
                    1e9,
                )
                for label, (x, y) in zip(LABELS, xy, strict=True)
            ]
            made.apply(MapUpdate(objects=tuple(things)))
    return str(tmp_path / "one"), str(tmp_path / "other")


def test_align_writes_the_transform_between_the_frames(rooms: tuple[str, str]) -> None:
    one, other = rooms
    assert main(["describe", other, "--relative-to", one, "--align", "--by", "ann"]) == 0
    with merged(rooms) as both:
        for label in LABELS:
            first, second = both.objects(label)
            assert np.allclose(first.p_map, second.p_map, atol=0.1), label


def test_maps_with_nothing_in_common_are_not_aligned(rooms, tmp_path, capsys):
    create_map(tmp_path / "empty").close()
    words = [
        "describe",
        str(tmp_path / "empty"),
        "--relative-to",
        rooms[0],
        "--align",
        "--by",
        "ann",
    ]
    assert main(words) == 1
    assert "--pose X,Y,Z,DEG would work" in capsys.readouterr().err
    with open_map(tmp_path / "empty") as empty:
        assert empty.sequence == 0

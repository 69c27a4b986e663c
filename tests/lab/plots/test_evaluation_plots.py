"""Pictures of an evaluation: what is written, where outlines lie, which paths are refused."""

from pathlib import Path

import numpy as np
import pytest

from kg.model.errors import PictureError
from lab.maps.complete_truth import TrueObject
from lab.maps.map_evaluation import calibration
from lab.maps.truth_matching import MappedObject, TruthMatcher
from lab.plots.reliability_plot import plot_reliability
from lab.plots.truth_plot import plot_truth, truth_outline


def texts_of(svg: Path) -> list[str]:
    """Everything written in a drawing; matplotlib notes each text beside its outline."""
    lines = (line.strip() for line in svg.read_text().splitlines())
    return [line[5:-4] for line in lines if line.startswith("<!-- ") and line.endswith(" -->")]


def mapped(label: str, x: float, y: float) -> MappedObject:
    return MappedObject(label, np.array([x, y, 0.5]), 0.9)


def true(name: str, label: str, x: float, y: float, **more: object) -> TrueObject:
    return TrueObject(name, label, np.array([x, y, 0.5]), **more)  # type: ignore[arg-type]


@pytest.fixture
def matcher() -> TruthMatcher:
    return TruthMatcher(
        [
            true("table", "dining table", 2, 2, extent=(2.0, 1.0, 0.7)),
            true("left chair", "chair", 0, 2),
            true("right_chair", "chair", 4, 2),
            true("tin_box", "not coco", 4, 0, ignore=True, extent=(0.3, 0.2, 0.2)),
            true("plant", "vase", 0, 0, ignore=True),
        ],
        np.eye(4),
    )


def test_every_kind_of_object_is_written_and_counted(matcher: TruthMatcher, tmp_path: Path) -> None:
    objects = [
        mapped("dining table", 2, 2.1),
        mapped("dining table", 2.5, 1.5),
        mapped("chair", 0.1, 2),
        mapped("suitcase", 4, 0.1),
        mapped("laptop", 0.2, 2.1),
        mapped("umbrella", 9, 9),
        mapped("vase", 0, 0.1),
    ]
    matching = matcher.match(objects)
    written = texts_of(plot_truth(matching, matcher, tmp_path / "a.svg", title="our kitchen"))
    assert "our kitchen" in written
    counts = ("true 2", "missed 1", "duplicate 1", "wrong label 2", "ghost 1", "ignored 1")
    assert set(counts) <= set(written)
    # names of ignored things that no label fits say what the wrong label is near
    for text in ("suitcase (near tin box)", "laptop (near chair)", "umbrella", "vase"):
        assert text in written
    assert written.count("chair") == written.count("dining table") == 2
    assert any("2 of 3 true objects" in text and "precision 0.33" in text for text in written)


def test_empty_maps_and_truths_are_pictures_too(tmp_path: Path) -> None:
    for number, (truth, objects) in enumerate(
        [([], []), ([true("a", "cup", 0, 0)], []), ([], [mapped("cup", 0, 0)])]
    ):
        matcher = TruthMatcher(truth, np.eye(4))
        matching = matcher.match(objects)
        path = plot_truth(matching, matcher, tmp_path / f"{number}.svg", title="few")
        assert "few" in texts_of(path)


def test_extents_turn_with_the_world_of_the_truth() -> None:
    T = np.eye(4)
    T[:2, :2] = [[0, -1], [1, 0]]
    T[:3, 3] = [10, 0, 0]
    matcher = TruthMatcher([true("table", "dining table", 2, 1, extent=(2.0, 1.0, 0.7))], T)
    corners = truth_outline(matcher, 0)
    assert corners.min(axis=0) == pytest.approx([9 - 0.5, 2 - 1.0])
    assert corners.max(axis=0) == pytest.approx([9 + 0.5, 2 + 1.0])


def test_reliability_names_each_calibration_with_its_error(tmp_path: Path) -> None:
    matcher = TruthMatcher([true("a", "cup", 0, 0)], np.eye(4))
    some = calibration([matcher.match([mapped("cup", 0, 0), mapped("cup", 7, 0)])])
    none = calibration([matcher.match([])])
    path = plot_reliability([("bayes", some), ("none", none)], tmp_path / "r.svg", title="houses")
    written = texts_of(path)
    assert {"houses", "bayes: ECE 0.400, 2 objects", "none: no objects"} <= set(written)


def test_another_ending_is_refused(matcher: TruthMatcher, tmp_path: Path) -> None:
    with pytest.raises(PictureError, match=r"\.png, \.svg or \.pdf would work"):
        plot_truth(matcher.match([]), matcher, tmp_path / "a.bmp", title="x")
    with pytest.raises(PictureError, match=r"\.png, \.svg or \.pdf would work"):
        plot_reliability([], tmp_path / "a", title="x")

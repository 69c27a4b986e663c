"""Drawn detections, and masks."""

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst

from kg.model.errors import RecordingError
from perception.annotate import draw_detections, label_colour, save_image
from perception.binary_masks import connected_components, distance_to_walls, runs, with_neighbours
from perception.frames import Detections, Frame, SceneScores


@pytest.fixture
def frame() -> Frame:
    return Frame(
        id="1",
        rgb=np.full((240, 320, 3), 40, np.uint8),
        depth=np.ones((240, 320), np.float32),
        K=np.eye(3),
        T_map_cam=np.eye(4),
        stamp=0.0,
    )


def found(*boxes: tuple[float, float, float, float]) -> Detections:
    n = len(boxes)
    return Detections(
        np.array(boxes, np.float32).reshape(n, 4), np.linspace(0.9, 0.5, n, dtype=np.float32),
        ("cup", "chair", "sink")[:n],
    )  # fmt: skip


def test_a_box_is_drawn_in_its_labels_colour_where_it_lies(frame):
    picture = draw_detections(frame, found((100, 80, 200, 180)))
    for row, column in ((130, 100), (130, 200), (180, 150)):
        assert tuple(picture[row, column]) == label_colour("cup")
    assert (picture[100:160, 120:180] == 40).all(), "what is inside stays visible"
    assert (picture[60:79, 100:130] != 40).any(), "the label stands above the box"
    assert (frame.rgb == 40).all(), "the frame itself is untouched"


def test_boxes_at_the_border_keep_their_labels_inside(frame):
    for box in ((0, 0, 50, 30), (300, 0, 320, 240), (0, 220, 320, 240)):
        picture = draw_detections(frame, found(box))
        assert (picture == label_colour("cup")).all(-1).sum() > 150


def test_the_likeliest_places_are_listed(frame):
    scene = SceneScores({"kitchen": 0.8, "bath_room": 0.15, "hall": 0.05})
    picture = draw_detections(frame, found(), scene)
    changed = (picture != 40).any(-1)
    rows, columns = np.nonzero(changed)
    assert rows.min() > 120
    assert columns.max() < 160
    assert not (draw_detections(frame, found(), None) != 40).any()


def test_saved_pictures_keep_red_red(frame, tmp_path):
    rgb = np.zeros((20, 30, 3), np.uint8)
    rgb[..., 0] = 250
    for name in ("a.png", "a.jpg"):
        save_image(tmp_path / name, rgb)
        blue, _, red = cv2.imread(str(tmp_path / name))[10, 10]
        assert red > 200
        assert blue < 50


def test_pictures_that_cannot_be_written_say_so(tmp_path):
    rgb = np.zeros((20, 30, 3), np.uint8)
    with pytest.raises(RecordingError, match=r"\.jpg and \.png work"):
        save_image(tmp_path / "a.xyz", rgb)
    with pytest.raises(RecordingError, match="No such file"):
        save_image(tmp_path / "absent" / "a.png", rgb)


masks = npst.arrays(np.bool_, st.tuples(st.integers(1, 7), st.integers(1, 7)))


def beside(mask: np.ndarray, x: int, y: int) -> list[tuple[int, int]]:
    around = [(x - 1, y), (x + 1, y), (x, y - 1), (x, y + 1)]
    return [(i, j) for i, j in around if 0 <= i < mask.shape[0] and 0 <= j < mask.shape[1]]


@given(masks)
def test_cells_share_a_number_where_a_way_joins_them(mask: np.ndarray) -> None:
    labels = connected_components(mask)
    assert ((labels >= 0) == mask).all()
    found = 0
    left = {(int(x), int(y)) for x, y in np.argwhere(mask)}
    while left:
        part, border = set(), {min(left)}
        while border:
            part |= border
            border = {c for at in border for c in beside(mask, *at) if mask[c]} - part
        assert len({int(labels[cell]) for cell in part}) == 1
        left -= part
        found += 1
    assert set(np.unique(labels[mask]).tolist()) == set(range(found))


@given(masks)
def test_a_mask_grows_by_the_four_cells_beside_each(mask: np.ndarray) -> None:
    expected = mask.copy()
    for x, y in np.argwhere(mask).tolist():
        for cell in beside(mask, x, y):
            expected[cell] = True
    assert (with_neighbours(mask) == expected).all()


@given(masks)
def test_distances_are_to_the_nearest_wall_up_to_the_greatest(mask: np.ndarray) -> None:
    walls = np.argwhere(~np.pad(mask, 1)) - 1
    found = distance_to_walls(mask, 2)
    for cell in np.ndindex(mask.shape):
        nearest = np.sqrt(((walls - cell) ** 2).sum(axis=1).min())
        assert abs(found[cell] - min(nearest, 2.0)) < 1e-5


@given(masks)
def test_runs_hold_the_cells_of_a_mask_without_gaps(mask: np.ndarray) -> None:
    again = np.zeros_like(mask)
    for row, first, end in runs(mask).tolist():
        assert first < end
        assert end == mask.shape[1] or not mask[row, end]
        assert not again[row, max(first - 1, 0) : end].any()
        again[row, first:end] = True
    assert (again == mask).all()


def test_a_mask_without_cells_has_no_components() -> None:
    assert connected_components(np.zeros((0, 3), np.bool_)).shape == (0, 3)

"""Pictures show what was found and where."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from kg.model.errors import RecordingError
from perception.annotate import draw_detections, label_colour, save_image
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

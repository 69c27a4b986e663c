"""Detections of Supervision, Ultralytics and COCO's results, by their own interfaces."""

from types import SimpleNamespace

import numpy as np
import pytest
from pycocotools import mask as coco

from kg.model.errors import FrameError
from perception.frames import Detections, box_pixels

SHAPE = (48, 64)
BOXES = np.array([[4, 6, 20, 30], [30, 10, 60, 40]], np.float32)
SCORES = np.array([0.4, 0.9], np.float32)


def masks() -> np.ndarray:
    """Masks (2, H, W): an ellipse in each box."""
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]]
    return np.stack(
        [
            ((x - (a + c) / 2) / (c - a) * 2) ** 2 + ((y - (b + d) / 2) / (d - b) * 2) ** 2 <= 1
            for a, b, c, d in BOXES
        ]
    )


def supervised(**other: object) -> SimpleNamespace:
    """The attributes of supervision.Detections."""
    given = {
        "xyxy": BOXES,
        "mask": masks(),
        "confidence": SCORES,
        "class_id": np.array([0, 2]),
        "tracker_id": None,
        "data": {"class_name": np.array(["cup", "chair"])},
    }
    return SimpleNamespace(**{**given, **other})


class Tensor:
    """A tensor on another device: an array only after `cpu`."""

    def __init__(self, values: np.ndarray) -> None:
        self._values = values

    def cpu(self) -> np.ndarray:
        return self._values


def ultralytics(**other: object) -> SimpleNamespace:
    """The attributes of ultralytics.engine.results.Results."""
    boxes = SimpleNamespace(xyxy=Tensor(BOXES), conf=Tensor(SCORES), cls=Tensor(np.array([0.0, 2])))
    corners = [np.array([[a, b], [c, b], [c, d], [a, d]], np.float32) for a, b, c, d in BOXES]
    given = {
        "boxes": boxes,
        "masks": SimpleNamespace(xy=corners),
        "names": {0: "cup", 1: "fork", 2: "chair"},
        "orig_shape": SHAPE,
    }
    return SimpleNamespace(**{**given, **other})


def results(how: str) -> list[dict]:
    """Entries of COCO's results with masks in one of its ways."""
    found = []
    for number, (box, score, mask) in enumerate(zip(BOXES, SCORES, masks(), strict=True)):
        x1, y1, x2, y2 = box.tolist()
        text = coco.encode(np.asfortranarray(mask.astype(np.uint8)))
        flat = np.concatenate([[False], mask.T.ravel(), [False]])
        changes = np.nonzero(flat[1:] != flat[:-1])[0]
        runs = {"size": [*SHAPE], "counts": np.diff([0, *changes, mask.size]).tolist()}
        corners = [[x1, y1, x2, y1, x2, y2, x1, y2]]
        ways = {
            "text": {**text, "counts": text["counts"].decode()},
            "bytes": text,
            "runs": runs,
            "polygons": corners,
            "none": None,
        }
        one = {"image_id": 7, "category_id": (3, 62)[number], "score": float(score)}
        found.append({**one, "bbox": [x1, y1, x2 - x1, y2 - y1], "segmentation": ways[how]})
    return found


def cut(number: int) -> np.ndarray:
    top, bottom, left, right = box_pixels(BOXES[number], SHAPE)
    return masks()[number, top:bottom, left:right]


@pytest.mark.parametrize(
    "found",
    [
        Detections.from_supervision(supervised()),
        Detections.from_supervision(supervised(data={}), ["cup", "fork", "chair"]),
        *(
            Detections.from_coco(results(how), {3: "cup", 62: "chair"})
            for how in ("text", "bytes", "runs")
        ),
    ],
)
def test_detections_come_best_first_with_their_masks(found):
    assert found.label == ("chair", "cup")
    np.testing.assert_allclose(found.score, [0.9, 0.4])
    np.testing.assert_allclose(found.xyxy, BOXES[::-1])
    for mask, number in zip(found.mask, (1, 0), strict=True):
        np.testing.assert_array_equal(mask, cut(number))


@pytest.mark.parametrize(
    "found",
    [
        Detections.from_ultralytics(ultralytics()),
        Detections.from_coco(results("polygons"), {3: "cup", 62: "chair"}),
    ],
)
def test_outlines_become_masks(found):
    assert found.label == ("chair", "cup")
    np.testing.assert_allclose(found.xyxy, BOXES[::-1])
    assert all(mask.all() for mask in found.mask)  # each fills its box


def test_what_has_no_masks_has_none():
    assert Detections.from_supervision(supervised(mask=None)).mask == ()
    assert Detections.from_ultralytics(ultralytics(masks=None)).mask == ()
    assert Detections.from_coco(results("none"), {3: "cup", 62: "chair"}).mask == ()
    assert len(Detections.from_coco([], {3: "cup"})) == 0
    nothing = supervised(xyxy=BOXES[:0], mask=None, confidence=SCORES[:0], class_id=[], data={})
    assert len(Detections.from_supervision(nothing, ["cup"])) == 0
    assert len(Detections.from_supervision(nothing)) == 0  # as in supervision.Detections.empty()


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Detections.from_supervision(supervised(data={})), "no names"),
        (lambda: Detections.from_supervision(supervised(data={}), ["cup"]), r"classes \[2\]"),
        (lambda: Detections.from_supervision(supervised(confidence=None)), "no scores"),
        (lambda: Detections.from_supervision(supervised(mask=masks()[:1])), r"\(2, H, W\)"),
        (lambda: Detections.from_supervision(supervised(mask=masks()[:, 0])), r"\(H, W\)"),
        (lambda: Detections.from_supervision(supervised(confidence=SCORES[:1])), "2 labels"),
        (lambda: Detections.from_ultralytics(ultralytics(names={0: "cup"})), r"classes \[2\]"),
        (lambda: Detections.from_ultralytics(ultralytics(boxes=None)), "no boxes"),
        (lambda: Detections.from_coco([{"bbox": [1, 2, 3, 4]}], {3: "cup"}), "category_id"),
        (lambda: Detections.from_coco(results("runs"), {3: "cup"}), r"classes \[62\]"),
        (
            lambda: Detections.from_coco(
                [{**results("runs")[0], "segmentation": {"size": [9, 9], "counts": [3]}}],
                {3: "cup"},
            ),
            "that many pixels",
        ),
    ],
)
def test_what_does_not_fit_is_refused_in_one_line(make, message):
    with pytest.raises(FrameError, match=message) as refused:
        make()
    assert "\n" not in str(refused.value)

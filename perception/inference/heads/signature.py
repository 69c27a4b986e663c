"""Recognition of a network's head by names, types and shapes of its inputs and outputs."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, Final

from kg.model.errors import ModelError
from perception.inference.heads.candidates import Head
from perception.inference.heads.dense import (
    BINS,
    BOX,
    PLUS_STRIDES,
    STRIDES,
    DenseHead,
    boxes_and_scores,
    cells,
    nanodet,
    yolo_v5,
    yolo_v8,
    yolox,
)
from perception.inference.heads.listed import (
    EndToEndHead,
    QueryHead,
    RegionHead,
    SetPredictionHead,
)
from perception.inference.session import Session

KNOWN: Final = (
    "images, orig_target_sizes -> labels, boxes, scores (RT-DETR, D-FINE, DEIM); image -> logits, "
    "pred_boxes (DETR); boxes [1, N, 4], scores [1, N, C]; [1, N, 5 + C] (YOLOX, YOLOv5); "
    "[1, 4 + C, N] (YOLOv8, 11), with prototypes; [1, N, 6] (YOLOv10); [1, N, C + 32] (NanoDet); "
    "boxes [n, 4], labels [n], scores [n], masks (torchvision)"
)
_SIZES: Final = ("orig_target_sizes", "orig_sizes", "target_sizes")
_QUERIES: Final = (
    # logits, boxes, masks, values of images
    ("logits", "pred_boxes", "pred_masks", "0..1"),
    ("pred_logits", "pred_boxes", "pred_masks", "0..1"),
    ("labels", "dets", "masks", "imagenet"),  # RF-DETR
)
_MAX_ROWS: Final = 1000  # rows of an end-to-end head
_OTHER_TASKS: Final = ("classify", "pose", "obb")

Shape = list[Any]


def head_of(session: Session, labels: int | None = None) -> Head:
    """The head of a network; `labels` is the number of its labels where these are known.

    Raises ModelError for a network of another interface.
    """
    task = session.metadata.get("task")
    if task in _OTHER_TASKS:
        raise ModelError(f"{session.path.name} is a network to {task}; detect or segment would do")
    for match in _MATCHES:
        head = match(session, labels)
        if head is not None:
            return head
    raise ModelError(
        f"{session.path.name} is no detector of a known interface ({session.interface()}); "
        f"known: {KNOWN}"
    )


def _set_prediction(session: Session, _: int | None) -> Head | None:
    size = next((name for name in session.inputs if name in _SIZES), None)
    if len(session.inputs) != 2 or size is None:
        return None
    if not {"labels", "boxes", "scores"} <= set(session.outputs):
        return None
    return SetPredictionHead(next(name for name in session.inputs if name != size), size)


def _queries(session: Session, _: int | None) -> Head | None:
    for logits, boxes, masks, values in _QUERIES:
        if not {logits, boxes} <= set(session.outputs):
            continue
        classes, last = session.outputs[logits], session.outputs[boxes]
        if len(classes) != 3 or len(last) != 3 or not isinstance(classes[2], int):
            continue
        real = _real_pixels(session)
        if len(session.inputs) != 1 + (real is not None):
            continue
        image = next(name for name in session.inputs if real is None or name != real[0])
        with_masks = (masks,) if masks in session.outputs else ()
        outputs = (logits, boxes, *with_masks)
        return QueryHead(image, outputs, classes[2], values, mask_input=real)
    return None


def _real_pixels(session: Session) -> tuple[str, tuple[int, ...]] | None:
    """An input that says which pixels are no padding, and its shape."""
    if "pixel_mask" not in session.inputs or len(session.inputs) != 2:
        return None
    image = next(name for name in session.inputs if name != "pixel_mask")
    given = zip(session.inputs["pixel_mask"][1:], session.image_size(image), strict=False)
    return "pixel_mask", (1, *(n if isinstance(n, int) else side for n, side in given))


def _regions(session: Session, _: int | None) -> Head | None:
    if len(session.inputs) != 1:
        return None
    shapes = session.outputs
    for batched in (False, True):
        rank = 1 + batched
        boxes = [n for n, s in shapes.items() if len(s) == rank + 1 and s[-1] == 4]
        flat = [n for n, s in shapes.items() if len(s) == rank]
        labels = [n for n in flat if "int" in session.output_types[n] and n != "num_dets"]
        scores = [n for n in flat if "float" in session.output_types[n]]
        masks = [n for n, s in shapes.items() if len(s) >= 3 + batched and n not in boxes]
        if len(boxes) == len(labels) == len(scores) == 1 and len(masks) <= 1:
            image = next(iter(session.inputs))
            outputs = (*boxes, *labels, *scores, *masks)
            return RegionHead(image, outputs, batched, len(session.inputs[image]) == 4)
    return None


def _boxes_and_scores(session: Session, _: int | None) -> Head | None:
    if len(session.inputs) != 1:
        return None
    shapes = {name: s for name, s in session.outputs.items() if len(s) == 3}
    if {"boxes", "scores"} <= set(shapes):
        names = ("boxes", "scores")
    elif len(shapes) == len(session.outputs) == 2:
        first, second = sorted(shapes, key=lambda name: shapes[name][2] != 4)
        names = (first, second)
    else:
        return None
    boxes, scores = (shapes[name] for name in names)
    unlike = names != ("boxes", "scores") and boxes[1] != scores[1]
    if boxes[2] != 4 or not isinstance(scores[2], int) or unlike:
        return None
    image = next(iter(session.inputs))
    return DenseHead(image, names, scores[2], "letterbox", "0..255", boxes_and_scores)


def _rows(session: Session, labels: int | None) -> Head | None:
    """Heads of one output of rows or columns, and perhaps prototypes of masks."""
    prototypes = [name for name, s in session.outputs.items() if len(s) == 4]
    rows = [name for name, s in session.outputs.items() if len(s) == 3]
    if len(session.inputs) != 1 or len(rows) != 1 or len(prototypes) > 1:
        return None
    if len(rows) + len(prototypes) != len(session.outputs):
        return None
    channels = session.outputs[prototypes[0]][1] if prototypes else 0
    if not isinstance(channels, int):
        return None
    image, names = next(iter(session.inputs)), (rows[0], *prototypes)
    shape, size = session.outputs[rows[0]], session.image_size(image)
    if shape[2] == 6 + channels and isinstance(shape[1], int | str) and _is_list(shape[1]):
        return EndToEndHead(image, names)
    heads = _grid_heads(shape, size, channels, labels)
    return next((DenseHead(image, names, *rest) for rest in heads), None)


def _is_list(rows: int | str) -> bool:
    return isinstance(rows, str) or rows <= _MAX_ROWS


_Rest = tuple[int, str, str, Callable[..., Any]]


def _grid_heads(
    shape: Shape, size: tuple[int, int], prototypes: int, labels: int | None
) -> Iterator[_Rest]:
    """(classes, resize, values, decoder) of the heads that a shape [1, N, W] or [1, W, N] fits."""
    _, high, wide = shape
    count = cells(*size)
    is_columns = wide == count or isinstance(wide, str)
    if is_columns and isinstance(high, int) and high > 4 + prototypes:
        yield high - 4 - prototypes, "letterbox", "0..1", yolo_v8(prototypes)
    if prototypes or not isinstance(wide, int) or not isinstance(high, int):
        return
    of_nanodet = wide - 4 * BINS
    strides = {count: STRIDES, cells(*size, PLUS_STRIDES): PLUS_STRIDES}.get(high)
    plausible = strides == PLUS_STRIDES or of_nanodet == (labels or 80)
    if strides is not None and of_nanodet > 0 and plausible:
        yield of_nanodet, "stretch", "imagenet bgr", nanodet(*size, strides)
    if high == count and wide > BOX:
        yield wide - BOX, "letterbox", "0..255 bgr", yolox(*size)
    if high == 3 * count and wide > BOX:
        yield wide - BOX, "letterbox", "0..1", yolo_v5


_MATCHES: Final = (_set_prediction, _queries, _regions, _boxes_and_scores, _rows)

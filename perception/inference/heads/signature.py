"""Recognition of a network's heads by names, types and shapes of its inputs and outputs.

Where these fit several readings, the values of a first answer decide
(`perception.inference.detector`).
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from typing import Any, Final

import numpy as np

from kg.model.errors import ModelError
from perception.inference.class_labels import METADATA_KEYS
from perception.inference.heads.candidates import Head
from perception.inference.heads.dense import (
    BINS,
    BOX,
    PLUS_STRIDES,
    STRIDES,
    Dense,
    DenseHead,
    cells,
    decoded,
    nanodet,
    yolo_v8,
    yolox,
)
from perception.inference.heads.listed import (
    ListHead,
    QueryHead,
    RowsHead,
    SetPredictionHead,
)
from perception.inference.session import Session

KNOWN: Final = (
    "images, orig_target_sizes -> labels, boxes, scores (RT-DETR, D-FINE, DEIM); image -> logits, "
    "pred_boxes (DETR); boxes [1, N, 4], scores [1, N, C]; [1, N, 5 + C] (YOLOX, YOLOv5); "
    "[1, 4 + C, N] (YOLOv8, 11), with prototypes; rows of boxes, scores and classes, [1, N, 6] or "
    "[N, 7]; [1, N, C + 32] (NanoDet); boxes [n, 4], labels [n], scores [n], masks (torchvision, "
    "TensorFlow, OpenMMLab, EfficientNMS)"
)
_SIZES: Final = ("orig_target_sizes", "orig_sizes", "target_sizes")
_SCALES: Final = ("im_shape", "scale_factor")  # inputs of PaddleDetection
_QUERIES: Final = (
    # logits, boxes, masks, values of images
    ("logits", "pred_boxes", "pred_masks", "0..1"),
    ("pred_logits", "pred_boxes", "pred_masks", "0..1"),
    ("labels", "dets", "masks", "imagenet"),  # RF-DETR
)
_MAX_ROWS: Final = 1000  # rows of a list
_OTHER_TASKS: Final = ("classify", "pose", "obb")
_STRIDE_SETS: Final = (STRIDES, PLUS_STRIDES, (4, 8, 16, 32))
#: columns of x1, y1, x2, y2, score and class in rows, by the number of columns
_ORDERS: Final[dict[int, dict[str, tuple[int, ...]]]] = {
    6: {
        "rows": (0, 1, 2, 3, 4, 5),
        "rows-class-score": (0, 1, 2, 3, 5, 4),
        "rows-class-first": (2, 3, 4, 5, 1, 0),
        "rows-score-first": (2, 3, 4, 5, 0, 1),
    },
    7: {
        "rows-of-batch": (1, 2, 3, 4, 5, 6),
        "rows-of-batch-class-score": (1, 2, 3, 4, 6, 5),
        "rows-of-batch-class-first": (3, 4, 5, 6, 2, 1),
    },
}
_FROM_1: Final = ("rows-labels-from-1", "rows-labels-from-1-to-80")
#: outputs of AutoML's EfficientDet: rows of the image's number, y1, x1, y2, x2, score, class from 1
_Y_FIRST: Final = ("detections", (2, 1, 4, 3, 5, 6))
#: roles of outputs by their names, the first that matches; what is left has none
_ROLES: Final = (
    ("", r"^raw_|anchor|multiclass|index"),
    ("masks", r"mask"),
    ("count", r"^num|num_|count"),
    ("scores", r"score|conf|prob"),
    ("labels", r"class|label|categor"),
    ("boxes", r"box|^dets|_dets"),
)
#: heads of lists by the axes of boxes and all outputs' names: (pattern, y first, first labels,
#: resize)
_LISTS: Final = (
    (r"num_dets|graph\d*_|pred_(boxes|classes)|(^|,)dets(,|$)", (False,), (0,), "letterbox"),
    (r"detection_boxes", (True,), (1,), "stretch"),
    (r"valid_detections", (True, False), (0,), "stretch"),
    (r"^2,boxes,labels,scores", (False,), (1,), "stretch"),
    (r"^3,boxes,(scores,classes|classes,scores)", (False,), (0,), "letterbox"),
    (r"(^|,)num|num_", (False,), (0,), "letterbox"),
    (r"", (False,), (0, 1), "stretch"),
)

Shape = list[Any]


def heads_of(session: Session) -> list[Head]:
    """The readings of a network that its inputs and outputs allow, the likeliest first.

    Raises ModelError for a network of another interface.
    """
    task = session.metadata.get("task")
    if task in _OTHER_TASKS:
        raise ModelError(f"{session.path.name} is a network to {task}; detect or segment would do")
    for match in _MATCHES:
        found = list(match(session))
        if found:
            return found
    raise ModelError(
        f"{session.path.name} is no detector of a known interface ({session.interface()}); "
        f"known: {KNOWN}"
    )


def _set_prediction(session: Session) -> Iterator[Head]:
    size = next((name for name in session.inputs if name in _SIZES), None)
    named = {"labels", "boxes", "scores"} <= set(session.outputs)
    if len(session.inputs) == 2 and size is not None and named:
        image = next(name for name in session.inputs if name != size)
        yield SetPredictionHead(image_input=image, size_input=size)


def _queries(session: Session) -> Iterator[Head]:
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
        yield QueryHead(
            image_input=image,
            outputs=(logits, boxes, *with_masks),
            classes=classes[2],
            values=values,
            sigmoid=logits == "labels",
            mask_input=real,
        )
        return


def _real_pixels(session: Session) -> tuple[str, tuple[int, ...]] | None:
    """An input that says which pixels are no padding, and its shape."""
    if "pixel_mask" not in session.inputs or len(session.inputs) != 2:
        return None
    image = next(name for name in session.inputs if name != "pixel_mask")
    given = zip(session.inputs["pixel_mask"][1:], session.image_size(image), strict=False)
    return "pixel_mask", (1, *(n if isinstance(n, int) else side for n, side in given))


def _roles(session: Session) -> dict[str, str]:
    """Outputs of a list by their roles: by names, else by types and shapes."""
    found = dict[str, str]()
    for name in session.outputs:
        role = next((role for role, names in _ROLES if re.search(names, name.lower())), None)
        if role:
            found.setdefault(role, name)
    if {"boxes", "labels"} <= set(found):
        return found
    shapes = session.outputs
    for rank in (1, 2):
        boxes = [n for n, s in shapes.items() if len(s) == rank + 1 and s[-1] == 4]
        flat = [n for n, s in shapes.items() if len(s) == rank]
        labels = [n for n in flat if "int" in session.output_types[n] and n != "num_dets"]
        scores = [n for n in flat if "float" in session.output_types[n]]
        masks = [n for n, s in shapes.items() if len(s) >= 2 + rank and n not in boxes]
        if len(boxes) == len(labels) == len(scores) == 1 and len(masks) <= 1:
            roles = ("boxes", "labels", "scores", "masks")
            return dict(zip(roles, (*boxes, *labels, *scores, *masks), strict=False))
    return {}


def _lists(session: Session) -> Iterator[Head]:
    roles, shapes = _roles(session), session.outputs
    if len(session.inputs) != 1 or not {"boxes", "labels"} <= set(roles):
        return
    boxes, with_scores = shapes[roles["boxes"]], "scores" in roles
    flat = [shapes[roles[one]] for one in ("labels", "scores") if one in roles]
    listed = all(len(s) < len(boxes) or (len(s) == len(boxes) and s[-1] == 1) for s in flat)
    if len(boxes) not in (2, 3) or boxes[-1] != (4 if with_scores else 5) or not listed:
        return
    names, image = f"{len(boxes)},{','.join(shapes)}".lower(), next(iter(session.inputs))
    downs: tuple[bool, ...]
    _, downs, firsts, resize = next(one for one in _LISTS if re.search(one[0], names))
    if firsts == (1,) and any(key in session.metadata for key in METADATA_KEYS):
        firsts = (1, 0)  # names may begin with the first class
    if downs == (False,) and session.is_channels_last(image):
        downs, resize = (True, False), "stretch"  # of TensorFlow's kin
    if downs == (True,) and "int" in session.output_types[roles["labels"]]:
        downs, firsts = (True, False), (0,)  # EfficientNMS has TensorFlow's names, too
    outputs = tuple(roles[one] for one in ("boxes", "labels", "scores", "masks") if one in roles)
    for down in downs:
        for first in firsts:
            for gaps in (True, False)[: 1 + (first and len(firsts) > 1)]:
                yield ListHead(
                    image_input=image,
                    outputs=outputs,
                    name=f"list{'-y-first' * down}-labels-from-{first}{'' if gaps else '-to-80'}",
                    with_scores=with_scores,
                    down_first=down,
                    first_label=first,
                    gaps=gaps,
                    resize=resize,
                )


def _boxes_and_scores(session: Session) -> Iterator[Head]:
    if len(session.inputs) != 1:
        return
    shapes = {name: s for name, s in session.outputs.items() if len(s) == 3}
    if {"boxes", "scores"} <= set(shapes):
        names = ("boxes", "scores")
    elif len(shapes) == len(session.outputs) == 2:
        first, second = sorted(shapes, key=lambda name: shapes[name][2] != 4)
        names = (first, second)
    else:
        return
    boxes, scores = (shapes[name] for name in names)
    # [1, C, N], as PaddleDetection has it
    by_class = boxes[1] == scores[2] and isinstance(scores[1], int) and boxes[1] > 10 * scores[1]
    classes = scores[1] if by_class else scores[2]
    unlike = names != ("boxes", "scores") and boxes[1] != scores[1] and not by_class
    if boxes[2] != 4 or not isinstance(classes, int) or unlike:
        return

    image = next(iter(session.inputs))
    # of an SSD shares of the input, and a column for the background
    for kind in ("", "-shares"):
        for column, background in (("", None), ("-background-first", 0), ("-background-last", -1)):

            def decode(outputs: list[Any], apart: Any = background) -> Dense:
                of_class = outputs[1].T if by_class else outputs[1]
                kept = of_class if apart is None else np.delete(of_class, apart, 1)
                return Dense(outputs[0], kept)

            yield DenseHead(
                image_input=image,
                outputs=names,
                name=f"boxes-scores{kind}{column}",
                classes=classes - (background is not None),
                resize="stretch" if kind else "letterbox",
                values="imagenet" if kind else "0..255",
                decode=decode,
                background=background,
                shares=bool(kind),
                named=True,
            )


def _rows(session: Session) -> Iterator[Head]:
    """Heads of one output of rows or columns, and perhaps prototypes of masks."""
    sizes = tuple(name for name in session.inputs if name in _SCALES)
    images = [name for name in session.inputs if name not in _SCALES]
    prototypes = [name for name, s in session.outputs.items() if len(s) == 4]
    rows = [
        n for n, s in session.outputs.items() if len(s) == 3 or (len(s) == 2 and s[1] in (6, 7))
    ]
    counts = [name for name, s in session.outputs.items() if len(s) <= 1]
    if len(images) != 1 or len(rows) != 1 or len(prototypes) > 1:
        return
    if len(rows) + len(prototypes) + len(counts) != len(session.outputs):
        return
    channels = session.outputs[prototypes[0]][1] if prototypes else 0
    if not isinstance(channels, int):
        return
    image, names = images[0], (rows[0], *prototypes)
    shape, size = session.outputs[rows[0]], session.image_size(image)
    width, many = shape[-1], shape[-2]
    listed = isinstance(many, str) or (isinstance(many, int) and many <= _MAX_ROWS)
    if isinstance(width, int) and listed and not (channels and width != 6 + channels):
        resize, orders = "stretch" if sizes else "letterbox", _ORDERS.get(width - channels, {})
        automl = width == len(_Y_FIRST[1]) + 1 and rows[0].partition(":")[0] == _Y_FIRST[0]
        if automl:
            orders = {"rows-of-batch-y-first-labels-from-1": _Y_FIRST[1]}
        firsts = dict.fromkeys(orders, int(automl))
        if session.is_channels_last(image) and not automl:  # of TensorFlow's kin
            turned = (1, 0, 3, 2, 4, 5)
            swapped = {f"{n}-y-first": tuple(o[k] for k in turned) for n, o in orders.items()}
            orders, firsts = orders | swapped, firsts | dict.fromkeys(swapped, 0)
        # EfficientDet's, whose classes are COCO's ids; names in the file begin with the first class
        told = any(key in session.metadata for key in METADATA_KEYS)
        if "rows" in orders and isinstance(many, int) and not channels and not told:
            orders |= dict.fromkeys(_FROM_1, orders["rows"])
            firsts |= dict.fromkeys(_FROM_1, 1)
        for name, order in orders.items():
            yield RowsHead(
                image_input=image,
                outputs=names,
                name=name,
                order=order,
                first_label=firsts[name],
                gaps=name != _FROM_1[1],
                resize=resize,
                size_inputs=sizes,
            )
    if len(shape) == 3 and not sizes:
        yield from _grid_heads(image, names, shape, size, channels)


def _grid_heads(
    image: str, names: tuple[str, ...], shape: Shape, size: tuple[int, int], prototypes: int
) -> Iterator[Head]:
    """The heads that a shape [1, N, W] or [1, W, N] fits."""
    _, high, wide = shape
    counts = {cells(*size, strides) * anchors for strides in _STRIDE_SETS for anchors in (1, 3)}
    box, rgb = "letterbox", "0..1"
    #: name, number of classes (none: the shape does not allow it), resize, values, decoder
    table: list[tuple[str, int, str, str, Callable[..., Dense]]] = []
    columns = wide in counts or (isinstance(wide, str) and isinstance(high, int))
    if columns and isinstance(high, int):
        table.append(("yolov8", high - 4 - prototypes, box, rgb, yolo_v8(prototypes)))
    if not prototypes and isinstance(wide, int):
        one, three = cells(*size), 3 * cells(*size)
        few = isinstance(high, int) and high <= _MAX_ROWS
        unknown = not isinstance(high, int)
        strides = {one: STRIDES, cells(*size, PLUS_STRIDES): PLUS_STRIDES}.get(high, ())
        of_nanodet = (wide - 4 * BINS) * (strides == PLUS_STRIDES or wide - 4 * BINS == 80)
        with_object, classes = decoded(objectness=True), wide - BOX
        rows = (wide - 4) * (high in counts or unknown)
        if strides:
            nano = nanodet(*size, strides)
            table.append(("nanodet", of_nanodet, "stretch", "imagenet bgr", nano))
        if high == one:
            table.append(("yolox", classes, box, "0..255 bgr", yolox(*size)))
            table.append(("yolox-decoded", classes, box, "0..255 bgr", with_object))
        if high in (one, three) or unknown:
            table.append(("yolov5", classes, box, rgb, with_object))
        corners_ = (wide - 4) * (high in counts or few)
        shares = (wide - 4) * (few or unknown)
        table += [
            ("yolov8-rows", rows, box, rgb, decoded()),
            ("corners-rows", corners_, box, rgb, decoded(corners=True)),
            ("rtdetr", shares, "stretch", rgb, decoded()),
        ]
    for name, classes, resize, values, decode in table:
        if classes > 0:
            yield DenseHead(
                image_input=image,
                outputs=names,
                name=name,
                classes=classes,
                resize=resize,
                values=values,
                decode=decode,
                objectness=name == "yolox-decoded",
                corners=None if name in ("nanodet", "yolox") else name == "corners-rows",
                shares=True if name == "rtdetr" else None,
            )


_MATCHES: Final = (_set_prediction, _queries, _lists, _boxes_and_scores, _rows)

"""Heads: real networks whose decoding is cut off, or written in another way, find the same."""

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper, numpy_helper

from kg.model.errors import ModelError
from perception.frames import box_pixels
from perception.inference.class_labels import coco_by_id, is_object
from perception.inference.detector import load_detector
from perception.sources.folders.image_files import read_colour

FLOAT = TensorProto.FLOAT


def node(text: str, **attributes) -> onnx.NodeProto:
    """`Split boxes -> low high`: a node's kind, inputs and outputs."""
    left, _, right = text.partition(" -> ")
    kind, *inputs = left.split()
    return helper.make_node(kind, inputs, right.split(), **attributes)


# boxes [1, N, 4] by their corners -> `box`, centre and size
CENTRE_AND_SIZE = (
    node("Split boxes -> low high", axis=2),
    node("Sub high low -> size"),
    node("Add high low -> twice"),
    node("Mul twice half -> centre"),
    node("Concat centre size -> box", axis=2),
)
HALF, RAW = {"half": np.float32(0.5)}, {"values": "0..255"}
AT_INPUT = {"orig_target_sizes": np.array([[416, 416]])}
DECODER = "/model/decoder/Gather"
YOLOX, NANODET, DEIM = "yolox_nano_416", "nanodet_plus_m_416", "deimv2_femto_416"

# a network at hand, the nodes behind what is left of it, and its outputs, constants and metadata
WRITTEN = {
    "a raw head of YOLOX": (YOLOX, [], {"output": (FLOAT, [1, 3549, 85])}, {}, RAW),
    "a raw head of NanoDet": (
        NANODET,
        [node("Reshape __t27 rows -> bins"), node("Concat scores bins -> output", axis=2)],
        {"output": (FLOAT, [1, 3598, 112])},
        {"rows": np.array([1, 3598, 32])},
        RAW | {"resize": "letterbox"},
    ),
    "columns of YOLO v8": (
        YOLOX,
        [
            *CENTRE_AND_SIZE,
            node("Concat box scores -> rows", axis=2),
            node("Transpose rows -> output0", perm=[0, 2, 1]),
        ],
        {"output0": (FLOAT, [1, 84, 3549])},
        HALF,
        RAW | {"task": "detect"},
    ),
    # objectness 1, and two thirds of the cells empty
    "rows of YOLO v5": (
        YOLOX,
        [
            *CENTRE_AND_SIZE,
            node("Concat box sure scores -> rows", axis=2),
            node("Concat rows empty -> output0", axis=1),
        ],
        {"output0": (FLOAT, [1, 3 * 3549, 85])},
        HALF
        | {
            "sure": np.ones((1, 3549, 1), np.float32),
            "empty": np.zeros((1, 2 * 3549, 85), np.float32),
        },
        RAW,
    ),
    "logits and boxes of a transformer": (
        DEIM,
        [
            node(f"Identity {DECODER}_7_output_0 -> logits"),
            node(f"Identity {DECODER}_8_output_0 -> pred_boxes"),
        ],
        {"logits": (FLOAT, ["N", "Q", 80]), "pred_boxes": (FLOAT, ["N", "Q", 4])},
        {"orig_target_sizes": np.array([[1, 1]])},
        {},
    ),
    "finished rows": (
        DEIM,
        [
            node("Cast labels -> classes", to=FLOAT),
            node("Unsqueeze classes last -> c"),
            node("Unsqueeze scores last -> s"),
            node("Concat boxes s c -> output0", axis=2),
        ],
        {"output0": (FLOAT, [1, "K", 6])},
        AT_INPUT | {"last": np.array([2])},
        {"resize": "stretch"},
    ),
    "regions": (
        DEIM,
        [
            node(f"Squeeze {name} first -> {name}_of_image")
            for name in ("boxes", "labels", "scores")
        ],
        {
            "boxes_of_image": (FLOAT, ["n", 4]),
            "labels_of_image": (TensorProto.INT64, ["n"]),
            "scores_of_image": (FLOAT, ["n"]),
        },
        AT_INPUT | {"first": np.array([0])},
        {"names": ",".join(filter(is_object, coco_by_id()))},
    ),
}


@pytest.mark.parametrize("written", WRITTEN)
def test_networks_written_in_another_way_find_the_same(shared, tmp_path, written):
    name, nodes, outputs, constants, metadata = WRITTEN[written]
    model = onnx.load(shared(f"models/{name}.onnx"))
    graph = model.graph
    for one in [one for one in graph.input if one.name in constants]:
        graph.input.remove(one)
    graph.node.extend(nodes)
    graph.initializer.extend(numpy_helper.from_array(v, key) for key, v in constants.items())
    del graph.output[:], graph.value_info[:]
    graph.output.extend(helper.make_tensor_value_info(k, *v) for k, v in outputs.items())
    helper.set_model_props(model, metadata)
    onnx.save(model, tmp_path / f"{name}-cut.onnx")
    kitchen = read_colour(shared("data/rgbd/redkitchen/frame-000240.color.jpg"))
    head = "list-labels-from-0" if written == "regions" else None
    found = load_detector(tmp_path / f"{name}-cut.onnx", head=head).detect_image(kitchen)
    expected = load_detector(shared(f"models/{name}.onnx")).detect_image(kitchen)
    assert len(expected) > 5
    assert found.label == expected.label
    np.testing.assert_allclose(found.score, expected.score, atol=2e-4)
    np.testing.assert_allclose(found.xyxy, expected.xyxy, atol=0.2)


# masks, in networks that answer the same to every image

LABELS = ("cup", "chair")
SQUARE = {"images": ((1, 3, 64, 64), 1)}
IMAGE = np.zeros((100, 200, 3), np.uint8)  # letterboxed into 64 x 64: scale 0.32


def disc(side: int) -> np.ndarray:
    """(side, side) positive inside a circle about the middle, of a quarter of the side."""
    row, column = np.mgrid[0:side, 0:side] + 0.5
    return (side / 4 - np.hypot(row - side / 2, column - side / 2)).astype(np.float32)


def is_disc(mask: np.ndarray, box: np.ndarray, centre: tuple[float, float], radii: tuple) -> None:
    """Whether a mask (h, w) in a box is an ellipse of the image, but for pixels at its edge."""
    top, bottom, left, right = box_pixels(box, IMAGE.shape[:2])
    assert mask.shape == (bottom - top, right - left)
    row, column = np.mgrid[top:bottom, left:right] + 0.5
    away = np.hypot((column - centre[0]) / radii[0], (row - centre[1]) / radii[1])
    assert mask[away < 0.9].all() and mask.any()
    assert not mask[away > 1.1].any()


def test_masks_of_prototypes(write_network):
    raw = np.zeros((1, 4 + 2 + 2, 84), np.float32)
    raw[0, :4, 5] = [32, 20, 40, 24]  # centre, size [px of the input]
    raw[0, 4:6, 5] = [0.1, 0.9]
    raw[0, 6:, 5] = [2, 0]
    prototypes = np.stack([disc(16), -np.ones((16, 16), np.float32)])[None]
    path = write_network(
        {"output0": raw, "output1": prototypes},
        inputs=SQUARE,
        metadata={"names": "{0: 'cup', 1: 'chair'}", "task": "segment"},
    )
    found = load_detector(path).detect_image(IMAGE)
    assert found.label == ("chair",)
    np.testing.assert_allclose(found.xyxy, [[37.5, 25, 162.5, 100]], rtol=1e-5)
    # the disc of the input has radius 16 about (32, 32)
    is_disc(found.mask[0], found.xyxy[0], (100, 100), (50, 50))


def test_masks_of_finished_rows(write_network):
    rows = np.array([[[12, 8, 52, 32, 0.8, 0, 1]]], np.float32)
    path = write_network({"output0": rows, "output1": disc(16)[None, None]}, inputs=SQUARE)
    found = load_detector(path, labels=LABELS).detect_image(IMAGE)
    assert found.label == ("cup",)
    is_disc(found.mask[0], found.xyxy[0], (100, 100), (50, 50))


@pytest.mark.parametrize("whole", [True, False])
def test_masks_of_regions(write_network, whole):
    probability = 1 / (1 + np.exp(-disc(64 if whole else 28)))
    path = write_network(
        {
            "boxes": np.array([[0, 0, 64, 64], [1, 1, 5, 5]], np.float32),
            "labels": np.array([1, 0], np.int64),
            "scores": np.array([0.9, 0.1], np.float32),
            "masks": np.stack([probability, probability])[:, None].astype(np.float32),
        },
        inputs={"image": ((3, 64, 64), 1)},
    )
    found = load_detector(path, labels=("background", "cup")).detect_image(IMAGE)
    assert found.label == ("cup",)
    # stretched: the mask fills the image
    is_disc(found.mask[0], found.xyxy[0], (100, 50), (50, 25))


def test_queries_with_no_object_and_masks(write_network):
    logits = np.array([[[0, 3, 0], [0, 0, 9.0]]], np.float32)
    outputs = {
        "logits": logits,
        "pred_boxes": np.array([[[0.5, 0.5, 0.6, 0.8]] * 2], np.float32),
        "pred_masks": np.stack([disc(16)] * 2)[None],
    }
    path = write_network(outputs, inputs={"pixel_values": ((1, 3, 64, 64), 1)})
    found = load_detector(path, labels=LABELS).detect_image(IMAGE)
    assert found.label == ("chair",)
    assert found.score == pytest.approx([np.exp(3) / (np.exp(3) + 2)])
    np.testing.assert_allclose(found.xyxy, [[40, 10, 160, 90]], rtol=1e-5)
    is_disc(found.mask[0], found.xyxy[0], (100, 50), (50, 25))


def test_coco_ids_are_named_and_unused_ones_left_out(write_network):
    logits = np.full((1, 2, 91), -9, np.float32)
    logits[0, 0, 47] = 2  # cup
    logits[0, 1, 12] = 2  # no class of COCO
    boxes = np.array([[[0.5, 0.5, 0.2, 0.2]] * 2], np.float32)
    path = write_network({"dets": boxes, "labels": logits})
    assert load_detector(path).detect_image(IMAGE).label == ("cup",)


# hostile networks


FLOOD = {
    "output0": np.tile(np.float32([1, 1, 50, 30, 0.9, 0, 0.9]), (1, 2, 1)),
    "o": np.zeros((1, 1, 9999, 2), np.float32),
}


@pytest.mark.parametrize(
    ("outputs", "inputs", "metadata", "told"),
    [
        (84, (1, 3, 10**6, 8), {}, "up to 4096 a side"),
        (6, (1, 3, 64, 64), {"task": "pose"}, "to pose"),
        (6, (1, 3, 64, 64), {"resize": "?"}, "letterbox"),
        (FLOOD, (1, 3, 64, 64), {}, "up to 8192"),
    ],
)
def test_impossible_networks_are_one_line(write_network, outputs, inputs, metadata, told):
    made = outputs if outputs is FLOOD else {"x": np.zeros((1, outputs, 84), np.float32)}
    path = write_network(made, inputs={"image": (inputs, 1)}, metadata=metadata)
    with pytest.raises(ModelError, match=told) as caught:
        load_detector(path, labels=LABELS).detect_image(IMAGE)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e38])
@pytest.mark.parametrize("shape", [(1, 6, 84), (1, 84, 7), (1, 7, 6)])
def test_numbers_that_are_none_give_no_box_outside_the_image(write_network, shape, value):
    path = write_network({"x": np.full(shape, value, np.float32)}, inputs=SQUARE)
    detector = load_detector(path, labels=LABELS)
    with np.errstate(all="ignore"):
        try:
            found = detector.detect_image(IMAGE)
        except ModelError as error:
            assert "answered class" in str(error) or "fits none" in str(error)
            return
    assert found.xyxy.min(initial=0) >= 0
    assert found.xyxy.max(initial=0) <= 200


def test_a_flood_of_boxes_is_bounded(write_network):
    rng = np.random.default_rng(1)
    corner = rng.uniform(0, [50, 18], (1, 3000, 2))
    boxes = np.concatenate([corner, corner + rng.uniform(1, 14, (1, 3000, 2))], 2)
    scores = rng.uniform(0.5, 1, (1, 3000, 40))
    path = write_network(
        {"boxes": boxes.astype(np.float32), "scores": scores.astype(np.float32)}, inputs=SQUARE
    )
    found = load_detector(path, labels=[str(i) for i in range(40)]).detect_image(IMAGE)
    assert max(found.label.count(str(i)) for i in range(40)) <= 100


def shapes_of(rng: np.random.Generator) -> dict[str, tuple[int, ...]]:
    """Outputs like those of one kind of network, of shapes that need not belong together."""
    n, m, c = (int(rng.choice(some)) for some in ((0, 1, 3, 84), (1, 2, 3), (1, 2, 3)))
    kinds: list[dict[str, tuple[int, ...]]] = [
        {"boxes": (1, n, 4), "scores": (1, m, c)},
        {"logits": (1, n, c), "pred_boxes": (1, m, 4), "pred_masks": (1, n, c - 1, 4)},
        {"boxes": (n, 4), "labels": (n,), "scores": (n,), "masks": (m, c - 1, 7, 7)},
        {"rows": (c - 1, 84, 5 + c)},
        {"rows": (1, 6 + c, 84), "prototypes": (1, m, 8, 8)},
        {"rows": (1, n, 6 + c), "prototypes": (1, m, 8, 8)},
        {"rows": (1, 84, 32 + c)},
    ]
    return kinds[int(rng.integers(len(kinds)))]


@pytest.mark.parametrize("seed", range(4))
def test_networks_whose_outputs_do_not_belong_together_are_one_line(tmp_path, seed):
    rng = np.random.default_rng(seed)
    path, read = tmp_path / "odd.onnx", 0
    for _ in range(120):
        graph = helper.make_graph([], "g", [], [])
        graph.input.append(helper.make_tensor_value_info("image", FLOAT, [1, 3, 64, 64]))
        for name, shape in shapes_of(rng).items():
            value = rng.normal(0.5, rng.choice([0.3, 30]), shape).astype(np.float32)
            if name == "labels":
                value = rng.integers(-1, 3, shape)
            elif value.size and rng.random() < 0.2:
                value.flat[0] = rng.choice([np.nan, np.inf, 1e38])
            graph.initializer.append(numpy_helper.from_array(value, f"{name}_value"))
            graph.node.append(helper.make_node("Identity", [f"{name}_value"], [name]))
            kind = helper.np_dtype_to_tensor_dtype(value.dtype)
            declared = [d if rng.random() < 0.7 else None for d in shape]
            graph.output.append(helper.make_tensor_value_info(name, kind, declared))
        opset = [helper.make_opsetid("", 17)]
        onnx.save(helper.make_model(graph, opset_imports=opset, ir_version=8), path)
        try:
            with np.errstate(all="ignore"):
                found = load_detector(path, labels=LABELS).detect_image(IMAGE)
        except ModelError as error:
            assert "\n" not in str(error)
        else:
            read += 1
            assert np.isfinite(found.xyxy).all()
    assert read  # values of 30 are no scores

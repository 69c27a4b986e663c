"""Networks that look for a patch of one colour, and answer where it is as a kind of export does."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np
import onnx
from numpy.typing import NDArray
from onnx import TensorProto as T
from onnx import helper, numpy_helper

from benchmarks.networks_in_the_wild.kinds import Array, Cup, Kind
from perception.inference.session import fit

COLOUR: Final = (255, 40, 120)  # of the patch
PATCH: Final = np.array([0.5, 0.45, 0.66, 0.6])  # of the picture, xyxy
ALIKE: Final = 0.12  # of the range of values
FEW: Final = 16.5  # [px] of a row or a column of the input
SCORE: Final = 0.9


def patched(rgb: NDArray[np.uint8]) -> tuple[NDArray[np.uint8], Array]:
    """A picture (H, W, 3) with the patch, and its box, xyxy [px]."""
    box = np.rint(PATCH * (rgb.shape[1::-1] * 2)).astype(int)
    painted = rgb.copy()
    painted[box[1] : box[3], box[0] : box[2]] = COLOUR
    return painted, box


def seen_at(kind: Kind, rgb: NDArray[np.uint8], box: Array) -> Cup:
    """The cup as the network sees the picture's box (4,) when it is fed as it wants."""
    fitted = fit(rgb, kind.size, kind.resize, "0..255")
    in_input = box * np.array(fitted.scale * 2) + np.array(fitted.shift * 2)
    return Cup(in_input, SCORE, kind.size[::-1])


def write(kind: Kind, cup: Cup, path: Path) -> None:
    """Write the network: the answer is linear in box and score, about those of `cup`."""
    kinds = {name: _type(kind, a) for name, a in kind.answer(cup).items()}
    v0 = np.array([*cup.box, cup.score])
    steps = [kind.answer(_cup(cup, v0 + 1e-3 * row)) for row in np.eye(5)]
    constants: dict[str, Array] = {"v0": v0.astype(np.float32)}
    nodes = _finder(kind, constants)
    for number, (name, first) in enumerate(kind.answer(cup).items()):
        slopes = np.array([(one[name] - first) / 1e-3 for one in steps])  # (5, ...)
        moving = np.argwhere(np.abs(slopes).max(axis=0) > 1e-9)
        at = tuple(moving.T)
        constants |= {
            f"{name}_all": first.astype(np.float32),
            f"{name}_at": moving.astype(np.int64),
            f"{name}_here": first[at].astype(np.float32),
            f"{name}_slopes": slopes[(slice(None), *at)].astype(np.float32),
        }
        nodes += [
            _node(f"MatMul off {name}_slopes -> {name}_step"),
            _node(f"Add {name}_step {name}_here -> {name}_now"),
            _node(f"ScatterND {name}_all {name}_at {name}_now -> {name}_float"),
        ]
        found = f"{name}_float"
        for axis, side in enumerate(kind.shapes if number == 0 else ()):
            if isinstance(side, str):  # a length that is known as it runs
                constants[f"{name}_{side}"] = np.full(first.shape[axis], -1, np.float32)
                nodes += [
                    _node(f"Less {name}_{side} found -> {found}_{side}_all"),
                    _node(f"Compress {found} {found}_{side}_all -> {found}_{side}", axis=axis),
                ]
                found = f"{found}_{side}"
        nodes.append(_node(f"Cast {found} -> {name}", to=kinds[name]))
    inputs = [helper.make_tensor_value_info("images", kind.kind, list(kind.image))]
    inputs += [helper.make_tensor_value_info(n, k, s) for n, (s, k) in kind.more.items()]
    outputs = [
        helper.make_tensor_value_info(
            name, kinds[name], list(kind.shapes if kind.shapes and i == 0 else a.shape)
        )
        for i, (name, a) in enumerate(kind.answer(cup).items())
    ]
    held = [numpy_helper.from_array(np.ascontiguousarray(a), name) for name, a in constants.items()]
    graph = helper.make_graph(nodes, "g", inputs, outputs, held)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    helper.set_model_props(model, kind.metadata)
    onnx.save(model, path)


def _cup(cup: Cup, v: Array) -> Cup:
    return Cup(v[:4], float(v[4]), cup.size)


def _type(kind: Kind, array: Array) -> int:
    """Element type of an output: floats as the input's."""
    if array.dtype.kind != "f":
        return int(helper.np_dtype_to_tensor_dtype(array.dtype))
    return T.FLOAT16 if kind.kind == T.FLOAT16 else T.FLOAT


def _node(text: str, **attributes: Any) -> onnx.NodeProto:
    """`Sub a b -> c`: a node's operator, inputs and output."""
    left, _, output = text.partition(" -> ")
    operator, *inputs = left.split()
    return helper.make_node(operator, inputs, [output], **attributes)


def _finder(kind: Kind, constants: dict[str, Array]) -> list[onnx.NodeProto]:
    """Nodes to `off`: box [px of the input, or of the image] and score less those of `v0`."""
    height, width = kind.size
    scale, _, order = kind.values.partition(" ")
    low, colour, high = _in_values(np.array([[(0, 0, 0), COLOUR, (255, 255, 255)]]), scale)[0]
    turn = -1 if order == "bgr" else 1
    constants |= {
        "colour": colour[::turn].reshape(1, 3, 1, 1),
        "range": (high - low)[::turn].reshape(1, 3, 1, 1),
        "alike": np.float32([ALIKE]),
        "few": np.float32([FEW]),
        "last": np.float32([0, 0, 1, 1]),
        "score": np.float32([SCORE]),
        "size": np.float32([width, height]),
        "swap": np.array([1, 0]),
        **{f"n{n}": np.array([n]) for n in range(4)},
    }
    one = len(kind.image) == 3
    last = kind.image[-1] == 3
    nodes = [
        _node("Cast images -> floats", to=T.FLOAT),
        _node("Unsqueeze floats n0 -> batch" if one else "Identity floats -> batch"),
        _node("Transpose batch -> planes", perm=[0, 3, 1, 2] if last else [0, 1, 2, 3]),
        _node("Slice planes n0 n1 -> first"),
        _node("Sub first colour -> apart"),
        _node("Div apart range -> shares"),
        _node("Abs shares -> distances"),
        _node("ReduceMax distances -> distance", axes=[1]),
        _node("Less distance alike -> is_patch"),
        _node("Cast is_patch -> patch", to=T.FLOAT),
    ]
    for axis, across, along in (("x", 2, 3), ("y", 3, 2)):
        end: dict[str, Any] = {"axis": along, "keepdims": 0}
        nodes += [
            _node(f"ReduceSum patch n{across} -> {axis}_sum"),
            _node(f"Greater {axis}_sum few -> {axis}_is"),
            _node(f"Cast {axis}_is -> {axis}_any", to=T.INT32),
            _node(f"ArgMax {axis}_any -> {axis}1", **end),
            _node(f"ArgMax {axis}_any -> {axis}2", **end, select_last_index=1),
        ]
    nodes += [
        *(_node(f"Reshape {side} n1 -> {side}_flat") for side in ("x1", "y1", "x2", "y2")),
        _node("Concat x1_flat y1_flat x2_flat y2_flat -> corners", axis=0),
        _node("Cast corners -> pixels", to=T.FLOAT),
        _node("Add pixels last -> box_in_input"),
        *_in_image(next(iter(kind.more), "")),
        _node("ReduceMax x_any -> any", keepdims=0),
        _node("Cast any -> found", to=T.FLOAT),
        _node("Mul found score -> sure"),
        _node("Concat box sure -> v", axis=0),
        _node("Sub v v0 -> off"),
    ]
    return nodes


def _in_image(given: str) -> list[onnx.NodeProto]:
    """Nodes from `box_in_input` to `box`, by the image's size or scale where it is an input."""
    if not given:
        return [_node("Identity box_in_input -> box")]
    scale = given == "scale_factor"  # of the input over the image, y first
    return [
        _node(f"Cast {given} -> numbers", to=T.FLOAT),
        _node("Reshape numbers n2 -> pair"),
        _node("Gather pair swap -> ratio" if scale else "Div size pair -> ratio"),
        _node("Concat ratio ratio -> ratios", axis=0),
        _node("Div box_in_input ratios -> box"),
    ]


def _in_values(rgb: Array, scale: str) -> NDArray[np.float32]:
    """Colours (1, n, 3) in the values of a network's input, as `fit` gives them."""
    tensor = fit(rgb.astype(np.uint8), (1, rgb.shape[1]), "stretch", scale).tensor
    return np.moveaxis(tensor[0], 0, -1)

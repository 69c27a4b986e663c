"""A detector of oranges in rendered pictures: a network of a few nodes that goes by colour.

    python -m benchmarks.search.orange_network oranges.onnx

Published networks are trained on photographs; with this one pictures of the simulated house go the
same way as photographs do. Of all colours there, only an orange's has less blue than 0.17 of its
red.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import onnx
from numpy.typing import NDArray
from onnx import TensorProto, helper, numpy_helper

from lab.command_line import parser_of

WIDTH, HEIGHT = 320, 240  # [px] of the simulated camera
MAX_BOXES = 5
HALF = 3.0  # [px] half a box
WEIGHTS = (0.7, 0.0, -4.0)  # of red, green and blue, 0..255; above BIAS it is an orange's colour
BIAS = -8.0


def orange_network() -> onnx.ModelProto:
    """Image [1, 3, H, W], 0..255 -> boxes [1, n, 4], scores [1, n, 1], at the densest spots."""
    constants: dict[str, NDArray[np.generic]] = {
        "weights": np.array(WEIGHTS, np.float32).reshape(1, 3, 1, 1),
        "bias": np.array([BIAS], np.float32),
        "zero": np.zeros(1, np.float32),
        "one": np.ones(1, np.float32),
        "flat": np.array([1, -1], np.int64),
        "most": np.array([MAX_BOXES], np.int64),
        "width": np.array([WIDTH], np.int64),
        "last": np.array([-1], np.int64),
        "corners": np.array([-HALF, -HALF, HALF, HALF], np.float32),
    }
    nodes = [
        helper.make_node("Conv", ["image", "weights", "bias"], ["colour"]),
        helper.make_node("Clip", ["colour", "zero", "one"], ["orange"]),
        helper.make_node("AveragePool", ["orange"], ["density"], kernel_shape=[5, 5], pads=[2] * 4),
        helper.make_node("MaxPool", ["density"], ["around"], kernel_shape=[9, 9], pads=[4] * 4),
        helper.make_node("Equal", ["density", "around"], ["is_peak"]),
        helper.make_node("Cast", ["is_peak"], ["peak"], to=TensorProto.FLOAT),
        helper.make_node("Mul", ["density", "peak"], ["peaks"]),
        helper.make_node("Reshape", ["peaks", "flat"], ["row"]),
        helper.make_node("TopK", ["row", "most"], ["score", "spot"]),
        helper.make_node("Unsqueeze", ["score", "last"], ["scores"]),
        helper.make_node("Mod", ["spot", "width"], ["x"]),
        helper.make_node("Div", ["spot", "width"], ["y"]),
        helper.make_node("Unsqueeze", ["x", "last"], ["xs"]),
        helper.make_node("Unsqueeze", ["y", "last"], ["ys"]),
        helper.make_node("Concat", ["xs", "ys", "xs", "ys"], ["centres"], axis=2),
        helper.make_node("Cast", ["centres"], ["middles"], to=TensorProto.FLOAT),
        helper.make_node("Add", ["middles", "corners"], ["boxes"]),
    ]
    image = helper.make_tensor_value_info("image", TensorProto.FLOAT, [1, 3, HEIGHT, WIDTH])
    outputs = [
        helper.make_tensor_value_info("boxes", TensorProto.FLOAT, [1, MAX_BOXES, 4]),
        helper.make_tensor_value_info("scores", TensorProto.FLOAT, [1, MAX_BOXES, 1]),
    ]
    weights = [numpy_helper.from_array(value, name) for name, value in constants.items()]
    graph = helper.make_graph(nodes, "oranges", [image], outputs, weights)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 13)], ir_version=8)
    helper.set_model_props(model, {"names": "orange"})
    return model


def main() -> None:
    """Write the network."""
    parser = parser_of("benchmarks.search.orange_network", __doc__)
    parser.add_argument("file", type=Path, help="ONNX file to write")
    onnx.save(orange_network(), parser.parse_args().file)


if __name__ == "__main__":
    main()

"""Cost of an encoder while mapping: a network of the size of ViT-B/32, with random weights.

    python -m benchmarks.encoder_cost RECORDING [--turns 2] [--limit N]

Maps the recording with and without it by turns, and prints processor and wall time of each run,
and the ratios of the least ones. The text encoder is a small one, since mapping needs no texts.
"""

from __future__ import annotations

import argparse
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

from mapping.looks.user_encoder import listed_words
from tests.encoder_files import write_colour_pair

WIDTH, LAYERS, HEADS, PATCH, SIDE, VALUES = 768, 12, 12, 32, 224, 512


def vision_transformer() -> onnx.ModelProto:
    """Image encoder pixel_values [N, 3, 224, 224] -> image_embeds [N, 512], 88 million weights."""
    rng = np.random.default_rng(0)
    tensors, nodes = list[onnx.TensorProto](), list[onnx.NodeProto]()

    def weight(name: str, *shape: int) -> str:
        values = rng.normal(0, 0.02, shape).astype(np.float32)
        tensors.append(numpy_helper.from_array(values, name))
        return name

    def constant(name: str, values: list[int]) -> str:
        tensors.append(numpy_helper.from_array(np.array(values, np.int64), name))
        return name

    def node(kind: str, inputs: list[str], output: str, **how: object) -> str:
        nodes.append(helper.make_node(kind, inputs, [output], **how))
        return output

    def normal(x: str, name: str) -> str:
        scale, shift = weight(f"{name}.scale", WIDTH), weight(f"{name}.shift", WIDTH)
        return node("LayerNormalization", [x, scale, shift], name, axis=-1)

    def linear(x: str, name: str, a: int, b: int) -> str:
        product = node("MatMul", [x, weight(f"{name}.w", a, b)], f"{name}.product")
        return node("Add", [product, weight(f"{name}.b", b)], name)

    heads = constant("heads", [0, 0, HEADS, WIDTH // HEADS])
    flat, wide = constant("flat", [0, WIDTH, -1]), constant("wide", [0, 0, WIDTH])
    tensors.append(numpy_helper.from_array(np.float32(1 / np.sqrt(WIDTH / HEADS)), "scale"))
    kernel = weight("patches", WIDTH, 3, PATCH, PATCH)
    strides = [PATCH, PATCH]
    x = node("Conv", ["pixel_values", kernel], "conv", strides=strides, kernel_shape=strides)
    x = node("Transpose", [node("Reshape", [x, flat], "rows")], "tokens", perm=[0, 2, 1])
    x = node("Add", [x, weight("position", 1, (SIDE // PATCH) ** 2, WIDTH)], "placed")
    for n in range(LAYERS):
        y = normal(x, f"{n}.first")
        parts = {}
        for part, order in (("q", [0, 2, 1, 3]), ("k", [0, 2, 3, 1]), ("v", [0, 2, 1, 3])):
            one = node("Reshape", [linear(y, f"{n}.{part}", WIDTH, WIDTH), heads], f"{n}.{part}.h")
            parts[part] = node("Transpose", [one], f"{n}.{part}.t", perm=order)
        z = node("MatMul", [parts["q"], parts["k"]], f"{n}.fit")
        z = node("Softmax", [node("Mul", [z, "scale"], f"{n}.scaled")], f"{n}.share", axis=-1)
        z = node("MatMul", [z, parts["v"]], f"{n}.seen")
        z = node(
            "Reshape", [node("Transpose", [z], f"{n}.back", perm=[0, 2, 1, 3]), wide], f"{n}.z"
        )
        x = node("Add", [x, linear(z, f"{n}.out", WIDTH, WIDTH)], f"{n}.attended")
        y = linear(normal(x, f"{n}.second"), f"{n}.up", WIDTH, 4 * WIDTH)
        y = node("Mul", [y, node("Sigmoid", [y], f"{n}.gate")], f"{n}.gelu")
        x = node("Add", [x, linear(y, f"{n}.down", 4 * WIDTH, WIDTH)], f"{n}.layer")
    tensors.append(numpy_helper.from_array(np.array([1], np.int64), "axis"))
    x = node("ReduceMean", [normal(x, "last")], "pooled", axes=[1], keepdims=0)
    node("MatMul", [x, weight("projection", WIDTH, VALUES)], "image_embeds")
    shape = ["N", 3, SIDE, SIDE]
    graph = helper.make_graph(
        nodes,
        "vision",
        [helper.make_tensor_value_info("pixel_values", TensorProto.FLOAT, shape)],
        [helper.make_tensor_value_info("image_embeds", TensorProto.FLOAT, ["N", VALUES])],
        tensors,
    )
    made = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)])
    made.ir_version = 8
    return made


def _run(words: list[str], environment: dict[str, str]) -> tuple[float, float]:
    """Processor and wall time [s] of a command."""
    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    command = [sys.executable, "-m", "hereabouts.cli", *words]
    subprocess.run(command, env=environment, check=True, capture_output=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    used = after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime
    return used, time.perf_counter() - start


def main() -> None:
    """Run the benchmark."""
    parser = argparse.ArgumentParser("python -m benchmarks.encoder_cost", description=__doc__)
    parser.add_argument("recording")
    parser.add_argument("--turns", type=int, default=2)
    parser.add_argument("--limit", type=int, default=10_000)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        words = " ".join(listed_words()).split()
        write_colour_pair(folder / "vit", text_values=VALUES, words=words)
        onnx.save(vision_transformer(), str(folder / "vit" / "image.onnx"))
        files = f"{folder / 'vit' / 'image.onnx'},{folder / 'vit' / 'text.onnx'}"
        environment = {**os.environ, "HEREABOUTS_CACHE": str(folder / "cache")}
        opened = _run(["models", "check", "--encoder", files], environment)
        print(f"open and fit once: {opened[0]:.1f} s of processor, {opened[1]:.1f} s")  # noqa: T201
        least: dict[bool, list[float]] = {}
        for turn in range(2 * given.turns):
            encoded = turn % 2 == 1
            command = ["map", given.recording, "--into", str(folder / f"{turn}.map")]
            command += ["--limit", str(given.limit), *(["--encoder", files] if encoded else [])]
            found = _run(command, environment)
            print(f"{'with' if encoded else 'without'} encoder: {found[0]:.1f} s, {found[1]:.1f} s")  # noqa: T201
            before = least.get(encoded, [*found])
            least[encoded] = [min(pair) for pair in zip(before, found, strict=True)]
        ratios = [w / o for w, o in zip(least[True], least[False], strict=True)]
        print(f"with / without: processor {ratios[0]:.2f}, wall {ratios[1]:.2f}")  # noqa: T201


if __name__ == "__main__":
    main()

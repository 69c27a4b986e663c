"""Encoders for tests, in files with the interfaces of the public exports.

The pair of real use: images by the bundled classifier's probabilities of ImageNet's classes, and
texts by the classes that have one of their words in the name. Small ones of other interfaces.
"""

import csv
import json
from collections import defaultdict
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper
from tokenizers import Tokenizer
from tokenizers.models import WordLevel
from tokenizers.pre_tokenizers import Whitespace

from perception.inference.model_zoo import default_model, model_path

CLIP_MEAN = np.array([0.48145466, 0.4578275, 0.40821073], np.float32).reshape(1, 3, 1, 1)
CLIP_STD = np.array([0.26862954, 0.26130258, 0.27577711], np.float32).reshape(1, 3, 1, 1)
PHOTO = ("a", "photo", "of")
CLASSES = 1000


def words_of_classes(synsets: Path) -> dict[str, set[int]]:
    """Words in the names of ImageNet's classes -> the classes, by a table of index and name."""
    found = defaultdict[str, set[int]](set)
    with synsets.open(encoding="utf-8") as file:
        for row in csv.DictReader(file):
            for word in row["name"].casefold().replace("'", " ").replace("-", " ").split():
                found[word].add(int(row["index"]))
    found["drinkware"] = found["mug"] | found["cup"] | found["bottle"] | found["goblet"]
    found["unicorn"] = found["zebra"] | found["sorrel"]  # as WordNet's next of kin
    return dict(found)


def write_tokenizer(folder: Path, words: list[str], unknown: str = "<unk>") -> list[str]:
    """Write tokenizer.json with a token for each word; the tokens in their order."""
    tokens = list(dict.fromkeys(["<pad>", unknown, *PHOTO, *words]))
    numbers = {token: number for number, token in enumerate(tokens)}
    tokenizer = Tokenizer(WordLevel(numbers, unk_token=unknown))
    tokenizer.pre_tokenizer = Whitespace()
    tokenizer.save(str(folder / "tokenizer.json"))
    return tokens


def write_class_pair(folder: Path, words: Mapping[str, set[int]]) -> str:
    """Write image.onnx, text.onnx and tokenizer.json; the value of --encoder."""
    folder.mkdir(parents=True, exist_ok=True)
    tokens = write_tokenizer(folder, sorted(words))
    table = np.zeros((len(tokens), CLASSES), np.float32)
    for number, token in enumerate(tokens):
        table[number, sorted(words.get(token, ()))] = 1.0
    _write(text_network(table), folder / "text.onnx")
    _write(_class_images(), folder / "image.onnx")
    return f"{folder / 'image.onnx'},{folder / 'text.onnx'}"


def _class_images() -> onnx.ModelProto:
    """The bundled classifier, from CLIP's values to roots of its classes' probabilities."""
    model = onnx.load(str(model_path(default_model("scene").name)))
    graph, inside = model.graph, model.graph.input[0].name
    nodes = [
        helper.make_node("Mul", ["pixel_values", "scale"], ["scaled"]),
        helper.make_node("Add", ["scaled", "shift"], [inside]),
        *graph.node,
        helper.make_node("Softmax", ["imagenet_logits"], ["shares"], axis=1),
        helper.make_node("Sqrt", ["shares"], ["image_embeds"]),
    ]
    constants = [
        *graph.initializer,
        numpy_helper.from_array(CLIP_STD * 255, "scale"),
        numpy_helper.from_array(CLIP_MEAN * 255, "shift"),
    ]
    made = helper.make_graph(
        nodes,
        "image",
        [helper.make_tensor_value_info("pixel_values", TensorProto.FLOAT, ["N", 3, 224, 224])],
        [helper.make_tensor_value_info("image_embeds", TensorProto.FLOAT, ["N", CLASSES])],
        constants,
    )
    found = helper.make_model(made, opset_imports=model.opset_import)
    found.ir_version = model.ir_version
    return found


def text_network(
    table: np.ndarray,
    *,
    name: str = "input_ids",
    output: str = "text_embeds",
    length: int | str = "T",
    mask: int | None = None,
    kind: int = TensorProto.INT64,
    batch: int | str = "N",
    factor: float = 1.0,
) -> onnx.ModelProto:
    """A network that adds the rows of a table (V, D), times a factor, at numbers of tokens."""
    nodes, inputs, total = _text_nodes(name, output, [batch, length], mask, kind)
    constants = {"table": table * np.float32(factor)}
    return _model(nodes, inputs, {output: table.shape[1]}, constants, total)


def _text_nodes(name, output, shape, mask, kind):
    """`mask` is the type of an attention mask, if there is one."""
    inputs = [helper.make_tensor_value_info(name, kind, shape)]
    nodes = [helper.make_node("Gather", ["table", name], ["rows"])]
    rows = "rows"
    if mask is not None:
        inputs.append(helper.make_tensor_value_info("attention_mask", mask, shape))
        nodes += [
            helper.make_node("Cast", ["attention_mask"], ["share"], to=TensorProto.FLOAT),
            helper.make_node("Unsqueeze", ["share", "last"], ["wide"]),
            helper.make_node("Mul", ["rows", "wide"], ["counted"]),
        ]
        rows = "counted"
    nodes.append(helper.make_node("ReduceSum", [rows, "axis"], [output], keepdims=0))
    return nodes, inputs, {"axis": np.array([1]), "last": np.array([-1])}


def image_network(
    values: int,
    *,
    name: str = "pixel_values",
    output: str = "image_embeds",
    side: int | str = 224,
    batch: int | str = "N",
    kind: int = TensorProto.FLOAT,
    last: bool = False,
    factor: float = 1.0,
) -> onnx.ModelProto:
    """A network whose embedding is the mean of each colour, and their products, in D values.

    With `last` colours are the last axis; the embedding is multiplied by `factor`.
    """
    shape = [batch, side, side, 3] if last else [batch, 3, side, side]
    nodes, inputs, constants = _image_nodes(name, output, shape, values, kind, factor)
    return _model(nodes, inputs, {output: values}, constants, {})


def _image_nodes(name, output, shape, values, kind=TensorProto.FLOAT, factor=1.0):
    inputs = [helper.make_tensor_value_info(name, kind, shape)]
    axes = [0, 3, 1, 2] if shape[-1] == 3 else [0, 1, 2, 3]
    nodes = [
        helper.make_node("Cast", [name], ["values"], to=TensorProto.FLOAT),
        helper.make_node("Transpose", ["values"], ["ordered"], perm=axes),
        helper.make_node("GlobalAveragePool", ["ordered"], ["colours"]),
        helper.make_node("Flatten", ["colours"], ["flat"]),
        helper.make_node("MatMul", ["flat", "weights"], [output]),
    ]
    return nodes, inputs, {"weights": np.eye(3, values, dtype=np.float32) * np.float32(factor)}


def joint_network(table: np.ndarray, *, side: int = 224, length: int = 77) -> onnx.ModelProto:
    """Both encoders in one network, with a mask and the logits of pairs, as CLIP is exported."""
    shape = ["N", 3, side, side]
    images, first, some = _image_nodes("pixel_values", "image_embeds", shape, table.shape[1])
    whole = TensorProto.INT64
    texts, second, rest = _text_nodes("input_ids", "text_embeds", ["N", length], whole, whole)
    pairs = [
        helper.make_node("Transpose", ["text_embeds"], ["turned"]),
        helper.make_node("MatMul", ["image_embeds", "turned"], ["logits_per_image"]),
    ]
    sizes = {"logits_per_image": "N", "text_embeds": table.shape[1], "image_embeds": table.shape[1]}
    constants = {"table": table, **some, **rest}
    return _model([*images, *texts, *pairs], [*second, *first], sizes, constants, {})


def _model(nodes, inputs, outputs, constants, more) -> onnx.ModelProto:
    tensors = [numpy_helper.from_array(v, k) for k, v in {**constants, **more}.items()]
    given = [
        helper.make_tensor_value_info(name, TensorProto.FLOAT, ["N", size])
        for name, size in outputs.items()
    ]
    graph = helper.make_graph(nodes, "encoder", inputs, given, tensors)
    made = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)])
    made.ir_version = 8
    return made


def _write(model: onnx.ModelProto, path: Path) -> None:
    onnx.save(model, str(path))


def write_json(path: Path, content: object) -> None:
    path.write_text(json.dumps(content), encoding="utf-8")


#: colours as words, whose embeddings the small image networks give: (R, G, B) shares
COLOURS = {"red": (1, 0, 0), "green": (0, 1, 0), "blue": (0, 0, 1), "cup": (1, 1, 1)}


def colour_table(tokens: list[str], values: int = 3) -> np.ndarray:
    """Rows (V, D) of the words for colours."""
    table = np.zeros((len(tokens), values), np.float32)
    for number, token in enumerate(tokens):
        table[number, :3] = COLOURS.get(token, (0, 0, 0))
    return table


def write_colour_pair(folder, *, values=3, text_values=None, words=(), **how):
    """Write small image.onnx, text.onnx and tokenizer.json; the value of --encoder.

    `words` have tokens too. Keys of `how` that begin with text_ are for the text network.
    """
    folder.mkdir(parents=True, exist_ok=True)
    tokens = write_tokenizer(folder, [*sorted(COLOURS), *words])
    of_text = {k.removeprefix("text_"): how.pop(k) for k in [*how] if k.startswith("text_")}
    _write(image_network(values, **how), folder / "image.onnx")
    table = colour_table(tokens, text_values or values)
    table[5 + len(COLOURS) :, 0] = 1.0
    _write(text_network(table, **of_text), folder / "text.onnx")
    return f"{folder / 'image.onnx'},{folder / 'text.onnx'}"

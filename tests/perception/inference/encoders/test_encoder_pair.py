"""Encoders in files with the interfaces of the public exports, and files that do not belong."""

import shutil

import cv2
import numpy as np
import onnx
import pytest
from onnx import TensorProto

from kg.model.errors import ModelError
from perception.inference.encoders import EncoderPair, open_encoder
from tests.encoder_files import (
    CLIP_MEAN,
    CLIP_STD,
    COLOURS,
    colour_table,
    joint_network,
    text_network,
    write_colour_pair,
    write_json,
    write_tokenizer,
)

HALF = np.full((1, 3, 1, 1), 0.5, np.float32)
RGB = np.array([200, 90, 30], np.uint8)
SIGLIP = {"output": "pooler_output", "text_output": "pooler_output", "text_length": 64}


def plain(size: tuple[int, int] = (40, 40)) -> np.ndarray:
    return np.full((*size, 3), RGB, np.uint8)


def expected(mean: np.ndarray, std: np.ndarray) -> np.ndarray:
    values = ((RGB.reshape(1, 3, 1, 1) / 255 - mean) / std).ravel()
    return values / np.linalg.norm(values)


def check(pair: EncoderPair, mean: np.ndarray = CLIP_MEAN, std: np.ndarray = CLIP_STD) -> None:
    """That values of images are as the model wants them, and that texts lie where images do."""
    pair.check()
    np.testing.assert_allclose(pair.encode_image(plain()), expected(mean, std), atol=1e-3)
    for colour, rgb in list(COLOURS.items())[:3]:
        shown = pair.encode_image(np.full((50, 50, 3), np.array(rgb) * 255, np.uint8))
        fits = {word: float(shown @ pair.encode_text(word)) for word in ("red", "green", "blue")}
        assert max(fits, key=fits.get) == colour


@pytest.mark.parametrize(
    "how",
    [
        {},  # Transformers' and Transformers.js' exports
        {"text_mask": TensorProto.INT64, "text_length": 77},
        {"text_mask": TensorProto.BOOL, "text_length": 77},
        {"text_mask": TensorProto.FLOAT, "text_kind": TensorProto.INT32},
        {"last": True, "side": 256, "batch": 1, "text_batch": 1, "text_length": 64},
        {"batch": 4, "side": 384, "text_batch": 2},
        {"kind": TensorProto.FLOAT16},
        {"name": "image", "output": "features", "text_name": "text", "text_output": "features"},
        {"text_kind": TensorProto.INT32, "text_name": "tokens", "text_length": 77},
        {"output": "image_features", "text_output": "text_features", "side": "H"},
    ],
)
def test_the_interfaces_of_clip(tmp_path, how):
    check(open_encoder(write_colour_pair(tmp_path, **how)))


def test_siglip_stretches_and_has_values_around_zero(tmp_path):
    pair = open_encoder(write_colour_pair(tmp_path, **SIGLIP))
    check(pair, HALF, HALF)
    wide = pair.encode_image(plain((20, 80)))  # no grey beside it
    np.testing.assert_allclose(wide, expected(HALF, HALF), atol=1e-3)


@pytest.mark.parametrize("last", [False, True])
def test_a_network_of_bytes_gets_values_of_0_to_255(tmp_path, last):
    """Such exports have mean and deviation inside."""
    pair = open_encoder(write_colour_pair(tmp_path, kind=TensorProto.UINT8, last=last))
    check(pair, 0 * HALF, 2 * HALF)


def test_both_in_one_file(tmp_path):
    tokens = write_tokenizer(tmp_path, sorted(COLOURS))
    onnx.save(joint_network(colour_table(tokens)), str(tmp_path / "clip.onnx"))
    pair = open_encoder(str(tmp_path / "clip.onnx"))
    check(pair)
    assert pair.name == "clip"


@pytest.mark.parametrize(
    ("file", "content", "mean", "std"),
    [
        (
            "preprocessor_config.json",
            {
                "image_mean": [0, 0, 0],
                "image_std": [1, 1, 1],
                "size": {"shortest_edge": 256},
                "crop_size": {"height": 256, "width": 256},
            },
            np.zeros_like(HALF),
            np.ones_like(HALF),
        ),
        ("preprocessor_config.json", {"size": 384, "do_normalize": False}, 0 * HALF, 2 * HALF),
        (
            "open_clip_config.json",
            {
                "preprocess_cfg": {"mean": [0.5] * 3, "std": [0.5] * 3, "resize_mode": "squash"},
                "model_cfg": {"vision_cfg": {"image_size": 256}, "text_cfg": {"context_length": 9}},
            },
            HALF,
            HALF,
        ),
    ],
)
def test_configurations_above_the_folder_onnx(tmp_path, file, content, mean, std):
    """The layout of repositories: files of the model above, networks in onnx/."""
    write_colour_pair(tmp_path / "mobile" / "onnx", side="H")
    for name in ("image", "text"):
        inside = tmp_path / "mobile" / "onnx" / f"{name}.onnx"
        inside.rename(inside.with_name(f"{name}_model.onnx"))
    shutil.move(tmp_path / "mobile/onnx/tokenizer.json", tmp_path / "mobile/tokenizer.json")
    write_json(tmp_path / "mobile" / file, content)
    folder = tmp_path / "mobile" / "onnx"
    pair = open_encoder(f"{folder / 'image_model.onnx'},{folder / 'text_model.onnx'}")
    check(pair, mean, std)
    assert pair.name == "mobile"


def test_things_keep_their_aspect(tmp_path):
    """A tall thing is seen whole, with grey beside it."""
    tall = np.zeros((90, 30, 3), np.uint8)
    tall[:30, :, 0] = tall[60:, :, 2] = 255  # red above, blue below
    write_json(tmp_path / "preprocessor_config.json", {"do_normalize": False})
    red, green, blue = open_encoder(write_colour_pair(tmp_path)).encode_image(tall)
    assert abs(red - blue) < 0.01
    assert 0.65 < green / red < 0.8  # grey of two thirds of the image, and a ninth of red


@pytest.fixture
def files(tmp_path):
    """Callable: values of texts, words -> a folder with a pair."""

    def make(values: int = 3, name: str = "pair"):
        write_colour_pair(tmp_path / name, text_values=values)
        return tmp_path / name

    return make


def test_halves_that_do_not_belong_together_are_refused(files):
    folder = files()
    image, text = folder / "image.onnx", folder / "text.onnx"
    for given, message in (
        (f"{image}", "its text encoder is missing"),
        (f"{text}", "no image input"),
        (f"{text},{image}", "no image input"),
        (f"{image},{files(values=5, name='other') / 'text.onnx'}", "3 values .* 5"),
        (f"{image},{text},{text}", "clip.onnx or image.onnx,text.onnx"),
        (f"{image},{folder / 'none.onnx'}", "no encoder file"),
        ("", "clip.onnx or image.onnx,text.onnx"),
        (f"{folder / 'tokenizer.json'}", "no ONNX network"),
    ):
        with pytest.raises(ModelError, match=message) as refused:
            open_encoder(given)
        assert "\n" not in str(refused.value)


@pytest.mark.parametrize("words", [["red"], [f"word{n}" for n in range(3000)]])
def test_the_tokenizer_of_another_model_is_refused(files, words):
    folder = files()
    if len(words) == 1:  # the model has many more tokens than its tokenizer
        tokens = [*COLOURS, *(f"word{n}" for n in range(3000))]
        model = joint_network(colour_table(tokens))
        onnx.save(model, str(folder / "clip.onnx"))
        given = str(folder / "clip.onnx")
    else:
        given = f"{folder / 'image.onnx'},{folder / 'text.onnx'}"
    write_tokenizer(folder, ["cup", *words])
    with pytest.raises(ModelError, match="the tokenizer of the same model"):
        open_encoder(given)


@pytest.mark.parametrize(
    ("how", "message"),
    [
        ({"factor": np.nan}, "image.onnx gives .* no embedding; .* would work"),
        ({"factor": 0.0}, "image.onnx gives .* no embedding; .* would work"),
        ({"text_factor": np.nan}, "text.onnx gives .* no embedding; .* would work"),
        ({"text_mask": TensorProto.DOUBLE}, r"attention_mask is tensor\(double\); .* would work"),
        ({"side": 9000}, "up to 4096 a side would work"),
    ],
)
def test_networks_that_are_no_encoders_are_refused(tmp_path, how, message):
    with pytest.raises(ModelError, match=message) as refused:
        open_encoder(write_colour_pair(tmp_path, **how))
    assert "\n" not in str(refused.value)


def test_a_network_that_tells_nothing_apart_is_refused(files):
    folder = files()
    onnx.save(text_network(np.ones((9, 3), np.float32)), str(folder / "text.onnx"))
    with pytest.raises(ModelError, match=r"text.onnx makes the same of whatever"):
        open_encoder(f"{folder / 'image.onnx'},{folder / 'text.onnx'}")


def test_a_file_that_was_cut_off_is_refused_and_told_what_works(files):
    folder = files()
    text = folder / "text.onnx"
    text.write_bytes(text.read_bytes()[:100])
    with pytest.raises(ModelError, match=r"can be run \(.*\); its whole file, .* would work"):
        open_encoder(f"{folder / 'image.onnx'},{text}")


@pytest.mark.parametrize(("content", "message"), [(None, "no tokenizer.json"), ("{}", "is no")])
def test_a_missing_or_damaged_tokenizer_is_refused(files, content, message):
    folder = files()
    (folder / "tokenizer.json").unlink()
    if content is not None:
        (folder / "tokenizer.json").write_text(content)
    with pytest.raises(ModelError, match=message):
        open_encoder(f"{folder / 'image.onnx'},{folder / 'text.onnx'}")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("x" * 10_000, "at most 300 characters, got 10,000"),
        ("red " * 70, "tokens, and the text encoder reads 64"),
        ("чашка", "does not know the words"),
        ("赤い", "does not know the words"),
        ("Becher", "does not know the words"),
        ("  ", "no letters"),
        ("!?", "no letters"),
    ],
)
def test_texts_that_the_model_cannot_read_are_refused(tmp_path, text, message):
    pair = open_encoder(write_colour_pair(tmp_path, **SIGLIP))
    with pytest.raises(ModelError, match=message):
        pair.encode_text(text)
    np.testing.assert_array_equal(pair.encode_text("a RED  cup"), pair.encode_text("a red cup"))


def test_a_picture_that_shows_nothing_has_no_embedding(tmp_path):
    pair = open_encoder(write_colour_pair(tmp_path))
    with pytest.raises(ModelError, match="shows nothing"):
        pair.describe(cv2.imencode(".png", plain())[1].tobytes())


def test_the_checksum_is_of_networks_weights_and_tokenizer(files):
    folder = files()
    given = f"{folder / 'image.onnx'},{folder / 'text.onnx'}"
    seen = {open_encoder(given).checksum}
    (folder / "image.onnx_data").write_bytes(b"weights")
    seen.add(open_encoder(given).checksum)
    tokenizer = folder / "tokenizer.json"
    tokenizer.write_text(tokenizer.read_text() + "\n")
    seen.add(open_encoder(given).checksum)
    write_json(folder / "preprocessor_config.json", {"image_mean": [0.1, 0.2, 0.3]})
    seen.add(open_encoder(given).checksum)
    assert len(seen) == 4

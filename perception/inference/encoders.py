"""Encoders of looks: the bundled one, and pairs for image and text from the user's ONNX files.

Interfaces of the public exports (CLIP, OpenCLIP, SigLIP, MobileCLIP): one image input
[N, 3, H, W], and token numbers [N, T] with or without an attention mask, in two files or in one;
the output is the projected embedding (`image_embeds`, `text_embeds`), or for SigLIP
`pooler_output`. `preprocessor_config.json` or `open_clip_config.json` beside the image encoder, or
in the folder above, tells size and values of images; without them they are CLIP's, and SigLIP's
for a `pooler_output`. Images keep their aspect, with grey beside them, unless the model stretches.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from kg.model.errors import ModelError
from perception.camera.image_decoding import decode_picture
from perception.inference.model_zoo import encoder_files, resolve, sha256_of
from perception.inference.session import MAX_SIZE, Session, fit
from perception.inference.text_tokens import (
    TextTokens,
    configuration,
    load_tokens,
    tokens_file,
)

Floats = NDArray[np.float32]

#: outputs by what exporters call them, the projected embeddings first
_IMAGES: Final = ("image_embeds", "image_features", "image_embedding", "pooler_output")
_TEXTS: Final = ("text_embeds", "text_features", "text_embedding", "pooler_output")
_INTEGERS: Final = {"tensor(int64)": np.int64, "tensor(int32)": np.int32}
#: types of masks, too
_KINDS: Final = {**_INTEGERS, "tensor(bool)": np.bool_, "tensor(float)": np.float32}
#: file names that say nothing about the model, whose name is that of their folder then
_PLAIN_NAMES: Final = ("model", "vision", "visual", "image", "text", "onnx")
_CLIP: Final = (0.48145466, 0.4578275, 0.40821073), (0.26862954, 0.26130258, 0.27577711)
_SIGLIP: Final = (0.5, 0.5, 0.5), (0.5, 0.5, 0.5)
_SIDE: Final = 224  # [px] of images, where nothing says it
_TOKENS: Final = {"pooler_output": 64}  # of a text, where nothing says it: SigLIP's, ...
_USUAL_TOKENS: Final = 77  # ... else CLIP's
_CONFIGURATIONS: Final = (
    "preprocessor_config.json",
    "open_clip_config.json",
    "tokenizer_config.json",
)
#: tokens by which a model may have more than its tokenizer
_SPARE_TOKENS: Final = 1024
_GREY: Final = np.full((8, 8, 3), 127, np.uint8)
_RED: Final = np.full((8, 8, 3), (220, 60, 50), np.uint8)
_SAME: Final = 1e-5  # difference of unit vectors, below which nothing was told apart


@dataclass(frozen=True)
class EncoderPair:
    """Two encoders of one model; each opens its network when it is first used."""

    image_path: Path
    text_path: Path
    threads: int | None = None  # of the image encoder
    known_checksum: str = ""  # of files that are as they were when it was computed

    @cached_property
    def name(self) -> str:
        """Short name of the model: that of its file, or of its folder."""
        stem, folder = self.image_path.stem, self.image_path.resolve().parent
        if not stem.casefold().startswith(_PLAIN_NAMES):
            return stem
        return folder.parent.name if folder.name == "onnx" else folder.name

    @cached_property
    def checksum(self) -> str:
        """Hexadecimal sha256 of networks, weights, tokenizer, and how images are prepared."""
        if self.known_checksum:
            return self.known_checksum
        digests = [sha256_of(path) for path in self.files if path.name not in _CONFIGURATIONS]
        size, stretched, *values = self._preparation
        told = digests, size, stretched, [one.ravel().tolist() for one in values]
        return hashlib.sha256(repr(told).encode()).hexdigest()

    @cached_property
    def files(self) -> tuple[Path, ...]:
        """Files of both networks, weights beside them, the tokenizer, and configurations."""
        both = [p for path in (self.image_path, self.text_path) for p in _parts(path)]
        folders = [*_folders(self.image_path), *_folders(self.text_path)]
        told = [f / name for f in folders for name in _CONFIGURATIONS if (f / name).is_file()]
        return tuple(dict.fromkeys((*both, tokens_file(_folders(self.text_path)), *told)))

    @cached_property
    def size(self) -> int:
        """Number of values of both encoders' embeddings; raises ModelError where they differ."""
        images, texts = len(self.encode_image(_GREY)), len(self.encode_text("cup"))
        if images != texts:
            raise ModelError(
                f"{self.image_path.name} gives {images} values and {self.text_path.name} {texts}: "
                "both must be of one model, exported with their projection"
            )
        return images

    def describe(self, picture: bytes) -> Floats:
        """Unit vector (D,) of a JPEG or PNG.

        Raises RecordingError for a damaged picture, and ModelError for one that shows nothing.
        """
        return self.encode_image(decode_picture(picture))

    def encode_image(self, rgb: NDArray[np.uint8]) -> Floats:
        """Unit vector (D,) of an image (H, W, 3); raises ModelError."""
        session, name, output = self._images
        size, stretched, mean, deviation = self._preparation
        fitted = fit(rgb, size, "stretch" if stretched else "letterbox", "0..255").tensor
        values = (fitted - mean) / deviation
        inputs: dict[str, NDArray[Any]] = {name: values.astype(np.float32)}
        inputs |= _others(session, name, 8)
        return _unit(session, session.run([output], inputs)[0])

    def encode_text(self, text: str) -> Floats:
        """Unit vector (D,) of a text of up to 300 characters.

        Raises ModelError for a longer one, and for one in a language that the model does not know.
        """
        return _unit(self._texts[0], self._read(*self._tokens.of(text, self._context)))

    def _read(self, tokens: NDArray[np.int64], mask: NDArray[np.int64]) -> NDArray[np.generic]:
        """The output of the text encoder."""
        session, name, output = self._texts
        inputs = _others(session, name, tokens.shape[1])
        for one in session.inputs:
            if one == name or "mask" in one:
                inputs[one] = (tokens if one == name else mask).astype(_kind(session, one))
        return session.run([output], inputs)[0]

    def check(self) -> None:
        """Raise ModelError unless both are encoders of one model, with its tokenizer."""
        grey, red = self.encode_image(_GREY), self.encode_image(_RED)
        tokens, context = self._tokens, self._context
        last = self._token(tokens.size - 1, context)
        if last is None or self._token(tokens.size + _SPARE_TOKENS, context) is not None:
            raise ModelError(
                f"{tokens.path} has {tokens.size:,} tokens, and {self.text_path.name} another "
                "number: the tokenizer of the same model would work"
            )
        word, cup, _ = _unit(self._texts[0], last), self.encode_text("cup"), self.size
        for path, one, other in ((self.image_path, grey, red), (self.text_path, word, cup)):
            if np.abs(one - other).max() < _SAME:
                raise ModelError(
                    f"{path.name} makes the same of whatever it is given; an encoder would work"
                )

    def _token(self, token: int, context: int) -> NDArray[np.generic] | None:
        """The output of the text encoder for a token; None where it has no such token."""
        tokens = np.full((1, context), token, np.int64)
        try:
            return self._read(tokens, np.ones_like(tokens))
        except ModelError:
            return None

    @cached_property
    def _tokens(self) -> TextTokens:
        return load_tokens(_folders(self.text_path))

    @cached_property
    def _images(self) -> tuple[Session, str, str]:
        """The network of images, its input and its output."""
        session = Session(self.image_path, self.threads, "cpu")
        found = next((n for n, shape in session.inputs.items() if len(shape) == 4), None)
        if found is None:
            raise ModelError(
                f"{self.image_path.name} has no image input ({session.interface()}); "
                "image.onnx,text.onnx would work"
            )
        return session, found, _output(session, _IMAGES)

    @cached_property
    def _texts(self) -> tuple[Session, str, str]:
        """The network of texts, its input and its output."""
        same = self.text_path == self.image_path
        session = self._images[0] if same else Session(self.text_path, None, "cpu")
        found = _text_input(session)
        if found is None:
            raise ModelError(
                f"{self.text_path.name} reads no texts ({session.interface()}): its text encoder "
                "is missing; image.onnx,text.onnx would work"
            )
        for other in (name for name, shape in session.inputs.items() if len(shape) < 4):
            _kind(session, other)  # refuses rare types
        return session, found, _output(session, _TEXTS)

    @cached_property
    def _context(self) -> int:
        """Number of tokens of a text."""
        session, name, output = self._texts
        length = session.inputs[name][1]
        if isinstance(length, int):
            return length
        opened = configuration(_folders(self.text_path), "open_clip_config.json")
        given = _within(opened, "model_cfg", "text_cfg").get("context_length")
        return int(self._tokens.context or given or _TOKENS.get(output, _USUAL_TOKENS))

    @cached_property
    def _preparation(self) -> tuple[tuple[int, int], bool, Floats, Floats]:
        """Height and width of images, whether they are stretched, mean and deviation of values."""
        session, name, output = self._images
        folders = _folders(self.image_path)
        plain = configuration(folders, "preprocessor_config.json")
        opened = configuration(folders, "open_clip_config.json")
        values = _within(opened, "preprocess_cfg")
        mean, deviation = _SIGLIP if output == "pooler_output" else _CLIP
        mean = plain.get("image_mean") or values.get("mean") or mean
        deviation = plain.get("image_std") or values.get("std") or deviation
        if plain.get("do_normalize") is False:
            mean, deviation = (0.0, 0.0, 0.0), (1.0, 1.0, 1.0)
        given = plain.get("crop_size") or plain.get("size")
        given = given or _within(opened, "model_cfg", "vision_cfg").get("image_size")
        size = session.image_size(name, _sides(given))
        stretched = output == "pooler_output" or values.get("resize_mode") == "squash"
        try:
            arrays = [np.array(v, np.float32).reshape(1, 3, 1, 1) for v in (mean, deviation)]
        except (TypeError, ValueError) as error:
            raise ModelError(f"mean and deviation need three values, got {mean!r:.60}") from error
        if not (np.isfinite(arrays).all() and (arrays[1] > 0).all()):
            raise ModelError(f"deviations of values above 0 would work, got {deviation!r:.60}")
        if session.takes_bytes(name):  # the network has its own mean and deviation
            return size, stretched, 0 * arrays[0], np.ones_like(arrays[1])
        return size, stretched, arrays[0] * 255, arrays[1] * 255


def open_encoder(files: str, threads: int | None = None, *, check: bool = True) -> EncoderPair:
    """The encoders in "clip.onnx" (both in one), or "image.onnx,text.onnx"; both are checked.

    `files` may be the name of one that was fetched, too. Raises ModelError: a file is missing or no
    such network, the text encoder or its tokenizer is missing, or they are of different models.
    Without `check` it only looks for the files.
    """
    fetched = encoder_files(files.strip())
    paths = fetched or [Path(part.strip()) for part in files.split(",")]
    if len(paths) > 2 or not files.strip():
        raise ModelError(f"an encoder is clip.onnx or image.onnx,text.onnx; got {files!r}")
    missing = next((path for path in paths if not path.is_file()), None)
    if missing is not None:
        raise ModelError(f"no encoder file {missing}; clip.onnx or image.onnx,text.onnx would work")
    pair = EncoderPair(paths[0].resolve(), paths[-1].resolve(), threads)
    if check:
        pair.check()
    return pair


def _parts(path: Path) -> list[Path]:
    """A network's file, and those of its weights where they lie beside it."""
    beside = [path.with_name(path.name + ending) for ending in ("_data", ".data")]
    return [path, *(one for one in beside if one.is_file())]


def _folders(path: Path) -> list[Path]:
    """Folders of the configuration of a network: beside it, or above a folder `onnx`."""
    return [path.parent, path.parent.parent]


def _text_input(session: Session) -> str | None:
    """The input of tokens: the integers [N, T] that are no mask, positions or types."""
    for name, shape in session.inputs.items():
        other = any(part in name for part in ("mask", "position", "type"))
        if session.input_types[name] in _INTEGERS and len(shape) == 2 and not other:
            return name
    return None


def _output(session: Session, names: tuple[str, ...]) -> str:
    """The output with the embedding: by name, else the only one of [N, D]."""
    flat = [name for name, shape in session.outputs.items() if len(shape) == 2]
    flat = [name for name in flat if not name.startswith("logits")]
    found = [name for name in names if name in session.outputs] or (flat if len(flat) == 1 else [])
    if not found:
        raise ModelError(
            f"{session.path.name} has no embedding among its outputs ({session.interface()}); "
            f"an export with {names[0]} [N, D] would work"
        )
    return found[0]


def _others(session: Session, name: str, tokens: int) -> dict[str, NDArray[Any]]:
    """Values for the inputs beside `name`: the other half of a network that has both."""
    found: dict[str, NDArray[Any]] = {}
    for other, shape in session.inputs.items():
        if other == name:
            continue
        if len(shape) == 4:
            sides = session.image_size(other, (_SIDE, _SIDE))
            found[other] = np.zeros((1, 3, *sides), np.float32)
        else:
            length = shape[1] if len(shape) > 1 and isinstance(shape[1], int) else tokens
            values = np.arange(length) if "position" in other else np.full(length, "mask" in other)
            found[other] = values.astype(_kind(session, other))[None]
    return found


def _kind(session: Session, name: str) -> type[np.generic]:
    """Type of the values of an input beside images; raises ModelError for a rare one."""
    kind = session.input_types[name]
    if kind not in _KINDS:
        raise ModelError(
            f"{session.path.name}: input {name} is {kind}; one of {', '.join(_KINDS)} would work"
        )
    return _KINDS[kind]


def _sides(given: object) -> tuple[int, int]:
    """Height and width of a configuration: 224, [224, 224], or by name."""
    if isinstance(given, dict):
        short = given.get("shortest_edge", _SIDE)
        given = [given.get("height", short), given.get("width", short)]
    sides = given if isinstance(given, list) and len(given) == 2 else [given, given]
    height, width = (
        side if isinstance(side, int) and 0 < side <= MAX_SIZE else _SIDE for side in sides
    )
    return height, width


def _within(configuration: dict[str, Any], *names: str) -> dict[str, Any]:
    """An object within the objects of a configuration; {} where it is none."""
    for name in names:
        found = configuration.get(name)
        configuration = found if isinstance(found, dict) else {}
    return configuration


def _unit(session: Session, found: NDArray[np.generic]) -> Floats:
    """Unit vector (D,) of an output [N, D], [N, 1, D] or [D]; others of N repeat the first."""
    vector = np.asarray(found if found.ndim < 2 else found[0], np.float32).reshape(-1)
    length = float(np.linalg.norm(vector))
    if vector.shape != found.shape[-1:] or not np.isfinite(length) or length < 1e-9:
        raise ModelError(
            f"{session.path.name} gives values {found.shape} that are no embedding; an export "
            "whose output [N, D] has finite values that are not all 0 would work"
        )
    unit: Floats = vector / length
    return unit


FEATURES: Final = 1280
CLASSES: Final = 1000  # of ImageNet
_OUTPUTS: Final = ("features", "imagenet_logits")


@dataclass(frozen=True, slots=True)
class LookNetwork:
    """A network that describes pictures of things."""

    name: str
    session: Session

    @property
    def checksum(self) -> str:
        """Its name, which no other bundled network has."""
        return self.name

    @property
    def size(self) -> int:
        """Number of values of a picture."""
        return FEATURES + CLASSES

    def describe(self, picture: bytes) -> NDArray[np.float32]:
        """Features, and behind them log-probabilities of ImageNet's classes, of a JPEG or PNG.

        Raises RecordingError for a damaged picture, and ModelError for one that shows nothing.
        """
        name = next(iter(self.session.inputs))
        rgb = decode_picture(picture)
        fitted = fit(rgb, self.session.image_size(name), "letterbox", "0..255")
        features, logits = self.session.run(_OUTPUTS, {name: fitted.tensor})
        scores = logits[0].astype(np.float64) - logits[0].max()
        log_p = scores - np.log(np.exp(scores).sum())
        return np.concatenate([features[0], log_p]).astype(np.float32)


def load_look_network() -> LookNetwork:
    """The default scene classifier, which has features and ImageNet's classes too.

    Raises ModelError for a network without them.
    """
    path, card = resolve("default", "scene")
    session = Session(path, None, "cpu")
    sizes = [tuple(session.outputs.get(output, ())[1:]) for output in _OUTPUTS]
    if sizes != [(FEATURES,), (CLASSES,)]:
        raise ModelError(
            f"{path.name} does not describe things ({session.interface()}); the bundled scene "
            "classifier would work"
        )
    return LookNetwork(card.name if card is not None else path.stem, session)

"""The user's encoder: compares texts with looks, by a threshold that absent words are fitted to.

How well a text fits a picture is the cosine of two embeddings. It is counted in deviations from how
well words of absent things (animals, vehicles, landscapes) fit that picture, and then from how well
the text fits the pictures of the map, so that neither a picture nor a text counts that fits all.
A thing is said to look like a text where the text fits it better than 97 % of the absent words fit
the picture of the map that each fits best.

The user's cache remembers the files of each encoder by its checksum, and embeddings of its absent
words: maps keep name and checksum alone.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from kg.model.errors import ModelError
from kg.model.regular_files import read_text
from mapping.looks.look_store import ENCODED, Floats, kept_looks
from perception.inference.array_file import DAMAGE, read_arrays, write_arrays

if TYPE_CHECKING:
    from perception.inference.encoders import EncoderPair

MIN_WORDS: Final = 20  # absent words that a threshold is fitted to, at least, ...
MAX_WORDS: Final = 1000  # ... and at most
FITTED: Final = 0.97  # share of them that no picture of a map looks like
_PRIOR: Final = 10  # views of nothing in particular, so that few views of a map are no rule
_MAX_FILE: Final = 1 << 26  # bytes
_WORDS: Final = Path(__file__).with_name("absent_words.txt")


@dataclass(frozen=True)
class UserEncoder:
    """An encoder with absent words; `images` and `texts` of it are one model's."""

    pair: EncoderPair
    words: tuple[str, ...]  # absent ones
    negatives: Floats  # (m, D) their embeddings

    @property
    def name(self) -> str:
        """Short name of the model."""
        return self.pair.name

    @property
    def checksum(self) -> str:
        """sha256 of its files."""
        return self.pair.checksum

    @property
    def size(self) -> int:
        """Number of values of an embedding."""
        return int(self.negatives.shape[1])

    def describe(self, picture: bytes) -> Floats:
        """Embedding (D,) of a JPEG or PNG; raises RecordingError or ModelError."""
        return self.pair.describe(picture)

    def scores(
        self, text: str, synset: str, things: Sequence[Floats]
    ) -> tuple[NDArray[np.float64], float]:
        """How much each of n things looks like a text, (n,), and from which score it is said to.

        `things` are embeddings (views, D). Raises ModelError for a text that it does not know.
        """
        found = fits(things, np.stack([self.pair.encode_text(text)]), self.negatives)
        return found[:, 0], least_fit(fits(things, self.negatives, self.negatives))


def fits(things: Sequence[Floats], texts: Floats, negatives: Floats) -> NDArray[np.float64]:
    """How well n things fit k texts, (n, k), each by the view of it that fits best.

    In deviations: of how well the view fits the `negatives`, and of how well the text fits all
    views, with some more views that it fits as an absent word does.
    """
    rows = np.concatenate(things).astype(np.float64)
    usual = rows @ negatives.T.astype(np.float64)
    deviation = np.maximum(usual.std(axis=1, keepdims=True), 1e-9)
    fit = (rows @ texts.T.astype(np.float64) - usual.mean(axis=1, keepdims=True)) / deviation
    number = len(rows) + _PRIOR
    fit = fit - fit.sum(axis=0) / number
    fit /= np.sqrt(((fit**2).sum(axis=0) + _PRIOR) / number)
    starts = np.cumsum([0, *(len(one) for one in things[:-1])])
    found: NDArray[np.float64] = np.maximum.reduceat(fit, starts, axis=0)
    return found


def least_fit(found: NDArray[np.float64]) -> float:
    """The fit that `FITTED` of the absent words, (n things, m words), have at most."""
    return float(np.quantile(found.max(axis=0), FITTED))


def share_refused(things: Sequence[Floats], encoder: UserEncoder) -> float:
    """Share of absent words that nothing is said to look like, each fitted to the other ones."""
    found = fits(things, encoder.negatives, encoder.negatives)
    refused = [
        found[:, word].max() <= least_fit(np.delete(found, word, axis=1))
        for word in range(found.shape[1])
    ]
    return float(np.mean(refused))


def remembered(files: str, words: Sequence[str] | None = None) -> UserEncoder:
    """The checked encoder of `files` ("image.onnx,text.onnx"), which this machine remembers.

    Files that are as they were are not opened. `words` are absent ones in place of those before, or
    of the shipped ones. Raises ModelError.
    """
    from perception.inference.encoders import open_encoder  # loads onnxruntime

    pair = open_encoder(files, threads=1, check=False)
    if words is None:
        for known in _file("").parent.glob("*.npz"):
            if (same := _load(known, pair)) is not None:
                return same
    pair.check()
    before = _absent(_file(pair.checksum)) if words is None else None
    if before is None:
        before = _encoded(pair, listed_words() if words is None else words)
    encoder = UserEncoder(pair, *before)
    arrays = {
        "checksum": np.array(pair.checksum),
        "paths": np.array([str(pair.image_path), str(pair.text_path)]),
        "stamps": np.array(_stamps(pair)),
        "words": np.array(encoder.words, dtype=np.str_),
        "negatives": encoder.negatives,
    }
    path = _file(pair.checksum)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ModelError(f"cannot make {path.parent}: {error.strerror}") from error
    write_arrays(path, arrays)
    return encoder


def given_words(text: str) -> list[str]:
    """Words with commas between them, or those of the file `text`, one a line.

    Raises ModelError for a file that is missing or cannot be read.
    """
    if os.path.isfile(text):  # noqa: PTH113 - Path.is_file raises for names that are too long
        return listed_words(Path(text))
    if text.endswith((".txt", ".csv")) or text.startswith((".", "/", "~")):
        raise ModelError(f"no file of words {text}; zebra,glacier,... or a file there would work")
    return [word.strip() for word in text.split(",") if word.strip()]


def listed_words(path: Path = _WORDS) -> list[str]:
    """Words of a file, one a line; raises ModelError for an unreadable one."""
    try:
        lines = read_text(path, "utf-8-sig", max_bytes=1 << 20).splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise ModelError(f"cannot read words from {path}: {error}") from error
    return [line.strip() for line in lines if line.strip()]


def _encoded(pair: EncoderPair, words: Sequence[str]) -> tuple[tuple[str, ...], Floats]:
    """Those of the words that an encoder knows, with their embeddings (m, D)."""
    found = dict[str, Floats]()
    for word in dict.fromkeys(words):
        try:
            found[word] = pair.encode_text(word)
        except ModelError:
            continue  # a word that it does not know
    if not MIN_WORDS <= len(found) <= MAX_WORDS:
        raise ModelError(
            f"a threshold is fitted to {MIN_WORDS} to {MAX_WORDS} absent words that the encoder "
            f"knows, got {len(found)}; a file with a word a line would work as --negatives"
        )
    return tuple(found), np.stack(list(found.values()))


_opened: dict[Path, UserEncoder] = {}  # by the file that remembers it
_opening = threading.Lock()


def encoder_of(folder: Path) -> UserEncoder | None:
    """The encoder that the map in `folder` was made with; None without one.

    Raises ModelError where its files are not on this machine.
    """
    kept = kept_looks(folder / ENCODED)
    if kept is None:
        return None
    with _opening:
        remembers = _file(kept.checksum)
        found = _opened.get(remembers) or _load(remembers)
        if found is None:
            raise ModelError(
                f"the encoder {kept.name} of this map is not known on this machine; "
                "`hereabouts models check --encoder FILE` with its files would work"
            )
        _opened[remembers] = found
    return found


def check_same(folder: Path, encoder: UserEncoder) -> None:
    """Raise ModelError where the map in `folder` was made with another encoder."""
    kept = kept_looks(folder / ENCODED)
    if kept is not None and kept.checksum != encoder.checksum:
        raise ModelError(
            f"the map was made with the encoder {kept.name} ({kept.checksum[:12]}), and not with "
            f"{encoder.name} ({encoder.checksum[:12]}), whose embeddings do not compare; "
            "that one, or a new map, would work"
        )


def _file(checksum: str) -> Path:
    from perception.inference.model_zoo import cache_folder  # it loads an HTTP client

    return cache_folder() / "encoders" / f"{checksum[:32]}.npz"


def _load(remembers: Path, only: EncoderPair | None = None) -> UserEncoder | None:
    """The encoder of a file whose own files are where and as they were; else None.

    With `only`, None too for files at other paths, or ones of another time.
    """
    from perception.inference.encoders import EncoderPair  # loads onnxruntime

    known = _absent(remembers)
    if known is None:
        return None
    try:
        data = read_arrays(remembers, _MAX_FILE)
        images, texts = (Path(str(path)) for path in data["paths"].tolist())
        if only is not None and (images, texts) != (only.image_path, only.text_path):
            return None
        pair = EncoderPair(images, texts, 1, str(data["checksum"]))
        if _stamps(pair) != data["stamps"].tolist():
            pair = EncoderPair(images, texts, 1)
            if only is not None or pair.checksum != str(data["checksum"]):
                return None
    except (*DAMAGE, ModelError):
        return None
    return UserEncoder(pair, *known)


def _absent(remembers: Path) -> tuple[tuple[str, ...], Floats] | None:
    """Absent words of an encoder that a file remembers, with their embeddings (m, D)."""
    try:
        data = read_arrays(remembers, _MAX_FILE)
        words, found = tuple(map(str, data["words"].tolist())), data["negatives"]
    except DAMAGE:
        return None
    sound = found.ndim == 2 and MIN_WORDS <= len(words) == len(found)
    return (words, found.astype(np.float32)) if sound else None


def _stamps(pair: EncoderPair) -> list[str]:
    """Size and time of each file of an encoder."""
    states = ((path, path.stat()) for path in pair.files)
    return [f"{path} {state.st_size} {state.st_mtime_ns}" for path, state in states]

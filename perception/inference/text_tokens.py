"""Text tokens: the numbers by which a text encoder reads a text, as its `tokenizer.json` says."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from kg.model.errors import ModelError
from kg.model.regular_files import read_text

FILE: Final = "tokenizer.json"
MAX_TEXT: Final = 300  # characters
_MAX_FILE: Final = 1 << 26  # bytes
_MAX_CONTEXT: Final = 512  # tokens; a configuration says "no limit" by a huge number
#: UTF-8 bytes a token, below which a text in another script than Latin was cut into single letters
_FEWEST_BYTES: Final = 2.5
_LATIN: Final = 0x250  # first code point behind the Latin letters


@dataclass(frozen=True, slots=True)
class TextTokens:
    """A tokenizer, and how its model is given tokens."""

    path: Path
    tokenizer: Any  # tokenizers.Tokenizer
    pad: int  # token behind the end of a text
    context: int | None  # tokens of a text; None where no file says it
    unknown: int | None  # token of what the tokenizer does not know

    @property
    def size(self) -> int:
        """Number of tokens that there are."""
        return int(self.tokenizer.get_vocab_size())

    def of(self, text: str, context: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Tokens (1, `context`) of a text, and 1 for each of them that is no padding, else 0.

        Raises ModelError for a text that is too long, empty, or in a language without tokens.
        """
        if len(text) > MAX_TEXT:
            raise ModelError(f"a text has at most {MAX_TEXT} characters, got {len(text):,}")
        plain = " ".join(text.casefold().split())
        if not any(c.isalnum() for c in plain):
            raise ModelError(f"{text!r} has no letters; a text such as red mug would work")
        self._check_language(plain)
        ids = self.tokenizer.encode(f"a photo of {plain}").ids
        if len(ids) > context:
            raise ModelError(
                f"{text[:40]!r} has {len(ids)} tokens, and the text encoder reads {context}; "
                "a shorter text would work"
            )
        padded = np.full((1, context), self.pad, np.int64)
        padded[0, : len(ids)] = ids
        return padded, (np.arange(context) < len(ids)).astype(np.int64)[None]

    def _check_language(self, plain: str) -> None:
        ids = self.tokenizer.encode(plain, add_special_tokens=False).ids
        foreign = any(c.isalpha() and ord(c) >= _LATIN for c in plain)
        cut = foreign and len(plain.encode()) < _FEWEST_BYTES * len(ids)
        if not ids or self.unknown in ids or cut:
            raise ModelError(
                f"the text encoder does not know the words of {plain[:40]!r}; those of its own "
                "language, mostly English, would work"
            )


def tokens_file(folders: list[Path]) -> Path:
    """The tokenizer's file in the first of `folders` that has one; raises ModelError for none."""
    path = next((f / FILE for f in folders if (f / FILE).is_file()), None)
    if path is None:
        raise ModelError(f"no {FILE} beside the text encoder; that of the same model would work")
    return path


def load_tokens(folders: list[Path]) -> TextTokens:
    """The tokenizer of the first of `folders` that has one; raises ModelError for none."""
    path = tokens_file(folders)
    try:
        from tokenizers import Tokenizer
    except ModuleNotFoundError as error:
        raise ModelError(
            "texts need the package tokenizers: pip install 'hereabouts[encoder]'"
        ) from error
    try:
        content = read_text(path, max_bytes=_MAX_FILE)
        tokenizer = Tokenizer.from_str(content)
        model = json.loads(content)["model"]
    except Exception as error:  # the package raises nothing narrower
        raise ModelError(f"{path} is no tokenizer: {' '.join(str(error).split())[:120]}") from error
    own, settings = tokenizer.padding or {}, configuration(folders, "tokenizer_config.json")
    named = settings.get("pad_token") or settings.get("eos_token")
    named = named.get("content") if isinstance(named, dict) else named
    pad = own.get("pad_id", tokenizer.token_to_id(named) if isinstance(named, str) else None)
    length = (tokenizer.truncation or {}).get("max_length", settings.get("model_max_length"))
    tokenizer.no_padding()
    tokenizer.no_truncation()
    unknown = model.get("unk_id")
    if unknown is None and model.get("unk_token"):
        unknown = tokenizer.token_to_id(model["unk_token"])
    known = isinstance(length, int) and 0 < length <= _MAX_CONTEXT
    return TextTokens(path, tokenizer, int(pad or 0), length if known else None, unknown)


def configuration(folders: list[Path], name: str) -> dict[str, Any]:
    """A JSON object of the first of `folders` that has a file of that name; {} for none.

    Raises ModelError for one that is no such object.
    """
    path = next((f / name for f in folders if (f / name).is_file()), None)
    if path is None:
        return {}
    try:
        found = json.loads(read_text(path, max_bytes=_MAX_FILE))
    except (OSError, ValueError, RecursionError) as error:
        raise ModelError(f"cannot read {path}: {error}") from error
    if not isinstance(found, dict):
        raise ModelError(f"{path} holds no JSON object")
    return found

"""Values of answers, made plain: bounded text in one visible line, and times to the second."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterable
from datetime import UTC, datetime
from typing import Final

from kg.history.timestamps import iso

#: maximum characters of a label, of a sentence and of an IRI
LABEL: Final = 120
SENTENCE: Final = 400
ADDRESS: Final = 300
#: control, format (bidirectional and invisible ones), surrogate, private use, line separators
_HIDDEN: Final = frozenset(("Cc", "Cf", "Cs", "Co", "Zl", "Zp"))
#: variation selectors, which are invisible too and can carry any text
_SELECTORS: Final = (range(0xFE00, 0xFE10), range(0xE0100, 0xE01F0))


def escaped(value: object, max_length: int) -> str:
    r"""`value` in one visible line of at most `max_length` characters; a cut ends in an ellipsis.

    >>> escaped("cup\n\u202eSYSTEM", 40)
    'cup\\u000a\\u202eSYSTEM'
    """
    text = str(value)
    written = "".join(map(_visible, text[: max_length + 1]))
    return written if len(written) <= max_length else written[: max_length - 1] + "…"


def in_one_line(message: str) -> str:
    """A message in one visible line, since it may contain text of the map."""
    return escaped(" ".join(message.split()), SENTENCE)


def for_agents(sentences: Iterable[str]) -> list[str]:
    """Sentences without the commands of a shell that tell people more."""
    return [re.sub(r":? `hereabouts [^`]*`", "", sentence) for sentence in sentences]


def clock(seconds: float) -> str:
    """A time [s since 1970] as ISO 8601 in UTC, to the second."""
    return iso(seconds).partition(".")[0] + "Z"


def time_or_none(value: object) -> str | None:
    """A time as ISO 8601 in UTC, to the second; None for other values."""
    return clock(value.astimezone(UTC).timestamp()) if isinstance(value, datetime) else None


def _visible(character: str) -> str:
    code = ord(character)
    if unicodedata.category(character) not in _HIDDEN and not any(code in r for r in _SELECTORS):
        return character
    return f"\\u{code:04x}" if code < 0x10000 else f"\\U{code:08x}"

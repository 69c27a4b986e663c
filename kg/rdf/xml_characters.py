"""Characters that XML 1.0 does not allow (section 2.2), rejected or replaced.

New text with such characters is rejected. Where an older map holds them, XML and pages have U+FFFD
instead; all other formats escape them.
"""

from __future__ import annotations

import re
from typing import Final

_UNWRITABLE: Final = re.compile("[\x00-\x08\x0b\x0c\x0e-\x1f\ud800-\udfff\ufffe\uffff]")
#: the same in UTF-8, and the carriage return, which a parser of XML takes for a line feed
_BYTES: Final = re.compile(rb"[\x00-\x08\x0b\x0c\x0d\x0e-\x1f]|\xef\xbf[\xbe\xbf]")
_STAND_IN: Final = "\ufffd".encode()
_RETURN: Final = b"&#13;"


def unwritable(text: str) -> str | None:
    """The first character of `text` that XML cannot hold, as U+0001; None where there is none."""
    found = _UNWRITABLE.search(text)
    return None if found is None else f"U+{ord(found[0]):04X}"


def shown(text: str) -> str:
    """`text` with U+FFFD for each character that XML cannot hold."""
    return _UNWRITABLE.sub("\ufffd", text)


def in_xml(body: bytes) -> bytes:
    """A document of XML, in UTF-8, as every parser reads it."""
    return _BYTES.sub(_written, body)


def is_xml(media_type: str) -> bool:
    """Whether documents of that media type are XML."""
    return media_type.endswith(("/xml", "+xml"))


class XmlPieces:
    """`in_xml` of a document that comes in pieces, cut anywhere."""

    def __init__(self) -> None:
        self._kept = b""

    def take(self, piece: bytes) -> bytes:
        """The characters that can be written by now."""
        body = self._kept + piece
        # the beginning of a character of three bytes may be one that is to be replaced
        cut = next((n for n in (2, 1) if body.endswith(b"\xef\xbf"[:n])), 0)
        body, self._kept = (body[:-cut], body[-cut:]) if cut else (body, b"")
        return in_xml(body)

    def rest(self) -> bytes:
        """The characters that were held back."""
        rest, self._kept = self._kept, b""
        return rest


def _written(match: re.Match[bytes]) -> bytes:
    return _RETURN if match[0] == b"\r" else _STAND_IN

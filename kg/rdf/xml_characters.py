"""Characters that XML 1.0 does not allow (section 2.2).

New text with such characters is rejected. If an older map holds them, XML and pages contain U+FFFD
instead; all other formats escape them.
"""

from __future__ import annotations

import re
from typing import Final

_UNWRITABLE: Final = re.compile("[\x00-\x08\x0b\x0c\x0e-\x1f\ud800-\udfff\ufffe\uffff]")
#: the same in UTF-8, and the carriage return, which an XML parser reads as a line feed
_BYTES: Final = re.compile(rb"[\x00-\x08\x0b\x0c\x0d\x0e-\x1f]|\xef\xbf[\xbe\xbf]")


def unwritable(text: str) -> str | None:
    """The first character of `text` that XML does not allow, as U+0001; None without one."""
    match = _UNWRITABLE.search(text)
    return None if match is None else f"U+{ord(match[0]):04X}"


def shown(text: str) -> str:
    """`text` with U+FFFD for each character that XML does not allow."""
    return _UNWRITABLE.sub("\ufffd", text)


def in_xml(body: bytes) -> bytes:
    """A UTF-8 XML document in which all characters are allowed."""
    return _BYTES.sub(lambda match: b"&#13;" if match[0] == b"\r" else "\ufffd".encode(), body)


def is_xml(media_type: str) -> bool:
    """Whether the media type is one of XML."""
    return media_type.endswith(("/xml", "+xml"))


class XmlPieces:
    """`in_xml` for a document in pieces of any length."""

    def __init__(self) -> None:
        self._pending = b""

    def take(self, piece: bytes) -> bytes:
        """The next characters, without an incomplete one at the end."""
        body = self._pending + piece
        # the first bytes of a character of three bytes that may have to be replaced
        cut = next((n for n in (2, 1) if body.endswith(b"\xef\xbf"[:n])), 0)
        body, self._pending = (body[:-cut], body[-cut:]) if cut else (body, b"")
        return in_xml(body)

    def rest(self) -> bytes:
        """The bytes of an incomplete character at the end of the document."""
        rest, self._pending = self._pending, b""
        return rest

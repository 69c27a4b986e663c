"""Turtle without escaped local names: full IRIs where a prefixed name would need a backslash.

``object:1\\/geometry`` is valid Turtle 1.1, but the OWLAPI (5.1.9) does not read it.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Final

_TOKEN: Final = re.compile(
    r"""
      "(?:[^"\\]|\\.)*" | <[^>]*>
    | (?P<prefix>[\w-]*):(?P<local>(?:[^\s\\;,()\[\]"<>]|\\.)*)
    """,
    re.VERBOSE,
)
_ESCAPE: Final = re.compile(r"\\(.)")


def with_full_iris(turtle: str, prefixes: Mapping[str, str]) -> str:
    """A Turtle or TriG document of the engine, with full IRIs for names that contain an escape.

    Strings must be on one line, in double quotes.
    """
    if "\\" not in turtle:
        return turtle

    def written(match: re.Match[str]) -> str:
        local, namespace = match["local"], prefixes.get(match["prefix"] or "")
        if local is None or namespace is None or "\\" not in local:
            return match[0]
        return "<" + namespace + _ESCAPE.sub(r"\1", local) + ">"

    return _TOKEN.sub(written, turtle)

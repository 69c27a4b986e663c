"""Text tables: cells are folded to fit a terminal; wide characters count as two columns."""

from __future__ import annotations

import unicodedata
from collections.abc import Iterator, Sequence
from typing import Final

_MIN_WIDTH: Final = 3  # columns of a terminal that a folded cell keeps
_RULE: Final = "─"
_DIRECTIONS: Final = "\u202a\u202b\u202c\u202d\u202e\u2066\u2067\u2068\u2069"


def text_table(
    header: Sequence[str], rows: Sequence[Sequence[str]], right: Sequence[bool], width: int
) -> str:
    """A table at most `width` wide, if that is possible; `right` marks right-aligned columns.

    Below a width of 120, columns stand closer together.
    """
    gap = "   " if width >= 120 else "  "
    cells = [[printable(cell) for cell in row] for row in (header, *rows)]
    widths = _fitted(
        [
            max(max(map(_columns, cell.split("\n"))) for cell in column)
            for column in zip(*cells, strict=True)
        ],
        width - len(gap) * (len(header) - 1) - 1,
    )
    lines = [line for row in cells for line in _row(row, widths, right, gap)]
    rule = " " + _RULE * (sum(widths) + len(gap) * (len(widths) - 1))
    heading = max(len(_folded(cell, size)) for cell, size in zip(cells[0], widths, strict=True))
    return "\n".join([*lines[:heading], rule, *lines[heading:]])


def text_blocks(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Rows as blocks of lines, ``name  value``, for a terminal too narrow for a table."""
    width = max((_columns(name) for name in header), default=0)
    blocks = [
        "\n".join(
            f" {printable(name):{width}}  {printable(cell)}".rstrip()
            for name, cell in zip(header, row, strict=True)
            if cell
        )
        for row in rows
    ]
    return "\n\n".join(blocks)


def _row(
    cells: Sequence[str], widths: Sequence[int], right: Sequence[bool], gap: str
) -> Iterator[str]:
    folded = [_folded(cell, width) for cell, width in zip(cells, widths, strict=True)]
    for number in range(max(map(len, folded))):
        parts = []
        for lines, width, to_right in zip(folded, widths, right, strict=True):
            text = lines[number] if number < len(lines) else ""
            space = " " * (width - _columns(text))
            parts.append(space + text if to_right else text + space)
        yield f" {gap.join(parts)}".rstrip()


def _fitted(widths: list[int], total: int) -> list[int]:
    """The widths of columns, the widest made narrower until all fit into `total`."""
    while sum(widths) > total and max(widths) > _MIN_WIDTH:
        widths[widths.index(max(widths))] -= 1
    return widths


def _folded(text: str, width: int) -> list[str]:
    """The lines of a cell: broken between words, and within one that is too long."""
    lines = []
    for line in text.split("\n"):
        rest = line
        while _columns(rest) > width:
            at = max(1, _fitting(rest, width))
            blank = rest.rfind(" ", 0, at + 1)
            at = blank if blank > 0 else at
            lines.append(rest[:at].rstrip())
            rest = rest[at:].lstrip()
        lines.append(rest)
    return lines


def _fitting(text: str, width: int) -> int:
    """The number of characters that fit into `width`."""
    used = 0
    for number, character in enumerate(text):
        used += _columns(character)
        if used > width:
            return number
    return len(text)


def _columns(text: str) -> int:
    """Width of a text in columns of a terminal."""
    if text.isascii():
        return len(text)
    return sum(
        0 if unicodedata.combining(c) else 2 if unicodedata.east_asian_width(c) in "WF" else 1
        for c in text
    )


def printable(text: str) -> str:
    """The text without characters that control a terminal or the direction of writing."""
    lines = text.expandtabs(4).splitlines() or [""]
    kept = (
        "".join(c for c in line if unicodedata.category(c) != "Cc" and c not in _DIRECTIONS)
        for line in lines
    )
    return "\n".join(kept)

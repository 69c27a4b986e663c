"""Counts over all members: what a query that counts means when several maps answer as one.

COUNT, SUM, MIN and MAX of parts can be put together; an average, a sample or a count of distinct
values cannot, and is refused.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from kg.errors import QueryError
from kg.server.fleet.gathering import Row, values
from kg.sparql_text import outermost, tail_of, tokens

_ITEM = re.compile(
    r"\s*(?:[?$](?P<key>\w+)"
    r"|\(\s*(?P<how>count|sum|min|max)\s*\(\s*(?:\*|[?$]\w+)\s*\)\s*as\s+[?$](?P<name>\w+)\s*\))",
    re.IGNORECASE,
)
_AGAIN = {"count": "SUM", "sum": "SUM", "min": "MIN", "max": "MAX"}
_CAN = "totals are of SELECT with columns, COUNT, SUM, MIN and MAX of one variable, and GROUP BY"


@dataclass(frozen=True, slots=True)
class Totals:
    """A query that counts, in two steps: each member's, and the one over their answers."""

    members: str  # the query for the members, without order and limit
    keys: tuple[str, ...]
    sums: tuple[tuple[str, str], ...]  # column, and the aggregate that puts it together
    columns: tuple[str, ...]
    prologue: str
    tail: str  # ORDER BY and LIMIT, as they were

    def over(self, rows: Sequence[Row]) -> str:
        """The query that puts the members' rows together."""
        known = self._known(rows)
        parts = dict(self.sums)
        chosen = " ".join(
            f"({parts[name]}(?part_{name}) AS ?{name})" if name in parts else f"?{name}"
            for name in self.columns
        )
        renamed = [
            {(f"part_{key}" if key in parts else key): term for key, term in row.items()}
            for row in known
        ]
        given = [f"part_{name}" if name in parts else name for name in self.columns]
        group = f" GROUP BY {' '.join(f'?{key}' for key in self.keys)}" if self.keys else ""
        where = f"WHERE {{ {values(renamed, given)} }}{group}"
        return f"{self.prologue} SELECT {chosen} {where} {self.tail}"

    def _known(self, rows: Sequence[Row]) -> list[Row]:
        """The rows without those of members that have nothing to take the least or most of."""
        extremes = [name for name, how in self.sums if how in ("MIN", "MAX")]
        if self.keys or not extremes:
            return list(rows)
        return [row for row in rows if any(name in row for name in extremes)]


def prologue_of(sparql: str) -> str:
    """What stands before the query form: BASE and PREFIX."""
    forms = ("select", "ask", "construct", "describe")
    starts = (m.start() for m in tokens(sparql) if (m["word"] or "").lower() in forms)
    return sparql[: next(starts, 0)]


def totals_of(sparql: str) -> Totals:
    """The two steps of a query that counts; raises QueryError where it cannot be put together."""
    prologue = prologue_of(sparql)
    rest = _without_comments(sparql[len(prologue) :])
    flat, tail = outermost(rest), tail_of(rest)
    opening = rest.find("{")
    keyword = re.match(r"select\b(.*?)(?:\bwhere\b\s*|\bfrom\b.*)?$", rest[:opening], re.I | re.S)
    if keyword is None or opening < 0 or tail.offset:
        raise QueryError(f"{_CAN}; not with OFFSET")
    keys, sums, columns = _columns(keyword[1])
    closing = rest.rfind("}") + 1
    after = flat[closing:]
    cut = re.search(r"\b(?:order|limit)\b", after, re.IGNORECASE)
    end = closing + (cut.start() if cut else len(after))
    _refuse_other_groups(rest[closing:end], keys)
    if set(re.findall(r"[?$](\w+)", tail.order)) - set(columns):
        raise QueryError("totals can be ordered by their own columns alone")
    return Totals(
        members=prologue + rest[:end],
        keys=keys,
        sums=sums,
        columns=columns,
        prologue=prologue,
        tail=rest[end:],
    )


def _columns(
    text: str,
) -> tuple[tuple[str, ...], tuple[tuple[str, str], ...], tuple[str, ...]]:
    keys, sums, columns, at = [], [], [], 0
    while text[at:].strip():
        item = _ITEM.match(text, at)
        if item is None:
            raise QueryError(f"{_CAN}; not: {' '.join(text[at:].split())[:60]}")
        if item["key"]:
            keys.append(item["key"])
        else:
            sums.append((item["name"], _AGAIN[item["how"].lower()]))
        columns.append(item["key"] or item["name"])
        at = item.end()
    if not sums:
        raise QueryError(f"{_CAN}; nothing is counted here")
    return tuple(keys), tuple(sums), tuple(columns)


def _refuse_other_groups(text: str, keys: Sequence[str]) -> None:
    match = re.fullmatch(r"\s*(?:group\s+by((?:\s+[?$]\w+)+))?\s*", text, re.IGNORECASE)
    if match is None:
        raise QueryError(f"{_CAN} by columns; not: {' '.join(text.split())[:60]}")
    grouped = re.findall(r"[?$](\w+)", match[1] or "")
    if set(grouped) != set(keys):
        raise QueryError("totals need every column of GROUP BY selected, so that groups can meet")


def _without_comments(text: str) -> str:
    pieces, done = [], 0
    for match in tokens(text):
        if match[0].startswith("#"):
            pieces += [text[done : match.start()], " "]
            done = match.end()
    return "".join([*pieces, text[done:]])

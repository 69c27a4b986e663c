"""Replay of one subject: its last full state, and the changes from there to a moment.

For the writer, about many subjects at once and all in one row: SQLite releases the interpreter's
lock at each row, and a busy reader then keeps it for milliseconds.
"""

from __future__ import annotations

import json
import sqlite3
from typing import Any

from kg.history.storage.row_codec import Coded, decode_delta

_STATE = (
    "SELECT sequence, data FROM state WHERE node = ? AND sequence <= ? "
    "ORDER BY sequence DESC LIMIT 1"
)
_CHANGES = (
    "SELECT data FROM change WHERE node = ? AND sequence > ? AND sequence <= ? ORDER BY sequence"
)
_COUNT = (
    "SELECT count(*) FROM change WHERE node = given.value AND sequence > "
    "coalesce((SELECT max(sequence) FROM state WHERE node = given.value), -1)"
)
_LAST = "SELECT max(sequence) FROM state WHERE node = given.value"
_PRESENT = f"""json_array(
    (SELECT hex(data) FROM state WHERE node = given.value AND sequence = ({_LAST})),
    (SELECT group_concat(hex(data)) FROM (
        SELECT data FROM change
        WHERE node = given.value AND sequence > coalesce(({_LAST}), -1) ORDER BY sequence
    ))
)"""


def facts_at(db: sqlite3.Connection, node: int, sequence: int) -> set[Coded]:
    """All facts about a node right after the transaction `sequence`."""
    start, data = db.execute(_STATE, (node, sequence)).fetchone() or (-1, b"")
    rows = db.execute(_CHANGES, (node, start, sequence)).fetchall()
    return _folded(data, [row for (row,) in rows])


def present_facts(db: sqlite3.Connection, nodes: list[int]) -> dict[int, set[Coded]]:
    """All facts about each node after the last transaction the log holds."""
    found = {}
    for node, (state, changes) in _of_each(db, nodes, _PRESENT).items():
        rows = changes.split(",") if changes else ()
        found[node] = _folded(bytes.fromhex(state or ""), [bytes.fromhex(row) for row in rows])
    return found


def changes_since_state(db: sqlite3.Connection, nodes: list[int]) -> dict[int, int]:
    """How often each node was changed since its last full state."""
    return _of_each(db, nodes, f"({_COUNT})")


def _of_each(db: sqlite3.Connection, nodes: list[int], value: str) -> dict[int, Any]:
    if not nodes:
        return {}
    select = f"SELECT json_group_array({value}) FROM json_each(?) AS given"
    (text,) = db.execute(select, (json.dumps(nodes),)).fetchone()
    return dict(zip(nodes, json.loads(text), strict=True))


def _folded(state: bytes, changes: list[bytes]) -> set[Coded]:
    facts = set(decode_delta(state).added)
    for row in changes:
        delta = decode_delta(row)
        facts.difference_update(delta.removed)
        facts.update(delta.added)
    return facts

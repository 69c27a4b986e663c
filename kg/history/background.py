"""Ontology and common sense as they were: as they are, with what was changed since undone."""

from __future__ import annotations

import json
from collections.abc import Iterable

from pyoxigraph import Quad

from kg.engine import Engine
from kg.history.coding import decode_delta
from kg.history.log import BACKGROUND, Log
from kg.patterns import Pattern

# CROSS: the few nodes first, or SQLite goes through all changes there are
_SINCE = (
    "SELECT node, data FROM node CROSS JOIN change ON change.node = node.id "
    "WHERE graph IN (SELECT value FROM json_each(?)) AND sequence > ? AND sequence <= ? "
    "ORDER BY sequence"
)


def background_at(
    log: Log, engine: Engine, sequence: int, patterns: Iterable[Pattern] = (Pattern(),)
) -> set[Quad]:
    """What ontology and common sense said after `sequence`, of what any of the patterns matches.

    `engine` may be written meanwhile, and says what holds now or at any moment since.
    """
    wanted = [
        pattern._replace(graph=graph)
        for pattern in patterns
        for graph in BACKGROUND
        if pattern.graph in (None, graph)
    ]
    quads = {quad for pattern in wanted for quad in engine.quads_for_pattern(*pattern)}
    # what is recorded now is all that the engine may have had when it was read: the log goes first
    for quad, held in changed_since(log, sequence).items():
        if not held:
            quads.discard(quad)
        elif any(pattern.covers(quad) for pattern in wanted):
            quads.add(quad)
    return quads


def changed_since(log: Log, sequence: int) -> dict[Quad, bool]:
    """Each fact of ontology and common sense changed since, and whether it held at `sequence`.

    The first change tells; so the answer is right whichever of the later ones an engine has seen.
    """
    held: dict[Quad, bool] = {}
    with log.lock:
        known = [log.terms.find(graph) for graph in BACKGROUND]
        rows = log.db.execute(_SINCE, (json.dumps(known), sequence, log.last)).fetchall()
        for node, data in rows:
            for side, before in zip(decode_delta(data), (True, False), strict=True):
                for quad in log.terms.quads(node, side):
                    held.setdefault(quad, before)
    return held

"""Ontology and common sense as they were: as they are, with what was changed since undone."""

from __future__ import annotations

import json

from pyoxigraph import Quad

from kg.history.storage.log import BACKGROUND, HistoryLog
from kg.history.storage.row_codec import decode_delta
from kg.rdf.quad_store import QuadStore

# CROSS: the few nodes first, or SQLite scans all changes
_SINCE = (
    "SELECT node, data FROM node CROSS JOIN change ON change.node = node.id "
    "WHERE graph IN (SELECT value FROM json_each(?)) AND sequence > ? AND sequence <= ? "
    "ORDER BY sequence"
)


def background_at(log: HistoryLog, engine: QuadStore, sequence: int) -> set[Quad]:
    """The facts of ontology and common sense after `sequence`.

    `engine` may be written meanwhile: it holds the present state or any since `sequence`.
    """
    quads = {q for graph in BACKGROUND for q in engine.quads_for_pattern(None, None, None, graph)}
    # read the log after the engine: it then covers every change that the engine may have had
    for quad, held in changed_since(log, sequence).items():
        (quads.add if held else quads.discard)(quad)
    return quads


def changed_since(log: HistoryLog, sequence: int) -> dict[Quad, bool]:
    """Each fact of ontology and common sense changed since, and whether it held at `sequence`.

    The first change decides, so that the result does not depend on how many of the later ones an
    engine has applied.
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

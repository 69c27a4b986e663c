"""Ontology and common sense as they were: the present ones with later changes undone."""

from __future__ import annotations

from pyoxigraph import Quad

from kg.history.storage.change_lines import quads_of
from kg.history.storage.log import BACKGROUND, HistoryLog
from kg.rdf.quad_store import QuadStore


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
    for change in log.change_lines(sequence, log.last, background=True):
        for side, before in zip(change, (True, False), strict=True):
            for quad in quads_of(side):
                held.setdefault(quad, before)
    return held

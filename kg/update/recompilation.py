"""Recompilation: graph:commonsense follows an update of graph:ontology, in the same transaction."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

from pyoxigraph import NamedNode, Quad

from kg import vocabulary as v
from kg.errors import OntologyError
from kg.ontology.loading import compile_commonsense
from kg.ontology.replacement import recompiled
from kg.rdf.skolem import named
from kg.update.change_draft import ChangeDraft

_ONTOLOGY: Final = NamedNode(v.ONTOLOGY_GRAPH)
_COMMONSENSE: Final = NamedNode(v.COMMONSENSE_GRAPH)


def recompile_commonsense(draft: ChangeDraft) -> None:
    """Add to `draft` what its changes of the ontology change in graph:commonsense.

    Raises OntologyError where the ontology would be invalid.
    """
    if not any(q.graph_name == _ONTOLOGY for q in (*draft.added, *draft.removed)):
        return
    before = _compiled(draft.before(None, None, None, _ONTOLOGY))
    after = set(compile_commonsense(named(draft.after(None, None, None, _ONTOLOGY))))
    present = set(draft.after(None, None, None, _COMMONSENSE))
    delete, insert, _ = recompiled(present, before, after)
    draft.change(delete, insert)


def _compiled(quads: Iterable[Quad]) -> set[Quad]:
    """What an ontology compiles to; nothing where it is invalid, so that it can be mended."""
    try:
        return set(compile_commonsense(named(quads)))
    except OntologyError:
        return set()

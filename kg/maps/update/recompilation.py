"""Recompilation of graph:commonsense in the transaction that changes graph:ontology."""

from __future__ import annotations

from kg.knowledge.ontology.loading import compile_commonsense
from kg.knowledge.ontology.replacement import compiled_before, recompiled
from kg.maps.update.change_draft import ChangeDraft
from kg.model import vocabulary as v
from kg.rdf.skolem import named


def recompile_commonsense(draft: ChangeDraft) -> None:
    """Add to `draft` the changes of graph:commonsense that follow from those of the ontology.

    Raises OntologyError where the ontology would be invalid.
    """
    if not any(q.graph_name == v.ONTOLOGY_GRAPH for q in (*draft.added, *draft.removed)):
        return
    old = named(draft.before(None, None, None, v.ONTOLOGY_GRAPH))
    before = compiled_before(old, set(draft.before(None, None, None, v.COMMONSENSE_GRAPH)))
    after = set(compile_commonsense(named(draft.after(None, None, None, v.ONTOLOGY_GRAPH))))
    present = set(draft.after(None, None, None, v.COMMONSENSE_GRAPH))
    delete, insert, _ = recompiled(present, before, after)
    draft.change(delete, insert)

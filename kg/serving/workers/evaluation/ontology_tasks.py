"""Replacements of a map's ontology, validated and compiled in a worker.

The shapes, the hierarchy and the relations of an ontology that a client sends can take any time and
memory. The worker computes the quads to delete and to insert; the writer receives only these.
"""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from pyoxigraph import Store

from kg.knowledge.ontology.diagnostics import check_valid
from kg.knowledge.ontology.loading import SHAPES_FILE, check_limits, ontology_of
from kg.knowledge.ontology.replacement import plan_replacement
from kg.maps.update.change_draft import GroundUpdate, QuadChange
from kg.model.resources import ONTOLOGIES
from kg.rdf.skolem import anonymous
from kg.serving.workers.evaluation.ingestion import quads_of_document


def load_libraries() -> None:
    """Import all that `plan_ontology` needs, before the process is confined."""
    from kg.rdf.shacl import validate

    validate((), ONTOLOGIES / SHAPES_FILE)  # the libraries import some modules at the first use


def plan_ontology(store: Store, request: dict[str, Any]) -> tuple[dict[str, Any], bytes]:
    """The planned replacement of the ontology in a snapshot by a document.

    Raises as `ingestion.quads_of_document` and `plan_replacement`; OntologyError for an invalid
    ontology.
    """
    ontology = ontology_of(anonymous(quads_of_document(request)))
    check_limits(ontology.quads)  # at once: to validate a large one takes a minute
    warnings = check_valid(ontology)
    plan = plan_replacement(store, ontology.quads, whole=request["whole"])
    head, body = GroundUpdate((QuadChange(plan.delete, plan.insert),)).encode()
    head |= {"kept": plan.kept, "lost": plan.lost, "unnamed": plan.unnamed}
    head |= {"warnings": [asdict(warning) for warning in warnings]}
    return head | {"changes": [asdict(change) for change in plan.changes]}, body

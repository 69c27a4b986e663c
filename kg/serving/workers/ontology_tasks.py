"""Replacements of a map's ontology, validated and compiled in a worker.

The shapes, the hierarchy and the relations of an ontology that a client sends can take any time and
memory. The worker computes the quads to delete and to insert; the writer receives only these.
"""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from pyoxigraph import Store

from kg.knowledge.ontology.diagnostics import check_valid
from kg.knowledge.ontology.diff import OntologyChange
from kg.knowledge.ontology.loading import Ontology
from kg.knowledge.ontology.replacement import ReplacementPlan, plan_replacement
from kg.maps.update.ground_update import GroundUpdate, Step
from kg.rdf.skolem import anonymous
from kg.serving.workers.ingestion import quads_of_document
from kg.serving.workers.process import Answer


def plan_ontology(store: Store, request: dict[str, Any]) -> tuple[dict[str, Any], bytes]:
    """The planned replacement of the ontology in a snapshot by a document, for `decoded_plan`.

    Raises as `kg.serving.workers.ingestion.quads_of_document` and `plan_replacement`; OntologyError
    for an invalid ontology.
    """
    ontology = Ontology(tuple(anonymous(quads_of_document(request))), ())
    check_valid(ontology)
    plan = plan_replacement(store, ontology.quads, whole=request["whole"])
    head, body = GroundUpdate((Step(plan.delete, plan.insert),)).encode()
    head |= {"kept": plan.kept, "lost": plan.lost, "unnamed": plan.unnamed}
    return head | {"changes": [asdict(change) for change in plan.changes]}, body


def decoded_plan(answer: Answer) -> ReplacementPlan:
    """The planned replacement that a worker sent."""
    head = answer.details
    (step,) = GroundUpdate.decode(dict(head), answer.body).steps
    return ReplacementPlan(
        changes=tuple(OntologyChange(**change) for change in head["changes"]),
        kept=tuple(head["kept"]),
        delete=step.delete,
        insert=step.insert,
        lost=tuple(head["lost"]),
        unnamed=head["unnamed"],
    )

"""Facts of an object's best observation (sosa:Observation)."""

from __future__ import annotations

import math

from pyoxigraph import Literal, Quad

from kg.maps.facts.robot_and_recordings import recording_iri, recording_name
from kg.model import vocabulary as v
from kg.model.errors import InvalidFactError
from kg.model.iris import observation_iri
from kg.model.records import Evidence
from kg.rdf.literals import (
    Properties,
    first,
    iri_node,
    known_iri,
    share_literal,
    stamp_of,
    subject_quads,
    time_literal,
)


def observation_quads(iri: str, evidence: Evidence, base: str) -> list[Quad]:
    """Facts of the observation of the object `iri`.

    Raises InvalidFactError for numbers that are not finite or out of range.
    """
    what = f"observation of {iri}"
    if len(evidence.box) != 4 or not all(map(math.isfinite, evidence.box)):
        raise InvalidFactError(f"{what}: box must be 4 finite numbers, got {evidence.box}")
    return subject_quads(
        observation_iri(base, iri),
        [
            (v.RDF_TYPE.value, known_iri(v.SOSA_OBSERVATION)),
            (v.SOSA_FEATURE, iri_node(iri, what)),
            (v.SOSA_RESULT_TIME, time_literal(evidence.stamp, f"{what}: stamp")),
            (v.FRAME, Literal(evidence.frame)),
            (v.FROM_RECORDING, known_iri(recording_iri(evidence.recording, base))),
            (v.BOX, Literal(" ".join(str(round(n)) for n in evidence.box))),
            (v.SCORE, share_literal(evidence.score, f"{what}: score")),
            (v.MODEL, Literal(evidence.model)),
        ],
    )


def evidence_of(properties: Properties, base: str) -> Evidence:
    """The evidence that an observation with `properties` has."""
    left, top, right, bottom = (float(n) for n in first(properties, v.BOX, "0 0 0 0").split())
    return Evidence(
        frame=first(properties, v.FRAME, ""),
        recording=recording_name(first(properties, v.FROM_RECORDING, ""), base),
        stamp=stamp_of(properties, v.SOSA_RESULT_TIME),
        box=(left, top, right, bottom),
        score=float(first(properties, v.SCORE, "1")),
        model=first(properties, v.MODEL, ""),
    )

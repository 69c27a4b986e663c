"""Object update: the record of an object after a sighting (thesis section 3.3.1)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from kg.model.records import ObjectRecord
from mapping.reference.confidence import existence, mean_position, reinforced
from mapping.reference.settings import ReferenceSettings
from mapping.sighting import Sighting


def new_object(
    iri: str, sighting: Sighting, stamp: float, settings: ReferenceSettings
) -> ObjectRecord:
    """Record of a new object, without place and evidence; `stamp` [s since 1970]."""
    confidence = reinforced(0.0, sighting.score, settings.phi, settings.nu)
    return ObjectRecord(
        iri=iri,
        category=sighting.category,
        p_map=sighting.p_map,
        confidence=confidence,
        existence=existence(confidence, settings.nu),
        observations=1,
        first_seen=stamp,
        last_seen=stamp,
    )


def updated_object(
    record: ObjectRecord, sighting: Sighting, stamp: float, settings: ReferenceSettings
) -> ObjectRecord:
    """Record after one more sighting at `stamp` [s since 1970]; place and evidence unchanged.

    A sighting kappa or farther away belongs to an object whose position was asserted elsewhere:
    the running mean starts again from it.
    """
    confidence = reinforced(record.confidence, sighting.score, settings.phi, settings.nu)
    p_map = mean_position(record.p_map, record.observations, sighting.p_map)
    if float(np.linalg.norm(sighting.p_map - record.p_map)) >= settings.kappa:
        p_map = sighting.p_map
    return replace(
        record,
        p_map=p_map,
        confidence=confidence,
        existence=existence(confidence, settings.nu),
        observations=record.observations + 1,
        last_seen=max(record.last_seen, stamp),
    )

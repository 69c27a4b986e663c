"""What a sighting makes of an object's record (thesis section 3.3.1)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from kg.records import ObjectRecord
from mapping.association import Sighting
from mapping.confidence import existence, mean_position, raised
from mapping.settings import ReferenceSettings


def first_seen(
    iri: str, sighting: Sighting, stamp: float, settings: ReferenceSettings
) -> ObjectRecord:
    """The record of a new object, in no place and without evidence yet; `stamp` [s since 1970]."""
    confidence = raised(0.0, sighting.score, settings.phi, settings.nu)
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


def seen_again(
    record: ObjectRecord, sighting: Sighting, stamp: float, settings: ReferenceSettings
) -> ObjectRecord:
    """`record` after one more sighting at `stamp` [s since 1970]; place and evidence as they were.

    Seen at least kappa away, which is where somebody said it was moved to, its mean begins anew.
    """
    confidence = raised(record.confidence, sighting.score, settings.phi, settings.nu)
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

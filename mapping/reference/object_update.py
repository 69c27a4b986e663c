"""Object update: confidence (eq. 3.1, 3.4), running mean and record (thesis section 3.3.1)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from kg.model.records import ObjectRecord
from mapping.frames.sighting import Sighting
from mapping.reference.settings import ReferenceSettings


def reinforced(confidence: float, score: float, phi: float, nu: float) -> float:
    """Eq. 3.1 with its misprint corrected: C_k = min(C_{k-1} + phi D_k, nu).

    A new object starts from C_{k-1} = 0. C is not a probability.
    """
    return min(confidence + phi * score, nu)


def decayed(confidence: float, xi: float) -> float:
    """Eq. 3.4: C_k = C_{k-1} - xi; the object leaves the map when this is not positive."""
    return confidence - xi


def existence(confidence: float, nu: float) -> float:
    """Existence score C / nu, 0..1: orders objects, is not a calibrated probability."""
    return confidence / nu


def mean_position(
    p_map: NDArray[np.float64], observations: int, observed: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Running mean (3,) [m] of `observations` earlier positions and `observed` (3,)."""
    return np.asarray(p_map + (observed - p_map) / (observations + 1), dtype=np.float64)


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

"""Object update: association, visibility and confidence (thesis section 3.3.1, eq. 3.1 to 3.4)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from kg.model.records import ObjectRecord
from mapping.frames.projection import project, to_camera
from mapping.frames.sighting import Sighting
from mapping.reference.settings import ReferenceSettings
from perception.frames import Frame


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


@dataclass(frozen=True, slots=True)
class Association:
    """Data association of one frame's sightings with the registered objects."""

    matched: Mapping[str, Sighting]  # object IRI -> the one sighting that updates it
    new: tuple[Sighting, ...]  # no registered object of their class within the gate


def associate(
    sightings: Sequence[Sighting], objects: Sequence[ObjectRecord], kappa: float
) -> Association:
    """Gated nearest-neighbour assignment: each sighting to an object of its class within `kappa`.

    `kappa` [m] is exclusive. Of several sightings of one object only the nearest counts.
    """
    by_category: dict[str, list[ObjectRecord]] = {}
    for record in objects:
        by_category.setdefault(record.category, []).append(record)
    best: dict[str, tuple[float, Sighting]] = {}
    new: list[Sighting] = []
    for sighting in sightings:
        found = _nearest(sighting, by_category.get(sighting.category, ()), kappa)
        if found is None:
            new.append(sighting)
        elif found[1] not in best or found[0] < best[found[1]][0]:
            best[found[1]] = (found[0], sighting)
    return Association({iri: sighting for iri, (_, sighting) in best.items()}, tuple(new))


def _nearest(
    sighting: Sighting, candidates: Sequence[ObjectRecord], kappa: float
) -> tuple[float, str] | None:
    """Distance [m] and IRI of the nearest candidate nearer than `kappa`; ties go to the first."""
    if not candidates:
        return None
    offsets = np.array([c.p_map for c in candidates]) - sighting.p_map
    distances = np.linalg.norm(offsets, axis=1)
    index = int(np.argmin(distances))
    distance = float(distances[index])
    return (distance, candidates[index].iri) if distance < kappa else None


def most_confident(sightings: Sequence[Sighting], kappa: float) -> tuple[Sighting, ...]:
    """Non-maximum suppression: of new sightings of a class within `kappa` [m], the best score."""
    kept: list[Sighting] = []
    for sighting in sorted(sightings, key=lambda s: -s.score):
        if not any(_same(sighting, other, kappa) for other in kept):
            kept.append(sighting)
    return tuple(kept)


def _same(a: Sighting, b: Sighting, kappa: float) -> bool:
    return a.category == b.category and float(np.linalg.norm(a.p_map - b.p_map)) < kappa


Floats = NDArray[np.float64]


def in_field_of_view(p_cam: Floats, K: Floats, shape: tuple[int, int]) -> bool:
    """Field-of-view test, eq. 3.2: whether `p_cam` (3,) [m] is ahead and within both angles.

    The angles are the camera's own, from `K` and the image's (height, width): with the principal
    point off the centre they differ to the left and right, and the test equals "falls on a pixel".
    """
    x, y, z = (float(v) for v in p_cam)
    if not z > 0:
        return False
    return _within(math.atan(x / z), K[0, 0], K[0, 2], shape[1]) and _within(
        math.atan(y / z), K[1, 1], K[1, 2], shape[0]
    )


def _within(angle: float, focal: float, centre: float, pixels: int) -> bool:
    return -math.atan((centre + 0.5) / focal) < angle < math.atan((pixels - 0.5 - centre) / focal)


def window(depth: NDArray[np.float32], row: int, column: int, size: int) -> NDArray[np.float32]:
    """Window W of eq. 3.3: the known depths (n,) [m] in a `size` x `size` square about a pixel."""
    top, left = row - size // 2, column - size // 2
    patch = depth[max(top, 0) : max(top + size, 0), max(left, 0) : max(left + size, 0)]
    return np.asarray(patch[patch > 0], dtype=np.float32)


def occluded(depths: NDArray[np.float32], z: float) -> bool:
    """Occlusion test, eq. 3.3: whether any depth of the window is nearer than the object's `z` [m].

    The rule is strict: an object's own front counts as an occluder where its mean lies deeper.
    """
    return bool(np.any(depths < z))


def missed(frame: Frame, p_map: Floats, settings: ReferenceSettings) -> bool:
    """Negative evidence: whether an undetected object at `p_map` (3,) [m] was visible in `frame`.

    It must lie in the field of view (3.2), in the sensor's good depth range, show depth around its
    pixel, and be unoccluded (3.3).
    """
    p_cam = to_camera(frame.T_map_cam, p_map)
    z = float(p_cam[2])
    if not settings.min_depth <= z <= settings.max_depth:
        return False
    if not in_field_of_view(p_cam, frame.K, frame.depth.shape):
        return False
    depths = window(frame.depth, *project(p_cam, frame.K), settings.occlusion_window)
    return len(depths) > 0 and not occluded(depths, z)

"""Nearest-neighbour data association (thesis section 3.3.1, "Treating object occurrences")."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from kg.model.records import ObjectRecord
from mapping.frames.sighting import Sighting


@dataclass(frozen=True, slots=True)
class Association:
    """Data association of one frame's sightings with the registered objects."""

    matched: Mapping[str, Sighting]  # object IRI -> the one sighting that updates it
    new: tuple[Sighting, ...]  # no registered object of their class within the gate
    dropped: int  # duplicates of the matched ones


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
    matched = {iri: sighting for iri, (_, sighting) in best.items()}
    return Association(matched, tuple(new), len(sightings) - len(new) - len(matched))


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

"""The methods on trial: what each makes of a building's rooms, learnt from all other buildings."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from kg.knowledge.placement.belief_model import (
    EvidenceArrays,
    Matrix,
    PlacementParameters,
    posterior_belief,
    sigmoid,
)
from kg.knowledge.placement.surveys import logit
from kg.model import vocabulary as v
from lab.placement.data import TrialData
from lab.placement.fitting import TrainingSet
from lab.placement.scores import Predictions, rooms_visited

Vector = NDArray[np.float64]

METHODS: Final = ("thesis edges", "conceptnet", "statistics", "as shipped", "model")


def one_building(sample: TrainingSet, building: int) -> EvidenceArrays:
    """The evidence about one building: (n, m) counts of all others."""
    rooms, held = sample.evidence.rooms, sample.evidence.rooms_with
    return replace(sample.evidence, rooms=rooms[building], rooms_with=held[building])


def probabilities(
    method: str, train: TrainingSet, evidence: EvidenceArrays, parameters: PlacementParameters
) -> Matrix:
    """(n, m) probabilities by one of `METHODS`; whatever a method learns, it learns from `train`.

    thesis edges: one probability for every edge, one for every other pair. conceptnet: a logistic
    curve over ln(1 + weight). statistics: the rate in other buildings, half a room added to each
    side, and of a kind of room without any the rate over all rooms. as shipped: the model without
    imported statistics. model: with them.
    """
    if method == "thesis edges":
        listed = evidence.listed > 0
        return np.where(listed, _rate(train, listed), _rate(train, ~listed))
    if method == "conceptnet":
        return sigmoid(_curve(train, np.log1p(evidence.weight)))
    if method == "statistics":
        rooms, held = evidence.rooms, evidence.rooms_with
        anywhere = (held.sum(1, keepdims=True) + 0.5) / (rooms.sum(1, keepdims=True) + 1)
        return np.where(rooms > 0, (held + 0.5) / (rooms + 1), anywhere)
    if method == "as shipped":
        nothing = np.zeros_like(evidence.rooms)
        evidence = replace(evidence, rooms=nothing, rooms_with=nothing)
    return posterior_belief(evidence, parameters).mean


def _rate(train: TrainingSet, cells: NDArray[np.bool_]) -> float:
    held, rooms = (float(x[:, cells].sum()) for x in (train.held, train.rooms))
    return (held + 0.5) / (rooms + 1)


def _curve(train: TrainingSet, x: Matrix) -> Matrix:
    """Logistic regression of held on x over all rooms of the training buildings (Newton)."""
    rooms, held = train.rooms.sum(0).ravel(), train.held.sum(0).ravel()
    design = np.column_stack([np.ones(x.size), x.ravel()])
    coefficients = np.array([logit(float(held.sum() / rooms.sum())), 0.0], dtype=float)
    for _ in range(25):
        p = sigmoid(design @ coefficients)
        hessian = design.T @ (design * (rooms * p * (1 - p))[:, None]) + 1e-6 * np.eye(2)
        coefficients = coefficients + np.linalg.solve(hessian, design.T @ (held - rooms * p))
    return np.asarray((design @ coefficients).reshape(x.shape))


def outcome(
    data: TrialData, building: int, table: Matrix, without: frozenset[int] = frozenset()
) -> Predictions:
    """Predictions of a table of probabilities for a building, without the rooms numbered `without`.

    A room that is several kinds holds what any of them would; one that is none, what an average
    place does.
    """
    held, p = room_matrix(data, building, table, without)
    sought = data.sought[building]
    visited = [
        rooms_visited(p[row], held[row]) for row in np.flatnonzero(sought) if held[row].any()
    ]
    return Predictions(
        p[sought].ravel(),
        held[sought].ravel(),
        np.array(visited),
        1 - np.prod(1 - p[sought], axis=1),
        held[sought].any(axis=1).astype(float),
    )


def room_matrix(
    data: TrialData, building: int, table: Matrix, without: frozenset[int]
) -> tuple[Matrix, Matrix]:
    """(n, rooms) what each room holds, 0 or 1, and how probable a table makes that."""
    rooms = [r for n, r in enumerate(data.buildings[building].rooms) if n not in without]
    held = np.array([[float(iri in room.objects) for room in rooms] for iri in data.objects])
    columns = [[data.places[iri] for iri in room.places or (v.PLACE,)] for room in rooms]
    p = np.column_stack([1 - np.prod(1 - table[:, where], axis=1) for where in columns])
    return held, np.clip(p, 1e-4, 1 - 1e-4)


def with_seen(
    data: TrialData, building: int, evidence: EvidenceArrays, seen: frozenset[int]
) -> EvidenceArrays:
    """The evidence once some rooms of the building itself have been looked at, by number.

    Rooms that are several kinds teach nothing: what they hold is no one kind's doing.
    """
    held, without = np.zeros_like(evidence.listed), np.zeros_like(evidence.listed)
    for number in sorted(seen):
        room = data.buildings[building].rooms[number]
        if len(room.places) != 1:
            continue
        there = np.array([float(iri in room.objects) for iri in data.objects])
        held[:, data.places[room.places[0]]] += there
        without[:, data.places[room.places[0]]] += 1 - there
    return replace(evidence, building_with=held, building_without=without)

"""Belief about a target's position: probabilities on cells of the floor.

All evidence shares the cells: a remembered position and the room around it are the same cells, so
that a failed view of the position lowers the room too, and no evidence counts twice. Each instance
lies in some of the cells, or is not on the floor.

Rooms of one kind learn from each other. The probability that such a room holds the target is the
mean of a beta distribution; a room that was searched in vain, with a chance f to have shown the
target, counts as f rooms without it.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kg.model.shares import percent
from planner.freespace.grid import Cells, FreeSpace
from planner.freespace.planning_map import PlanningMap
from planner.search.goals.candidate_queries import Candidate
from planner.settings import BeliefSettings


@dataclass(frozen=True, slots=True, eq=False)
class CellBelief:
    """Probability that the target is in each cell, and that it is in none.

    `weight` sums to 1 - `absent`. Raises ValueError for negative or missing mass.
    """

    cells: Cells  # (c,)
    weight: NDArray[np.float64]  # (c,)
    absent: float  # probability that the target is not on this floor

    def __post_init__(self) -> None:
        total = float(self.weight.sum()) + self.absent
        if self.weight.min(initial=0.0) < 0 or self.absent < 0 or not np.isclose(total, 1.0):
            raise ValueError(f"weights must be 0 or more and sum to 1 with absent, got {total:g}")

    @property
    def present(self) -> float:
        """Probability that the target is on this floor."""
        return 1.0 - self.absent


def site_weights(
    space: FreeSpace, cells: Cells, p_map: ArrayLike, sigma: float
) -> NDArray[np.float64]:
    """(c,) Gaussian weights around `p_map` (2,) [m] with `sigma` [m]; they sum to 1.

    A position off the floor (on a counter, in a wall) gives its weight to the nearest cells.
    """
    off = ((space.centres(cells) - np.asarray(p_map, np.float64)[:2]) ** 2).sum(axis=1)
    log = -off / (2 * max(sigma, space.cell / 2) ** 2)
    weight = np.exp(log - log.max())
    return np.asarray(weight / weight.sum(), np.float64)


Weights = NDArray[np.float64]

_MAX_KNOWN: int = 150  # remembered objects that are separate instances
_MAX_NEARBY: int = 100


@dataclass(frozen=True, slots=True, eq=False)
class Contribution:
    """Part of an instance's weight that comes from one candidate."""

    candidate: Candidate
    row: int  # of `TargetBelief.weight`
    weight: Weights  # (c,)


@dataclass(frozen=True, slots=True, eq=False)
class TargetBelief:
    """Belief of k instances of the targets.

    In all methods, `unseen` (c,) is the probability that all views so far would have missed an
    object in each cell.
    """

    cells: Cells  # (c,)
    weight: Weights  # (k, c) probability that an instance lies in a cell; rows sum to 1 at most
    target: NDArray[np.intp]  # (k,) number of its target
    parts: tuple[Contribution, ...]
    alike: NDArray[np.bool_]  # (k, k) whether two instances are in rooms of one kind
    doubt: Weights  # (k,) 1 / (alpha + beta) of the distribution of such rooms; 0 learns nothing
    before: NDArray[np.bool_] = field(init=False)  # (k, k) `alike`, of earlier instances alone
    total: Weights = field(init=False)  # (k,) weight of each instance

    def __post_init__(self) -> None:
        object.__setattr__(self, "before", np.tril(self.alike, -1))
        object.__setattr__(self, "total", np.maximum(self.weight.sum(axis=1), 1e-12))

    def searched(self, unseen: Weights) -> Weights:
        """(k,) weight of each instance in the cells that views have shown."""
        return np.asarray(self.weight @ (1.0 - unseen))

    def _learned(self, searched: Weights, alike: NDArray[np.bool_]) -> Weights:
        """(k,) what searches of `alike` (k, k) rooms in vain leave of each instance's weight."""
        return np.asarray(1.0 / (1.0 + self.doubt * (alike @ (searched / self.total))))

    def present(self, unseen: Weights) -> Weights:
        """(k,) by how much failed views raise or lower the weight in cells that none has seen."""
        searched = self.searched(unseen)
        learned = self._learned(searched, self.alike)
        return np.asarray(learned / np.maximum(1.0 - learned * searched, 1e-12))

    def still_missing(self, unseen: Weights, targets: int) -> Weights:
        """(targets,) probability that no instance of each target has been seen."""
        return self.missing_after(self.searched(unseen), targets)

    def missing_after(self, searched: Weights, targets: int) -> Weights:
        """As `still_missing`, from what `searched` gives."""
        # by the chain rule, an instance learns from those before
        found = self._learned(searched, self.before) * searched
        log = np.log(np.maximum(1.0 - found, 1e-12))
        return np.exp(np.bincount(self.target, log, minlength=targets))

    def expected(self, unseen: Weights, value: Weights) -> Weights:
        """(c,) expected instances in each cell after failed views; target j counts `value[j]`."""
        return np.asarray((value[self.target] * self.present(unseen)) @ self.weight * unseen)

    def left(self, unseen: Weights, wanted: Sequence[int]) -> float:
        """Probability that any of the `wanted` targets is on this floor after failed views."""
        rows = np.isin(self.target, wanted)
        here = np.clip(self.present(unseen) * (self.weight @ unseen), 0.0, 1.0)
        return float(1.0 - np.prod(1.0 - here[rows]))

    def belief(self, unseen: Weights, wanted: Sequence[int], targets: int) -> CellBelief:
        """Belief about the next instance of all `wanted` targets together."""
        weight = self.expected(unseen, np.isin(np.arange(targets), wanted).astype(np.float64))
        left, total = self.left(unseen, wanted), float(weight.sum())
        if total <= 0:
            return CellBelief(self.cells, np.zeros(len(self.cells)), 1.0)
        return CellBelief(self.cells, weight / total * left, 1.0 - left)


def build_target_belief(
    ground: PlanningMap, cells: Cells, candidates: Sequence[Candidate], settings: BeliefSettings
) -> TargetBelief:
    """Belief in the instances of `candidates`."""
    rows: list[tuple[int, Weights]] = []
    parts: list[Contribution] = []
    rooms: list[Candidate | None] = []  # the place of an instance that was not observed
    for target in sorted({candidate.target for candidate in candidates}):
        of_target = [candidate for candidate in candidates if candidate.target == target]
        for instance in _Instances(ground, cells, of_target, settings).all():
            weight = np.sum([part for _, part in instance], axis=0)
            if float(weight.sum()) > 1e-6:
                parts += [Contribution(candidate, len(rows), part) for candidate, part in instance]
                rows.append((target, weight))
                rooms.append(next((c for c, _ in instance if c.kind == "place"), None))
    weight = np.array([w for _, w in rows]).reshape(-1, len(cells))
    kinds = np.array(["" if c is None else f"{c.target} {c.room_kind}" for c in rooms], str)
    alike = (kinds[:, None] == kinds) & (kinds != "") & ~np.eye(len(kinds), dtype=np.bool_)
    doubt = np.array([0.0 if c is None else 1 / c.rooms for c in rooms])
    target_of = np.array([t for t, _ in rows], np.intp)
    return TargetBelief(cells, weight, target_of, tuple(parts), alike, doubt)


def _moved(known: Candidate, probability: float) -> Candidate:
    """A remembered object that is no longer where it was, with `probability`."""
    away = f"{known.label} has been moved since with {percent(probability)}"
    facts = (*known.facts[:1], f"{away}, perhaps within its room")
    return replace(known, kind="moved", probability=probability, facts=facts)


_Instance = list[tuple[Candidate, Weights]]  # its parts


class _Instances:
    """The instances of one target."""

    def __init__(
        self,
        ground: PlanningMap,
        cells: Cells,
        candidates: Sequence[Candidate],
        settings: BeliefSettings,
    ) -> None:
        self._ground, self._cells, self._settings = ground, cells, settings
        ranked = sorted(candidates, key=lambda c: (-c.probability, c.iri))
        self._known = [c for c in ranked if c.kind == "known"][:_MAX_KNOWN]
        nearby = [c for c in ranked if c.kind == "nearby" and c.probability > 0][:_MAX_NEARBY]
        self._nearby: dict[int, list[Candidate]] = defaultdict(list)
        for near in nearby:
            self._nearby[ground.room_at(near.p_map, near.place)].append(near)
        places = {c.iri: c for c in candidates if c.kind in ("place", "frontier")}
        self._places = {room: places[iri] for room, iri in enumerate(ground.rooms) if iri in places}
        self._room = ground.space.room.reshape(-1)[cells]
        self._seen = np.zeros(len(cells)) if ground.seen is None else ground.seen.reshape(-1)[cells]
        self._uniform = np.full(len(cells), 1.0 / len(cells))
        self._all_over = cache(self._spread)
        self._anywhere = self._all_places()

    def all(self) -> list[_Instance]:
        """The parts of each instance."""
        rooms = [r for r in range(len(self._ground.rooms)) if (self._room == r).any()]
        return [
            *(self._remembered(known) for known in self._known),
            *(self._of_room(room) for room in rooms),
        ]

    def _spread(self, room: int) -> Weights:
        """(c,) distribution over a room."""
        inside = self._room == room
        return np.asarray(inside / max(int(inside.sum()), 1))

    def _overlooked(self, room: int, noticed: float) -> Weights:
        """As `_all_over`, with less weight on seen cells, where it would have been noticed."""
        weight = (self._room == room) * (1.0 - noticed * self._seen)
        return np.asarray(weight / max(float(weight.sum()), 1e-12))

    def _mixed(self, weight: Weights) -> Weights:
        """`weight` with a share of it spread over the whole floor, so that no cell is ruled out."""
        share = self._settings.uniform_share
        return (1 - share) * weight + share * float(weight.sum()) * self._uniform

    def _remembered(self, known: Candidate) -> _Instance:
        s = self._settings
        room = self._ground.room_at(known.p_map, known.place)
        moved = (1 - s.p_left_floor) * (
            s.p_same_room * self._all_over(room) + (1 - s.p_same_room) * self._anywhere
        )
        p_moved = max(known.existence - known.probability, 0.0)
        parts = [(known, self._mixed(known.probability * self._site(known, room)))]
        if p_moved > 0:
            parts.append((_moved(known, p_moved), self._mixed(p_moved * moved)))
        return parts

    def _site(self, known: Candidate, room: int) -> Weights:
        """(c,) weights around a remembered position, on its own side of the walls."""
        s, inside = self._settings, self._room == room
        sigma = s.site_sigma if known.deviation is None else max(known.deviation, s.min_sigma)
        inside = inside if inside.any() else np.ones_like(inside)
        weight = np.zeros(len(self._cells))
        weight[inside] = site_weights(self._ground.space, self._cells[inside], known.p_map, sigma)
        return weight

    def _all_places(self) -> Weights:
        """(c,) distribution over all places by their probability to contain the target."""
        total = sum(c.probability for c in self._places.values())
        if total <= 0:
            return self._uniform
        return np.asarray(
            sum(c.probability / total * self._all_over(r) for r, c in self._places.items())
        )

    def _of_room(self, room: int) -> _Instance:
        """Instance in a room that was not observed; partly around objects it is found near."""
        place, nearby = self._places.get(room), self._nearby.get(room, [])
        here = [*nearby, *([] if place is None else [place])]
        p = max((c.probability for c in here), default=0.0)
        beside = (self._settings.beside if place is not None else 1.0) if nearby else 0.0
        total = sum(c.probability for c in nearby)
        parts: _Instance = []
        if place is not None:
            spread = self._overlooked(room, place.noticed)
            parts.append((place, self._mixed((1 - beside) * p * spread)))
        for near in nearby:
            sigma = self._settings.beside_sigma
            site = site_weights(self._ground.space, self._cells, near.p_map, sigma)
            parts.append((near, self._mixed(beside * p * near.probability / total * site)))
        return parts

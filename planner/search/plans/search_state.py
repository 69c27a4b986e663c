"""Planning state of a search: target belief, candidate views, and the views that failed.

    state = build_search(semantic_map, ["cup"])
    view = state.next_view(at)            # a number in state.views, or None: give up
    state.missed(view)                    # after the view, if it did not detect the target

A `PlanningState` is changed in place and never writes to the map.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kg.maps.semantic_map import SemanticMap
from planner.freespace.grid import FreeSpace
from planner.freespace.planning_map import PlanningMap, planning_map_of, planning_map_on
from planner.search.belief import CellBelief, TargetBelief, build_target_belief
from planner.search.goals.candidate_queries import Candidate, CandidateQueries
from planner.search.goals.search_facts import SearchFacts, read_facts
from planner.search.goals.targets import Target
from planner.search.plans.search_viewpoints import (
    proven_views,
    search_viewpoints,
    with_fresh_viewpoints,
)
from planner.search.viewpoints.candidate_views import (
    CandidateViews,
    Motion,
    Sensor,
    belief_cells,
    candidate_views,
    sweep_chance,
)
from planner.search.viewpoints.next_best_view import NextBestView, RevisitModel, RobotState
from planner.settings import BELIEF, MAX_ROUNDS, BeliefSettings


@dataclass(frozen=True, slots=True, eq=False)
class ViewReason:
    """Reason for a view: one candidate and its share of the probability."""

    candidate: Candidate
    target: str  # label
    probability: float  # that the view finds the target because of this candidate


@dataclass(frozen=True, slots=True, eq=False)
class FoundTarget:
    """A target that has been found."""

    target: Target
    p_map: NDArray[np.float64]  # (2,) or (3,) [m]


FreshViews = Callable[[PlanningMap, CandidateViews, NDArray[np.float64]], CandidateViews]


class PlanningState:
    """Planning state of one search for one or several targets; all of them are wanted.

    `fresh` adds views after all others failed. `blocked` and fresh viewpoints replace the candidate
    views, so that earlier numbers of views are invalid afterwards.
    """

    def __init__(
        self,
        targets: tuple[Target, ...],
        planning_map: PlanningMap,
        views: CandidateViews,
        candidates: tuple[Candidate, ...],
        known: TargetBelief,
        settings: BeliefSettings = BELIEF,
        fresh: FreshViews | None = None,
        facts: SearchFacts | None = None,
    ) -> None:
        self.targets, self.candidates, self.target_belief = targets, candidates, known
        self.settings, self.facts = settings, facts
        self.finds: list[FoundTarget] = []
        self.unseen = np.ones(len(views.cells))  # (c,) chance that all views missed an object there
        self._planning_map, self._fresh = planning_map, fresh or with_fresh_viewpoints
        self._first = known.left(self.unseen, range(len(targets)))
        sites = [part.weight for part in known.parts if part.candidate.kind == "known"]
        self.known = np.sum([np.zeros(len(views.cells)), *sites], axis=0)  # (c,) known things there
        self.rounds = 0  # how often fresh viewpoints were taken
        self.views = views
        self.next_best_view = NextBestView(views)
        self.revisits = RevisitModel(views)

    def _use(self, views: CandidateViews) -> None:
        """Replace the candidate views by others over the same cells."""
        self.views = views
        self.next_best_view = NextBestView(views)
        self.revisits = self.revisits.moved_to(views)

    @property
    def space(self) -> FreeSpace:
        """The floor."""
        return self._planning_map.space

    @property
    def rooms(self) -> tuple[str, ...]:
        """Place IRI by number of room; "" where a room is no place."""
        return self._planning_map.rooms

    @property
    def room_names(self) -> tuple[str, ...]:
        """Label of the place by number of room."""
        return tuple(self._planning_map.names)

    @property
    def wanted(self) -> tuple[int, ...]:
        """Numbers of the targets not yet found."""
        done = {id(find.target) for find in self.finds}
        return tuple(i for i, target in enumerate(self.targets) if id(target) not in done)

    @property
    def belief(self) -> CellBelief:
        """Belief about all targets still wanted together."""
        return self.target_belief.belief(self.unseen, self.wanted, len(self.targets))

    @property
    def left(self) -> float:
        """Probability that any target still wanted is on this floor, after all failed views."""
        return self.target_belief.left(self.unseen, self.wanted) if self.wanted else 0.0

    def robot_state(self, p_map: ArrayLike, heading: float = 0.0) -> RobotState:
        """Robot state at `p_map` (2,) [m]: the floor cell nearest to it."""
        return RobotState(self.space.nearest(p_map), heading)

    def place_of(self, view: int) -> str:
        """IRI of the place that a view is taken in; "" for none."""
        room = self._room_of(view)
        return self.rooms[room] if room >= 0 else ""

    def place_name(self, view: int) -> str:
        """Label of the place that a view is taken in; "" for none."""
        room = self._room_of(view)
        return self._planning_map.names[room] if room >= 0 else ""

    def _room_of(self, view: int) -> int:
        cell = self.views.viewpoints[self.views.viewpoint[view]]
        return int(self.space.room.reshape(-1)[cell])

    def weights(self, unseen: NDArray[np.float64]) -> NDArray[np.float64]:
        """(c,) value of seeing each cell: expected instances in it of targets still wanted."""
        count = len(self.targets)
        missing = self.target_belief.still_missing(unseen, count)
        missing /= np.maximum(self.target_belief.still_missing(self.unseen, count), 1e-12)
        wanted = np.isin(np.arange(count), self.wanted)
        return self.target_belief.expected(unseen, np.where(wanted, missing, 0.0))

    @property
    def overlooked(self) -> float:
        """Probability that all views so far have missed a target that is on this floor.

        It is the greater of two values, so that a wrong belief does not end a search: for a target
        distributed by the belief, and for a target distributed evenly over the floor. Floor that no
        view shows counts until fresh viewpoints were tried.
        """
        return self._missed_chance(self.next_best_view.seeable)

    def _missed_chance(self, seeable: NDArray[np.bool_]) -> float:
        """As `overlooked`, on floor that was seen or is `seeable` (c,)."""
        counted = seeable | (self.unseen < 1.0) if self.rounds else np.ones_like(seeable)
        rows = np.isin(self.target_belief.target, self.wanted)
        believed = self.target_belief.weight[rows].sum(axis=0)[counted]
        unseen = self.unseen[counted]
        if not len(unseen):
            return 0.0
        total = float(believed.sum())
        where_believed = float(believed @ unseen) / total if total > 0 else 0.0
        return max(where_believed, float(unseen.mean()))

    def next_view(self, at: RobotState) -> int | None:
        """The view to take next from `at`; None where the search gives up.

        The search gives up when the probability that all views missed the target, on floor that
        reachable viewpoints show, is below `settings.stop_below`. Until then, it takes fresh
        viewpoints, with other occlusions, once all views gain little or repeat earlier ones.
        """
        while self.wanted:
            seeable = self.next_best_view.seeable_from(at)
            if self._missed_chance(seeable) <= self.settings.stop_below:
                return None
            weight = self.weights(self.unseen)
            min_gain = self.settings.give_up * float(weight[seeable].sum()) / 2.0**self.rounds
            view = self.choose(at, self.unseen, self.revisits, min_gain)
            if self.rounds == MAX_ROUNDS or (view is not None and not self._is_stale(view)):
                return view
            self.rounds += 1
            expected = self.target_belief.expected(self.unseen, np.ones(len(self.targets)))
            self._use(self._fresh(self._planning_map, self.views, expected))
        return None

    def _is_stale(self, view: int) -> bool:
        """Whether `view` gains little because earlier views from nearby were alike."""
        weight = self.weights(self.unseen)
        fresh = float(self.views.chance[view] @ weight)
        return bool(self.revisits.chance(view) @ weight < self.settings.stale * fresh)

    def choose(
        self,
        at: RobotState,
        unseen: NDArray[np.float64],
        revisits: RevisitModel,
        min_gain: float | None = None,
    ) -> int | None:
        """The best view from `at` for given `unseen` (c,) and `revisits`.

        A view that probably shows a known thing comes before all others.
        None where no view gains at least `min_gain`, by default the share `settings.give_up` of the
        probability before the first view.
        """
        min_gain = self.settings.give_up * self._first if min_gain is None else min_gain
        weight = self.weights(unseen)
        gains = revisits.gains(weight)
        gains[(gains < min_gain) | ~self.next_best_view.reached(at)] = 0.0
        if self.known.any():
            known = np.where(
                gains > 0, revisits.gains(np.minimum(weight, self.known * unseen)), 0.0
            )
            if (most := float(known.max())) >= self.settings.likely:
                gains[known < most / 2] = 0.0
        if not gains.max() > 0:
            return None
        view = self.next_best_view.best(at, weight, revisits, gains)
        if view is None or not gains[view] > 0:  # only the views after it would gain enough
            rates = gains / self.next_best_view.costs(at, np.arange(len(gains)))
            view = int(np.argmax(rates))
        return view

    def missed(self, view: int) -> None:
        """Update the belief: `view` was taken and showed no target."""
        self.unseen = self.unseen * (1.0 - self.revisits.chance(view))
        self.revisits.add(view)

    def missed_sweep(self, cell: int, heading: float, extent: float) -> None:
        """Update the belief: a sweep of `extent` [rad] about `heading` showed no target.

        Cells that an earlier view from near the floor `cell` showed count less (`RevisitModel`).
        """
        chance = sweep_chance(self.views, cell, heading, extent)
        self.unseen = self.unseen * (1.0 - self.revisits.reduced(cell, chance))
        self.revisits.add_shown(cell, chance)

    def found(self, target: str, p_map: ArrayLike) -> None:
        """Update the belief: `target`, by text or label, is at `p_map` and no longer wanted.

        Raises KeyError where this search has no such target.
        """
        number = self._number(target)
        if number in self.wanted:
            self.finds.append(FoundTarget(self.targets[number], np.asarray(p_map, np.float64)))

    def blocked(self, cells: ArrayLike) -> None:
        """Update the floor: `cells` are not traversable; the belief is kept.

        Raises LayoutError where no floor would be left.
        """
        old = self.views
        space = self.space.without(cells)
        kept = old.viewpoints[space.free.reshape(-1)[old.viewpoints]]
        self._planning_map = replace(self._planning_map, space=space)
        self._use(old.with_viewpoints(space, kept))

    def why(
        self,
        view: int,
        unseen: NDArray[np.float64] | None = None,
        revisits: RevisitModel | None = None,
    ) -> tuple[ViewReason, ...]:
        """Reasons for a view, the weightiest first; reasons of less than a hundredth are left out.

        `unseen` (c,) as in `TargetBelief` and `revisits` are the present ones by default.
        """
        unseen = self.unseen if unseen is None else unseen
        shown = (revisits or self.revisits).chance(view) * unseen
        present, wanted = self.target_belief.present(unseen), set(self.wanted)
        found: dict[int, tuple[Candidate, float]] = {}
        for part in self.target_belief.parts:
            if part.candidate.target in wanted:
                share = float(part.weight @ shown * present[part.row])
                found[id(part.candidate)] = (part.candidate, share)
        total = sum(share for _, share in found.values())
        reasons = [
            ViewReason(candidate, self.targets[candidate.target].label, share)
            for candidate, share in found.values()
            if share > 0.01 * total
        ]
        return tuple(sorted(reasons, key=lambda r: (-r.probability, r.candidate.iri)))

    def _number(self, target: str) -> int:
        for number, one in enumerate(self.targets):
            if target in (one.text, one.label, one.iri) or target in one.kinds.values():
                return number
        raise KeyError(f"{target!r} is no target of this search")


def build_search(
    semantic_map: SemanticMap,
    targets: Sequence[str],
    *,
    sensor: Sensor | None = None,
    motion: Motion | None = None,
    space: FreeSpace | None = None,
    at: float | None = None,
    start: ArrayLike | None = None,
    settings: BeliefSettings = BELIEF,
) -> PlanningState | None:
    """Planning state for `targets` (labels, synonyms, supercategories, needs); all are wanted.

    Args:
        semantic_map: The map.
        targets: Texts that name targets.
        sensor: Sensor model of the robot; the thesis' by default.
        motion: Motion model of the robot; the thesis' by default.
        space: Floor of the building; by default the map's observed floor and its places.
        at: Time of the search, for the persistence of objects [s since 1970]; by default the
            latest time in the map.
        start: Position (2,) [m] of the robot, from where it can look too; by default the map's.
        settings: Settings of the belief.

    Returns:
        The state; None where the map has neither places with an area nor objects.

    Raises:
        UnknownCategoryError: A text names no target.
    """
    facts = read_facts(semantic_map, targets, at)
    return state_of(
        facts, sensor=sensor, motion=motion, space=space, start=start, settings=settings
    )


def state_of(
    facts: SearchFacts,
    *,
    sensor: Sensor | None = None,
    motion: Motion | None = None,
    space: FreeSpace | None = None,
    start: ArrayLike | None = None,
    settings: BeliefSettings = BELIEF,
) -> PlanningState | None:
    """Planning state from what a search knows; arguments and result are those of `build_search`."""
    queries = CandidateQueries(facts, settings)
    things = [queries.things(i) for i in range(len(facts.targets))]
    if space is not None:
        planning_map: PlanningMap | None = planning_map_on(space, facts.places)
    else:
        spots = [c.p_map for of_target in things for c in of_target if c.probability > 0]
        planning_map = planning_map_of(facts.places, spots, settings, facts.floor, facts.base)
    if planning_map is None:
        return None
    candidates = tuple(
        candidate
        for i, of_target in enumerate(things)
        for candidate in (*of_target, *queries.places(i, planning_map))
    )
    sensor = sensor or Sensor()
    cells = belief_cells(planning_map.space)
    belief = build_target_belief(planning_map, cells, candidates, settings)
    proven = proven_views(facts.seen_from or {}, planning_map.space, belief)
    begin = facts.robot.p_map if start is None and facts.robot is not None else start
    here = np.array([] if begin is None else [planning_map.space.nearest(begin)], np.intp)
    weight = belief.weight.sum(axis=0)
    viewpoints = search_viewpoints(
        planning_map, cells, weight, sensor, (0.0, 0.0) if begin is None else begin
    )
    views = candidate_views(
        planning_map.space,
        sensor,
        motion,
        cells=cells,
        viewpoints=np.unique(np.concatenate([viewpoints, proven[:, 0], here])),
        proven=proven,
    )
    return PlanningState(
        facts.targets, planning_map, views, candidates, belief, settings, facts=facts
    )

"""Planning state of a search: target belief, candidate views, and the views that failed.

    state = build_search(semantic_map, ["cup"])
    view = state.next_view(at)            # a number in state.views, or None: give up
    state.missed(view)                    # taken, and the target was not detected

A `PlanningState` is changed in place and never writes to the map.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kg.maps.facts.occupancy import tiles_of_rows
from kg.maps.room_statistics import placement_table
from kg.maps.semantic_map import SemanticMap
from mapping.occupancy.mapped_floor import mapped_floor
from planner.freespace.grid import Cells, FreeSpace
from planner.freespace.planning_map import (
    Place,
    PlanningMap,
    all_places,
    planning_map_of,
    planning_map_on,
)
from planner.search.belief import CellBelief, TargetBelief, build_target_belief
from planner.search.goals.candidate_queries import Candidate, CandidateQueries, map_time
from planner.search.goals.targets import Target, resolve
from planner.search.viewpoints.candidate_views import (
    CandidateViews,
    belief_cells,
    candidate_views,
    picture_chance,
)
from planner.search.viewpoints.coverage import covering_viewpoints
from planner.search.viewpoints.next_best_view import NextBestView, RevisitModel, RobotState
from planner.search.viewpoints.sensor import Motion, Sensor
from planner.settings import BELIEF, MAX_ROOMS, MAX_ROUNDS, BeliefSettings


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


class PlanningState:
    """Planning state of one search for one or several targets; all of them are wanted.

    `fresh` adds views when all others failed; by default it is `with_fresh_viewpoints`. `blocked`
    replaces `space`, `rooms`, `views`, `next_best_view` and `revisits`, so that earlier numbers of
    views do not hold after it.
    """

    def __init__(
        self,
        targets: tuple[Target, ...],
        planning_map: PlanningMap,
        views: CandidateViews,
        candidates: tuple[Candidate, ...],
        known: TargetBelief,
        settings: BeliefSettings = BELIEF,
        fresh: Callable[[PlanningMap, CandidateViews, NDArray[np.float64]], CandidateViews]
        | None = None,
    ) -> None:
        self.targets, self.candidates, self.target_belief = targets, candidates, known
        self.settings = settings
        self.finds: list[FoundTarget] = []
        self.unseen = np.ones(len(views.cells))  # (c,) chance that all views missed what lies there
        self._planning_map, self._fresh = planning_map, fresh or with_fresh_viewpoints
        self._first = known.left(self.unseen, range(len(targets)))
        self.rounds = 0  # how often fresh positions were taken
        self.views, self.next_best_view, self.revisits = (
            views,
            NextBestView(views),
            RevisitModel(views),
        )

    def _use(self, views: CandidateViews) -> None:
        """Replace the candidate views by others over the same cells."""
        self.views, self.next_best_view = views, NextBestView(views)
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

    @property
    def expected_finds(self) -> float:
        """Expected number of targets still wanted that are on this floor."""
        return sum(self.target_belief.left(self.unseen, [number]) for number in self.wanted)

    def robot_state(self, p_map: ArrayLike, heading: float = 0.0) -> RobotState:
        """Robot state at `p_map` (2,) [m]: the floor cell nearest to it."""
        return RobotState(self.space.nearest(p_map), heading)

    def place_of(self, view: int) -> str:
        """IRI of the place a view is taken in; "" for none."""
        cell = self.views.viewpoints[self.views.viewpoint[view]]
        room = int(self.space.room.reshape(-1)[cell])
        return self.rooms[room] if room >= 0 else ""

    def place_name(self, view: int) -> str:
        """Label of the place a view is taken in."""
        cell = self.views.viewpoints[self.views.viewpoint[view]]
        room = int(self.space.room.reshape(-1)[cell])
        return self._planning_map.names[room] if room >= 0 else ""

    def weights(self, unseen: NDArray[np.float64]) -> NDArray[np.float64]:
        """(c,) value of seeing each cell: targets expected there that are still wanted."""
        count = len(self.targets)
        needed = self.target_belief.still_missing(unseen, count)
        needed = needed / np.maximum(self.target_belief.still_missing(self.unseen, count), 1e-12)
        of = np.zeros(count)
        of[list(self.wanted)] = needed[list(self.wanted)]
        return self.target_belief.expected(unseen, of)

    @property
    def overlooked(self) -> float:
        """Probability that all views so far have missed a target that is on this floor.

        The greater of two values, so that a wrong belief does not end a search: for a target that
        is distributed as believed, and for one that is anywhere on the floor. Floor that no view
        shows counts until fresh viewpoints were tried.
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

        It gives up when the probability that all views missed the target, on floor that reachable
        viewpoints show, is below `settings.stop_below`. Until then, views that gain little or
        repeat earlier ones make it take fresh viewpoints, which see behind other occlusions.
        """
        while self.wanted:
            seeable = self.next_best_view.seeable_from(at)
            if self._missed_chance(seeable) <= self.settings.stop_below:
                return None
            view = self.choose(at, self.unseen, self.revisits, self._least(seeable))
            if view is not None and not self._is_stale(view):
                return view
            if not self._refreshed():
                return view
        return None

    def _least(self, seeable: NDArray[np.bool_]) -> float:
        """Probability that a view must gain to be worth its way, with `seeable` (c,) floor."""
        worth = float(self.weights(self.unseen)[seeable].sum())
        return self.settings.give_up * worth / 2.0**self.rounds

    def _is_stale(self, view: int) -> bool:
        """Whether earlier views from there have shown most of what `view` shows."""
        weight = self.weights(self.unseen)
        fresh = float(self.views.chance[view] @ weight)
        return bool(self.revisits.chance(view) @ weight < self.settings.stale * fresh)

    def _refreshed(self) -> bool:
        """Take fresh viewpoints and halve the gain that is asked for; False after MAX_ROUNDS."""
        if self.rounds == MAX_ROUNDS:
            return False
        self.rounds += 1
        unseen = self.target_belief.expected(self.unseen, np.ones(len(self.targets)))
        self._use(self._fresh(self._planning_map, self.views, unseen))
        return True

    def choose(
        self,
        at: RobotState,
        unseen: NDArray[np.float64],
        revisits: RevisitModel,
        least: float | None = None,
    ) -> int | None:
        """The best view from `at` for given `unseen` (c,) and `revisits`.

        None where no view gains at least `least`, by default the share `settings.give_up` of the
        probability that there was at first.
        """
        least = self.settings.give_up * self._first if least is None else least
        weight = self.weights(unseen)
        gains = revisits.gains(weight)
        gains[(gains < least) | ~self.next_best_view.reached(at)] = 0.0
        if not gains.max() > 0:
            return None
        view = self.next_best_view.best(at, weight, revisits, gains)
        if view is None or not gains[view] > 0:  # worth something only as the way to better ones
            rates = gains / self.next_best_view.costs(at, np.arange(len(gains)))
            view = int(np.argmax(rates))
        return view

    def missed(self, view: int) -> None:
        """Update the belief: `view` was taken and showed no target."""
        self.unseen = self.unseen * (1.0 - self.revisits.chance(view))
        self.revisits.add(view)

    def missed_picture(self, cell: int, heading: float) -> None:
        """Update the belief: a picture from floor `cell` towards `heading` [rad] showed no target.

        Pictures from about the same position are correlated, so cells that an earlier picture or
        view showed count less.
        """
        chance = picture_chance(self.views, cell, heading)
        self.unseen = self.unseen * (1.0 - self.revisits.reduced(cell, chance))
        self.revisits.add_shown(cell, chance)

    def found(self, target: str, p_map: ArrayLike) -> None:
        """Update the belief: `target`, by text or label, is at `p_map` and no longer wanted.

        Raises KeyError for what is no target of this search.
        """
        number = self._number(target)
        if number in self.wanted:
            self.finds.append(FoundTarget(self.targets[number], np.asarray(p_map, np.float64)))

    def blocked(self, cells: ArrayLike) -> None:
        """Update the floor: `cells` cannot be driven through; the belief is kept.

        Raises LayoutError where no floor would be left.
        """
        old = self.views
        space = self.space.without(cells)
        kept = old.viewpoints[space.free.reshape(-1)[old.viewpoints]]
        self._planning_map = replace(self._planning_map, space=space)
        self._use(old.with_viewpoints(space, kept))

    def why(self, view: int, unseen: NDArray[np.float64] | None = None) -> tuple[ViewReason, ...]:
        """Reasons for a view, the weightiest first, without those of less than a hundredth.

        `unseen` (c,) is as in `TargetBelief`, by default the present one.
        """
        unseen = self.unseen if unseen is None else unseen
        shown = self.revisits.chance(view) * unseen
        missed, wanted = self.target_belief.missed(unseen), set(self.wanted)
        found: dict[int, tuple[Candidate, float]] = {}
        for part in self.target_belief.parts:
            if part.candidate.target in wanted:
                share = float(part.weight @ shown / missed[part.row])
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
    settings: BeliefSettings = BELIEF,
) -> PlanningState | None:
    """Planning state for `targets` (labels, synonyms, supercategories, needs); all are wanted.

    `at` [s since 1970] is the moment to search at, which persistence is computed for; by default
    the latest one the map knows of. `space` is the floor where it is known better than by the map,
    which has what depth showed and, beyond that, the rectangles of its places. None where the map
    has neither places with an area nor objects to look around.
    Raises UnknownCategoryError for what is no target.
    """
    wanted = resolve(semantic_map, targets)
    places = all_places(semantic_map)
    now = map_time(semantic_map) if at is None else at
    queries = CandidateQueries(semantic_map, places, placement_table(semantic_map), now, settings)
    things = [queries.things(i, one) for i, one in enumerate(wanted)]
    if space is not None:
        planning_map: PlanningMap | None = planning_map_on(space, places)
    else:
        spots = [c.p_map for of_one in things for c in of_one if c.probability > 0]
        planning_map = _planning_map(semantic_map, places, spots, settings)
    if planning_map is None:
        return None
    found = tuple(
        candidate
        for i, (one, of_one) in enumerate(zip(wanted, things, strict=True))
        for candidate in (*of_one, *queries.places(i, one, planning_map))
    )
    sensor = sensor or Sensor()
    cells = belief_cells(planning_map.space)
    known = build_target_belief(planning_map, cells, found, settings)
    viewpoints = _viewpoints(planning_map, cells, known.weight.sum(axis=0), sensor)
    views = candidate_views(planning_map.space, sensor, motion, cells=cells, viewpoints=viewpoints)
    return PlanningState(wanted, planning_map, views, found, known, settings)


def _planning_map(
    semantic_map: SemanticMap,
    places: Sequence[Place],
    spots: Sequence[NDArray[np.float64]],
    settings: BeliefSettings,
) -> PlanningMap | None:
    """Planning map of the storey where the robot is."""
    robot = semantic_map.robot()
    height = None if robot is None else float(robot.p_map[2])
    floor = mapped_floor(tiles_of_rows(semantic_map.query("goals-floor").records()), height)
    return planning_map_of(places, spots, settings, floor, semantic_map.base)


def with_fresh_viewpoints(
    planning_map: PlanningMap, views: CandidateViews, weight: NDArray[np.float64]
) -> CandidateViews:
    """`views` with further ones from fresh viewpoints, for cells of `weight` (c,)."""
    fresh = _viewpoints(planning_map, views.cells, weight, views.sensor, views.viewpoints)
    return views.with_viewpoints(planning_map.space, np.union1d(views.viewpoints, fresh))


def _viewpoints(
    planning_map: PlanningMap,
    cells: Cells,
    weight: NDArray[np.float64],
    sensor: Sensor,
    besides: ArrayLike = (),
) -> Cells:
    """Viewpoints in every room, or of many rooms in those with most of `weight` (c,) per area.

    As many rooms with free floor are among them at least, since a room full of tables is seen from
    others. Every cell is covered twice. None of `besides` is among the viewpoints.
    """
    space = planning_map.space
    if len(planning_map.rooms) > MAX_ROOMS:
        of_cell = space.room.reshape(-1)[cells]
        mass = np.bincount(of_cell, weight, minlength=len(planning_map.rooms))
        size = np.bincount(of_cell, minlength=len(planning_map.rooms))
        ranked = np.argsort(-mass / np.sqrt(np.maximum(size, 1)), kind="stable")
        stood_in = ranked[np.isin(ranked, space.room[space.free])]
        best = np.union1d(ranked[:MAX_ROOMS], stood_in[:MAX_ROOMS])
        inside = space.inside()
        space = space.without(inside[~np.isin(space.room.reshape(-1)[inside], best)])
    return covering_viewpoints(space, sensor.far, near=sensor.near, besides=besides)

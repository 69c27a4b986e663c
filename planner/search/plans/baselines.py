"""Baselines of a view plan on the same belief: rooms in a fixed order, each swept by views."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planner.search.plans.orders import nearest_neighbour, room_order
from planner.search.plans.rollout import PlanEvaluator, Rollout
from planner.search.viewpoints.next_best_view import RobotState

_SWEPT: float = 0.9  # share of the probability that a room's views can find, at which a sweep ends
_MAX_VIEWS: int = 12  # of a room


@dataclass(frozen=True, slots=True, eq=False)
class Baseline:
    """Expected time of another way to search, beside that of the plan."""

    name: str
    probability: float  # to find the target, as far as both reach; times are compared at it
    expected_seconds: float  # [s] mean time of the finds up to that probability
    plan_seconds: float  # [s] the same for the plan
    views: int


class RoomBaselines:
    """Room sweeps: rooms one after another, each swept by views before the next."""

    def __init__(self, evaluator: PlanEvaluator) -> None:
        self._evaluator = evaluator
        views = evaluator.state.views
        self._room_of = evaluator.state.space.room.reshape(-1)[views.viewpoints]
        self._reached = np.isfinite(views.ways.metres_from(evaluator.at.cell))
        self.rooms = [int(r) for r in np.unique(self._room_of[self._reached])]
        self._sweeps = {room: self._sweep(room) for room in self.rooms}

    def _sweep(self, room: int) -> list[int]:
        """Views of one room by the ratio rule, beginning at its middle."""
        state = self._evaluator.state
        views, viewpoints = state.views, np.flatnonzero((self._room_of == room) & self._reached)
        among = np.flatnonzero(np.isin(views.viewpoint, viewpoints))
        inside = state.space.room.reshape(-1)[views.cells] == room
        left = np.where(inside, state.weights(state.unseen), 0.0)
        goal = (1 - _SWEPT) * float(left @ views.chance.rows(among).greatest())
        at, order = self._middle(viewpoints), list[int]()
        while len(order) < _MAX_VIEWS and len(among):
            chance = views.chance.rows(among)
            gains = chance @ left
            view = int(among[np.argmax(gains / state.next_best_view.costs(at, among))])
            if float(gains.max()) <= 0 or float(left @ chance.greatest()) <= goal:
                break
            left = left * (1.0 - views.chance[view])
            order.append(view)
            at = state.next_best_view.after(at, view)
            among = among[among != view]
        return order

    def _middle(self, viewpoints: NDArray[np.intp]) -> RobotState:
        state = self._evaluator.state
        xy = state.space.centres(state.views.viewpoints[viewpoints])
        best = viewpoints[int(np.argmin(((xy - xy.mean(axis=0)) ** 2).sum(axis=1)))]
        return RobotState(int(state.views.viewpoints[best]))

    def nearest_first(self) -> list[int]:
        """Rooms in nearest-neighbour order."""
        views = self._evaluator.state.views
        first, between = views.ways.metres_from(self._evaluator.at.cell), views.ways.metres

        def metres(here: int | None, room: int) -> float:
            last = first if here is None else between[views.viewpoint[self._sweeps[here][-1]]]
            return float(last[self._room_of == room].min())

        return list(nearest_neighbour((r for r in self.rooms if self._sweeps[r]), metres))

    def best_order(self) -> list[int]:
        """Rooms in an order of little expected time, each swept as a whole."""
        state, rooms = self._evaluator.state, [room for room in self.rooms if self._sweeps[room]]
        views = state.views
        first = np.array([views.viewpoint[self._sweeps[room][0]] for room in rooms], np.intp)
        last = np.array([views.viewpoint[self._sweeps[room][-1]] for room in rooms], np.intp)
        p = np.array([state.belief.of_room(state.space, room) for room in rooms])
        if not p.sum() > 0:
            return rooms
        speed = views.motion.speed
        metres = views.ways.metres
        far = float(np.max(metres[np.isfinite(metres)], initial=1.0)) * 10 / speed
        between = metres[np.ix_(last, first)] / speed
        there = views.ways.metres_from(self._evaluator.at.cell)[first] / speed
        sweeps = np.array([self._seconds(self._sweeps[room]) for room in rooms])
        order = room_order(
            p,
            np.where(np.isfinite(there), there, far) + sweeps,
            np.where(np.isfinite(between), between, far) + sweeps,
        )
        return [rooms[i] for i in order]

    def _seconds(self, sweep: Sequence[int]) -> float:
        state, total = self._evaluator.state, 0.0
        at = RobotState(int(state.views.viewpoints[state.views.viewpoint[sweep[0]]]))
        for view in sweep:
            total += self._evaluator.cost(at, view)
            at = state.next_best_view.after(at, view)
        return total

    def rollout(self, rooms: Sequence[int]) -> Rollout:
        """Rollout of sweeping `rooms` in that order."""
        return self._evaluator.play([view for room in rooms for view in self._sweeps[room]])


def room_baselines(evaluator: PlanEvaluator, chosen: Rollout) -> tuple[Baseline, ...]:
    """Baselines that search room by room, compared with the rollout `chosen`."""
    rooms = RoomBaselines(evaluator)
    nearest, best = rooms.nearest_first(), rooms.best_order()
    if not nearest:
        return ()
    if nearest == best:
        name = "rooms, nearest first, which is also their best order"
        return (rated(name, rooms.rollout(nearest), chosen),)
    return (
        rated("rooms, nearest first", rooms.rollout(nearest), chosen),
        rated("rooms, best order", rooms.rollout(best), chosen),
    )


def turns_at_stops(evaluator: PlanEvaluator, stops: Sequence[NDArray[np.float64]]) -> Rollout:
    """Rollout of a whole turn at each of `stops` ((2,) [m]) in order, as the thesis' rule searches.

    Each turn is taken from the nearest viewpoint, one of the same room if there is any.
    """
    views, space = evaluator.state.views, evaluator.state.space
    whole = np.flatnonzero(views.extent >= 2 * np.pi - 1e-9)
    cells, room_of = views.viewpoints[views.viewpoint[whole]], space.room.reshape(-1)
    order = list[int]()
    for stop in stops:
        away = np.linalg.norm(space.centres(cells) - stop, axis=1)
        away[room_of[cells] != room_of[space.nearest(stop)]] += 1e6  # behind a wall
        order += [int(whole[np.argmin(away)])] if len(whole) else []
    return evaluator.play(list(dict.fromkeys(order)))


def rated(name: str, rollout: Rollout, chosen: Rollout) -> Baseline:
    """Baseline of `rollout`, compared with `chosen` as far as both find the same."""
    common = min(float(rollout.gains.sum()), float(chosen.gains.sum()))
    return Baseline(name, common, rollout.until(common), chosen.until(common), len(rollout.views))

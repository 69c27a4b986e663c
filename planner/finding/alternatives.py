"""Other ways to search, rated on the same belief: rooms in some order, each swept by looks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planner.finding.playing import Played, Player
from planner.ordering import OrderingProblem, solve
from planner.viewing.tour import Standing

_SWEPT: float = 0.9  # share of what a room's looks can find that ends its sweep
_A_ROOM: int = 12  # looks in a room, at most
_FEW: int = 14  # rooms up to which an order is proven


@dataclass(frozen=True, slots=True, eq=False)
class Alternative:
    """Another way to search and what it is expected to take."""

    name: str
    probability: float  # that it finds, as far as the plan does too: what the two are compared at
    expected_seconds: float  # [s] given that it finds that much
    plan_seconds: float  # [s] the same of the plan
    looks: int


class RoomOrders:
    """Rooms one after another; every room is swept by looks before the next."""

    def __init__(self, player: Player) -> None:
        self._player = player
        hunt = player.hunt
        stands = hunt.looks.stands
        self._of_stand = hunt.space.room.reshape(-1)[stands]
        looks = hunt.looks
        self._reached = np.isfinite(looks.metres_from(player.at.cell))
        self.rooms = [int(r) for r in np.unique(self._of_stand[self._reached])]
        self._sweeps = {room: self._sweep(room) for room in self.rooms}

    def _sweep(self, room: int) -> list[int]:
        """Looks of one room from its middle on, always of the best rate, whole turns among them."""
        hunt = self._player.hunt
        looks, stands = hunt.looks, np.flatnonzero((self._of_stand == room) & self._reached)
        among = np.flatnonzero(np.isin(looks.stand, stands))
        inside = hunt.space.room.reshape(-1)[looks.cells] == room
        left = np.where(inside, hunt.weights(hunt.unseen), 0.0)
        goal = (1 - _SWEPT) * float(left @ looks.chance[among].max(axis=0))
        at, order = self._middle(stands), list[int]()
        while len(order) < _A_ROOM and len(among):
            gains = looks.chance[among] @ left.astype(np.float32)
            look = int(among[np.argmax(gains / hunt.tourist.costs(at, among))])
            if float(gains.max()) <= 0 or float(left @ looks.chance[among].max(axis=0)) <= goal:
                break
            left = left * (1.0 - looks.chance[look])
            order.append(look)
            at = hunt.tourist.after(at, look)
            among = among[among != look]
        return order

    def _middle(self, stands: NDArray[np.intp]) -> Standing:
        hunt = self._player.hunt
        xy = hunt.space.centres(hunt.looks.stands[stands])
        best = stands[int(np.argmin(((xy - xy.mean(axis=0)) ** 2).sum(axis=1)))]
        return Standing(int(hunt.looks.stands[best]), 0.0, int(best))

    def nearest_first(self) -> list[int]:
        """Rooms always on to the nearest that remains."""
        looks, order = self._player.hunt.looks, list[int]()
        left = [room for room in self.rooms if self._sweeps[room]]
        metres = looks.metres_from(self._player.at.cell)
        while left:
            room = min(left, key=lambda r: (float(metres[self._of_stand == r].min()), r))
            left.remove(room)
            order.append(room)
            metres = looks.metres[looks.stand[self._sweeps[room][-1]]]
        return order

    def best_order(self) -> list[int]:
        """The order of least expected time, were rooms all there is (`planner.ordering`)."""
        hunt, rooms = self._player.hunt, [room for room in self.rooms if self._sweeps[room]]
        looks = hunt.looks
        first = np.array([looks.stand[self._sweeps[room][0]] for room in rooms])
        last = np.array([looks.stand[self._sweeps[room][-1]] for room in rooms])
        belief = hunt.belief
        p = np.array([belief.of_room(hunt.space, room) for room in rooms])
        if not rooms or p.sum() <= 0:
            return rooms
        speed = looks.motion.speed
        far = float(np.max(looks.metres[np.isfinite(looks.metres)], initial=1.0)) * 10 / speed
        between = looks.metres[np.ix_(last, first)] / speed
        there = looks.metres_from(self._player.at.cell)[first] / speed
        problem = OrderingProblem(
            p=p / p.sum(),
            T=np.where(np.isfinite(between), between, far),
            t0=np.where(np.isfinite(there), there, far),
            explore=np.array([self._seconds(self._sweeps[room]) for room in rooms]),
        )
        if len(rooms) <= _FEW:
            return [rooms[i] for i in solve(problem, time_limit=10.0).order]
        return _by_ratio(problem, rooms)

    def _seconds(self, sweep: Sequence[int]) -> float:
        hunt, total = self._player.hunt, 0.0
        stand = int(hunt.looks.stand[sweep[0]])
        at = Standing(int(hunt.looks.stands[stand]), 0.0, stand)
        for look in sweep:
            total += self._player.cost(at, look)
            at = hunt.tourist.after(at, look)
        return total

    def played(self, rooms: Sequence[int]) -> Played:
        """What sweeping `rooms` in that order brings."""
        return self._player.play([look for room in rooms for look in self._sweeps[room]])


def _by_ratio(problem: OrderingProblem, rooms: Sequence[int]) -> list[int]:
    """Always the room of most probability a second; the same on every machine."""
    left, order, way = list(range(len(rooms))), list[int](), problem.t0
    while left:
        rate = problem.p / np.maximum(way + problem.explore, 1e-9)
        best = left[int(np.argmax(rate[left]))]
        left.remove(best)
        order.append(rooms[best])
        way = problem.T[best]
    return order


def alternatives(player: Player, chosen: Played) -> tuple[Alternative, ...]:
    """Rooms nearest first, and rooms in their best order, beside the `chosen` looks."""
    orders = RoomOrders(player)
    return tuple(
        rated(name, orders.played(rooms), chosen)
        for name, rooms in (
            ("rooms, nearest first", orders.nearest_first()),
            ("rooms, best order", orders.best_order()),
        )
        if rooms
    )


def turns_at(player: Player, stops: Sequence[NDArray[np.float64]]) -> Played:
    """A whole turn at each of `stops` ((2,) [m]) in their order: how the thesis' rule searches.

    Each is taken from the position nearest to it in its room, if there is one there.
    """
    looks, space = player.hunt.looks, player.hunt.space
    whole = np.flatnonzero(looks.extent >= 2 * np.pi - 1e-9)
    cells, room_of = looks.stands[looks.stand[whole]], space.room.reshape(-1)
    order = list[int]()
    for stop in stops:
        away = np.linalg.norm(space.centres(cells) - stop, axis=1)
        away[room_of[cells] != room_of[space.nearest(stop)]] += 1e6  # behind a wall
        order += [int(whole[np.argmin(away)])] if len(whole) else []
    return player.play(list(dict.fromkeys(order)))


def rated(name: str, played: Played, chosen: Played) -> Alternative:
    """`played` beside `chosen`, both as far as they find the same."""
    common = min(float(played.gains.sum()), float(chosen.gains.sum()))
    return Alternative(name, common, played.until(common), chosen.until(common), len(played.looks))

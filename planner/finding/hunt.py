"""A search under way: belief on the floor, looks to take, and what each look taught.

    hunt = prepare(semantic_map, ["cup"])
    look = hunt.next(at)                  # a number in hunt.looks, or None: nothing is worth a look
    hunt.missed(look)                     # looked, and did not see it

A `Hunt` is changed in place by what happens; it never writes to the map.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kg.floor import tiles_of_rows
from kg.placement.table import placement_table
from kg.semantic_map import SemanticMap
from planner.finding.candidates import Candidate, Gatherer, map_time
from planner.finding.ground import Ground, ground_of, ground_on
from planner.finding.places import Place, all_places
from planner.finding.prospects import Prospects, prospects
from planner.finding.settings import BELIEF, MOST_ROOMS, MOST_ROUNDS, Belief
from planner.finding.targets import Target, resolve
from planner.space.grid import Cells, FreeSpace
from planner.space.mapped import mapped_floor
from planner.viewing.belief import CellBelief
from planner.viewing.covers import standing_cells
from planner.viewing.looks import (
    Looks,
    belief_cells,
    candidate_looks,
    picture,
)
from planner.viewing.memory import Memory
from planner.viewing.sensor import Motion, Sensor
from planner.viewing.tour import Standing, Tourist


@dataclass(frozen=True, slots=True, eq=False)
class Reason:
    """Why to look somewhere: one candidate, and how much of the look's worth is its doing."""

    candidate: Candidate
    target: str  # what is wanted there
    probability: float  # that the look finds it on this account


@dataclass(frozen=True, slots=True, eq=False)
class Find:
    """A target that has been found."""

    target: Target
    p_map: NDArray[np.float64]  # (2,) or (3,) [m]


class Hunt:
    """One search for one or several targets; all of them are wanted.

    `fresh` gives further looks to a search in vain; by default it is `with_fresh_stands`.
    `space`, `rooms` (place IRI by number of room, "" where a room is no place), `looks`, `tourist`
    and `memory` are replaced by `blocked`; look numbers from before do not hold after it.
    """

    def __init__(
        self,
        targets: tuple[Target, ...],
        ground: Ground,
        looks: Looks,
        candidates: tuple[Candidate, ...],
        known: Prospects,
        settings: Belief = BELIEF,
        fresh: Callable[[Ground, Looks, NDArray[np.float64]], Looks] | None = None,
    ) -> None:
        self.targets, self.candidates, self.prospects = targets, candidates, known
        self.settings = settings
        self.finds: list[Find] = []
        self.unseen = np.ones(len(looks.cells))  # (c,) chance that all looks missed what lies there
        self._ground, self._fresh = ground, fresh or with_fresh_stands
        self._first = known.left(self.unseen, range(len(targets)))
        self.rounds = 0  # how often fresh positions were taken
        self.looks, self.tourist, self.memory = looks, Tourist(looks), Memory(looks)

    def _use(self, looks: Looks) -> None:
        """Go on with other looks over the same cells."""
        self.looks, self.tourist = looks, Tourist(looks)
        self.memory = self.memory.moved_to(looks)

    @property
    def space(self) -> FreeSpace:
        """The floor."""
        return self._ground.space

    @property
    def rooms(self) -> tuple[str, ...]:
        """Place IRI by number of room; "" where a room is no place."""
        return self._ground.rooms

    @property
    def wanted(self) -> tuple[int, ...]:
        """Numbers of the targets not yet found."""
        done = {id(find.target) for find in self.finds}
        return tuple(i for i, target in enumerate(self.targets) if id(target) not in done)

    @property
    def belief(self) -> CellBelief:
        """Where the next of what is still wanted is, all targets together."""
        return self.prospects.belief(self.unseen, self.wanted, len(self.targets))

    def belief_of(self, target: str) -> CellBelief:
        """Where one target is, by the text or label it was given with."""
        return self.prospects.belief(self.unseen, [self._number(target)], len(self.targets))

    @property
    def left(self) -> float:
        """Probability that anything still wanted is on this floor, after all looks in vain."""
        return self.prospects.left(self.unseen, self.wanted) if self.wanted else 0.0

    def standing(self, p_map: ArrayLike, heading: float = 0.0) -> Standing:
        """Where a robot at `p_map` (2,) [m] stands: the floor cell nearest to it."""
        return Standing(self.space.nearest(p_map), heading)

    def place_of(self, look: int) -> str:
        """IRI of the place a look is taken in; "" for none."""
        cell = self.looks.stands[self.looks.stand[look]]
        room = int(self.space.room.reshape(-1)[cell])
        return self.rooms[room] if room >= 0 else ""

    def place_name(self, look: int) -> str:
        """What people call the place a look is taken in."""
        cell = self.looks.stands[self.looks.stand[look]]
        room = int(self.space.room.reshape(-1)[cell])
        return self._ground.names[room] if room >= 0 else ""

    def weights(self, unseen: NDArray[np.float64]) -> NDArray[np.float64]:
        """(c,) worth of seeing each cell: what is expected there, if it is still needed."""
        count = len(self.targets)
        needed = self.prospects.still_missing(unseen, count)
        needed = needed / np.maximum(self.prospects.still_missing(self.unseen, count), 1e-12)
        of = np.zeros(count)
        of[list(self.wanted)] = needed[list(self.wanted)]
        return self.prospects.expected(unseen, of)

    @property
    def overlooked(self) -> float:
        """Chance that what lies on this floor was missed by all looks so far.

        Of what lies where it is believed to be, or anywhere on the floor at all: the greater of the
        two, so that a belief that misleads does not end a search. Floor that no look shows is left
        out once every position was thought of.
        """
        return self._overlooked(self.tourist.seeable)

    def _overlooked(self, seeable: NDArray[np.bool_]) -> float:
        """As `overlooked`, on floor that was seen or is `seeable` (c,)."""
        counted = seeable | (self.unseen < 1.0) if self.rounds else np.ones_like(seeable)
        rows = np.isin(self.prospects.target, self.wanted)
        believed = self.prospects.weight[rows].sum(axis=0)[counted]
        unseen = self.unseen[counted]
        if not len(unseen):
            return 0.0
        total = float(believed.sum())
        where_believed = float(believed @ unseen) / total if total > 0 else 0.0
        return max(where_believed, float(unseen.mean()))

    def next(self, at: Standing) -> int | None:
        """The look to take next from `at`; None where it is given up.

        It is once a thing on floor that can be seen from where there is a way to would have been
        found, but for a chance of `settings.rest`.
        Until then looks that are worth little, or show little that was not looked at from there
        before, have the hunt go on with fresh positions, which see round what hid it from the old.
        """
        while self.wanted:
            seeable = self.tourist.seeable_from(at)
            if self._overlooked(seeable) <= self.settings.rest:
                return None
            look = self.choose(at, self.unseen, self.memory, self._least(seeable))
            if look is not None and not self._worn(look):
                return look
            if not self._refreshed():
                return look
        return None

    def _least(self, seeable: NDArray[np.bool_]) -> float:
        """What a look must find to be worth its way, of what is left on `seeable` (c,) floor."""
        worth = float(self.weights(self.unseen)[seeable].sum())
        return self.settings.give_up * worth / 2.0**self.rounds

    def _worn(self, look: int) -> bool:
        """Whether most of what `look` shows was looked at from there before."""
        weight = self.weights(self.unseen)
        fresh = float(self.looks.chance[look] @ weight)
        return bool(self.memory.chance(look) @ weight < self.settings.worn * fresh)

    def _refreshed(self) -> bool:
        """Take fresh positions, and be content with looks that find half as much; False at last."""
        if self.rounds == MOST_ROUNDS:
            return False
        self.rounds += 1
        unseen = self.prospects.expected(self.unseen, np.ones(len(self.targets)))
        self._use(self._fresh(self._ground, self.looks, unseen))
        return True

    def choose(
        self, at: Standing, unseen: NDArray[np.float64], memory: Memory, least: float | None = None
    ) -> int | None:
        """As `next`, on trial: with other things `unseen` (c,) and remembered.

        None where no look finds at least `least`, by default `settings.give_up` of what there was
        to find at first.
        """
        least = self.settings.give_up * self._first if least is None else least
        weight = self.weights(unseen)
        gains = memory.gains(weight)
        gains[(gains < least) | ~self.tourist.reached(at)] = 0.0
        if not gains.max() > 0:
            return None
        look = self.tourist.best(at, weight, memory, gains)
        if look is None or not gains[look] > 0:  # it led on to better ones, and is nothing itself
            rates = gains / self.tourist.costs(at, np.arange(len(gains)))
            look = int(np.argmax(rates))
        return look

    def missed(self, look: int) -> None:
        """Learn that `look` was taken and showed nothing that is wanted."""
        self.unseen = self.unseen * (1.0 - self.memory.chance(look))
        self.memory.note(look)

    def missed_picture(self, cell: int, heading: float) -> None:
        """Learn from one picture taken from floor `cell` towards `heading` [rad], on the way, say.

        Pictures from about the same position tell much the same: what one of them or a look showed
        counts less in the next.
        """
        chance = picture(self.looks, cell, heading)
        self.unseen = self.unseen * (1.0 - self.memory.lessened(cell, chance))
        self.memory.note_shown(cell, chance)

    def found(self, target: str, p_map: ArrayLike) -> None:
        """Learn that `target`, by text or label, is at `p_map`; it is wanted no more.

        Raises KeyError for what this hunt was not made for.
        """
        number = self._number(target)
        if number in self.wanted:
            self.finds.append(Find(self.targets[number], np.asarray(p_map, np.float64)))

    def blocked(self, cells: ArrayLike) -> None:
        """Learn that floor `cells` cannot be driven through; what was seen stays known.

        Raises LayoutError where no floor would be left.
        """
        old = self.looks
        space = self.space.without(cells)
        kept = old.stands[space.free.reshape(-1)[old.stands]]
        self._ground = replace(self._ground, space=space)
        self._use(old.with_stands(space, kept))

    def why(self, look: int, unseen: NDArray[np.float64] | None = None) -> tuple[Reason, ...]:
        """What makes a look worth while, the weightiest first; less than a hundredth of it is out.

        `unseen` (c,) as `Prospects` has it; by default what is unseen now.
        """
        unseen = self.unseen if unseen is None else unseen
        shown = self.memory.chance(look) * unseen
        missed, wanted = self.prospects.missed(unseen), set(self.wanted)
        found: dict[int, tuple[Candidate, float]] = {}
        for part in self.prospects.parts:
            if part.candidate.target in wanted:
                share = float(part.weight @ shown / missed[part.row])
                found[id(part.candidate)] = (part.candidate, share)
        total = sum(share for _, share in found.values())
        reasons = [
            Reason(candidate, self.targets[candidate.target].label, share)
            for candidate, share in found.values()
            if share > 0.01 * total
        ]
        return tuple(sorted(reasons, key=lambda r: (-r.probability, r.candidate.iri)))

    def _number(self, target: str) -> int:
        for number, one in enumerate(self.targets):
            if target in (one.text, one.label, one.iri) or target in one.kinds.values():
                return number
        raise KeyError(f"{target!r} is not what this hunt is for")


def prepare(
    semantic_map: SemanticMap,
    targets: Sequence[str],
    *,
    sensor: Sensor | None = None,
    motion: Motion | None = None,
    space: FreeSpace | None = None,
    at: float | None = None,
    settings: Belief = BELIEF,
) -> Hunt | None:
    """A hunt for `targets` (labels, synonyms, supercategories, needs; all are wanted).

    `at` [s since 1970] is the moment to search at, which tells how old memories are; by default the
    latest one the map knows of. `space` is the floor where it is known better than by the map,
    which has what depth showed and, beyond that, the rectangles of its places. None where the map
    has neither places with an area nor objects to look around.
    Raises UnknownCategoryError for what is no target.
    """
    wanted = resolve(semantic_map, targets)
    places = all_places(semantic_map)
    now = map_time(semantic_map) if at is None else at
    gatherer = Gatherer(semantic_map, places, placement_table(semantic_map), now, settings)
    things = [gatherer.things(i, one) for i, one in enumerate(wanted)]
    if space is not None:
        ground: Ground | None = ground_on(space, places)
    else:
        spots = [c.p_map for of_one in things for c in of_one if c.probability > 0]
        ground = _ground(semantic_map, places, spots, settings)
    if ground is None:
        return None
    found = tuple(
        candidate
        for i, (one, of_one) in enumerate(zip(wanted, things, strict=True))
        for candidate in (*of_one, *gatherer.places(i, one, ground))
    )
    sensor = sensor or Sensor()
    cells = belief_cells(ground.space)
    known = prospects(ground, cells, found, settings)
    stands = _stands(ground, cells, known.weight.sum(axis=0), sensor)
    looks = candidate_looks(ground.space, sensor, motion, cells=cells, stands=stands)
    return Hunt(wanted, ground, looks, found, known, settings)


def _ground(
    semantic_map: SemanticMap,
    places: Sequence[Place],
    spots: Sequence[NDArray[np.float64]],
    settings: Belief,
) -> Ground | None:
    """The floor as the map has seen it, on the storey where its robot is."""
    robot = semantic_map.robot()
    height = None if robot is None else float(robot.p_map[2])
    floor = mapped_floor(tiles_of_rows(semantic_map.ask("goals-floor").records()), height)
    return ground_of(places, spots, settings, floor, semantic_map.base)


def with_fresh_stands(ground: Ground, looks: Looks, weight: NDArray[np.float64]) -> Looks:
    """`looks` and such from positions that are not among theirs; `weight` (c,) of the cells."""
    fresh = _stands(ground, looks.cells, weight, looks.sensor, looks.stands)
    return looks.with_stands(ground.space, np.union1d(looks.stands, fresh))


def _stands(
    ground: Ground,
    cells: Cells,
    weight: NDArray[np.float64],
    sensor: Sensor,
    besides: ArrayLike = (),
) -> Cells:
    """Positions in every room, or in those that hold most of `weight` (c,) where rooms are many.

    Of those that one can stand in as many at least: a room full of tables is seen from others. Two
    covers; none of `besides` is in them.
    """
    space = ground.space
    if len(ground.rooms) > MOST_ROOMS:
        of_cell = space.room.reshape(-1)[cells]
        mass = np.bincount(of_cell, weight, minlength=len(ground.rooms))
        size = np.bincount(of_cell, minlength=len(ground.rooms))
        ranked = np.argsort(-mass / np.sqrt(np.maximum(size, 1)), kind="stable")
        stood_in = ranked[np.isin(ranked, space.room[space.free])]
        best = np.union1d(ranked[:MOST_ROOMS], stood_in[:MOST_ROOMS])
        inside = space.inside()
        space = space.without(inside[~np.isin(space.room.reshape(-1)[inside], best)])
    return standing_cells(space, sensor.far, near=sensor.near, besides=besides)

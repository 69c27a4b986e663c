"""Every (home, object) query, searched in every way; homes in parallel, every run the same."""

from __future__ import annotations

import hashlib
import math
import multiprocessing
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from benchmarks.search.corrupted_priors import CORRUPTED
from benchmarks.search.ground_truth import HiddenObject
from benchmarks.search.home_space import HomeSpace
from benchmarks.search.homes import Home, read_homes
from benchmarks.search.plan_calibration import PlanOutcome, planned
from benchmarks.search.priors import Prior, PriorKnowledge
from benchmarks.search.robot import TrialOutcome
from benchmarks.search.room_policies import brute_force, greedy_walk, oracle, thesis_rule
from benchmarks.search.view_policy import Ablation, ours
from kg.model.errors import InvalidFactError
from planner.search.viewpoints.candidate_views import Motion, Sensor
from planner.settings import BELIEF

METHODS: Final = ("ours", "thesis", "greedy", "brute_force", "clairvoyant")
#: The same without pictures on the way; ours is one of `PARTS`.
SILENT: Final = tuple(f"{who}, nothing on the way" for who in ("thesis", "greedy", "brute_force"))
#: Ours without some of its parts.
PARTS: Final[Mapping[str, Ablation]] = {
    "a picture a metre": Ablation(apart=1.0),
    "nothing on the way": Ablation(apart=math.inf),
    "whole turns only": Ablation(apart=math.inf, whole_turns=True),
}
#: Ways of searching for an object where the ontology does not list it.
UNLISTED: Final = tuple(f"{who}, unlisted place" for who in ("ours", "thesis", "clairvoyant"))

#: How long it takes to give up what is not there: searched once in each home, by ours.
NOWHERE: Final = "ours, not there at all"


@dataclass(frozen=True, slots=True)
class TrialSettings:
    """Settings of a trial."""

    sensor: Sensor = field(default_factory=Sensor)
    motion: Motion = field(default_factory=Motion)
    rooms: Path | None = None  # CSV of rooms; without it what ships
    apart: bool = False  # the CSV did not count these homes
    seed: int = 0
    queries: int | None = None  # at most so many, evenly over all
    give_up_at: float = BELIEF.stop_below  # chance that ours missed a thing, at which it gives up
    robustness: bool = False  # also with beliefs that mislead
    calibration: bool = False  # only plans, carried out as they are
    processes: int = 2


@dataclass(frozen=True, slots=True)
class Searched:
    """One query, and how each way of searching fared."""

    home: str
    kind: str
    outcomes: Mapping[str, TrialOutcome]
    planned: PlanOutcome | None = None  # with `TrialSettings.calibration`

    def shortest(self, name: str) -> TrialOutcome:
        """The search of one that knows where it is that `name` was hidden."""
        return self.outcomes[UNLISTED[2] if name in UNLISTED else "clairvoyant"]


_Task = tuple[int, Home, tuple[str, ...], TrialSettings]


def run(
    folder: Path, settings: TrialSettings, tick: Callable[[str, int, int], None] | None = None
) -> tuple[Searched, ...]:
    """All queries of the homes in `folder`, in the order of homes and objects.

    `tick(home, done, of)` hears of every home that is done. Raises InvalidFactError for homes or
    statistics that cannot be read, or where there is nothing to search for.
    """
    homes = read_homes(folder)
    kinds = _chosen(homes, settings)
    tasks = [(i, home, kinds[i], settings) for i, home in enumerate(homes) if kinds[i]]
    if not tasks:
        raise InvalidFactError(f"nothing to search for in {folder}: no room holds a known object")
    found: dict[int, tuple[Searched, ...]] = {}
    for number, searched in _all(tasks, settings.processes):
        found[number] = searched
        if tick:
            tick(homes[number].name, len(found), len(tasks))
    return tuple(one for number in sorted(found) for one in found[number])


def _chosen(homes: Sequence[Home], settings: TrialSettings) -> list[tuple[str, ...]]:
    """The objects to search for in each home."""
    known = PriorKnowledge(homes, settings.rooms)
    pairs = [
        (i, kind) for i, home in enumerate(homes) for kind in home.objects if known.knows(kind)
    ]
    if settings.queries is not None and settings.queries < len(pairs):
        at = np.linspace(0, len(pairs) - 1, settings.queries).round().astype(int)
        pairs = [pairs[i] for i in at]
    return [tuple(kind for j, kind in pairs if j == i) for i in range(len(homes))]


def _all(tasks: Sequence[_Task], processes: int) -> Iterator[tuple[int, tuple[Searched, ...]]]:
    if min(processes, len(tasks)) <= 1:
        yield from map(search_home, tasks)
        return
    # no fork: it copies the locks of threads that are not copied
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(min(processes, len(tasks)), mp_context=context) as pool:
        largest_first = sorted(tasks, key=lambda task: -len(task[1].rooms))
        for done in as_completed([pool.submit(search_home, task) for task in largest_first]):
            yield done.result()


def search_home(task: _Task) -> tuple[int, tuple[Searched, ...]]:
    """All queries of one home."""
    number, home, kinds, settings = task
    building = HomeSpace(home, settings.sensor, settings.motion)
    priors = PriorKnowledge([home], settings.rooms, apart=settings.apart).priors(home)
    found = list[Searched]()
    for kind in kinds:
        name, start, hidden = _query(building, kind, settings)
        if settings.calibration:
            outcome = planned(building, start, hidden, priors[kind].chances)
            found.append(Searched(home.name, kind, {}, outcome))
        else:
            first = kind == kinds[0]
            outcomes = _search(building, name, start, hidden, priors[kind], settings, first)
            found.append(Searched(home.name, kind, outcomes))
    return number, tuple(found)


def _query(
    building: HomeSpace, kind: str, settings: TrialSettings
) -> tuple[str, int, HiddenObject]:
    """Name of a query, the cell it starts at, and what is hidden."""
    name = f"{settings.seed} {building.home.name} {kind}"
    rng = seeded(name)
    cells = _hiding_places(building, kind, rng)
    start = int(rng.choice(building.space.floor()))
    return name, start, HiddenObject(building.space, settings.sensor, cells, name)


def _search(
    building: HomeSpace,
    name: str,
    start: int,
    hidden: HiddenObject,
    prior: Prior,
    settings: TrialSettings,
    first: bool,
) -> dict[str, TrialOutcome]:
    plain = Ablation(give_up_at=settings.give_up_at)
    found = {
        "ours": ours(building, start, hidden, prior.chances, plain),
        "thesis": thesis_rule(building, start, hidden, prior.listed),
        "greedy": greedy_walk(building, start, hidden, prior.chances.p),
        "brute_force": brute_force(building, start, hidden),
        SILENT[0]: thesis_rule(building, start, hidden, prior.listed, listens=False),
        SILENT[1]: greedy_walk(building, start, hidden, prior.chances.p, listens=False),
        SILENT[2]: brute_force(building, start, hidden, listens=False),
        "clairvoyant": oracle(building, start, hidden),
    }
    for part, manner in PARTS.items():
        found[part] = ours(
            building, start, hidden, prior.chances, replace(manner, give_up_at=plain.give_up_at)
        )
    if settings.robustness:
        found |= _robustness(building, start, hidden, prior, name, plain)
    if settings.robustness and first:
        nothing = HiddenObject(building.space, settings.sensor, [], name)
        found[NOWHERE] = ours(building, start, nothing, prior.chances, plain)
    return found


def _robustness(
    building: HomeSpace, start: int, hidden: HiddenObject, prior: Prior, name: str, plain: Ablation
) -> dict[str, TrialOutcome]:
    rng = seeded(f"{name} misled")
    found = {
        how: ours(
            building,
            start,
            hidden,
            replace(prior.chances, p=mislead(prior.chances.p, rng)),
            plain,
        )
        for how, mislead in CORRUPTED.items()
    }
    unlisted = [room for room in building.covers if not prior.listed[room]]
    if unlisted:
        cells = np.concatenate([building.space.floor(room) for room in unlisted])
        elsewhere = HiddenObject(building.space, building.sensor, [int(rng.choice(cells))], name)
        found[UNLISTED[0]] = ours(building, start, elsewhere, prior.chances, plain)
        found[UNLISTED[1]] = thesis_rule(building, start, elsewhere, prior.listed)
        found[UNLISTED[2]] = oracle(building, start, elsewhere)
    return found


def _hiding_places(building: HomeSpace, kind: str, rng: np.random.Generator) -> list[int]:
    """A floor cell for every instance, drawn evenly from its room's floor."""
    return [
        int(cell)
        for floor, count in hiding_floors(building, kind)
        for cell in rng.choice(floor, count)
    ]


def hiding_floors(building: HomeSpace, kind: str) -> list[tuple[NDArray[np.intp], int]]:
    """Floor cells (n,) of each room that holds a kind of object, and how many it holds."""
    floors = []
    for number, room in enumerate(building.home.rooms):
        floor, count = building.space.floor(number), room.holds.get(kind, 0)
        if not len(floor):  # covered by smaller rooms altogether: the nearest floor will do
            floor = np.array([building.space.nearest(building.middles[number])])
        if count:
            floors.append((floor, count))
    return floors


def seeded(name: str) -> np.random.Generator:
    """A generator of random numbers, always the same for a name."""
    digest = hashlib.sha256(name.encode()).digest()
    return np.random.default_rng(list(digest[:16]))

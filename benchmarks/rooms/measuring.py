"""All that is measured, in several processes."""

from __future__ import annotations

import multiprocessing
import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from functools import lru_cache, partial
from pathlib import Path
from typing import TypeVar

from benchmarks.rooms.houses import map_house
from benchmarks.rooms.looks import Networks, look, looks
from benchmarks.rooms.outcomes import MAPPERS, Outcome, mapped
from benchmarks.rooms.real_room import read_room
from benchmarks.rooms.stretches import Stretch, matcher, stretches
from mapping.evaluation.truth_matching import TruthMatcher

T = TypeVar("T")
#: Folders of rooms, networks, names of stretches, seeds of houses.
Measurement = tuple[Sequence[Path], Networks, tuple[str, ...], Sequence[int]]
Tasks = dict[str, Callable[[], T]]  # by what progress calls them


@lru_cache(maxsize=1)
def _parts(folder: Path, names: tuple[str, ...]) -> list[tuple[Stretch, TruthMatcher]]:
    room = read_room(folder)
    parts = stretches(room.frames, names)
    return [(part, matcher(part, room.frames, room.truth, room.T_map_world)) for part in parts]


def map_room(
    folder: Path, network: str, looking: Sequence[str], names: tuple[str, ...], cache: Path
) -> list[Outcome]:
    """The stretches `names` of the recording in `folder`, by each mapper."""
    room, seen, outcomes = read_room(folder), looks(folder, looking, cache), list[Outcome]()
    for part, truth in _parts(folder, names):
        frames = [room.frames[i] for i in part.indices]
        row = folder.name, network, part.name
        outcomes += [mapped(row, mapper, frames, seen, truth) for mapper in MAPPERS]
    return outcomes


def _house(seed: int) -> list[Outcome]:
    return list(map_house(seed))


def _run(tasks: Tasks[T], processes: int) -> list[T]:
    """Results in the order of the tasks; says on stderr which are done."""
    results = dict[str, T]()
    for name, result in _done(tasks, processes):
        results[name] = result
        sys.stderr.write(f"{len(results)} of {len(tasks)}: {name}\n")
    return [results[name] for name in tasks]


def _done(tasks: Tasks[T], processes: int) -> Iterator[tuple[str, T]]:
    if processes == 1:
        yield from ((name, task()) for name, task in tasks.items())
        return
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(processes, mp_context=context) as pool:
        futures = {pool.submit(task): name for name, task in tasks.items()}
        for future in as_completed(futures):
            yield futures[future], future.result()


def measured(what: Measurement, cache: Path, processes: int) -> list[Outcome]:
    """Outcomes of all rooms and houses; what networks saw goes into the folder `cache`."""
    folders, networks, names, seeds = what
    every = [one for looking in networks.values() for one in looking]
    _run({f"{f.name}, looks": partial(look, f, every, cache) for f in folders}, processes)
    rooms: Tasks[list[Outcome]] = {
        f"{folder.name}, {network}": partial(map_room, folder, network, looking, names, cache)
        for folder in folders
        for network, looking in networks.items()
    }
    houses = {f"house {seed}": partial(_house, seed) for seed in seeds}
    return [one for outcomes in _run(rooms | houses, processes) for one in outcomes]

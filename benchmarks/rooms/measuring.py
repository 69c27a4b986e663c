"""All that is measured: rooms in stretches, and houses, in several processes."""

from __future__ import annotations

import multiprocessing
import sys
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import lru_cache
from itertools import chain, starmap
from pathlib import Path
from typing import TypeVar

import numpy as np

from benchmarks.rooms.houses import map_house
from benchmarks.rooms.outcomes import MAPPERS, Outcome, outcome
from benchmarks.rooms.recordings import TRUTH, Networks, frames_of, look, looks
from benchmarks.rooms.stretches import SHOW_ALL, matcher_of, stretches
from lab.maps.complete_truth import load_complete_truth
from lab.maps.truth_matching import TruthMatcher
from perception.frames import Frame
from perception.sources.recording import open_recording

T = TypeVar("T")


def measured(
    folders: Sequence[Path], networks: Networks, names: Sequence[str], cache: Path, processes: int
) -> list[Outcome]:
    """The stretches `names` of rooms by each mapper; what networks see goes into `cache`."""
    every = [one for looking in networks.values() for one in looking]
    each(look, [(folder, every, cache) for folder in folders], processes)
    rooms = [
        (folder, network, looking, names, cache)
        for folder in folders
        for network, looking in networks.items()
    ]
    return [*chain.from_iterable(each(map_room, rooms, processes))]


def measured_houses(seeds: Sequence[int], processes: int) -> list[Outcome]:
    """The houses of `seeds` by each mapper."""
    return [*chain.from_iterable(each(map_house, [(seed,) for seed in seeds], processes))]


def map_room(
    folder: Path, network: str, looking: Sequence[str], names: Sequence[str], cache: Path
) -> list[Outcome]:
    """The stretches `names` of the recording in `folder`, by each mapper."""
    seen = looks(folder, looking, cache)
    return [
        outcome((folder.name, network, name), mapper, frames, seen, truth)
        for name, frames, truth in parts(folder)
        if name in names
        for mapper in MAPPERS
    ]


@lru_cache(maxsize=1)
def parts(folder: Path) -> list[tuple[str, list[Frame], TruthMatcher]]:
    """Name, frames and truth of all stretches of a recording that have frames."""
    frames, truth = frames_of(folder), load_complete_truth(folder / TRUTH)
    T_map_world = open_recording(folder).T_map_world
    found, whole = [], TruthMatcher(truth, T_map_world)
    for name, indices in stretches(np.stack([frame.T_map_cam for frame in frames])):
        if some := [frames[i] for i in indices]:
            part = whole if name in SHOW_ALL else matcher_of(some, truth, T_map_world)
            found.append((name, some, part))
    return found


def each(
    task: Callable[..., T], arguments: Sequence[tuple[object, ...]], processes: int
) -> list[T]:
    """Results of `task` for each of `arguments`, in their order; progress goes to stderr."""
    done = list[T]()
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(processes, mp_context=context) as pool:
        columns = zip(*arguments, strict=True)
        for result in pool.map(task, *columns) if processes > 1 else starmap(task, arguments):
            done.append(result)
            sys.stderr.write(f"{task.__name__}: {len(done)} of {len(arguments)}\n")
    return done

"""Expected times of searches, over all hiding places and all luck.

    python -m benchmarks.search.expected_time --homes homes

A search that has found nothing yet depends on nothing hidden. So one search in vain gives the
chance that nothing was found by each moment, and the integral of this chance is the expected time.
Differences between ways of searching then have no luck in them, but that of the start.
"""

from __future__ import annotations

import argparse
import contextlib
import math
import sys
from collections import defaultdict
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from benchmarks.search.ground_truth import HiddenObject
from benchmarks.search.home_space import HomeSpace
from benchmarks.search.homes import Home, read_homes
from benchmarks.search.priors import PriorKnowledge
from benchmarks.search.trial import hiding_floors, seeded
from benchmarks.search.view_policy import Ablation, ViewPolicy, initial_state
from hereabouts.cli.arguments import count
from hereabouts.cli.console import heading, print_table
from lab import command_line
from planner.freespace.grid import visible_cells
from planner.search.viewpoints.candidate_views import Motion, Sensor, angle_between, square

_ENOUGH: Final = 0.004  # chance that nothing was found, at which a search is left
_GIVE_UP_AT: Final = 0.0005
WAYS: Final = ("ours", "rooms apart", "nothing on the way")


class _OverError(Exception):
    """Nearly all hiding places were found."""


class HiddenAnywhere(HiddenObject):
    """Objects that may lie anywhere on the floor of their rooms; no look ever shows one."""

    def __init__(self, building: HomeSpace, kind: str) -> None:
        super().__init__(building.space, building.sensor, (), "")
        floors = hiding_floors(building, kind)
        self._counts = np.array([number for _, number in floors])
        self._sizes = np.array([len(cells) for cells, _ in floors])
        self._room = np.repeat(np.arange(len(floors)), self._sizes)  # of each hiding place
        self._place = np.full(building.space.room.size, -1)  # hiding place by cell of the grid
        self._place[np.concatenate([cells for cells, _ in floors])] = np.arange(len(self._room))
        self._building = building

    def seconds(self, policy: ViewPolicy) -> float:
        """[s] expected time until `policy` finds one, or gives up."""
        self._unseen = np.ones(len(self._room))
        self._times = defaultdict[int, NDArray[np.int64]](self._none)  # looks, by square
        self._missed, self._expected, self._until = 1.0, 0.0, 0.0
        self._robot = policy.robot
        with contextlib.suppress(_OverError):
            policy.search(self)
        self._pass()
        return self._expected

    def _none(self) -> NDArray[np.int64]:
        return np.zeros(len(self._room), np.int64)

    def _pass(self) -> None:
        self._expected += self._missed * (self._robot.seconds - self._until)
        self._until = self._robot.seconds

    def shown(self, cell: int, heading: float, extent: float) -> bool:
        """False; raises _OverError once nearly all hiding places would have been found."""
        self._pass()
        space, sensor = self._building.space, self._building.sensor
        cells, offset = visible_cells(space, cell, sensor.far)
        place = self._place[cells]
        bearing = np.arctan2(offset[:, 1], offset[:, 0])
        seen = (place >= 0) & (angle_between(bearing, heading) <= extent / 2 + 1e-9)
        place, metres = place[seen], np.hypot(offset[seen, 0], offset[seen, 1])
        looks = self._times[square(space, cell)]
        anew = np.where(looks[place] == 0, 1.0, 1 - sensor.rho)
        self._unseen[place] *= 1 - sensor.chance(metres) * anew
        looks[place] += metres >= sensor.near
        of_room = np.bincount(self._room, self._unseen) / self._sizes
        self._missed = float(np.prod(of_room**self._counts))
        if self._missed < _ENOUGH:
            raise _OverError
        return False


def expected_times(task: tuple[Home, Path | None, int]) -> list[tuple[float, ...]]:
    """[s] for each query of a home, in each of WAYS."""
    home, rooms, seed = task
    building = HomeSpace(home, Sensor(), Motion())
    found = []
    for kind, prior in PriorKnowledge([home], rooms).priors(home).items():
        hidden = HiddenAnywhere(building, kind)
        start = int(seeded(f"start {seed} {home.name} {kind}").choice(building.space.floor()))
        apart = replace(prior.chances, worth=np.full(len(prior.chances.p), np.inf))
        manners = (
            (prior.chances, Ablation(give_up_at=_GIVE_UP_AT)),
            (apart, Ablation(give_up_at=_GIVE_UP_AT)),
            (prior.chances, Ablation(apart=math.inf, give_up_at=_GIVE_UP_AT)),
        )
        times = []
        for chances, manner in manners:
            state = initial_state(building, building.views, chances, manner)
            times.append(hidden.seconds(ViewPolicy(building, start, state, manner)))
        found.append(tuple(times))
    return found


def main(argv: Sequence[str] | None = None) -> int:
    """Print the expected times; returns the exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.search.expected_time",
        description="Expected time of a search in each home, over all hiding places and all luck.",
    )
    parser.add_argument("--homes", required=True, metavar="DIR", help="homes, one JSON file each")
    parser.add_argument("--rooms", metavar="CSV", type=Path, help="rooms of real homes counted")
    parser.add_argument("--seed", type=count, default=0, metavar="N", help="of the starts")
    return command_line.run(parser, run, argv)


def run(arguments: argparse.Namespace) -> int:
    """Search in all homes, print means and differences to the first way."""
    homes = read_homes(Path(arguments.homes))
    tasks = [(home, arguments.rooms, arguments.seed) for home in homes]
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
        by_home = [np.array(times) for times in pool.map(expected_times, tasks) if times]
    times = np.concatenate(by_home)
    rows = []
    for way, name in enumerate(WAYS):
        differences = [(of_home[:, way] - of_home[:, 0]).sum() for of_home in by_home]
        error = np.std(differences, ddof=1) * np.sqrt(len(by_home)) / len(times)
        worst = np.sort(times[:, way])[-max(len(times) // 10, 1) :]
        more = times[:, way].mean() - times[:, 0].mean()
        slower = sum(difference > 0 for difference in differences)
        rows.append(
            (
                name,
                f"{times[:, way].mean():.1f}",
                f"{np.median(times[:, way]):.1f}",
                f"{worst.mean():.1f}",
                f"{more:+.1f} +- {error:.1f}" if way else "",
                f"{slower} of {len(by_home)}" if way else "",
            )
        )
    heading(f"{len(times)} queries")
    columns = ("", "mean s", "median s", "worst tenth", "more than ours", "homes slower than ours")
    print_table(columns, rows)
    return 0


if __name__ == "__main__":
    sys.exit(main())

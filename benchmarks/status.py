"""`hereabouts status` on simulated houses with truth: `python -m benchmarks.status`.

Only the first part of each tour is mapped, so that some rooms are never looked at; with a second
session, from another half of the rooms, small things have moved in between. Each house is asked
`queries/status.rq` for every category that houses hold, place by place, and the answers are
counted beside the truth of the simulation.

The truth of a (category, place) pair is that of `lab.recordings.viewed_truth`.

One limit parts two words, so a probability that is 0.03 from it at most is also counted apart.
"""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from hereabouts.cli.console import print_table
from hereabouts.demo.house_demo import layout_of
from kg.maps.semantic_map import SemanticMap
from kg.serving.opening import in_memory_map
from lab.command_line import parser_of
from lab.houses.house_changes import changed_house
from lab.houses.random_house import random_house
from lab.recordings.hard_senses import SENSES, detector_of
from lab.recordings.simulated_recording import DAY, KINECT
from lab.recordings.viewed_truth import HIDDEN, HouseTruth, TourPart, surfaces
from mapping.mapping_options import MappingOptions
from mapping.recording_mapper import map_recording
from planner.search.goals.status import NONE_SEEN, Value, status
from planner.simulation.camera import CameraModel, SimulatedCamera
from planner.simulation.house import OBJECTS, HouseRoom
from planner.simulation.house_robot import START, SimulatedTour

VALUES: Final[tuple[Value, ...]] = ("present", "gone", NONE_SEEN, "hidden", "never looked")
CLOSE: Final = 0.03  # share out of view, near HIDDEN


@dataclass(frozen=True, slots=True)
class Answer:
    """One pair, as it is and as `status` has it."""

    seed: int
    category: str
    place: str
    truth: Value
    answer: Value
    viewed: tuple[float, float]  # share of the place, true and as the map has it
    out_of_view: tuple[float, float]  # probability, true and as the answer has it


def answers(seed: int, part: float, sessions: int, senses: str) -> tuple[list[Answer], int]:
    """Answers for the house of `seed`, and how many pairs count neither way."""
    house, random, truth = random_house(seed), np.random.default_rng([seed, 29]), HouseTruth()
    points, layout, rooms = surfaces(house), layout_of(house), house.rooms
    with in_memory_map() as semantic_map:
        for number in range(sessions):
            if number:  # the rooms in reverse order, small things moved, vanished and come
                house = changed_house(house, random).house
            camera = SimulatedCamera(house, CameraModel(depth=KINECT), 1000 * seed + number)
            start = START + number * DAY
            tour = SimulatedTour(camera, name=f"session-{number + 1}", start=start)
            session = TourPart(camera, tour, part, np.concatenate([points, truth.spots()]))
            detector = detector_of(camera, SENSES[senses])
            map_recording(
                session,
                semantic_map,
                detector,
                options=MappingOptions(layout=layout, same_frame=True),
            )
            truth.add(session, len(points))
        return _compared(seed, semantic_map, truth, rooms)


def _compared(
    seed: int, semantic_map: SemanticMap, truth: HouseTruth, rooms: Sequence[HouseRoom]
) -> tuple[list[Answer], int]:
    found, doubtful = list[Answer](), 0
    labels = {f"place {number}": room for number, room in enumerate(rooms, start=1)}
    for category in sorted(OBJECTS):
        given = {one.place_label: one for one in reversed(status(semantic_map, category).places)}
        for name, room in labels.items():
            value = truth.value(category, room)
            if value is None:
                doubtful += 1
                continue
            one = given[name]
            shares = truth.share(room), one.viewed_share
            hidden = truth.out_of_view(category, room), one.out_of_view
            found.append(Answer(seed, category, name, value, one.value, shares, hidden))
    return found, doubtful


def report(found: Sequence[Answer], doubtful: int) -> None:
    """Print the confusion matrix, how many are right, and the mean over the values."""
    counts = Counter((one.truth, one.answer) for one in found)
    rows, recalls = list[tuple[object, ...]](), list[float]()
    for truth in VALUES:
        row = [counts[truth, answer] for answer in VALUES]
        right = counts[truth, truth] / sum(row) if sum(row) else float("nan")
        recalls += [right] if sum(row) else []
        rows.append((truth, *row, f"{right:.3f}"))
    print_table(("truth", *VALUES, "right"), rows)
    right = sum(one.truth == one.answer for one in found)
    print(  # noqa: T201
        f"{right} of {len(found)} right: {right / len(found):.3f}; mean over the values "
        f"{np.mean(recalls):.3f}; {doubtful} pairs count neither way"
    )
    open_words = (NONE_SEEN, "hidden")
    pairs = [one for one in found if one.truth in open_words and one.answer in open_words]
    near = [one for one in pairs if abs(one.out_of_view[0] - HIDDEN) < CLOSE]
    apart = right - sum(one.truth == one.answer for one in near)
    errors = [abs(true - told) for true, told in (one.out_of_view for one in pairs)]
    print(  # noqa: T201
        f"without {len(near)} pairs close to the limit {apart / (len(found) - len(near)):.3f}; "
        f"probability out of view wrong by {np.mean(errors):.3f} on average"
    )


def main(argv: Sequence[str] | None = None) -> int:
    """Map, ask, print."""
    parser = parser_of("benchmarks.status", __doc__)
    parser.add_argument("--seeds", type=int, nargs="+", default=list(range(300, 310)))
    parser.add_argument("--sessions", type=int, default=1, choices=(1, 2))
    parser.add_argument("--part", type=float, default=0.5, help="share of each tour that is mapped")
    parser.add_argument("--senses", choices=sorted(SENSES), default="demo")
    parser.add_argument("--wrong", action="store_true", help="also list what is wrong")
    arguments = parser.parse_args(argv)
    found, doubtful = list[Answer](), 0
    for seed in arguments.seeds:
        more, left_out = answers(seed, arguments.part, arguments.sessions, arguments.senses)
        found, doubtful = found + more, doubtful + left_out
    report(found, doubtful)
    for one in found if arguments.wrong else ():
        if one.truth != one.answer:
            viewed = "viewed {:.2f}, in the map {:.2f}".format(*one.viewed)
            viewed += ", out of view {:.2f}, answered {:.2f}".format(*one.out_of_view)
            print(  # noqa: T201
                f"house {one.seed}, {one.category} in {one.place} ({viewed}): "
                f"{one.answer}, truly {one.truth}"
            )
    return 0


if __name__ == "__main__":
    sys.exit(main())

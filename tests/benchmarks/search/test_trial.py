"""Searches on trial: the truth, the robot, the ways of searching, and the command."""

import json
import math
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from benchmarks.search.__main__ import main
from benchmarks.search.corrupted_priors import CORRUPTED
from benchmarks.search.ground_truth import HiddenObject
from benchmarks.search.home_space import HomeSpace
from benchmarks.search.homes import Home, HomeRoom, RoomFloor, read_homes
from benchmarks.search.plan_calibration import planned, reliability
from benchmarks.search.priors import PriorKnowledge
from benchmarks.search.robot import TrialOutcome
from benchmarks.search.room_beliefs import RoomChances
from benchmarks.search.room_policies import brute_force, greedy_walk, oracle, thesis_rule
from benchmarks.search.scores import HORIZON, score
from benchmarks.search.view_policy import Ablation, ours
from kg.model.errors import InvalidFactError
from planner.freespace.geodesic import distance_fields
from planner.freespace.grid import visible_cells
from planner.search.viewpoints.candidate_views import Motion, Sensor

HOME = Home(
    "three rooms",
    (
        HomeRoom("kitchen", RoomFloor(0, 4, 0, 4), {"sink": 1}),
        HomeRoom("bedroom", RoomFloor(4, 8, 0, 4), {"bed": 1}),
        HomeRoom("hallway", RoomFloor(0, 8, 4, 6), {}),
    ),
    ((0, 2), (1, 2)),
)


@cache
def building(recall: float = 1.0) -> HomeSpace:
    return HomeSpace(HOME, Sensor(far=3.0, recall=recall), Motion())


def hidden(room: int, recall: float = 1.0, name: str = "x") -> HiddenObject:
    place = building(recall)
    floor = place.space.floor(room)
    return HiddenObject(place.space, place.sensor, [int(floor[len(floor) // 3])], name)


def even(parts: int) -> RoomChances:
    return RoomChances.apart(np.ones(3) / parts)


def test_a_look_shows_what_is_in_range_and_in_view() -> None:
    space, thing = building().space, hidden(0)
    x, y = space.centres([thing.cells[0]])[0]
    cell = int(thing.views[0])
    here = space.centres([cell])[0]
    bearing = float(np.arctan2(y - here[1], x - here[0]))
    assert thing.shown(cell, bearing, 1.0)
    assert not thing.shown(cell, bearing + np.pi, 1.0)
    assert thing.shown(cell, bearing + np.pi, 2 * np.pi)
    assert not thing.shown(thing.cells[0], 0.0, 2 * np.pi)  # nearer than the camera sees
    assert not thing.shown(space.nearest((7, 1), 1), 0.0, 2 * np.pi)  # behind walls


def test_a_repeated_look_helps_as_little_as_the_sensor_says() -> None:
    first = again = 0
    for number in range(600):
        thing = hidden(0, 0.7, f"draw {number}")
        cell = int(thing.views[0])
        if thing.shown(cell, 0.0, 2 * np.pi):
            first += 1
        elif thing.shown(cell, 0.0, 2 * np.pi):
            again += 1
    assert first / 600 == pytest.approx(0.7, abs=0.06)
    assert again / (600 - first) == pytest.approx(0.2 * 0.7, abs=0.07)


def test_luck_does_not_depend_on_the_order_of_looks() -> None:
    cells = [int(c) for c in hidden(0, 0.5).views[::15]]

    def shown(order: list[int]) -> dict[int, bool]:
        thing = hidden(0, 0.5)
        seen: dict[int, bool] = {}
        squares = set()
        for cell in order:
            here = building(0.5).space.centres([cell])[0]
            if (square := tuple(np.floor((here + 0.2) / 1.0))) not in squares:
                seen[cell] = thing.shown(cell, 0.0, 2 * np.pi)
            squares.add(square)
        return seen

    forth, back = shown(cells), shown(cells[::-1])
    both = forth.keys() & back.keys()
    assert len(both) > 3
    assert all(forth[c] == back[c] for c in both)


def test_all_ways_find_it_and_none_before_the_one_that_knows() -> None:
    start = building().space.nearest((7, 5), 2)
    turns = Ablation(apart=math.inf, whole_turns=True)
    for room in range(3):
        thing = hidden(room)
        least = oracle(building(), start, thing)
        told = {
            "thesis": thesis_rule(building(), start, thing, [True, False, False]),
            "brute": brute_force(building(), start, thing),
            "greedy": greedy_walk(building(), start, thing, np.array([0.8, 0.3, 0.1])),
            "ours": ours(building(), start, thing, RoomChances.apart([0.8, 0.3, 0.1])),
            "turns": ours(building(), start, thing, RoomChances.apart(np.ones(3) / 2), turns),
        }
        for name, outcome in told.items():
            assert outcome.found, (name, room)
            assert outcome.seconds >= least.seconds - 1e-6, (name, room)
            assert outcome.metres >= least.metres - 1e-4, (name, room)


def test_a_rule_that_listens_is_faster_on_the_whole_and_never_finds_less() -> None:
    start = building().space.nearest((7, 5), 2)
    pairs = [
        [thesis_rule(building(), start, hidden(room), [False] * 3, listens=on) for on in (1, 0)]
        for room in range(3)
    ]
    assert all(listening.found for listening, _ in pairs)
    heard, blind = (sum(one.seconds for one in side) for side in zip(*pairs, strict=True))
    assert heard < blind


def test_a_greedy_walk_goes_where_the_chance_is_worth_the_way() -> None:
    start = building().space.nearest((4, 5), 2)
    likely, unlikely = (
        greedy_walk(building(), start, hidden(0), np.array(chances)).seconds
        for chances in ([0.9, 0.01, 0.01], [0.01, 0.9, 0.01])
    )
    assert likely < unlikely


def test_the_rule_goes_to_listed_rooms_first_and_belief_to_likely_ones() -> None:
    start = building().space.nearest((4, 5), 2)
    listed, other = [True, False, False], [False, True, False]
    assert (
        thesis_rule(building(), start, hidden(0), listed).seconds
        < thesis_rule(building(), start, hidden(0), other).seconds
    )
    assert (
        ours(building(), start, hidden(0), RoomChances.apart([0.9, 0.01, 0.01])).seconds
        < ours(building(), start, hidden(0), RoomChances.apart([0.01, 0.9, 0.01])).seconds
    )


def test_a_search_gives_up_where_there_is_nothing() -> None:
    nothing = HiddenObject(building().space, building().sensor, [], "nothing")
    start = building().space.nearest((4, 5), 2)
    for outcome in (
        brute_force(building(), start, nothing),
        ours(building(), start, nothing, even(3)),
        oracle(building(), start, nothing),
    ):
        assert not outcome.found
        assert np.isfinite(outcome.seconds)


def test_the_surer_one_wants_to_be_the_later_one_gives_up() -> None:
    nothing = HiddenObject(building().space, building().sensor, [], "nothing")
    start = building().space.nearest((4, 5), 2)
    outcomes = [
        ours(building(), start, nothing, even(3), Ablation(give_up_at=limit))
        for limit in (0.1, 1e-5)
    ]
    assert outcomes[0].seconds < outcomes[1].seconds


def test_scores_of_searches_are_what_they_say() -> None:
    best = [TrialOutcome(True, 10, 2, 1)] * 2
    told = score([TrialOutcome(True, 90, 4, 3), TrialOutcome(False, 2 * HORIZON, 40, 9)], best)
    assert (told.success, told.mean_seconds_found, told.queries) == (0.5, 90, 2)
    assert told.mean_seconds == pytest.approx((90 + 2 * HORIZON) / 2)
    assert told.spl == pytest.approx(0.25)
    assert told.auc == pytest.approx((1 - 90 / HORIZON) / 2)


def test_no_home_tells_where_its_own_things_are(tmp_path: Path) -> None:
    rooms = tmp_path / "rooms.csv"
    head = "room,n_rooms,object,rooms_with_object"
    rooms.write_text(f"{head}\nkitchen,1,bed,1\nbedroom,40,bed,38\nhallway,40,bed,1\n")
    told = Home(
        "h", (HomeRoom("kitchen", RoomFloor(0, 4, 0, 4), {"bed": 1}), *HOME.rooms[1:]), None
    )
    own = PriorKnowledge([told], rooms).priors(told)["bed"]
    apart = PriorKnowledge([told], rooms, apart=True).priors(told)["bed"]
    shipped = PriorKnowledge([told]).priors(told)["bed"]
    assert own.chances.p[0] < apart.chances.p[0]
    assert own.chances.p[1] > max(own.chances.p[0], own.chances.p[2], shipped.chances.p[2])
    assert own.listed[1]
    assert not own.listed[2]


def test_misleading_beliefs_keep_what_they_do_not_replace() -> None:
    chances = np.array([0.9, 0.3, 0.0])
    for how, mislead in CORRUPTED.items():
        told = mislead(chances, np.random.default_rng(1))
        assert told.sum() == pytest.approx(chances.sum()), how
        assert (told >= 0.7 * chances - 1e-12).all(), how


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{}", "is no home"),
        ('{"scene": "a", "rooms": []}', "has no rooms"),
        ('{"scene": "a", "rooms": [{"id": 1, "label": "x"}]}', "is no home"),
        (
            '{"scene": "a", "rooms": [{"id": 1, "label": "x", "centroid": [0, 0, 0], '
            '"dims": [1, 1, NaN], "coco": {}}]}',
            "is no home",
        ),
    ],
)
def test_what_is_no_home_is_refused_in_one_line(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "h.json").write_text(text)
    with pytest.raises(InvalidFactError, match=message) as caught:
        read_homes(tmp_path)
    assert "\n" not in str(caught.value)


def test_the_command_searches_real_homes_and_repeats_itself(shared, tmp_path, capsys):
    home = shared("data/homes/00245-741Fdj7NLF9.json")
    (tmp_path / home.name).symlink_to(home)
    rooms = shared("data/homes/hm3d_room_object_counts.csv")
    command = ["--homes", str(tmp_path), "--rooms", str(rooms)]
    command += ["--queries", "3", "--processes", "1", "--json"]
    assert main(command) == 0
    told = json.loads(capsys.readouterr().out)
    assert main(command) == 0
    assert json.loads(capsys.readouterr().out) == told
    for way in ("ours", "thesis", "brute_force", "clairvoyant"):
        assert told[way]["queries"] == 3
        assert 0 <= told[way]["spl"] <= 1
    assert told["clairvoyant"]["success"] == 1
    assert told["ours"]["success"] == 1
    assert told["clairvoyant"]["mean_seconds"] <= told["ours"]["mean_seconds"]


def test_plans_find_with_the_chance_they_predict_where_the_belief_is_the_truth() -> None:
    """One room holds it for certain, anywhere on its floor."""
    place, rng = building(0.7), np.random.default_rng(3)
    floor = place.space.floor(0)
    outcomes = []
    for number in range(24):
        cells, start = [int(rng.choice(floor))], int(rng.choice(place.space.floor()))
        thing = HiddenObject(place.space, place.sensor, cells, f"plan {number}")
        outcomes.append(planned(place, start, thing, RoomChances.apart([1.0, 0.0, 0.0])))
    told = reliability(outcomes)["one instance"]
    assert told.plans == 24
    assert list(told.predicted) == sorted(told.predicted)
    assert told.found[-1] == pytest.approx(told.predicted[-1], abs=0.15)
    assert told.found[2] == pytest.approx(told.predicted[2], abs=0.2)


def test_the_command_prints_what_plans_predict_and_what_came_true(shared, tmp_path, capsys):
    home = shared("data/homes/00245-741Fdj7NLF9.json")
    (tmp_path / home.name).symlink_to(home)
    command = ["--homes", str(tmp_path), "--queries", "2", "--processes", "1", "--calibration"]
    assert main([*command, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["all"]["plans"] == 2
    assert len(told["all"]["predicted"]) == len(told["parts"]) == len(told["all"]["found"])
    assert main(command) == 0
    assert "predicted" in capsys.readouterr().out


def test_beliefs_that_mislead_and_what_is_not_there_are_rows_of_their_own(shared, tmp_path, capsys):
    home = shared("data/homes/00245-741Fdj7NLF9.json")
    (tmp_path / home.name).symlink_to(home)
    command = ["--homes", str(tmp_path), "--queries", "1", "--robustness"]
    assert main([*command, "--give-up-at", "0.1", "--processes", "1", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["settings"]["give_up_at"] == 0.1
    nowhere = told["robustness"]["ours, not there at all"]
    assert (nowhere["success"], nowhere["queries"]) == (0, 1)
    assert nowhere["mean_seconds"] > told["ours"]["mean_seconds"]


def test_wrong_usage_and_missing_homes_are_told_in_one_line(tmp_path, capsys):
    assert main(["--homes", str(tmp_path)]) == 1
    assert "no homes in" in capsys.readouterr().err
    for wrong in (["--recall", "1.5"], ["--far", "0.5"], ["--far", "1e9"], ["--queries", "0"]):
        with pytest.raises(SystemExit) as left:
            main(["--homes", str(tmp_path), *wrong])
        assert left.value.code == 2


def test_storeys_are_joined_by_stairs_that_are_walked_but_not_seen_through() -> None:
    heights = (0.0, 0.9, 1.8)
    rooms = [
        HomeRoom("room", RoomFloor(5.0 * (n % 2), 5.0 * (n % 2) + 4, 0, 4, h), {})
        for n, h in enumerate(heights)
    ]  # the last one is above the first
    space = HomeSpace(Home("house", tuple(rooms), None), Sensor(), Motion()).space
    cells = [int(space.floor(n)[0]) for n in range(3)]
    assert min(len(space.floor(n)) for n in range(3)) > 0.8 * 16 / space.cell**2
    fields = distance_fields(space, cells).reshape(3, -1)[:, cells]
    assert np.isfinite(fields).all() and fields[0, 2] >= 2 * 0.9
    below = space.room.reshape(-1)[visible_cells(space, space.nearest((2, 2), 0), 12.0)[0]]
    assert 2 not in below

import numpy as np
import pytest

from benchmarks.status import VALUES, answers, main
from lab.recordings.viewed_truth import surfaces
from planner.simulation.house import furnished_house


def test_surfaces_are_floor_and_what_stands_on_it_up_to_the_eyes() -> None:
    house = furnished_house()
    points = surfaces(house)
    assert points[:, 2].min() >= 0 and points[:, 2].max() < 1.2
    table = house.objects[35]
    assert table.label == "dining table"
    on_it = np.linalg.norm(points[:, :2] - (table.x + 0.3, table.y - 0.3), axis=1) < 0.15
    assert points[on_it, 2] == pytest.approx(0.75, abs=0.01)


def test_rooms_nobody_went_to_are_never_looked_in() -> None:
    found, _ = answers(2, 0.2, 1, "demo")
    assert {one.truth for one in found} >= {"present", "never looked"}
    right = [one.answer == one.truth for one in found]
    assert np.mean(right) > 0.9
    shares = np.array([one.viewed for one in found])
    assert np.abs(shares[:, 0] - shares[:, 1]).mean() < 0.06
    assert {one.answer for one in found} <= set(VALUES)


def test_an_unknown_number_of_sessions_is_refused(capsys) -> None:
    with pytest.raises(SystemExit):
        main(["--sessions", "7"])
    assert "--sessions" in capsys.readouterr().err

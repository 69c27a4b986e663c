"""The fit of existence: regression, scores, labels of tracks, the mapper that keeps, the report."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from itertools import islice

import numpy as np
import pytest

from benchmarks import existence
from benchmarks.existence import (
    SHIPPED,
    TRIED,
    TrackEvidence,
    average_precision,
    fit,
    fitted,
    house_evidence,
    probability,
    report,
    scores,
    shipped,
    truths,
)
from benchmarks.rooms import houses
from benchmarks.rooms.houses import HOUSES
from lab.maps.complete_truth import TrueObject
from lab.maps.truth_matching import MappedObject, TruthMatcher
from mapping.objects.existence import MISSED, NOTHING, SEEN, SIZE, CategoryEvidence
from perception.frames import Frame
from planner.simulation.robot.house_robot import SimulatedTour

NUMBERS = np.array([1.5, -0.7, -0.4])


def synthetic(n: int, seed: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """Features (n, 2) and truth (n,) by `NUMBERS`."""
    rng = np.random.default_rng(seed)
    features = rng.normal(size=(n, 2))
    return features, (rng.random(n) < probability(features, NUMBERS)).astype(float)


def test_the_fit_recovers_known_numbers() -> None:
    features, true = synthetic(40_000)
    assert fit(features, true, np.ones(len(true))) == pytest.approx(NUMBERS, abs=0.06)


def test_the_fit_has_no_gradient_left() -> None:
    features, true = synthetic(300)
    weights = np.random.default_rng(2).uniform(0.5, 2, 300)
    found = fit(features, true, weights)
    left = weights * (true - probability(features, found))
    assert left.sum() == pytest.approx(0, abs=1e-6)
    assert features.T @ left == pytest.approx(1e-3 * found[:-1], abs=1e-6)


def test_a_weight_of_two_counts_a_case_twice() -> None:
    features, true = synthetic(60)
    twice = np.where(np.arange(60) < 20, 2.0, 1.0)
    repeated = np.r_[np.arange(60), np.arange(20)]
    assert fit(features, true, twice) == pytest.approx(
        fit(features[repeated], true[repeated], np.ones(80)), abs=1e-6
    )


def test_groups_are_weighted_equally() -> None:
    def tracks(group: str, shares: tuple[int, int]) -> list[TrackEvidence]:
        """Tracks without evidence, so many of them true and false."""
        return [TrackEvidence(group, "", k < shares[0], 0.0, 0.0, 0.0) for k in range(sum(shares))]

    few, many = tracks("a", (3, 1)), tracks("b", (100, 300))
    assert fitted([*few, *many], shipped)[-1] == pytest.approx(0, abs=1e-6)  # 3/4 and 1/4
    assert fitted(many, shipped)[-1] == pytest.approx(math.log(1 / 3), abs=1e-6)


def test_average_precision_by_hand() -> None:
    assert average_precision(
        np.array([0.9, 0.8, 0.7, 0.1]), np.array([True, False, True, False])
    ) == pytest.approx((1 + 2 / 3) / 2)
    tied = average_precision(np.array([0.5, 0.5]), np.array([True, False]))
    assert tied == 0.5  # whichever comes first


def test_scores_by_hand() -> None:
    true = TrackEvidence("a", "1", True, math.expm1(1), 0.0, 0.0)
    tracks = [true, replace(true, true=False, strength=0.0), replace(true, run="2")]
    loss, error, precision = scores(tracks, shipped, np.array([2.0, 0.0, 0.0, -1.0]))
    p = 1 / (1 + math.exp(-1))  # log-odds 1, -1 and 1
    assert loss == pytest.approx(-math.log(p))
    assert error == pytest.approx(1 - p)
    assert precision == 1  # run 2 has nothing that is false


def test_the_shipped_numbers_are_those_of_the_mapper() -> None:
    track = TrackEvidence("a", "", True, 7.0, 1.3, -0.4)
    odds = CategoryEvidence(strength=7.0, looks=2.0).log_odds(3.3, -0.4)
    found = probability(np.array([shipped(track)]), SHIPPED)
    assert found[0] == pytest.approx(1 / (1 + math.exp(-odds)))


def test_the_surest_track_of_a_thing_is_the_true_one() -> None:
    entries = [(0.0, False), (5.0, True)]
    truth = [TrueObject(str(x), "cup", np.array([x, 0, 0]), ignore=i) for x, i in entries]

    def found(*positions: float) -> list[bool | None]:
        objects = [MappedObject("cup", np.array([x, 0.0, 0.0])) for x in positions]
        return truths(objects, TruthMatcher(truth, np.eye(4)))

    assert found(0.3, 0.0, 9.0) == [True, False, False]
    assert found(5.1, 5.0) == [None, None]


def test_tracks_of_a_house_hold_candidates_that_enter_no_map(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    class Short(SimulatedTour):
        def frames(self, start: int = 0) -> Iterator[Frame]:
            return islice(super().frames(start), 40)

    monkeypatch.setattr(houses, "SimulatedTour", Short)
    tracks = house_evidence(2)
    assert {t.group for t in tracks} == {HOUSES}
    assert [*dict.fromkeys(t.run for t in tracks)] == [
        f"2, {senses}, {step}" for senses in ("demo", "hard") for step in (1, 4)
    ]
    p = probability(np.array([shipped(t) for t in tracks]), SHIPPED)
    assert p.min() < 0.2 and p.max() > 0.5
    assert all(t.frames >= 1 and t.strength > 0 for t in tracks)
    assert {t.true for t in tracks} == {True, False}


def drawn(group: str, seed: int) -> list[TrackEvidence]:
    """Tracks whose truth is drawn by the shipped numbers."""
    rng = np.random.default_rng(seed)
    found = list[TrackEvidence]()
    for k in range(3000):
        s, m = rng.gamma(1.0, 8.0), rng.gamma(1.0, 1.0)
        one = TrackEvidence(group, str(k % 3), False, s, m, -rng.gamma(1.0, 0.5), k % 7 + 1, 2)
        chance = probability(np.array([shipped(one)]), SHIPPED)[0]
        found.append(replace(one, true=bool(rng.random() < chance)))
    return found


def test_the_report_judges_each_group_by_the_others() -> None:
    lines = [*report([*drawn("a", 1), *drawn("b", 2)])]
    head, _, a, b, *rest = lines
    assert head.startswith("| group | tracks | true | log loss |")
    assert a.startswith("| a | 3000 | ") and b.startswith("| b | 3000 | ")
    of_b = ", ".join(f"{x:.2f}" for x in fitted(drawn("b", 2), shipped))
    assert a.endswith(f"| {of_b} |")
    assert [line.split(" | ")[0][2:] for line in rest[2:-1]] == list(TRIED)
    numbers = [float(part.split()[1]) for part in rest[-1].strip().split(", ")]
    assert numbers == pytest.approx([SEEN, MISSED, SIZE, NOTHING], abs=0.25)


def test_one_group_cannot_be_judged(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(existence, "room_folders", dict)
    monkeypatch.setattr(existence, "networks", dict)
    with pytest.raises(SystemExit, match="2"):
        existence.main([])
    assert "two rooms or houses would work" in capsys.readouterr().err

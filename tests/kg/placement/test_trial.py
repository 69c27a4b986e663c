"""The trial: what ships is what was fitted, and the blend does better than its parts."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from kg.errors import InvalidFactError
from kg.placement.settings import FITTED
from kg.placement.trial.data import Sources, TrialData, load
from kg.placement.trial.fitting import fit, log_likelihood
from kg.placement.trial.trial import run
from planner.commands import main

Shared = Callable[[str], Path]


def sources(shared: Shared) -> Sources:
    return Sources(
        shared("data/homes"),
        shared("data/homes/hm3d_room_object_counts.csv"),
        shared("data/s3dis/rooms_objects.csv"),
        shared("data/conceptnet/object_room_scores.json"),
    )


@pytest.fixture
def data(shared: Shared) -> TrialData:
    return load(sources(shared))


def test_the_shipped_numbers_are_near_the_likeliest(data: TrialData) -> None:
    shipped = log_likelihood(data.sample, FITTED)
    assert log_likelihood(data.sample, fit(data.sample, FITTED, steps=60)) < shipped + 0.5
    for name in ("base", "edge", "conceptnet", "usual", "kappa", "tau"):
        moved = replace(FITTED, **{name: getattr(FITTED, name) * 1.5})
        assert log_likelihood(data.sample, moved) < shipped, name


def test_a_home_is_judged_without_its_own_rooms(data: TrialData) -> None:
    assert data.counted
    rooms = data.sample.evidence.rooms
    assert not np.array_equal(rooms[0], rooms[1])
    everything = rooms[: data.homes] + data.sample.rooms[: data.homes]
    assert (everything == everything[0]).all()


def test_homes_that_the_statistics_cannot_have_counted_are_noticed(
    shared: Shared, tmp_path: Path
) -> None:
    home = {"scene": "h", "rooms": [{"label": "toilet", "coco": {"toilet": 1}}] * 30}
    (tmp_path / "h.json").write_text(json.dumps(home))
    found = load(replace(sources(shared), homes=tmp_path, s3dis=None))
    assert not found.counted


def test_the_blend_is_better_than_its_parts_and_calibrated(data: TrialData) -> None:
    result = run(data, parameters=FITTED, bootstrap=0)
    homes = {row.method: row.scores for row in result.rows if row.buildings == "homes"}
    blend = homes["blend"]
    for part in ("thesis edges", "conceptnet", "statistics"):
        assert blend["log_loss"] < homes[part]["log_loss"], part
        assert blend["brier"] < homes[part]["brier"], part
        assert blend["rooms_visited"] < homes[part]["rooms_visited"], part
    assert blend["ece"] < 0.05
    assert blend["rooms_visited"] < 1.9
    assert result.places["from_objects"] > 2 * result.places["most_common_kind"]


@pytest.mark.parametrize(
    "text", ["", "{}", "[1]", '{"scene": 1}', '{"scene": "a", "rooms": [{"label": "x"}]}']
)
def test_what_is_no_home_is_refused(tmp_path: Path, shared: Shared, text: str) -> None:
    (tmp_path / "h.json").write_text(text)
    with pytest.raises(InvalidFactError, match="is no home"):
        load(replace(sources(shared), homes=tmp_path))


def test_the_command_says_in_one_line_what_is_missing(
    tmp_path: Path, shared: Shared, capsys: pytest.CaptureFixture[str]
) -> None:
    counts = str(shared("data/homes/hm3d_room_object_counts.csv"))
    command = ["bench", "placement", "--homes", str(tmp_path), "--statistics", counts]
    assert main(command) == 1
    assert "no homes in" in capsys.readouterr().err


def test_the_command_gives_json(shared: Shared, capsys: pytest.CaptureFixture[str]) -> None:
    homes = str(shared("data/homes"))
    command = ["bench", "placement", "--homes", homes, "--shipped-parameters"]
    assert main([*command, "--bootstrap", "0", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert {row["buildings"] for row in told["rows"]} == {"homes"}
    assert told["searches"] > 100

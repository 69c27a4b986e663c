"""The trial: what ships is what was fitted, and the blend does better than its parts."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.placement.__main__ import main
from benchmarks.placement.data import Sources, TrialData, load
from benchmarks.placement.fitting import fit, fit_kind, log_likelihood
from benchmarks.placement.trial import run
from kg.errors import InvalidFactError
from kg.placement.settings import FITTED, HOMES, OFFICES

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
    for name in ("base", "edge", "conceptnet", "across_places", "kappa", "trust", "tau"):
        moved = replace(FITTED, **{name: getattr(FITTED, name) * (0.7 if name == "trust" else 1.5)})
        assert log_likelihood(data.sample, moved) < shipped, name


@pytest.mark.parametrize("kind", ["homes", "offices"])
def test_the_shipped_numbers_of_a_kind_are_what_its_buildings_give(
    data: TrialData, kind: str
) -> None:
    homes, count = range(data.homes), len(data.buildings)
    which, shipped = (homes, HOMES) if kind == "homes" else (range(data.homes, count), OFFICES)
    found = fit_kind(data.sample.only(which), FITTED)
    for name in ("lift", "kappa", "trust", "tau"):
        assert getattr(found, name) == pytest.approx(getattr(shipped, name), rel=0.05), name


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
    result = run(data, parameters=(HOMES, OFFICES), bootstrap=0)
    scores = {(row.buildings, row.method): row.scores for row in result.rows}
    for part in ("thesis edges", "conceptnet", "statistics"):
        for buildings in ("homes", "S3DIS"):
            ours, theirs = scores[buildings, "blend"], scores[buildings, part]
            assert ours["log_loss"] < theirs["log_loss"], (buildings, part)
            assert ours["brier"] < theirs["brier"], (buildings, part)
        visited = scores["homes", part]["rooms_visited"]
        assert scores["homes", "blend"]["rooms_visited"] < visited, part
    blend = scores["homes", "blend"]
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
    command = ["--homes", str(tmp_path), "--statistics", counts]
    assert main(command) == 1
    assert "no homes in" in capsys.readouterr().err


def test_the_command_gives_json(shared: Shared, capsys: pytest.CaptureFixture[str]) -> None:
    homes = str(shared("data/homes"))
    command = ["--homes", homes, "--shipped-parameters"]
    assert main([*command, "--bootstrap", "0", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert {row["buildings"] for row in told["rows"]} == {"homes"}
    assert told["searches"] > 100

"""The trial: what ships is what was fitted, and the blend does better than its parts."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from kg.knowledge.placement.belief_model import FITTED
from kg.model.errors import InvalidFactError
from lab.placement.__main__ import main
from lab.placement.data import Sources, TrialData, load
from lab.placement.fitting import fit_prior, log_likelihood
from lab.placement.trial import run

Shared = Callable[[str], Path]


def sources(shared: Shared) -> Sources:
    return Sources(
        shared("data/homes"),
        shared("data/homes/hm3d_room_object_counts.csv"),
        shared("data/s3dis/rooms_objects.csv"),
    )


@pytest.fixture
def data(shared: Shared) -> TrialData:
    return load(sources(shared))


def test_the_shipped_numbers_are_as_likely_as_those_fitted(data: TrialData) -> None:
    homes = data.sample.only(range(data.homes))
    fitted = fit_prior(homes, FITTED.kappa, FITTED.tau)
    assert log_likelihood(homes, FITTED) > log_likelihood(homes, fitted) - 5
    for moved in (
        replace(FITTED, knowledge=replace(FITTED.knowledge, base=-3.0)),
        replace(FITTED, knowledge=replace(FITTED.knowledge, conceptnet=1.5)),
        replace(FITTED, kappa=1.0),
        replace(FITTED, kappa=300.0),
        replace(FITTED, tau=1.0),
        replace(FITTED, tau=30.0),
    ):
        assert log_likelihood(homes, moved) < log_likelihood(homes, FITTED), moved


def test_a_home_is_judged_without_its_own_rooms(data: TrialData) -> None:
    assert data.counted
    rooms = data.sample.evidence.rooms
    assert not np.array_equal(rooms[0], rooms[1])
    everything = rooms[: data.homes] + data.sample.rooms[: data.homes]
    assert (everything == everything[0]).all()


def test_homes_that_the_statistics_cannot_have_counted_are_noticed(shared, tmp_path):
    home = {"scene": "h", "rooms": [{"label": "toilet", "coco": {"toilet": 1}}] * 30}
    (tmp_path / "h.json").write_text(json.dumps(home))
    found = load(replace(sources(shared), homes=tmp_path, s3dis=None))
    assert not found.counted


def test_the_model_is_better_than_its_parts_and_calibrated(data: TrialData) -> None:
    result = run(data, parameters=FITTED, bootstrap=0)
    scores = {(row.buildings, row.method): row.scores for row in result.rows}
    ours = scores["homes", "model"]
    for part in ("thesis edges", "conceptnet", "statistics", "as shipped"):
        theirs = scores["homes", part]
        for measure in ("log_loss", "brier", "rooms_visited"):
            assert ours[measure] < theirs[measure], (part, measure)
    assert ours["ece"] < 0.02
    assert ours["rooms_visited"] < 1.65
    assert scores["homes", "as shipped"]["log_loss"] < 0.165
    assert scores["homes", "as shipped"]["floor_ece"] < 0.08
    assert scores["S3DIS", "model"]["log_loss"] < scores["S3DIS", "conceptnet"]["log_loss"] / 2
    assert result.places["from_objects"] > 2 * result.places["most_common_kind"]


@pytest.mark.parametrize(
    "text", ["", "{}", "[1]", '{"scene": 1}', '{"scene": "a", "rooms": [{"label": "x"}]}']
)
def test_what_is_no_home_is_refused(tmp_path: Path, shared: Shared, text: str) -> None:
    (tmp_path / "h.json").write_text(text)
    with pytest.raises(InvalidFactError, match="is no home"):
        load(replace(sources(shared), homes=tmp_path))


def test_the_command_says_in_one_line_what_is_missing(tmp_path, shared, capsys):
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

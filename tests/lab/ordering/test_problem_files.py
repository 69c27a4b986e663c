"""`python -m lab.ordering` answers in the file's own format, and refuses what makes no sense."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest


def document() -> dict[str, Any]:
    places = [{"id": name, "explore_s": 10.0} for name in ("hall", "kitchen", "bath")]
    T = [[0, 10, 40], [10, 0, 30], [40, 30, 0]]
    query = {"world": "home", "object": "cup", "p": [0.1, 0.6, 0.3], "t0": [5, 15, 45]}
    return {
        "worlds": [{"id": "home", "speed": 0.25, "places": places, "T": T}],
        "queries": [{"id": model, "model": model} | query for model in ("single", "any")],
    }


def write(folder: Path, value: object) -> Path:
    path = folder / "problems.json"
    path.write_text(value if isinstance(value, str) else json.dumps(value))
    return path


def test_plans_are_written_and_summed_up(tmp_path: Path, prints: Callable[..., str]) -> None:
    plans = tmp_path / "plans.json"
    rows = json.loads(prints("lab.ordering", write(tmp_path, document()), "-o", plans, "--json"))
    written = json.loads(plans.read_text())
    assert set(written) == {"single", "any"}
    assert written["single"]["order"] == ["hall", "kitchen", "bath"]
    assert written["single"]["expected_seconds"] == pytest.approx(0.1 * 15 + 0.6 * 35 + 0.3 * 75)
    for plan in written.values():
        assert set(plan) == {"order", "expected_seconds", "lower_bound", "time_s"}
        assert plan["lower_bound"] == pytest.approx(plan["expected_seconds"])
        assert plan["lower_bound"] <= plan["expected_seconds"]
    (row,) = rows
    assert (row["places"], row["queries"], row["proven"]) == (3, 2, 2)


def test_a_hyphen_is_stdout(tmp_path, prints, monkeypatch):
    monkeypatch.chdir(tmp_path)
    problems = write(tmp_path, document())
    assert set(json.loads(prints("lab.ordering", problems, "-o", "-"))) == {"single", "any"}
    assert list(tmp_path.iterdir()) == [problems]


def test_more_places_than_can_be_proven_are_ordered_with_a_bound(tmp_path, prints):
    n, plans = 20, tmp_path / "plans.json"
    places = [{"id": k, "explore_s": 10.0} for k in range(n)]
    T = [[5.0 * abs(i - j) for j in range(n)] for i in range(n)]
    query = {"world": "row", "object": "cup", "p": [1 / n] * n, "t0": T[3], "model": "single"}
    rows = {"worlds": [{"id": "row", "places": places, "T": T}], "queries": [{"id": "q"} | query]}
    prints("lab.ordering", write(tmp_path, rows), "-o", plans, "--time-limit", "0.5")
    answer = json.loads(plans.read_text())["q"]
    assert sorted(answer["order"]) == list(range(n))
    assert 0 < answer["lower_bound"] <= answer["expected_seconds"]


def test_the_reference_problems_are_all_answered(tmp_path, shared, prints):
    source = shared("data/search/problems_reference.json")
    plans = tmp_path / "plans.json"
    assert prints("lab.ordering", source, "-o", plans) == ""
    written = json.loads(plans.read_text())
    queries = {query["id"]: query for query in json.loads(source.read_text())["queries"]}
    assert set(written) == set(queries)
    assert all(sorted(plan["order"]) == list(range(10)) for plan in written.values())


def broken(change: Callable[[dict[str, Any]], object]) -> dict[str, Any]:
    value = document()
    change(value)
    return value


@pytest.mark.parametrize(
    ("value", "says"),
    [
        ("", "not JSON"),
        ("[1", "not JSON"),
        ("[" * 100_000, "not JSON"),
        ("[]", "must be a JSON object"),
        ("{}", "'worlds'"),
        ({"worlds": [], "queries": []}, "something in it"),
        (broken(lambda d: d.pop("queries")), "'queries'"),
        (broken(lambda d: d["worlds"][0].pop("T")), "'T'"),
        (broken(lambda d: d["worlds"][0].pop("id")), "'id'"),
        (broken(lambda d: d["worlds"][0]["places"][1].pop("explore_s")), "'explore_s'"),
        (broken(lambda d: d["worlds"][0]["places"][1].update(id="hall")), "same id"),
        (broken(lambda d: d["worlds"][0]["places"][1].update(explore_s=-1)), "0 or more"),
        (broken(lambda d: d["worlds"][0]["places"].pop()), "shape"),
        (broken(lambda d: d["worlds"][0]["T"].pop()), "shape"),
        (broken(lambda d: d["worlds"][0]["T"][0].pop()), "equal length"),
        (broken(lambda d: d["worlds"][0].update(T=[[0, "x", 1]] * 3)), "numbers"),
        (broken(lambda d: d["worlds"][0].update(T=None)), "T"),
        (broken(lambda d: d["queries"][0].pop("p")), "'p'"),
        (broken(lambda d: d["queries"][0].update(p=[0.5, float("nan"), 0.5])), "finite"),
        (broken(lambda d: d["queries"][0].update(t0=[1, -2, 3])), "0 or more"),
        (broken(lambda d: d["queries"][0].update(t0=[1, 2])), "shape"),
        (broken(lambda d: d["queries"][0].update(t0=[1, 2, 1e308])), "at most 1e+12"),
        (broken(lambda d: d["queries"][0].update(p=[1e308] * 3)), "at most 1e+12"),
        (broken(lambda d: d["queries"][0].update(model="most")), "'single' or 'any'"),
        (broken(lambda d: d["queries"][0].update(model=["any"])), "'single' or 'any'"),
        (broken(lambda d: d["queries"][1].update(p=[0.5, 2, 0.5])), "at most 1"),
        (broken(lambda d: d["queries"][0].update(world="hoem")), "did you mean home"),
        (broken(lambda d: d["queries"][1].update(id="single")), "ids must differ"),
    ],
)
def test_files_that_make_no_sense_are_one_line_errors(tmp_path, fails, value, says):
    plans = tmp_path / "plans.json"
    assert says in fails("lab.ordering", write(tmp_path, value), "-o", plans)
    assert not plans.exists()


def test_files_that_cannot_be_read_or_written(tmp_path: Path, fails: Callable[..., str]) -> None:
    assert "cannot read" in fails("lab.ordering", tmp_path / "none", "-o", tmp_path / "plans")
    problems = write(tmp_path, document())
    assert "cannot write" in fails("lab.ordering", problems, "-o", tmp_path / "no" / "plans")


def test_a_query_without_any_probability_is_ordered_without_a_time(tmp_path, prints):
    value = broken(lambda d: d["queries"][0].update(p=[0, 0, 0]))
    plans = tmp_path / "plans.json"
    rows = json.loads(prints("lab.ordering", write(tmp_path, value), "-o", plans, "--json"))
    written = json.loads(plans.read_text())
    first = written.pop(value["queries"][0]["id"])
    assert sorted(first["order"]) == sorted(place["id"] for place in value["worlds"][0]["places"])
    assert first["expected_seconds"] is None
    assert first["lower_bound"] is None
    assert sum(row["queries"] for row in rows) == len(written)
    assert all(plan["expected_seconds"] > 0 for plan in written.values())

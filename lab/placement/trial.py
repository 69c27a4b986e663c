"""The trial: every building judged by what all other buildings teach."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from kg.knowledge.placement.belief_model import PlacementParameters, posterior, posterior_belief
from lab.placement.data import TrialData
from lab.placement.fitting import fit
from lab.placement.methods import (
    METHODS,
    one_building,
    outcome,
    probabilities,
    with_seen,
)
from lab.placement.scores import MEASURES, Predictions, interval, resampled

#: numbers of rooms seen before the rest of the building is judged
SEEN: Final = (1, 3, 5)
_DRAWS: Final = 20  # choices of which rooms were seen

Score = dict[str, float | tuple[float, float]]


@dataclass(frozen=True, slots=True)
class Row:
    """One method on one set of buildings."""

    buildings: str  # "homes", "S3DIS" or "all"
    method: str
    scores: dict[str, float]
    intervals: dict[str, tuple[float, float]]  # 95 %, over buildings


@dataclass(frozen=True, slots=True)
class Result:
    """Everything the trial found."""

    rows: tuple[Row, ...]
    gains: tuple[Row, ...]  # the model less another method on the same pairs: below 0 is better
    places: dict[str, float]  # accuracy of telling the kind of place from its objects
    parameters: PlacementParameters  # fitted to all buildings
    pairs: int
    searches: int

    def to_json(self) -> dict[str, Any]:
        """The same as plain values."""
        return {name: _plain(getattr(self, name)) for name in self.__dataclass_fields__}


def _plain(value: object) -> object:
    if isinstance(value, Row | PlacementParameters):
        return asdict(value)
    return [_plain(item) for item in value] if isinstance(value, tuple) else value


def run(
    data: TrialData,
    *,
    parameters: PlacementParameters | None = None,
    bootstrap: int = 1000,
    seed: int = 0,
    tick: Callable[[], None] = lambda: None,
) -> Result:
    """Cross-validate, building by building; deterministic for a seed.

    The model is fitted to the other homes each time unless `parameters` are given. `bootstrap`
    is how often buildings are resampled; `tick` is called after each building.
    """
    homes = range(data.homes)
    overall = parameters or fit(data.sample.only(homes))
    found: dict[str, list[Predictions]] = {}
    right: list[tuple[float, float, float]] = []
    for building in range(len(data.buildings)):
        others = [n for n in homes if n != building]
        numbers = parameters or fit(data.sample.only(others))
        for name, told in _judge(data, building, numbers, seed).items():
            found.setdefault(name, []).append(told)
        if building < data.homes:
            right.extend(_places(data, building, numbers))
        tick()
    rows, gains = [], []
    for label, which in _sets(data):
        if len(which):
            chosen = {name: [told[n] for n in which] for name, told in found.items()}
            draws = np.random.default_rng(seed).integers(0, len(which), (bootstrap, len(which)))
            rows += [_row(label, name, told, draws) for name, told in chosen.items()]
            gains += _gains(label, chosen, draws)
    hits = np.array(right).reshape(-1, 3)
    return Result(
        tuple(rows),
        tuple(gains),
        {
            "rooms": float(len(hits)),
            "from_objects": float(hits[:, 0].mean()),
            "most_common_kind": float(hits[:, 1].mean()),
            "probability_of_the_true_kind": float(hits[:, 2].mean()),
        },
        overall,
        sum(len(told.p) for told in found["model"]),
        sum(len(told.visited) for told in found["model"]),
    )


def _sets(data: TrialData) -> list[tuple[str, range]]:
    count = len(data.buildings)
    sets = [("homes", range(data.homes)), ("S3DIS", range(data.homes, count))]
    return [*sets, ("all", range(count))] if count > data.homes else sets[:1]


def _judge(
    data: TrialData, building: int, parameters: PlacementParameters, seed: int
) -> dict[str, Predictions]:
    train, evidence = data.sample.without(building), one_building(data.sample, building)
    found = {
        method: outcome(data, building, probabilities(method, train, evidence, parameters))
        for method in METHODS
    }
    random = np.random.default_rng([seed, building])
    count = len(data.buildings[building].rooms)
    before = probabilities("model", train, evidence, parameters)
    for k in SEEN:
        pair: dict[str, list[Predictions]] = {"before": [], "after": []}
        for _ in range(_DRAWS if k < count else 0):
            seen = frozenset(map(int, random.permutation(count)[:k]))
            after = posterior_belief(with_seen(data, building, evidence, seen), parameters).mean
            pair["before"].append(outcome(data, building, before, seen))
            pair["after"].append(outcome(data, building, after, seen))
        found[f"model, the rooms left before {k} seen"] = _together(pair["before"])
        found[f"model, the rooms left after {k} seen"] = _together(pair["after"])
    return found


def _together(outcomes: Sequence[Predictions]) -> Predictions:
    empty = [np.zeros(0)]
    return Predictions(
        *(
            np.concatenate([*empty, *(getattr(told, name) for told in outcomes)])
            for name in Predictions.__dataclass_fields__
        )
    )


def _row(label: str, method: str, told: Sequence[Predictions], draws: NDArray[np.int64]) -> Row:
    scores = {name: measure(told) for name, measure in MEASURES.items()}
    spread = resampled(told, draws) if len(draws) else {}
    return Row(label, method, scores, {name: interval(x) for name, x in spread.items()})


def _gains(label: str, told: dict[str, list[Predictions]], draws: NDArray[np.int64]) -> list[Row]:
    """The the model less each other method; and after less before, on the same rooms."""
    pairs = [("model", other) for other in METHODS if other != "model"]
    pairs += [
        (f"model, the rooms left after {k} seen", f"model, the rooms left before {k} seen")
        for k in SEEN
    ]
    rows = []
    for one, other in pairs:
        scores = {name: m(told[one]) - m(told[other]) for name, m in MEASURES.items()}
        intervals = {}
        if len(draws):
            first, second = resampled(told[one], draws), resampled(told[other], draws)
            intervals = {name: interval(first[name] - second[name]) for name in first}
        rows.append(Row(label, f"{one} less {other}", scores, intervals))
    return rows


def _places(
    data: TrialData, building: int, parameters: PlacementParameters
) -> list[tuple[float, float, float]]:
    """For each room of one kind: told right from its objects?, by base rate?, p of the truth."""
    evidence = one_building(data.sample, building)
    table = posterior_belief(evidence, parameters).mean
    prior = evidence.rooms.max(0) + data.sample.without(building).rooms.max(1).sum(0)
    found = []
    for room in data.buildings[building].rooms:
        if len(room.places) == 1:
            seen = np.array([iri in room.objects for iri in data.objects])
            p = posterior(table, seen, prior + 0.5)
            truth = data.places[room.places[0]]
            found.append(
                (float(p.argmax() == truth), float(prior.argmax() == truth), float(p[truth]))
            )
    return found

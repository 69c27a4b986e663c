"""Report of a plan: plain values for JSON, and text."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from itertools import takewhile
from typing import Final

import numpy as np
from numpy.typing import NDArray

from kg.maps.semantic_map import SemanticMap
from kg.model.shares import chance, percent
from planner.search.goals.candidate_queries import Candidate
from planner.search.goals.known_objects import known_json
from planner.search.goals.targets import Target
from planner.search.plans.answer_sentences import SURELY, find_sentences, known_of
from planner.search.plans.search_state import PlanningState, ViewReason
from planner.search.plans.view_plan import (
    ViewPlan,
    ViewStep,
    VisitedCandidate,
    planned_ways,
)

_Which = tuple[int, str, str]

_MAX_REASONS: Final = 5  # of a step; the others are summed up
_HALF: Final = 0.5
_BEARS: Final = 0.05  # share of a plan's probability from which on a reason is named
_LITTLE: Final = 0.1  # share of a plan's probability below which its last looks are left out, ...
_SLOWER: Final = 0.5  # ... where their gain a second is below this share of that before
_SAME_WEIGHT: Final = 0.5  # share of the weightiest reason from which on a second one is named


def plan_json(
    plan: ViewPlan, ways: Sequence[NDArray[np.float64]] | None = None
) -> dict[str, object]:
    """The plan as plain values; lengths to 1 mm, times to 1 ms, probabilities to 6 places.

    `goals` are the candidates in visiting order; `distance` and `seconds` are null for a candidate
    that no step shows. `ways` has one (n, 2) [m] for each step; steps then have the way to them,
    with points to 1 cm.
    """
    steps = [_step(step) for step in plan.steps]
    if ways is not None:
        steps = [{**step, "way": _corners(way)} for step, way in zip(steps, ways, strict=True)]
    return {
        "target": ", ".join(plan.targets),
        "targets": list(plan.targets),
        "rule": "viewpoints",
        **({"notes": [plan.note]} if plan.note else {}),
        "start": [round(float(value), 3) for value in plan.start],
        "goals": [_goal(goal) for goal in plan.goals],
        "expected_seconds": _rounded(plan.expected_seconds),
        "probability": round(plan.probability, 6),
        "finds": round(plan.finds, 6),
        "present": round(plan.present, 6),
        "steps": steps,
    }


def _rounded(value: float | None) -> float | None:
    return None if value is None or not math.isfinite(value) else round(value, 3)


def _goal(goal: VisitedCandidate) -> dict[str, object]:
    candidate = goal.candidate
    return {
        "iri": candidate.iri,
        "kind": candidate.kind,
        "x": round(float(candidate.p_map[0]), 3),
        "y": round(float(candidate.p_map[1]), 3),
        "probability": round(min(candidate.probability, 1.0), 6),
        "why": "; ".join(candidate.facts),
        "distance": _rounded(goal.metres),
        "seconds": _rounded(goal.seconds),
    }


def _corners(way: NDArray[np.float64]) -> list[list[float]]:
    """Every third point of a way, and its end: all points would say no more at 5 or 10 cm."""
    kept = np.append(np.arange(0, len(way) - 1, 3), len(way) - 1)
    return [[round(float(x), 2), round(float(y), 2)] for x, y in way[kept]]


def _step(step: ViewStep) -> dict[str, object]:
    return {
        "x": round(float(step.p_map[0]), 3),
        "y": round(float(step.p_map[1]), 3),
        "heading": round(step.heading, 4),
        "extent": round(step.extent, 4),
        "place": step.place or None,
        "probability": round(step.probability, 6),
        "seconds": round(step.seconds, 3),
        "distance": round(step.metres, 3),
        "cost": round(step.cost, 3),
        "left": round(step.left, 6),
        "why": [_reason(reason) for reason in step.why],
    }


def _reason(reason: ViewReason) -> dict[str, object]:
    return {
        "iri": reason.candidate.iri,
        "kind": reason.candidate.kind,
        "target": reason.target,
        "place": reason.candidate.place,
        "probability": round(reason.probability, 6),
        "facts": list(reason.candidate.facts),
    }


_WINDS = ("east", "north-east", "north", "north-west", "west", "south-west", "south", "south-east")


def direction(step: ViewStep) -> str:
    """Direction of a view: ``all around``, or a compass point where x is east and y north."""
    if step.extent >= 2 * math.pi - 1e-9:
        return "all around"
    return _WINDS[round(step.heading / (math.pi / 4)) % 8]


def purpose(candidate: Candidate) -> str:
    """Label of a candidate: the object, the object it is near, or the place."""
    if candidate.kind in ("nearby", "moved"):
        return (
            f"near {candidate.label}" if candidate.kind == "nearby" else f"{candidate.label}, moved"
        )
    return "beyond seen floor" if candidate.kind == "frontier" else candidate.label


def main_candidates(step: ViewStep) -> tuple[Candidate, ...]:
    """Main candidates of a view: the weightiest, and a second of about the same weight."""
    min_weight = _SAME_WEIGHT * step.why[0].probability if step.why else 0.0
    return tuple(reason.candidate for reason in step.why[:2] if reason.probability >= min_weight)


def step_purpose(step: ViewStep) -> str:
    """Labels of the main candidates of a view; "" where there are none."""
    return ", ".join(dict.fromkeys(map(purpose, main_candidates(step))))


def looks_table(
    steps: Sequence[ViewStep], wanted: int = 1
) -> tuple[tuple[str, ...], list[tuple[object, ...]]]:
    """Header and rows of a plan: viewpoint, direction, probability, time, probability left."""
    left = "not found yet" if wanted == 1 else "not all found yet"
    header = ("", "stand at", "in", "look", "for", "chance", "after", left)
    return header, [
        (
            number,
            f"{step.p_map[0]:.1f}, {step.p_map[1]:.1f}",
            step.place_name,
            direction(step),
            step_purpose(step),
            percent(step.probability),
            f"{step.seconds:.0f} s",
            percent(step.left),
        )
        for number, step in enumerate(steps, start=1)
    ]


def reason_lines(steps: Sequence[ViewStep]) -> list[str]:
    """The reasons that bear the probability of `steps`: share, chain of facts without sources.

    Known objects that are still in place are none: the answer has said where they were seen. Where
    they bear half of the probability, the others are not worth a line.
    """
    borne: dict[tuple[str, str], float] = {}
    named: dict[tuple[str, str], Candidate] = {}
    for reason in (reason for step in steps for reason in step.why):
        key = reason.candidate.iri, reason.candidate.kind
        named.setdefault(key, reason.candidate)
        borne[key] = borne.get(key, 0.0) + reason.probability
    total = sum(borne.values())
    if sum(p for (_, kind), p in borne.items() if kind == "known") >= _HALF * total:
        return []
    return [
        f"{percent(borne[key] / total):>5} of the chance: {_named(named[key])}"
        + fact_chain(named[key].facts[named[key].kind == "moved" :])
        for key in sorted(borne, key=lambda key: (-borne[key], key))[:_MAX_REASONS]
        if borne[key] >= _BEARS * total and named[key].kind != "known"
    ]


def _named(candidate: Candidate) -> str:
    """``near cup 2 at (1.0, 2.0): `` before the facts; "" where they begin with a place."""
    if candidate.kind == "place":
        return ""
    x, y = (float(value) for value in candidate.p_map)
    at = f" at ({x:.1f}, {y:.1f})" if candidate.kind == "nearby" else ""
    return f"{purpose(candidate)}{at}: "


def worthwhile(steps: Sequence[ViewStep]) -> int:
    """Number of the first looks of a plan, after which the others gain too little for their time.

    The others together add less than a tenth of the plan's probability, and find it at less than
    half the rate of the looks before.
    """
    gains, seconds = [step.finds for step in steps], [step.seconds for step in steps]
    for number in range(1, len(steps)):
        found, rest = sum(gains[:number]), sum(gains[number:])
        rate, later = found / seconds[number - 1], rest / (seconds[-1] - seconds[number - 1])
        if rest < _LITTLE * (found + rest) and later < _SLOWER * rate:
            return number
    return len(steps)


def fact_chain(facts: Sequence[str]) -> str:
    """Facts in brief, without sources and without the facts that only sum up others."""
    chain = takewhile(lambda fact: not fact.startswith(("together ", "viewed ")), facts)
    return "; ".join(map(without_sources, chain))


def without_sources(fact: str) -> str:
    """A fact without its sources.

    >>> without_sources("apple is found near banana (60 %, thesis 3.4.1; 42 of 70 rooms)")
    'apple is found near banana (60 %)'
    """
    fact = re.sub(r", by .*?\([^()]* %\)(?= for any of|$)", "", fact)
    return re.sub(r"\(([^(),]*),[^()]*\)", r"(\1)", fact)


def plan_lines(plan: ViewPlan, looks: int | None = None) -> list[str]:
    """Lines below the first `looks` (None: all): their probability and time, and the others'."""
    steps, rest = plan.steps[:looks], plan.steps[slice(looks, None) if looks else slice(0)]
    gain = sum(step.finds for step in steps)
    mean = sum(step.seconds * step.finds for step in steps) / gain if gain else 0.0
    several = len(plan.targets) > 1

    def told(finds: float) -> str:
        return f"{finds:.1f}" if several else percent(finds)

    one, of = len(steps) == 1, f" of {len(plan.targets)}" if several else ""
    text = (
        f"{'this look finds' if one else 'these looks find'} {'' if several else 'it with '}"
        f"{told(gain)}{of}, {'' if one else 'on average '}after {mean:.0f} s"
    )
    if not several and plan.present < SURELY:
        text = f"it is on this floor with a chance of {chance(plan.present)}; {text}"
    if rest:
        more = told(sum(step.finds for step in rest))
        seconds = rest[-1].seconds - steps[-1].seconds
        text += (
            f"; {len(rest)} more look{'s' * (len(rest) > 1)} would add {more} in {seconds:.0f} s"
        )
    return [text[:1].upper() + text[1:]]


def step_lines(steps: Sequence[ViewStep]) -> list[str]:
    """All steps: viewpoint, reasons, cost, probability left.

    The first view for a candidate prints its chain of facts, later views refer to that view.
    """
    first_views = dict[_Which, int]()  # number of the view, by target and candidate
    return [
        line
        for number, step in enumerate(steps, start=1)
        for line in _lines_of_step(number, step, first_views)
    ]


def _lines_of_step(number: int, step: ViewStep, first_views: dict[_Which, int]) -> Iterator[str]:
    x, y = (float(value) for value in step.p_map)
    degrees = math.degrees(step.extent)
    yield (
        f"{number}. From ({x:.1f}, {y:.1f}) in {step.place_name or 'no place'}, look "
        f"{direction(step)} ({degrees:.0f} degrees)."
    )
    for reason in step.why[:_MAX_REASONS]:
        candidate = reason.candidate
        which = candidate.target, candidate.iri, candidate.kind
        first, bears = first_views.setdefault(which, number), percent(reason.probability)
        if first < number:
            yield f"   {bears:>5}  {purpose(candidate)}: facts at step {first}"
            continue
        yield f"   {bears:>5}  {candidate.facts[0]}"
        yield from (f"          {fact}" for fact in candidate.facts[1:])
    if others := step.why[_MAX_REASONS:]:
        rest = sum(reason.probability for reason in others)
        yield f"   {percent(rest):>5}  further reasons ({len(others)})"
    yield (
        f"   Takes {step.cost:.0f} s; ends after {step.seconds:.0f} s and {step.metres:.1f} m in "
        f"all. Finds it here first with {percent(step.probability)}; {percent(step.left)} remain."
    )


def answer_json(
    semantic_map: SemanticMap, state: PlanningState, found: ViewPlan, now: float
) -> dict[str, object]:
    """A plan with its ways, and the known objects of its targets at `now`, as plain values."""
    ways = planned_ways(state, found, found.steps)
    return {
        **plan_json(found, ways),
        "worthwhile": worthwhile(found.steps),
        **_known_json(semantic_map, state.targets, now, state, found),
    }


def nothing_line(found: ViewPlan, budget: float | None = None) -> str:
    """Why a plan has no looks; `budget` [s] is that of the plan."""
    what = ", ".join(found.targets)
    if found.best > 0:
        return (
            f"Not worth looking: it is on this floor with a chance of {chance(found.present)}, and "
            f"the best look finds it with {percent(found.best)}"
        )
    if budget is not None:
        return f"No look for {what} ends within {budget:.0f} s"
    return f"No look for {what}: no reachable position shows a spot where it may be"


def _known_json(
    semantic_map: SemanticMap,
    targets: Sequence[Target],
    now: float,
    state: PlanningState | None = None,
    found: ViewPlan | None = None,
) -> dict[str, object]:
    said = [
        line for one in targets for line in find_sentences(semantic_map, one, now, state, found)
    ]
    said += [nothing_line(found)] if found is not None and not found.steps else []
    notes = [target.note for target in targets if target.note]
    known = [
        one
        for target in targets
        for one in known_json(target, known_of(semantic_map, target, state), now)
    ]
    return {"answer": said, "known": known, "understood": notes}


def empty_answer(
    semantic_map: SemanticMap, targets: Sequence[Target], now: float
) -> dict[str, object]:
    """Answer for a map without floor, on which no view can be planned."""
    labels = [target.label for target in targets]
    return {
        "target": ", ".join(labels),
        "targets": labels,
        "goals": [],
        "expected_seconds": None,
        "probability": 0.0,
        "finds": 0.0,
        "present": 0.0,
        "steps": [],
        "worthwhile": 0,
        **_known_json(semantic_map, targets, now),
    }

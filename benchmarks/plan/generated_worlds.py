"""Made-up buildings as search problems, in the format of `python -m benchmarks.plan`; seeded.

Rooms of 3 to 8 m hang on both sides of parallel corridors that a cross corridor joins; travel
follows the corridors, from door to door. Rooms of one category have like probabilities, as a
knowledge graph gives them.
"""

from __future__ import annotations

from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from benchmarks.ordering.problem import OrderingProblem
from planner.search.plans.thesis_rules import SearchModel

SPEED = 0.2412  # [m/s]; planner/search/plans/thesis_rules.py
EXPLORE = 41.79  # [s]
CATEGORIES = 12
#: how the reference problems spread their probability
Pattern = Literal["uniform", "dirichlet", "remainder"]
PATTERNS: tuple[Pattern, ...] = get_args(Pattern)


def building(rooms: int, seed: int) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Metres (n, n) between the rooms' centres along the corridors, and their categories (n,)."""
    rng = np.random.default_rng(seed)
    corridors = max(1, round(np.sqrt(rooms / 12)))
    corridor = np.sort(np.arange(rooms) % corridors)
    side = rng.integers(0, 2, rooms)
    along = np.zeros(rooms)
    for c in range(corridors):
        for s in (0, 1):
            mine = np.flatnonzero((corridor == c) & (side == s))
            width = rng.uniform(3.0, 8.0, len(mine))
            along[mine] = np.cumsum(width) - width / 2
    depth = rng.uniform(2.0, 4.0, rooms)
    across = np.abs(corridor[:, None] - corridor) * 14.0
    crossing = np.where(across > 0, along[:, None] + along, np.abs(along[:, None] - along))
    metres = crossing + across + depth[:, None] + depth
    np.fill_diagonal(metres, 0.0)
    return metres, rng.integers(0, CATEGORIES, rooms)


def problem(
    rooms: int, seed: int, model: SearchModel = "single", *, listed: bool = False
) -> OrderingProblem:
    """One search in such a building.

    Probabilities peaked by category, then jittered, and looks of unlike length; or, `listed`, one
    length and, like in the thesis, a few categories that are known to hold the thing and a small
    share (0 to 0.3) for all the other rooms together.
    """
    metres, category = building(rooms, seed)
    rng = np.random.default_rng([seed, rooms])
    if listed:
        p, explore = _listed(category, rng), np.full(rooms, EXPLORE)
    else:
        prior = rng.dirichlet(np.full(CATEGORIES, 0.4))[category] + 1e-3
        p = prior * rng.uniform(0.5, 1.5, rooms)
        explore = EXPLORE * rng.uniform(0.6, 1.6, rooms)
    p /= p.sum()
    if model == "any":
        p = np.minimum(p * rng.uniform(0.8, 4.0), 0.95)
    start = rng.integers(rooms)
    T: NDArray[np.floating[Any]] = (metres / SPEED).astype(
        np.float32 if rooms > 2000 else np.float64
    )

    seconds: NDArray[np.floating[Any]] = explore.astype(T.dtype)
    return OrderingProblem(p, T, T[start].copy(), seconds, model)


def reference_like(
    rooms: int, seed: int, model: SearchModel = "single", *, pattern: Pattern
) -> OrderingProblem:
    """One search in such a building as the reference problems ask it.

    A category names about ten rooms, one to five categories are listed, and looks take one time.
    All the probability lies on listed rooms, in like parts (`uniform`) or not (`dirichlet`); or
    0.65 to 0.85 of it, and the other rooms share the rest evenly (`remainder`).
    """
    metres, _ = building(rooms, seed)
    rng = np.random.default_rng([seed, rooms, PATTERNS.index(pattern)])
    categories = max(6, rooms // 10)
    category = rng.integers(0, categories, rooms)
    listed = np.isin(category, rng.choice(categories, rng.integers(1, 6), replace=False))
    p = np.zeros(rooms)
    parts = np.ones(listed.sum())
    p[listed] = parts / len(parts) if pattern == "uniform" else rng.dirichlet(parts)
    if pattern == "remainder" and not listed.all():
        p *= rng.uniform(0.65, 0.85)
        p[~listed] = (1.0 - p.sum()) / (~listed).sum()
    if model == "any":
        p = np.minimum(p * rng.uniform(0.8, 4.0), 0.95)
    T = metres / SPEED
    t0 = T[rng.integers(rooms)].copy()
    return OrderingProblem(p, T, t0, np.full(rooms, EXPLORE), model)


def _listed(category: NDArray[np.int64], rng: np.random.Generator) -> NDArray[np.float64]:
    some = np.isin(category, rng.choice(CATEGORIES, 3, replace=False))
    rest = rng.uniform(0.0, 0.3)
    return np.where(some, (1 - rest) * rng.dirichlet(np.ones(len(category))), rest / len(category))


def document(sizes: list[int], seeds: int) -> dict[str, Any]:
    """Worlds and queries in the format of `python -m benchmarks.plan`, `seeds` of each size."""
    worlds, queries = [], []
    for rooms in sizes:
        for seed in range(seeds):
            for model in ("single", "any"):
                made = problem(rooms, seed, "any" if model == "any" else "single")
                name = f"b{rooms}_{seed}_{model}"
                places = [{"id": k, "explore_s": float(e)} for k, e in enumerate(made.explore)]
                worlds.append({"id": name, "places": places, "T": made.T.tolist()})
                queries.append(
                    {
                        "id": name,
                        "world": name,
                        "object": "cup",
                        "model": model,
                        "t0": made.t0.tolist(),
                        "p": made.p.tolist(),
                    }
                )
    return {"worlds": worlds, "queries": queries}

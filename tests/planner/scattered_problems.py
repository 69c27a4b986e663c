"""Small made-up search problems for the tests of orders and their bounds."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from hypothesis import strategies as st

from planner.ordering import OrderingProblem
from planner.ordering.kernel import Kernel, reduce_problem

MODELS = ["single", "any"]


def scattered(n: int, seed: int, model: str, metric: bool = True) -> OrderingProblem:
    """`n` places strewn over a square; with `metric` false no triangle inequality."""
    rng = np.random.default_rng(seed)
    at = rng.uniform(0, 40, (n + 1, 2))
    T = np.hypot(*(at[:, None] - at).transpose(2, 0, 1)) / 0.25
    if not metric:
        T *= rng.uniform(0.2, 1.0, T.shape)
    p = rng.dirichlet(np.full(n, 0.5)) + 1e-4
    p = p / p.sum() if model == "single" else np.minimum(3 * p, 0.9)
    return OrderingProblem(p, T[1:, 1:], T[0, 1:], rng.uniform(5, 60, n), model)  # type: ignore[arg-type]


def with_no_leg(n: int, seed: int, model: str) -> OrderingProblem:
    """As `scattered`, with two places that no time lies between."""
    problem = scattered(n, seed, model)
    T, explore = problem.T.copy(), problem.explore.copy()
    T[0, 1] = T[1, 0] = 0.0
    explore[:2] = 0.0
    return OrderingProblem(problem.p, T, problem.t0, explore, problem.model)


@st.composite
def kernels(draw: st.DrawFn, odd: Sequence[float] = (0.0, 1.0)) -> Kernel:
    """Three to six places; legs that may break the triangle inequality, some chances `odd`."""
    n = draw(st.integers(3, 6))
    model = draw(st.sampled_from(MODELS))
    problem = scattered(n, draw(st.integers(0, 10_000)), model, draw(st.booleans()))
    p = problem.p.copy()
    p[0] = draw(st.sampled_from([p[0], *odd]))
    return reduce_problem(OrderingProblem(p, problem.T, problem.t0, problem.explore, problem.model))

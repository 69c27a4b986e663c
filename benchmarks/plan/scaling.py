"""Orders and bounds on made-up buildings, beside the ratio rule and a long search.

    python -m benchmarks.plan.scaling [SIZES [SEEDS [LONG]]]     (50,100,200,330,10000  2  10)

For each size, kind of probabilities (`peaked`, `listed`, and, like the reference problems,
`uniform`, `dirichlet`, `remainder`: benchmarks/plan/generated_worlds.py), model and building: the
expected time of the ratio rule, of a search of one second, and how far that is over the best of
two searches of LONG seconds beside it; the proven gap; the longest wall-clock time.
`--write FILE` writes the buildings as problems for `python -m benchmarks.plan` instead.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Literal

import numpy as np

from benchmarks.ordering import OrderingProblem
from benchmarks.ordering.local_search import ratio_rule
from benchmarks.ordering.reduction import reduce_problem
from benchmarks.ordering.solver import solve
from benchmarks.plan.generated_worlds import PATTERNS, Pattern, document, problem, reference_like

MODELS: tuple[Literal["single", "any"], ...] = ("single", "any")


Kind = Literal["peaked", "listed"] | Pattern
KINDS: tuple[Kind, ...] = ("peaked", "listed", *PATTERNS)
#: the reference problems are no larger
_MANY = 1000


def main() -> None:
    """Measure, or write the problems."""
    words = sys.argv[1:]
    if words[:1] == ["--write"]:
        Path(words[1]).write_text(json.dumps(document([30, 50, 100, 330], 2)))
        return
    sizes = [int(size) for size in (words[0] if words else "50,100,200,330,10000").split(",")]
    seeds = int(words[1]) if len(words) > 1 else 2
    long = float(words[2]) if len(words) > 2 else 10.0
    sys.stdout.write(
        "| places | kind | model | ratio rule | 1 s | over best known | gap | proven | most s |\n"
    )
    sys.stdout.write("|---|---|---|---|---|---|---|---|---|\n")
    for size in sizes:
        for kind in KINDS if size <= _MANY else KINDS[:2]:
            for model in MODELS:
                _row(size, kind, model, seeds, long)


def _row(size: int, kind: Kind, model: Literal["single", "any"], seeds: int, long: float) -> None:
    rows = []
    for seed in range(seeds):
        made = _made(size, seed, model, kind)
        reduced = reduce_problem(made)
        rule = reduced.cost(ratio_rule(reduced)) / reduced.norm
        found = solve(made)
        others = [solve(made, long, seed=s).expected_seconds for s in (1, 2)] if long > 0 else []
        best = min([*others, found.expected_seconds])
        over = found.expected_seconds / best - 1
        rows.append((rule, found.expected_seconds, over, found.gap, found.proven, found.seconds))
    rule, expected, over, gap, proven, seconds = np.mean(rows, axis=0)
    seconds = max(row[-1] for row in rows)
    sys.stdout.write(
        f"| {size} | {kind} | {model} | {rule:.0f} | {expected:.0f} | "
        f"{over:.2%} | {gap:.1%} | {proven:.0%} | {seconds:.2f} |\n"
    )
    sys.stdout.flush()


def _made(size: int, seed: int, model: Literal["single", "any"], kind: Kind) -> OrderingProblem:
    if kind == "peaked" or kind == "listed":
        return problem(size, seed, model, listed=kind == "listed")
    return reference_like(size, seed, model, pattern=kind)


if __name__ == "__main__":
    main()

"""In which order to look at places so that the expected time to find is least; docs/ordering.md.

Numpy, and numba where `warm_up` finds it: no graph, no map, no file. `problem` says what is asked,
`solve` answers it with an order, a proven lower bound and the gap between them; `misses` goes on
where looks can fail.
"""

from planner.ordering.compiled import warm_up
from planner.ordering.misses import MissPlan, Stop, plan_with_misses, update_after_miss
from planner.ordering.problem import OrderingProblem
from planner.ordering.solve import Ordering, solve

__all__ = [
    "MissPlan",
    "Ordering",
    "OrderingProblem",
    "Stop",
    "plan_with_misses",
    "solve",
    "update_after_miss",
    "warm_up",
]

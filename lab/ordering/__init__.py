"""Search ordering: the order of looking at places that minimises the expected time to find.

`problem` states it, `solver` answers with an order, a lower bound and the gap between the two.
"""

from lab.ordering.problem import OrderingProblem
from lab.ordering.solver import Ordering, solve

__all__ = ["Ordering", "OrderingProblem", "solve"]

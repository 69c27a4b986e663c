"""What kind of place a room is, told by the objects in it: the placement table read the other way.

Naive Bayes over place categories, made robust: a detector misses objects and sees some that are not
there, objects of a room are not independent, and no single object decides.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kg.placement.model import Matrix
from kg.placement.settings import DETECTED, INDEPENDENCE, MISTAKEN, MOST

Vector = NDArray[np.float64]


def posterior(present: Matrix, seen: NDArray[np.bool_], prior: Vector) -> Vector:
    """p(place | what was seen), (m,), adding up to 1.

    Args:
        present: (n, m) p(object in place), of the n objects that were seen or looked for in vain.
        seen: (n,) whether each was seen.
        prior: (m,) what is believed of the places beforehand, >= 0, not all 0.
    """
    detected = DETECTED * present + MISTAKEN * (1 - present)
    likelihood = np.log(np.where(seen[:, None], detected, 1 - detected))
    base = prior / prior.sum()
    # each object against what it says of the average place, damped and bounded
    relative = likelihood - likelihood @ base[:, None]
    score = INDEPENDENCE * np.clip(relative, -MOST, MOST).sum(0)
    weight = base * np.exp(score - score[base > 0].max(initial=-np.inf))
    return np.asarray(weight / weight.sum())

"""Place category of a room given the objects in it, by Bayes' rule on the placement table.

Naive Bayes over place categories, made robust: detectors have misses and false positives, objects
of a room are not independent, and the influence of a single object is bounded.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kg.knowledge.placement.belief_model import Matrix
from kg.knowledge.placement.settings import (
    DETECTION_RATE,
    FALSE_POSITIVE_RATE,
    LIKELIHOOD_DAMPING,
    MAX_LOG_RATIO,
)

Vector = NDArray[np.float64]


def posterior(
    present: Matrix, observed: NDArray[np.bool_], prior: Vector, weight: Vector | None = None
) -> Vector:
    """Posterior over place categories given the observed objects, (m,), adding up to 1.

    Args:
        present: (n, m) p(object in place), of the n objects that were found or missed.
        observed: (n,) whether each was found.
        prior: (m,) prior of the place categories, >= 0, not all 0.
        weight: (n,) weight of each object, 0..1; None: all 1.
    """
    detected = DETECTION_RATE * present + FALSE_POSITIVE_RATE * (1 - present)
    likelihood = np.log(np.where(observed[:, None], detected, 1 - detected))
    base = prior / prior.sum()
    # log-likelihood ratio of each object to the average place, damped and bounded
    relative = likelihood - likelihood @ base[:, None]
    counts = np.ones(len(observed)) if weight is None else weight
    score = LIKELIHOOD_DAMPING * (counts @ np.clip(relative, -MAX_LOG_RATIO, MAX_LOG_RATIO))
    product = base * np.exp(score - score[base > 0].max(initial=-np.inf))
    return np.asarray(product / product.sum())

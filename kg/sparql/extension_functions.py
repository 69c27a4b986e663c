"""Functions that queries may call and the engine lacks."""

from __future__ import annotations

import math
from typing import Final

from pyoxigraph import Literal, NamedNode

from kg import vocabulary as v
from kg.rdf.quad_store import Functions


def square_root(term: object) -> Literal | None:
    """XPath's math:sqrt; unbound for what has none."""
    try:
        return Literal(math.sqrt(float(getattr(term, "value", ""))))
    except ValueError:
        return None


FUNCTIONS: Final[Functions] = {NamedNode(v.MATH_SQRT): square_root}

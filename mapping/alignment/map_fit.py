"""Fit of a map into another: the transform that lays its floor and objects on the other's."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kg.maps.semantic_map import SemanticMap
from kg.model.errors import LayoutError
from mapping.alignment.floor_match import floor_of_map
from mapping.alignment.object_match import landmarks
from mapping.alignment.recording_fit import check_certain, summary_of
from mapping.alignment.search import AlignmentSearch

_OTHERWISE = "--pose X,Y,Z,DEG"


def aligned_maps(semantic_map: SemanticMap, other: SemanticMap) -> tuple[NDArray[np.float64], str]:
    """T_other_map (4, 4), and what was found in one line.

    Raises LayoutError where no transform fits, or several do.
    """
    title = semantic_map.description.title
    search = AlignmentSearch(
        floor_of_map(semantic_map.floor()),
        floor_of_map(other.floor()),
        landmarks(semantic_map.objects()),
        landmarks(other.objects()),
    )
    found = search.best()
    if found is None:
        raise LayoutError(
            f"{title!r} cannot be aligned: neither floor nor objects are in both maps; "
            f"{_OTHERWISE} would work"
        )
    check_certain(title, found, _OTHERWISE)
    return found.T, summary_of(title, found)

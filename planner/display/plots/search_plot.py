"""Plot of a search over its map: the path driven, the views taken, what was found."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from kg.maps.semantic_map import SemanticMap
from planner.display.plots.drawing import GroundTruth
from planner.display.plots.map_plot import SearchDrawing, plot_map
from planner.display.plots.plan_plot import numbered_stops


def plot_search(
    semantic_map: SemanticMap,
    search: str,
    path: Path | str,
    *,
    driven: ArrayLike,
    title: str,
    truth: GroundTruth | None = None,
) -> Path:
    """Draw the `search` (IRI) over the map to `path` and return it; PNG, SVG or PDF by its ending.

    `driven` is where the robot was, (n, 2) [m]; `truth` as `plot_map` has it. Raises PictureError
    as that does.
    """
    found = {
        iri
        for record in semantic_map.searches.all()
        if record.iri == search
        for iri in record.found
    }
    stops = numbered_stops(
        [np.array(look.position) for look in semantic_map.searches.looks(search)]
    )
    finds = [record.p_map for record in semantic_map.objects() if record.iri in found]
    line = np.asarray(driven, np.float64).reshape(-1, 2)
    return plot_map(
        semantic_map,
        path,
        search=SearchDrawing(line, stops, finds=tuple(finds)),
        title=title,
        truth=truth,
    )

"""Ground truth of a simulated house, for plots."""

from __future__ import annotations

import numpy as np

from planner.display.plots.drawing import GroundTruth
from planner.simulation.houses.house import House


def ground_truth(house: House) -> GroundTruth:
    """Walls, boxes around furniture and objects, and the objects' middles."""
    xmin, xmax, ymin, ymax = house.extent
    boxes = [item.bounds() for item in (*house.furnishings, *house.objects)]
    walls = []
    for wall in house.walls:
        for a, b in wall.pieces():
            if wall.along_x:
                walls.append(((a, wall.start[1]), (b, wall.start[1])))
            else:
                walls.append(((wall.start[0], a), (wall.start[0], b)))
    return GroundTruth(
        corners=np.array([(xmin, ymin), (xmax, ymax)]),
        boxes=np.array(boxes, np.float64).reshape(-1, 2, 3),
        walls=np.array(walls, np.float64).reshape(-1, 2, 2),
        objects=np.array([item.centre()[:2] for item in house.objects]).reshape(-1, 2),
    )

"""Depth sensor with the gaps and steps of a structured-light camera.

Steps follow the disparity's resolution (Khoshelham and Elberink, Sensors 2012), which makes them
grow with z^2.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from planner.simulation.sensing.camera import DepthSensor

EDGE: Final = 0.06  # relative step of depth between neighbouring pixels that makes an edge


@dataclass(frozen=True, slots=True)
class StructuredLightSensor(DepthSensor):
    """A depth camera that loses depth far off, along edges and on grazed surfaces."""

    fading: float = 0.0  # [m] before `far` over which the share of pixels with depth falls
    step: float = 0.0  # [m] resolution at a depth of 1 m; it grows with z^2
    grazing: float = 0.0  # least cosine between ray and normal that gives depth
    edge_loss: float = 0.0  # share of the pixels along edges of depth without depth

    def measure(
        self,
        depth: NDArray[np.float32],
        incidence: NDArray[np.float32],
        returns: NDArray[np.bool_],
        rng: np.random.Generator,
    ) -> NDArray[np.float32]:
        """Measured depth (H, W) [m], nan = no return."""
        measured = DepthSensor.measure(self, depth, incidence, returns, rng)
        if self.step:
            disparity = 1 / np.maximum(measured, 0.1) / self.step
            measured = (1 / np.maximum(np.round(disparity), 1) / self.step).astype(np.float32)
        lost = np.zeros(depth.shape, np.bool_)
        if self.grazing:
            lost |= ~returns | (incidence < self.grazing)
        if self.fading:
            draw = rng.random(depth.shape, dtype=np.float32)
            lost |= depth > self.far - self.fading * draw
        if self.edge_loss:
            draw = rng.random(depth.shape, dtype=np.float32)
            lost |= _edges(depth) & (draw < self.edge_loss)
        measured[lost] = np.nan
        return measured


#: A Kinect v1: 1/8 px of disparity, baseline 75 mm, focal length 580 px.
KINECT: Final = StructuredLightSensor(
    near=0.5, far=4.9, fading=0.6, step=0.00287, grazing=0.13, edge_loss=0.6
)


def _edges(depth: NDArray[np.float32]) -> NDArray[np.bool_]:
    """(H, W) pixels next to a step of depth."""
    edges = np.zeros(depth.shape, np.bool_)
    across = np.abs(np.diff(depth, axis=1)) > EDGE * depth[:, 1:]
    down = np.abs(np.diff(depth, axis=0)) > EDGE * depth[1:]
    edges[:, 1:] |= across
    edges[:, :-1] |= across
    edges[1:] |= down
    edges[:-1] |= down
    return edges

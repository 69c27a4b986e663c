"""Tracking report: how many images have a pose, and the errors to be expected."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Final

import numpy as np

from perception.camera.poses import Pose, inverse, motion
from perception.odometry.relative_motion import depth_agreement

if TYPE_CHECKING:
    from perception.odometry.features import Features
    from perception.odometry.key_graph import KeyFrame
    from perception.odometry.pose_graph import PoseConstraint

DRIFT_SHARE: Final = 0.015  # [m] of standard deviation a metre on the shortest way of links
TURN: Final = 0.5  # [m] that a radian of turning counts like
START: Final = 0.02  # [m] of standard deviation of a motion without way
COMPARED: Final = 200  # pairs of key frames whose depth is compared
MIN_FAR: Final = 0.2  # [m] between the two cameras of a pair
MAX_FAR: Final = 1.5
OVERLAP: Final = 0.3  # of their depth
CONTRADICTS: Final = 0.75  # share of depth that agrees, below which a pair is not one scene
MIN_COMPARED: Final = 8  # pairs from which a conclusion is drawn
MIN_TRACKED: Final = 0.85  # share of the images
MAX_CONTRADICTING: Final = 0.1  # share of the pairs, above which the poses are wrong


@dataclass(frozen=True, slots=True)
class TrackingReport:
    """Tracking report of a recording."""

    frames: int  # images looked at
    tracked: int  # images with a pose
    pieces: int  # parts of the recording that were not recognised in each other
    loops: int  # links between key frames that are far apart in time
    way: float  # [m] of the camera
    deviation: tuple[float | None, ...]  # [m] of each image's position, one sigma; None: lost
    compared: int  # pairs of views of one scene whose depth was compared
    contradicting: int  # of them, those whose depth shows two scenes
    plain: int = 0  # images that show too few corners with depth to begin a piece
    noise: float = 0.0  # of depth, as a share of it a metre; 0: small

    @property
    def error(self) -> float:
        """Error [m] to be expected of most positions (two sigma of nine in ten)."""
        known = [one for one in self.deviation if one is not None]
        return 2 * float(np.percentile(known, 90)) if known else 0.0

    @property
    def mostly_lost(self) -> bool:
        """Whether so many images have no pose that something may be wrong with all of them."""
        return self.tracked < MIN_TRACKED * self.frames

    @property
    def contradicts_itself(self) -> bool:
        """Whether the depth of many views contradicts the poses."""
        return contradicts(self.compared, self.contradicting)

    def summary(self) -> str:
        """One line."""
        lost = self.frames - self.tracked
        parts = [f"poses of {self.tracked} of {self.frames} frames over {self.way:.1f} m"]
        parts.append(f"{self.loops} loops closed" if self.loops else "no loop closed")
        parts.append(f"errors of up to {self.error:.2f} m expected")
        if lost:
            why = ["the camera was lost", f"{self.pieces} pieces"] * (self.pieces > 1)
            if self.plain:
                why.append(f"{self.plain} of them show too few corners where depth is measured")
            if self.noise:
                why.append(f"depth is noisy: off by {200 * self.noise:.0f} % at 2 m")
            told = f" ({'; '.join(why)})" if why else ""
            parts.append(f"{lost} frames without a pose are left out{told}")
        return ", ".join(parts)


def tracking_report(
    keys: Sequence[KeyFrame],
    edges: Sequence[PoseConstraint],
    loops: int,
    tracks: Sequence[int | None],
    main: int,
    plain: int,
) -> TrackingReport:
    """Report of the tracks: the key frame of each image, None: lost; `plain` as in the report."""
    used = [None if key is None or keys[key].piece != main else key for key in tracks]
    ways = _ways(edges, next((key for key in used if key is not None), 0))
    deviations = (None if k is None else START + DRIFT_SHARE * ways.get(k, np.inf) for k in used)
    used_keys = [key for key in keys if key.piece == main]
    compared, contradicting = contradictions(
        [
            (one.features, one.pose, other.features, other.pose)
            for number, other in enumerate(used_keys)
            for one in used_keys[:number]
        ]
    )
    return TrackingReport(
        frames=len(tracks),
        tracked=sum(key is not None for key in used),
        pieces=len({keys[key].piece for key in tracks if key is not None}),
        loops=loops,
        way=sum(motion(a.pose, b.pose)[0] for a, b in pairwise(used_keys)),
        deviation=tuple(deviations),
        compared=compared,
        contradicting=contradicting,
        plain=plain,
        noise=float(np.median([key.features.samples.noise for key in keys] or [0.0])),
    )


def _ways(edges: Sequence[PoseConstraint], start: int) -> dict[int, float]:
    """Shortest way [m] from a key frame to each by linked ones."""
    import networkx as nx  # as late as possible: what needs no poses starts faster

    graph: nx.Graph[int] = nx.Graph()
    graph.add_node(start)
    for edge in edges:
        far, turned = motion(np.eye(4), edge.T)
        known = graph.get_edge_data(edge.first, edge.second, {"way": np.inf})
        graph.add_edge(edge.first, edge.second, way=min(far + TURN * turned, known["way"]))
    ways: dict[int, float] = nx.single_source_dijkstra_path_length(graph, start, weight="way")
    return ways


def contradicts(compared: int, contradicting: int, most: float = MAX_CONTRADICTING) -> bool:
    """Whether so many contradicting pairs of views mean that their poses are wrong."""
    return compared >= MIN_COMPARED and contradicting > most * compared


def contradictions(pairs: Sequence[tuple[Features, Pose, Features, Pose]]) -> tuple[int, int]:
    """Pairs of views, some way apart, that should show one scene; and those that do not.

    Each pair is the features and the pose of one view, and those of the other.
    """
    near = [pair for pair in pairs if _may_show_one(pair[1], pair[3])]
    compared = contradicting = 0
    for a, T_a, b, T_b in near[:: -(-len(near) // COMPARED) or 1]:
        shown = depth_agreement(a, b, inverse(T_b) @ T_a)
        if shown.overlap >= OVERLAP:
            compared += 1
            contradicting += shown.share < CONTRADICTS
    return compared, contradicting


def _may_show_one(T_a: Pose, T_b: Pose) -> bool:
    far, turned = motion(T_a, T_b)
    return MIN_FAR < far < MAX_FAR and turned < np.pi / 4

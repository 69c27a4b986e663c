"""Settings of the occupancy map."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class OccupancySettings:
    """Settings of the inverse sensor model, the log-odds update and the tiles.

    Log-odds are in hundredths. The evidence of one frame and the clamping are those of OctoMap
    (Hornung et al., Autonomous Robots 34, 2013): 0.7 for what is hit, 0.4 for what is seen free.
    Raises ValueError where a value cannot work.
    """

    cell: float = 0.05  # [m] side of a cell
    side: int = 64  # cells along a side of a tile: 3.2 m
    near: float = 0.4  # [m] depth that is used ...
    far: float = 4.0  # [m] ... grows noisy with its square (Khoshelham and Oude Elberink, 2012)
    columns: int = 96  # pixels of a frame that are sampled, across; as many as cells at `far`
    edge: float = 0.05  # share of its depth by which a pixel may differ from its neighbours

    level: float = 0.04  # [m] off the floor's height is floor ...
    level_growth: float = 0.015  # [m per m of depth] ... and this much more with distance
    clearance: float = 0.03  # [m] beyond that is neither floor nor obstacle
    top: float = 1.8  # [m] above the floor is no obstacle
    eye: float = 1.1  # [m] higher obstacles cannot be looked over
    thing: float = 0.25  # [m] neighbouring pixels no further apart in depth show the same thing
    hits: int = 2  # points in a cell that make it an obstacle in one frame

    hit: int = 85  # log-odds of one frame's obstacle
    miss: int = 41  # log-odds of one frame's free floor
    least: int = -200  # clamped, so that the map can change
    most: int = 350
    occupied: int = 80  # from here on a cell is occupied ...
    free: int = -40  # ... and down from here free

    view: int = 4  # cells along a side of the larger cells that views are remembered for: 0.2 m
    close: float = 2.0  # [m] a view from no further shows small things too
    enough_views: int = 12  # larger cells of a tile viewed anew before it is written again ...
    refresh: float = 300.0  # [s] ... or views this much later than what is written

    enough: int = 40  # cells of a tile that must have changed before it is written again ...
    pause: float = 2.0  # [s] ... and the time between two writes, by the frames' stamps
    kept: int = 1024  # tiles in memory; older ones are read again from the graph

    storey: float = 1.8  # [m] floors further apart than this are two storeys
    lowest_camera: float = 0.15  # [m] above its floor
    highest_camera: float = 2.4  # [m]
    level_share: float = 0.3  # share of a frame's points that must lie level to be a new storey

    def __post_init__(self) -> None:
        if not (self.cell > 0 and self.side > 0 and 0 <= self.near < self.far):
            raise ValueError(f"cells, tiles and the depth range must not be empty, got {self}")
        if not self.least < self.free < 0 < self.occupied < self.most:
            raise ValueError(f"log-odds must be ordered about 0, got {self}")

    @property
    def span(self) -> float:
        """[m] side of a tile."""
        return self.cell * self.side

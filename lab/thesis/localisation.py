"""Tables 4.1 and 4.2: error of localising a person, a chair and a monitor, by histogram estimator.

The thesis' own pictures are not at hand. Its three objects are rendered at its printed positions,
seen by a camera 0.5 m above the floor (which makes the person 1.76 m tall), and detected by boxes
around their silhouettes that are too wide by a share `margin` of their sides. In scenario 1 there
is nothing behind them within the sensor's reach, in scenario 2 a wall at the depth at which the
thesis' predictions of person and chair ended up.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from statistics import fmean
from typing import Final

import numpy as np
from numpy.typing import NDArray

from lab.recordings.simulated_recording import KINECT, StructuredLightSensor
from lab.thesis.scenarios import DATA, rows_of
from mapping.frames.projection import to_map
from mapping.reference.depth_histogram import freedman_diaconis, localise
from mapping.reference.settings import ReferenceSettings
from perception.frames import Frame
from planner.simulation.camera import CameraModel
from planner.simulation.house import Item, Solid, SolidPart
from planner.simulation.ray_casting import FAR, hit, rays_of

Floats = NDArray[np.float64]


def scott(depths: Floats) -> float:
    """Histogram bin width [m] for `depths` (n,) by the rule of [57], as numpy's."""
    return math.cbrt(24 * math.sqrt(math.pi) / len(depths)) * float(np.std(depths))


def doane(depths: Floats) -> float:
    """Histogram bin width [m] for `depths` (n,) by the rule of [58], as numpy's; 0 = one bin."""
    n, sigma = len(depths), float(np.std(depths))
    if n < 3 or sigma == 0:
        return 0.0
    spread = math.sqrt(6 * (n - 2) / ((n + 1) * (n + 3)))
    skewness = abs(float(np.mean(((depths - np.mean(depths)) / sigma) ** 3)))
    bins = 1 + math.log2(n) + math.log2(1 + skewness / spread)
    return float(np.ptp(depths)) / bins


ESTIMATORS: Final = {"fd": freedman_diaconis, "scott": scott, "doane": doane}
NAMES: Final = {"fd": "Freedman-Diaconis", "scott": "Scott", "doane": "Doane"}
MARGINS: Final = (0.0, 0.1, 0.2, 0.3, 0.4)  # by which each side of a box is too wide, as a share
TIGHT: Final = 0.1  # margin of scenario 1; that of scenario 2 is the first with which both fail
WALL: Final = 5.65  # [m] before the camera
_HEIGHT: Final = 0.5  # [m] of the camera above the floor
_NOISES: Final = 10  # depth images of each scene
_CAMERA: Final = CameraModel(640, 480, 525.0, mount_height=_HEIGHT, pitch=0.0)
#: of a Kinect v1, without the end of its range: the thesis predicted points at 5.7 m
_SENSOR: Final = StructuredLightSensor(
    near=0.5, far=7.0, step=KINECT.step, edge_loss=KINECT.edge_loss
)
NAVY: Final = (0.20, 0.28, 0.45)
GREY: Final = (0.45, 0.46, 0.48)
_PERSON: Final = (
    SolidPart(-0.10, 0, 0.0, 0.15, 0.17, 0.85, NAVY, "cylinder"),
    SolidPart(0.10, 0, 0.0, 0.15, 0.17, 0.85, NAVY, "cylinder"),
    SolidPart(0, 0, 0.85, 0.44, 0.25, 0.62, GREY, "cylinder"),
    SolidPart(0, 0, 1.50, 0.18, 0.22, 0.26, GREY, "ellipsoid"),
)


@dataclass(frozen=True, slots=True)
class Printed:
    """One object of Table 4.1 or 4.2 as printed."""

    scenario: int
    name: str
    position: Floats  # (3,) [m] in the camera's link frame: x ahead, y to the left, z up
    errors: dict[str, float]  # [m] by estimator


@dataclass(frozen=True, slots=True)
class Located:
    """Mean errors [m] of one object over the depth images, by estimator."""

    printed: Printed
    margin: float
    wall: bool
    errors: dict[str, float]


def printed_objects() -> tuple[Printed, ...]:
    """The objects of both tables; raises LayoutError without the data."""
    found: dict[tuple[int, str], Printed] = {}
    for row in rows_of("tables_4_1_4_2.csv", DATA):
        key = int(row["scenario"]), row["object"]
        position = np.array([float(row[axis]) for axis in "xyz"])
        one = found.setdefault(key, Printed(*key, position, {}))
        one.errors[row["estimator"]] = float(row["error"])
    return tuple(found.values())


def localisation_errors(
    objects: Sequence[Printed], *, margin: float, wall: bool
) -> tuple[Located, ...]:
    """Mean errors of `objects` of one scenario, which stand before the camera together."""
    solids = [_solids(one) for one in objects]
    background = [_wall()] if wall else []
    depth, owner = _rendered([*solids, background])
    T_map_cam = _CAMERA.pose(0.0, 0.0, 0.0)
    errors: dict[tuple[str, str], list[float]] = {}
    for seed in range(_NOISES):
        rng = np.random.default_rng(seed)
        nothing = np.ones(depth.shape)
        measured = _SENSOR.measure(depth, nothing.astype(np.float32), nothing > 0, rng)
        rgb = np.zeros((*depth.shape, 3), np.uint8)
        frame = Frame(str(seed), rgb, measured, _CAMERA.K, T_map_cam, 0.0)
        for number, one in enumerate(objects):
            box = _box(owner == number, margin)
            for estimator, width in ESTIMATORS.items():
                p_cam = localise(frame, box, ReferenceSettings(), bin_width=width)
                assert p_cam is not None  # every box holds the object
                p_link = to_map(T_map_cam, p_cam) - np.array([0, 0, _HEIGHT])
                error = float(np.linalg.norm(p_link - one.position))
                errors.setdefault((one.name, estimator), []).append(error)
    return tuple(
        Located(one, margin, wall, {e: fmean(errors[one.name, e]) for e in ESTIMATORS})
        for one in objects
    )


def _solids(one: Printed) -> list[Solid]:
    """An object whose middle is at its printed position, its front towards the camera."""
    if one.name == "person":
        parts = [part.placed((0.0, 0.0, 0.0), "west") for part in _PERSON]
    elif one.name == "chair":
        parts = Item("chair", 0, 0, 0, "west", scale=(1.0, 1.0, 0.9)).solids()
    else:
        parts = Item("tv", 0, 0, 0, "west", scale=(0.5, 0.8, 0.55)).solids()
    low = np.min([part.lo for part in parts], axis=0)
    high = np.max([part.hi for part in parts], axis=0)
    middle = one.position + np.array([0, 0, _HEIGHT])
    offset = middle - (low + high) / 2
    return [replace(part, lo=part.lo + offset, hi=part.hi + offset) for part in parts]


def _wall() -> Solid:
    low, high = np.array([WALL, -6.0, 0.0]), np.array([WALL + 0.1, 6.0, 3.0])
    return Solid("box", low, high, GREY)


def _rendered(
    things: Sequence[Sequence[Solid]],
) -> tuple[NDArray[np.float32], NDArray[np.int64]]:
    """True depth (H, W) [m] and the number of the thing that each pixel shows, -1 for none."""
    u = (np.arange(_CAMERA.width) - _CAMERA.K[0, 2]) / _CAMERA.focal
    v = (np.arange(_CAMERA.height) - _CAMERA.K[1, 2]) / _CAMERA.focal
    grid = np.meshgrid(u, v)
    directions = np.stack([*grid, np.ones_like(grid[0])]).astype(np.float32)
    rays = rays_of(directions, _CAMERA.pose(0.0, 0.0, 0.0))
    everything = slice(0, _CAMERA.height), slice(0, _CAMERA.width)
    floor = Solid("box", np.array([-9.0, -9.0, -0.1]), np.array([9.0, 9.0, 0.0]), GREY)
    depth = hit(floor, rays, everything).t.copy()
    owner = np.full(depth.shape, -1)
    for number, solids in enumerate(things):
        for solid in solids:
            t = hit(solid, rays, everything).t
            nearer = t < depth
            depth[nearer], owner[nearer] = t[nearer], number
    return np.minimum(depth, FAR), owner


def _box(mask: NDArray[np.bool_], margin: float) -> Floats:
    """(4,) xyxy [px] around a silhouette, each side wider by a share `margin` of the box."""
    rows, columns = np.nonzero(mask)
    low = np.array([columns.min(), rows.min()], float)
    high = np.array([columns.max(), rows.max()], float)
    wider = margin * (high - low)
    return np.concatenate([low - wider, high + wider])


def report() -> Iterator[str]:
    """Lines of Markdown: both tables beside the published errors, and errors by the margin."""
    objects = printed_objects()
    first, second = ([one for one in objects if one.scenario == k] for k in (1, 2))
    swept = {m: localisation_errors(second, margin=m, wall=True) for m in MARGINS}
    fails = next(m for m, found in swept.items() if _on_the_wall(found) >= 2)
    scenes = (
        ("4.1", localisation_errors(first, margin=TIGHT, wall=False)),
        ("4.2", swept[fails]),
    )
    columns = " | ".join(NAMES[e] for e in ESTIMATORS)
    yield f"| table | object | box wider by | {columns} |"
    yield "|---|---|---|---|---|---|"
    for table, found in scenes:
        for one in found:
            pairs = (f"{one.errors[e]:.3f} / {one.printed.errors[e]:.3f}" for e in ESTIMATORS)
            yield f"| {table} | {one.printed.name} | {one.margin:.0%} | {' | '.join(pairs)} |"
    yield ""
    yield "| before the wall, box wider by | person | chair | monitor |"
    yield "|---|---|---|---|"
    for margin, found in swept.items():
        cells = (" / ".join(f"{one.errors[e]:.2f}" for e in ESTIMATORS) for one in found)
        yield f"| {margin:.0%} | {' | '.join(cells)} |"


def _on_the_wall(found: Sequence[Located]) -> int:
    """The number of objects that are localised at least half of the way to the wall behind them."""
    return sum(
        one.errors["fd"] > (WALL - float(one.printed.position[0])) / 2
        for one in found
        if one.printed.name != "monitor"
    )

"""Boxes of objects: grown from the surface, fitted to the views, kept while they are the same."""

import functools
import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from kg.maps.semantic_map import SemanticMap
from kg.model.areas import OrientedBox
from kg.serving.opening import in_memory_map
from lab.houses.random_house import random_house
from mapping.mapper import Mapper
from mapping.mapping_options import MappingOptions
from mapping.objects.extents.box_fit import BoxViews, fitted_box
from mapping.objects.extents.surface_growth import grown_box
from perception.frames import Detections, Frame
from planner.simulation.camera import SimulatedCamera
from planner.simulation.house import House
from planner.simulation.house_robot import SimulatedTour
from planner.simulation.sensors import SimulatedDetector

FOCAL, WIDTH, HEIGHT = 500.0, 640, 480
VOXEL = 0.025
TURN = 0.5  # [rad] of the house in the map
FRAMES = 120

Floats = np.ndarray


def pose(camera: Sequence[float], target: Sequence[float]) -> Floats:
    """T_map_cam (3, 4) of an upright camera that looks from one point to another."""
    ahead = np.subtract(target, camera) / np.linalg.norm(np.subtract(target, camera))
    right = np.cross(ahead, (0, 0, 1))
    right /= np.linalg.norm(right)
    return np.column_stack([right, np.cross(ahead, right), ahead, camera])


def view(T: Floats, points: Floats) -> Floats:
    """A row of a view whose box is the outline of `points` (n, 3) [m], cut by the image."""
    p = (points - T[:, 3]) @ T[:, :3]
    u, w = FOCAL * p[:, 0] / p[:, 2] + WIDTH / 2, FOCAL * p[:, 1] / p[:, 2] + HEIGHT / 2
    box = [u.min(), w.min(), u.max(), w.max()]
    box = np.clip(box, 0, [WIDTH, HEIGHT, WIDTH, HEIGHT])
    camera = (FOCAL, FOCAL, WIDTH / 2, HEIGHT / 2, WIDTH, HEIGHT)
    return np.array([*T.ravel(), *camera, *box, np.median(p[:, 2])], np.float32)


def around(box: OrientedBox, distance: float = 2.5, cameras: int = 8) -> list[Floats]:
    """Poses on a circle around a box."""
    angles = np.linspace(0, 2 * math.pi, cameras, endpoint=False)
    return [
        pose(np.add(box.centre, (distance * math.cos(a), distance * math.sin(a), 1)), box.centre)
        for a in angles
    ]


def shell(box: OrientedBox) -> Floats:
    """(n, 3) [m] points on the sides and the top of a box."""
    steps = [np.linspace(-0.5, 0.5, max(3, int(side / 0.0125))) for side in box.extent]
    x, y, z = (axis.ravel() for axis in np.meshgrid(*steps, indexing="ij"))
    on = (np.abs(x) == 0.5) | (np.abs(y) == 0.5) | (z == 0.5)
    own = np.stack([x, y, z], 1)[on] * box.extent
    c, s = math.cos(box.yaw), math.sin(box.yaw)
    return own @ np.array([(c, s, 0), (-s, c, 0), (0, 0, 1)]) + box.centre


class Surface:
    """Voxels of points [m]."""

    def __init__(self, *points: Floats) -> None:
        cells = np.unique(np.floor(np.concatenate(points) / VOXEL), axis=0)
        self.centres = (cells + 0.5) * VOXEL

    def __call__(self, low: Floats, high: Floats) -> tuple[Floats, float]:
        inside = ((self.centres >= low) & (self.centres <= high)).all(1)
        return self.centres[inside], VOXEL


STEPS = np.arange(-3, 3, 0.02)
FLOOR = np.stack(np.meshgrid(STEPS, STEPS, [0.0]), 3).reshape(-1, 3)


@pytest.mark.parametrize("yaw", [0.0, 0.35, -0.6])
@pytest.mark.parametrize("sides", [(0.5, 0.4, 0.9), (1.6, 0.7, 0.5), (0.2, 0.14, 0.25)])
def test_a_box_on_the_floor_is_found_with_its_orientation(sides, yaw) -> None:
    true = OrientedBox(np.array([0.3, -0.2, sides[2] / 2]), np.array(sides), yaw)
    points = shell(true)
    views = BoxViews.of([view(T, points) for T in around(true)])
    reach = max(sides)
    low, high = true.centre - reach, true.centre + reach
    grown = grown_box(Surface(points, FLOOR), low, high, views)
    assert grown is not None
    fitted = fitted_box(grown, views)
    assert fitted is not None
    assert fitted.overlap(true) > 0.7
    assert fitted.overlap(true) >= grown.overlap(true) - 0.15
    quarter = (fitted.yaw - yaw) / (math.pi / 2)
    assert abs(quarter - round(quarter)) < 0.1


def test_the_hidden_back_of_a_cupboard_is_told_by_its_outlines() -> None:
    true = OrientedBox(np.array([0.0, 0.0, 0.9]), np.array([0.7, 0.6, 1.8]), 0.0)
    points = shell(true)
    front = points[points[:, 1] < -0.29]  # all that the surface has
    cameras = [(x, -3.0, 1.5) for x in (-2.0, -1.2, 0.0, 1.2, 2.0)]
    views = BoxViews.of([view(pose(at, true.centre), points) for at in cameras])
    grown = grown_box(Surface(front), true.centre - 1.2, true.centre + 1.2, views)
    assert grown is not None and grown.extent[1] < 0.1
    fitted = fitted_box(grown, views)
    assert fitted is not None
    assert fitted.extent[1] > 0.3
    assert fitted.overlap(true) > 2 * grown.overlap(true)


@pytest.mark.parametrize("edge", [1, 3])  # the upper and the lower one
def test_an_edge_near_the_border_of_an_image_is_that_border(edge: int) -> None:
    """Edges of boxes, xyxy; a detector may end a box that is cut some pixels before the border."""
    true = OrientedBox(np.array([0.0, 0.0, 0.9]), np.array([0.7, 0.6, 1.8]), 0.0)
    grown = OrientedBox(true.centre, true.extent * 0.8, 0.1)
    border, inwards = (0.0, 0.0, WIDTH, HEIGHT)[edge], 1 if edge < 2 else -1

    def fitted(pixels: float) -> Floats:
        rows = [view(T, shell(true)) for T in around(true)]
        for row in rows:
            row[18 + edge] = border + inwards * pixels
        box = fitted_box(grown, BoxViews.of(rows))
        assert box is not None
        return np.array([*box.centre, *box.extent, box.yaw])

    for pixels in (1.0, 3.0):
        np.testing.assert_allclose(fitted(pixels), fitted(0.0), atol=4e-3)
    assert np.abs(fitted(12.0) - fitted(0.0)).max() > 4e-3  # that is an edge of the thing


def test_a_lit_screen_that_images_cut_reaches_their_border() -> None:
    screen = OrientedBox(np.array([0.0, 0.0, 1.5]), np.array([0.9, 0.06, 0.5]), 0.0)
    rim = OrientedBox(np.array([0.0, 0.0, 1.26]), np.array([0.9, 0.06, 0.02]), 0.0)
    poses = [pose((x, -1.2, 1.2), (x, 0.0, 0.9)) for x in (-0.2, 0.0, 0.2)]
    box = fitted_box(rim, BoxViews.of([view(T, shell(screen)) for T in poses]))
    assert box is not None
    bottom, top = (box.centre[2] + side * box.extent[2] / 2 for side in (-1, 1))
    assert bottom == pytest.approx(1.25, abs=0.02), "its rim alone has depth"
    assert top == pytest.approx(1.44, abs=0.04), "as high as the image shows at its distance"


def table_and_views(cut: float) -> tuple[Floats, BoxViews]:
    """A table top of 2 m by 1 m, and views that show `cut` [m] of it at one end."""
    top = shell(OrientedBox(np.array([0.0, 0.0, 0.7]), np.array([2.0, 1.0, 0.03]), 0.0))
    part = top[top[:, 0] < -1.0 + cut]
    cameras = [(-2.0, y, 1.5) for y in (-1.0, -0.5, 0.0, 0.5, 1.0)]
    rows = [view(pose(at, (-1.0 + cut / 2, 0.0, 0.7)), part) for at in cameras]
    return top, BoxViews.of(rows)


def test_the_top_of_a_table_is_followed_to_its_edges() -> None:
    top, views = table_and_views(cut=1.3)
    low, high = np.array([-1.2, -0.7, 0.4]), np.array([0.4, 0.7, 1.0])
    grown = grown_box(Surface(top, FLOOR), low, high, views)
    assert grown is not None
    np.testing.assert_allclose(sorted(grown.extent[:2]), [1.0, 2.0], atol=0.25)


def test_the_table_below_a_book_is_no_part_of_it() -> None:
    top, views = table_and_views(cut=0.3)
    low, high = np.array([-1.1, -0.7, 0.4]), np.array([-0.6, 0.7, 1.0])
    grown = grown_box(Surface(top, FLOOR), low, high, views)
    assert grown is not None and grown.extent[:2].max() < 1.2


@functools.cache
def drive() -> tuple[House, tuple[tuple[Frame, Detections], ...]]:
    """The first frames of a drive through a house that stands turned in the map."""
    camera = SimulatedCamera(random_house(11), seed=11)
    detector = SimulatedDetector(camera)
    c, s = math.cos(TURN), math.sin(TURN)
    T = np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
    frames = []
    for frame, _ in zip(SimulatedTour(camera).frames(), range(FRAMES), strict=False):
        frames.append((replace(frame, T_map_cam=T @ frame.T_map_cam), detector.detect(frame)))
    return camera.house, tuple(frames)


@functools.cache
def mapped(surface: float | None) -> SemanticMap:
    options = MappingOptions(surface=surface, occupancy=False, check_poses=False)
    semantic_map = in_memory_map(base="http://example.org/house/")
    with Mapper(semantic_map, options, recording="drive") as mapper:
        for frame, detections in drive()[1]:
            mapper.add(frame, detections)
    sequence = semantic_map.sequence
    mapper.flush()
    assert semantic_map.sequence == sequence, "the same views again write no other boxes"
    return semantic_map


def overlaps(semantic_map: SemanticMap) -> Floats:
    """Overlap of each true thing with the box of the nearest object of its category."""
    c, s = math.cos(TURN), math.sin(TURN)
    found = []
    for item in drive()[0].objects:
        low, high = item.bounds()
        middle = (low + high) / 2
        middle[:2] = np.array([(c, -s), (s, c)]) @ middle[:2]
        near = semantic_map.objects(item.label, near=middle[:2], radius=0.6, min_existence=0.5)
        true = OrientedBox(middle, high - low, TURN)
        boxes = [OrientedBox(o.p_map, o.extent, o.yaw) for o in near if o.extent is not None]
        found += [max(true.overlap(box) for box in boxes)] if boxes else []
    return np.array(found)


def test_boxes_in_a_turned_house_agree_with_the_truth() -> None:
    before, after = overlaps(mapped(None)), overlaps(mapped(VOXEL))
    assert len(after) >= 8
    assert np.median(after) > 0.5
    assert np.median(after) > np.median(before) + 0.1
    assert (after >= 0.25).mean() >= max((before >= 0.25).mean(), 0.85)


def test_without_a_surface_boxes_lie_along_the_axes_of_the_map() -> None:
    records = mapped(None).objects()
    assert records and {record.yaw for record in records} == {0.0}


def test_a_grown_box_is_in_the_graph_and_told_by_why() -> None:
    house = mapped(VOXEL)
    turned = next(record for record in house.objects() if abs(record.yaw) > 0.1)
    facts = "here:yaw ?yaw ; here:extentX ?x"
    (row,) = house.query(f"SELECT ?yaw ?x WHERE {{ <{turned.iri}> {facts} }}").rows
    assert turned.extent is not None and row == (turned.yaw, turned.extent[0])
    (yaw,) = house.history.explain(f"{turned.iri.removeprefix(house.base)} here:yaw")
    assert any("part of the surface" in step.text for _, step in yaw.walk())

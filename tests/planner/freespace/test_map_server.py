"""Free space from files of ROS' map_server and from arrays."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from kg.model.areas import Area
from kg.model.errors import LayoutError
from perception.binary_masks import connected_components
from planner.freespace.geodesic import distance_fields
from planner.freespace.grid import NO_ROOM, FreeSpace, Occupancy, space_of_occupancy, visible_cells
from planner.freespace.map_server import places_file, read_grid, space_of_grid
from tests.planner.freespace.distances import metres_between

YAML = "image: floor.pgm\nresolution: 0.5 # m\norigin: [-1.0, 2.0, 0.0]\nnegate: {negate}\n"
PLAIN = YAML.format(negate=0)
PIXELS = np.array([[0, 254, 205], [254, 254, 254]], np.uint8)  # wall, free, unknown; free
WALL = [[0, 1], [0, 0], [0, 0]]  # (nx, ny)
FREE = [[1, 0], [1, 1], [1, 0]]


def written(folder: Path, pgm: bytes, yaml: str = PLAIN) -> Path:
    (folder / "floor.pgm").write_bytes(pgm)
    (folder / "floor.yaml").write_text(yaml, encoding="utf-8")
    return folder / "floor.yaml"


def flat(values: NDArray[np.int_], resolution: float = 0.05) -> Occupancy:
    """A grid of (nx, ny) occupancies in per cent, -1 where unknown."""
    return Occupancy(values == 0, values == 100, np.zeros(2), resolution)


def house() -> NDArray[np.int_]:
    """Two rooms of 4 x 4 m in cells of 0.05 m: thin walls, a door of 0.9 m in the middle."""
    values = np.full((170, 90), -1)
    values[2:164, 2:84] = 100
    values[3:82, 3:83], values[83:163, 3:83] = 0, 0
    values[82, 34:52] = 0
    return values


def test_the_upper_row_of_an_image_lies_at_the_largest_y(tmp_path: Path) -> None:
    pgm = b"P5\n# made by hand\n3 2\n255\n" + PIXELS.tobytes()
    path = written(tmp_path, pgm)
    grid = read_grid(path)
    np.testing.assert_array_equal(grid.occupied, WALL)
    np.testing.assert_array_equal(grid.free, FREE)
    space = space_of_grid(path, [])
    np.testing.assert_allclose(space.centres(space.floor()).min(axis=0), (-0.75, 2.25))


def test_plain_sixteen_bit_and_negated_images_and_lists_below_keys_say_the_same(tmp_path):
    plain = b"P2 3 2 255\n" + " ".join(str(v) for v in PIXELS.reshape(-1)).encode()
    wide = b"P5 3 2 65535\n" + (PIXELS.astype(">u2") * 257).tobytes()
    turned = b"P5 3 2 255\n" + (255 - PIXELS).tobytes()
    listed = 'image: "floor.pgm"\nresolution: 0.5\norigin:\n- -1.0\n- 2\n- 0.0\nmode: trinary\n'
    cases = [(plain, PLAIN), (wide, PLAIN), (turned, YAML.format(negate=1)), (plain, listed)]
    for pgm, yaml in cases:
        grid = read_grid(written(tmp_path, pgm, yaml))
        np.testing.assert_array_equal(grid.occupied, WALL)
        np.testing.assert_array_equal(grid.free, FREE)
        np.testing.assert_array_equal(grid.origin, (-1, 2))


@pytest.mark.parametrize(
    ("name", "written_as"),
    [
        ("floor # 2.pgm", "'floor # 2.pgm'   # the second"),
        ("floor #2.pgm", '"floor #2.pgm" # the "second"'),
        ("ann's floor.pgm", "'ann''s floor.pgm'"),
        ('a "floor".pgm', '"a \\"floor\\".pgm"'),
        ("a: floor.pgm", "'a: floor.pgm' # 'quoted'"),
        ("floor.pgm", "floor.pgm # it's plain"),
    ],
)
def test_a_name_is_what_stands_between_its_quotes(name, written_as, tmp_path):
    (tmp_path / name).write_bytes(b"P5 3 2 255\n" + PIXELS.tobytes())
    yaml = PLAIN.replace("floor.pgm", written_as) + "mode: 'trinary' # 'raw'\n# image: none.pgm\n"
    (tmp_path / "floor.yaml").write_text(yaml, encoding="utf-8")
    np.testing.assert_array_equal(read_grid(tmp_path / "floor.yaml").occupied, WALL)


def test_an_array_may_stand_for_the_image_with_its_first_row_at_the_smallest_y(tmp_path):
    np.save(tmp_path / "floor.npy", np.array([[0, 0, 0], [100, 0, -1]], np.int8))
    path = written(tmp_path, b"", PLAIN.replace("pgm", "npy"))
    np.testing.assert_array_equal(read_grid(path).occupied, WALL)
    np.testing.assert_array_equal(read_grid(path).free, FREE)


def _x(space: FreeSpace, ix: int) -> float:
    return float(space.centres(ix * space.shape[1])[0])


def test_thin_walls_hold_in_coarser_cells_and_doors_stay_open() -> None:
    places = [Area(0.1, 4.1, 0.1, 4.2), Area(4.1, 8.2, 0.1, 4.2)]
    space = space_of_occupancy(flat(house()), places)
    assert space.cell == pytest.approx(0.2)
    sizes = [len(space.floor(k)) * space.cell**2 for k in range(2)]
    assert all(3.7**2 <= size <= 4.0**2 for size in sizes)  # less than a cell is lost a wall
    wall = [int(ix) for ix in range(space.shape[0]) if abs(_x(space, ix) - 4.1) < space.cell]
    narrowest = min(wall, key=lambda ix: int(space.free[ix].sum()))
    gap = np.flatnonzero(space.free[narrowest])
    assert 0.5 < len(gap) * space.cell <= 0.9
    middle = space.centres(narrowest * space.shape[1] + gap).mean(axis=0)
    np.testing.assert_allclose(middle, (4.1, 2.1), atol=0.25)
    a, b = space.nearest((3.5, 0.6)), space.nearest((4.7, 0.6))
    assert metres_between(space, [a, b])[0, 1] > 2.5
    assert b not in visible_cells(space, a, 4.6)[0]


def test_the_smaller_place_has_the_cell_and_floor_in_none_is_the_last_room() -> None:
    places = [Area(0, 8, 0, 2), Area(1, 2, 0.5, 1.5), Area(20, 21, 0, 1)]
    space = space_of_occupancy(flat(house()), places)
    for p_map, room in (((3, 1), 0), ((1.5, 1), 1), ((3, 3), 3), ((7, 3), 3)):
        assert space.room.reshape(-1)[space.nearest(p_map)] == room
    assert not len(space.floor(2))
    whole = space_of_occupancy(flat(house()), [])
    assert set(np.unique(whole.room)) == {NO_ROOM, 0}


def test_small_islands_are_noise_and_large_grids_get_larger_cells() -> None:
    values = house()
    values[82, 34:52] = 100  # the door is a wall: two parts
    values[166:169, 86:89] = 0
    space = space_of_occupancy(flat(values), [])
    assert int(connected_components(space.free).max()) == 1
    free = np.ones((2000, 2000), np.bool_)
    space = space_of_occupancy(Occupancy(free, ~free, np.zeros(2), 0.1), [])
    assert space.room.size <= 4e5
    assert space.cell == pytest.approx(0.4)


@st.composite
def walls(draw: st.DrawFn) -> NDArray[np.int_]:
    """Floor with a straight wall of one cell between two of its borders, at any slant."""
    size = draw(st.integers(40, 60))
    ends = draw(st.integers(6, size - 7)), draw(st.integers(6, size - 7))
    values = np.zeros((size, size), int)
    share = np.linspace(0, 1, 4 * size)
    x, y = share * (size - 1), ends[0] + share * (ends[1] - ends[0])
    values[np.rint(x).astype(int), np.rint(y).astype(int)] = 100
    return values if draw(st.booleans()) else values.T


@settings(max_examples=30, deadline=None)
@given(walls(), st.sampled_from([0.2, 0.1]), st.data())
def test_nobody_walks_or_sees_through_a_slanted_wall(values, resolution, data):
    space = space_of_occupancy(flat(values, resolution), [])
    number = connected_components(space.free)
    assert int(number.max()) == 1
    start = int(data.draw(st.sampled_from(space.floor().tolist())))
    side = number.reshape(-1)[start]
    assert set(number.reshape(-1)[visible_cells(space, start, 3.0)[0]].tolist()) == {side}
    reached = np.isfinite(distance_fields(space, [start])[0])
    np.testing.assert_array_equal(reached, number == side)


@pytest.mark.parametrize(
    ("pgm", "yaml", "says"),
    [
        (b"P5 3 2 255\n\x00", PLAIN, "damaged"),
        (b"P2 3 2 255\n1 2 3 four 5 6", PLAIN, "no number"),
        (b"P2 3 2 255\n1 2 3 400 5 6", PLAIN, "damaged"),
        (b"P6 3 2 255\n" + bytes(18), PLAIN, "not a PGM"),
        (b"P5 99999 99999 255\n", PLAIN, "99999 x 99999 pixels"),
        (b"P5 3 2 70000\n" + bytes(12), PLAIN, "70000"),
        (b"P5 3 2 255\n" + bytes(6), "image: floor.pgm\nresolution: 0.5\n", "origin"),
        (b"P5 3 2 255\n" + bytes(6), "image: no.pgm\nresolution: 1\norigin: [0,0,0]", "no.pgm"),
        (b"P5 3 2 255\n" + bytes(6), PLAIN.replace("0.5", "much"), "much"),
        (b"P5 3 2 255\n" + bytes(6), PLAIN.replace("0.5", "-1"), "resolution"),
        (b"P5 3 2 255\n" + bytes(6), PLAIN.replace("0.5", "1e-9"), "0.01 to 10 m"),
        (b"P5 3 2 255\n" + bytes(6), PLAIN.replace("0.5", "nan"), "0.01 to 10 m"),
        (b"P5 3 2 255\n" + bytes(6), PLAIN.replace("2.0, 0.0", "inf, 0"), "finite"),
        (b"P5 3 2 255\n" + bytes(6), PLAIN.replace("2.0, 0.0", "2, 1"), "turned"),
        (b"P5 3 2 255\n" + bytes(6), PLAIN + "mode: scale\n", "mode scale"),
        (b"P5 3 2 255\n" + bytes(6), PLAIN, "no free cell"),
        (b"P5 3 2 255\n" + bytes(6), PLAIN.replace("floor.pgm", "floor.npy"), "npy array"),
        (b"", "", "no 'resolution'"),
    ],
)
def test_a_broken_map_is_refused_in_one_line(tmp_path, pgm, yaml, says):
    (tmp_path / "floor.npy").write_bytes(b"no array")
    with pytest.raises(LayoutError, match=says) as caught:
        space_of_grid(written(tmp_path, pgm, yaml), [])
    assert "\n" not in str(caught.value)


def test_a_map_names_its_file_of_places(tmp_path: Path) -> None:
    path = written(tmp_path, b"", PLAIN + "places: 'my rooms.geojson'  # ours\n")
    assert places_file(path) == tmp_path / "my rooms.geojson"
    with pytest.raises(LayoutError, match=r"'places: rooms.geojson' would work"):
        places_file(written(tmp_path, b"", PLAIN))


def test_files_that_are_not_there_or_no_text_are_refused(tmp_path: Path) -> None:
    with pytest.raises(LayoutError, match=r"cannot read away\.yaml"):
        read_grid(tmp_path / "away.yaml")
    (tmp_path / "floor.yaml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(LayoutError, match="not text"):
        read_grid(tmp_path / "floor.yaml")
    np.save(tmp_path / "floor.npy", np.array([[0, 101]]))
    path = written(tmp_path, b"", PLAIN.replace("pgm", "npy"))
    with pytest.raises(LayoutError, match="-1 or 0 to 100"):
        read_grid(path)
    with pytest.raises(LayoutError, match=r"must both be \(nx, ny\)"):
        Occupancy(np.ones((2, 2), np.bool_), np.ones((2, 3), np.bool_), np.zeros(2), 0.1)

"""Files of others that have no end or no room: refused in one line wherever they are read."""

import os
import sqlite3
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from kg.model.errors import HereaboutsError
from kg.model.regular_files import SQLITE_STEPS, StepLimit, check_regular
from kg.rdf.parsing import parse_file
from mapping.places.layout import load_layout
from perception.camera.intrinsics import load_intrinsics
from perception.number_tables import all_numbers
from planner.freespace.map_server import read_grid


@pytest.mark.parametrize(
    ("read", "ending"),
    [
        (load_layout, ".json"),
        (all_numbers, ".txt"),
        (load_intrinsics, ".json"),
        (lambda path: [*parse_file(path)], ".ttl"),
        (read_grid, ".yaml"),
    ],
)
@pytest.mark.parametrize("target", ["pipe", "/dev/zero"])
def test_pipes_and_devices_are_refused_at_once(tmp_path, read, ending, target):
    path = tmp_path / f"one{ending}"
    if target == "pipe":
        os.mkfifo(path)
    else:
        path.symlink_to(target)
    with pytest.raises(HereaboutsError, match="no regular file"):
        read(path)


def test_a_larger_file_than_can_be_read_names_the_limit(tmp_path: Path) -> None:
    path = tmp_path / "large.txt"
    with path.open("wb") as file:
        file.truncate(6_000_000)  # sparse
    check_regular(path)
    with pytest.raises(OSError, match="it has 6 MB; up to 5 would work"):
        check_regular(path, 5_000_000)


def test_an_array_that_announces_more_cells_than_it_has_is_refused(tmp_path: Path) -> None:
    (tmp_path / "floor.yaml").write_text("image: floor.npy\nresolution: 0.05\norigin: [0, 0, 0]\n")
    with (tmp_path / "floor.npy").open("wb") as file:
        header = {"descr": "<f8", "fortran_order": False, "shape": (10**6, 10**6)}
        np.lib.format.write_array_header_1_0(file, header)
    with pytest.raises(HereaboutsError, match="not an npy array"):
        read_grid(tmp_path / "floor.yaml")


def test_a_number_of_four_hundred_digits_is_no_corner(tmp_path: Path) -> None:
    corner = "[1" + "0" * 400 + ", 0]"
    (tmp_path / "rooms.geojson").write_text(
        '{"type": "FeatureCollection", "features": [{"type": "Feature", "properties": {}, '
        f'"geometry": {{"type": "Polygon", "coordinates": [[{corner}, [1, 0], [1, 1], {corner}]]}}'
        "}]}"
    )
    with pytest.raises(HereaboutsError, match="no rings"):
        load_layout(tmp_path / "rooms.geojson")


def test_a_query_on_tables_without_end_is_interrupted(tmp_path: Path) -> None:
    limit = StepLimit(tmp_path / "none.sqlite")
    endless = "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) SELECT max(i) FROM n"
    with closing(sqlite3.connect(tmp_path / "none.sqlite")) as opened:
        opened.set_progress_handler(limit, SQLITE_STEPS)
        for _ in range(2):
            with pytest.raises(sqlite3.OperationalError, match="interrupted"):
                opened.execute(endless).fetchone()
            limit.reset()
        assert opened.execute("SELECT 1").fetchone() == (1,)

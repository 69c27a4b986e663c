"""`hereabouts floor`: what a robot's own navigation reads of the map."""

import json
from pathlib import Path

import numpy as np
import pytest

from hereabouts.cli import main
from hereabouts.display.plots.map_plot import plot_map
from kg.model.records import FREE, LOW, TALL, FloorTile, MapUpdate, PlaceRecord
from kg.serving.opening import create_map, in_memory_map, open_map
from planner.freespace.map_server import read_grid

CELLS = np.zeros((64, 64), np.uint8)
CELLS[5:40, 3:30] = FREE
CELLS[10:14, 8:20] = LOW
CELLS[5:40, 30] = TALL
TILES = (FloorTile(0, 0, -1, 0.0, 0.05, CELLS, 1e9), FloorTile(0, 1, -1, 0.0, 0.05, CELLS.T, 1e9))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    with create_map(tmp_path / "flat.map", title="flat") as semantic_map:
        semantic_map.apply(MapUpdate(floor=TILES[:1]))
        semantic_map.apply(MapUpdate(floor=TILES))
        upstairs = FloorTile(1, 0, 0, 3.0, 0.05, CELLS, 1e9)
        semantic_map.apply(MapUpdate(floor=(upstairs,)))
    return tmp_path / "flat.map"


def test_the_files_say_what_the_map_knows(folder, tmp_path, capsys):
    yaml = tmp_path / "floor.yaml"
    assert main(["floor", str(folder), "-o", str(yaml)]) == 0
    out, err = capsys.readouterr()
    assert out == "" and "m2 free" in err
    grid = read_grid(yaml)
    assert grid.resolution == 0.05
    whole = np.concatenate([CELLS, CELLS.T])
    i, j = np.rint((grid.origin - (0.0, -3.2)) / 0.05).astype(int)

    def there(mask: np.ndarray, *states: int) -> bool:
        full = np.zeros_like(mask)
        part = np.isin(whole, states)
        at = np.argwhere(part) - (i, j)
        full[at[:, 0], at[:, 1]] = True
        return np.array_equal(mask, full)

    assert there(grid.free, FREE)
    assert there(grid.occupied, LOW, TALL)
    assert (tmp_path / "floor.pgm").read_bytes().startswith(b"P5\n")


def test_in_numbers(folder, tmp_path, capsys):
    yaml = tmp_path / "floor.yaml"
    assert main(["floor", str(folder), "-o", str(yaml), "--json", "--storey", "1"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["storey"], told["resolution"]) == (1, 0.05)
    assert told["free_m2"] == pytest.approx((CELLS == FREE).sum() * 0.0025, abs=0.01)
    assert told["occupied_m2"] == pytest.approx((CELLS > FREE).sum() * 0.0025, abs=0.01)


def test_the_floor_of_then(folder, tmp_path, capsys):
    areas = []
    for when in ("#1", "#2"):
        assert main(["floor", str(folder), "-o", f"{tmp_path}/f.yml", "--json", "--at", when]) == 0
        areas.append(json.loads(capsys.readouterr().out)["free_m2"])
    assert areas[1] == pytest.approx(2 * areas[0], abs=0.02)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["-o", "floor.png"], "ends with .yaml"),
        (["-o", "nowhere/floor.yaml"], "cannot write"),
        (["-o", "floor.yaml", "--storey", "7"], "mapped are: 0, 1"),
        (["-o", "two\nlines.yaml"], "must be text"),
        (["-o", "\udcff.yaml"], "must be text"),
    ],
)
def test_what_does_not_work_is_said_in_one_line(
    folder, tmp_path, monkeypatch, capsys, options, message
):
    monkeypatch.chdir(tmp_path)
    assert main(["floor", str(folder), *options]) == 1
    out, err = capsys.readouterr()
    assert out == "" and message in err and err.count("\n") == 1


@pytest.mark.parametrize("name", ["my floor", "1: first", "-"])
def test_a_name_that_yaml_would_misread_is_quoted(folder, tmp_path, name):
    assert main(["floor", str(folder), "-o", f"{tmp_path}/{name}.yaml"]) == 0
    assert f'image: "{name}.pgm"\n' in (tmp_path / f"{name}.yaml").read_text()
    assert read_grid(tmp_path / f"{name}.yaml").free.any()


def test_a_map_without_a_floor_says_so(tmp_path, capsys):
    with create_map(tmp_path / "bare.map"):
        pass
    assert main(["floor", str(tmp_path / "bare.map"), "-o", str(tmp_path / "f.yaml")]) == 1
    assert "no mapped floor" in capsys.readouterr().err
    assert not (tmp_path / "f.yaml").exists()


def test_a_picture_shows_walls_and_furniture(tmp_path):
    with in_memory_map() as semantic_map:
        place = PlaceRecord(semantic_map.place_iri(1), "place 1", 0, 3, -3, 0, 0)
        semantic_map.apply(MapUpdate(places=(place,)))
        bare = plot_map(semantic_map, tmp_path / "bare.svg").read_text()
        semantic_map.apply(MapUpdate(floor=TILES))
        drawn = plot_map(semantic_map, tmp_path / "drawn.svg").read_text()
        again = plot_map(semantic_map, tmp_path / "again.svg").read_text()
    assert "<image" in drawn and "<image" not in bare
    assert drawn == again


def test_stray_tiles_are_left_out(folder, tmp_path):
    words = ["floor", str(folder), "--storey", "0", "-o"]
    assert main([*words, str(tmp_path / "before.yaml")]) == 0
    with open_map(folder) as semantic_map:
        far = [FloorTile(0, n, n, 0.0, 0.05, CELLS, 1e9) for n in (-100_000, 100_000)]
        semantic_map.apply(MapUpdate(floor=tuple(far)))
    assert main([*words, str(tmp_path / "after.yaml")]) == 0
    assert (tmp_path / "after.pgm").read_bytes() == (tmp_path / "before.pgm").read_bytes()

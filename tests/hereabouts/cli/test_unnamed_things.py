"""Things without a name on the command line: counted below lists, and in no list or view."""

import json
from pathlib import Path

from hereabouts.cli import main
from kg.serving.opening import create_map
from tests.planner.flat import with_unnamed


def written(folder: Path) -> Path:
    """A map with objects and things without a name."""
    with create_map(folder / "flat.map") as flat:
        with_unnamed(flat)
    return folder / "flat.map"


def test_lists_of_the_command_line_name_them_below(tmp_path, capsys):
    path = written(tmp_path)
    said = f"; `hereabouts name {path} --review FILE.html` shows them"
    assert main(["ask", str(path), "summary"]) == 0
    out, err = capsys.readouterr()
    assert "unnamed" not in out
    assert f"and 3 things without a name (2 in the kitchen, 1 in place 3){said}" in err
    assert main(["ask", str(path), "objects-in-place", "-p", "place=place 1"]) == 0
    assert f"and 2 things without a name{said}" in capsys.readouterr().err
    assert main(["ask", str(path), "objects", "--json"]) == 0
    assert "without a name" not in capsys.readouterr().err


def test_exports_of_objects_leave_them_out_and_linked_data_has_them(tmp_path, capsys):
    path = written(tmp_path)
    for name, choice in (("flat.geojson", "--all"), ("flat.ttl", "--no-ontology")):
        assert main(["export", str(path), "-o", str(tmp_path / name), choice]) == 0
    assert (tmp_path / "flat.ttl").read_text().count("here:UnnamedThing") == 3
    features = json.loads((tmp_path / "flat.geojson").read_text())["features"]
    points = [one["properties"] for one in features if "existence" in one["properties"]]
    assert len(points) == 3 and "unnamed" not in str(points)
    capsys.readouterr()
    assert main(["check", str(path)]) == 0
    assert "0 findings" in "".join(capsys.readouterr())

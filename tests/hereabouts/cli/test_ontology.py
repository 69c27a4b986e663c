"""`hereabouts ontology`: what people see of checking, comparing and reloading."""

import json
import re
from collections.abc import Callable
from pathlib import Path

import pytest

from hereabouts.cli import main
from kg.model.vocabulary import PREFIXES
from kg.serving.opening import create_map, open_map

Run = Callable[..., str]
MUG = """<urn:mine> a owl:Ontology ; rdfs:label "mine" ; rdfs:comment "Ours." ;
    owl:imports <https://w3id.org/hereabouts/ontology/commonsense> ;
    owl:versionInfo "1" ; dct:license <urn:free> .
here:Mug a owl:Class ; rdfs:subClassOf here:Cup ; rdfs:label "mug" ; rdfs:comment "A cup." ;
    here:locatedAt here:Office .
"""


@pytest.fixture
def mine(tmp_path: Path) -> Path:
    path = tmp_path / "mine.ttl"
    names = "".join(f"@prefix {name}: <{iri}> .\n" for name, iri in PREFIXES.items())
    path.write_text(names + MUG)
    return path


@pytest.fixture
def flat(tmp_path: Path) -> Path:
    path = tmp_path / "flat.map"
    create_map(path).close()
    return path


def test_reload_tells_the_change_and_the_map_has_it(flat, mine, prints, capsys):
    told = [
        "+ category 'mug' added under cup",
        "+ ontology 'mine' added",
        "+ mug located at office 0.2 added",
    ]
    assert prints("ontology", "diff", flat, mine).splitlines() == told
    assert prints("ontology", "reload", flat, mine, "--dry-run").splitlines() == told
    assert "mug" not in prints("ask", flat, "located-at", "-p", "category=cup")
    assert prints("ontology", "reload", flat, mine, "--by", "ann").splitlines() == told
    assert "office" in prints("ask", flat, "located-at", "-p", "category=mug")
    assert prints("ontology", "reload", flat, mine) == ""
    assert main(["ontology", "diff", str(flat), str(mine)]) == 0
    assert capsys.readouterr().err == "no differences\n"


def test_json_has_the_same(flat: Path, mine: Path, prints: Run) -> None:
    found = json.loads(prints("ontology", "diff", flat, mine, "--json"))
    done = json.loads(prints("ontology", "reload", flat, mine, "--json"))
    assert done["changes"] == found
    assert [change["kind"] for change in found] == ["term", "term", "relation"]
    assert (done["sequence"], done["removed"], done["warnings"]) == (1, 0, [])
    assert done["added"] > 5


def test_check_says_what_is_wrong_where(mine, prints, capsys):
    assert prints("ontology", "check", mine) == ""
    mine.write_text(mine.read_text() + "here:Jug a owl:Class ; rdfs:subClassOf here:Cup .\n")
    assert main(["ontology", "check", str(mine), "--json"]) == 1
    finding = json.loads(capsys.readouterr().out)[0]
    assert (finding["severity"], finding["focus"]) == ("violation", f"{PREFIXES['here']}Jug")
    assert finding["file"] == str(mine)
    assert finding["line"] == len(mine.read_text().splitlines())
    assert "needs an rdfs:label" in finding["message"]
    good = mine.with_name("good.ttl")
    good.write_text(mine.read_text().partition("here:Jug")[0])
    assert main(["ontology", "check", str(good), str(mine)]) == 1
    assert "mine.ttl" in capsys.readouterr().out


def test_a_refused_ontology_leaves_the_map_as_it_is(flat: Path, mine: Path, fails: Run) -> None:
    with open_map(flat, read_only=True) as semantic_map:
        before = set(semantic_map.engine)
    good = mine.read_text()
    lines = len(good.splitlines())
    for bad, reason in (
        (good + "here:Cup here:locatedAt here:Kitchen", f"mine.ttl, line {lines + 1}: "),
        (good + "here:Cup here:locatedAt here:Fork .\n", f"mine.ttl, line {lines + 1}: here:Cup: "),
        (good.replace("owl:imports", "rdfs:seeAlso"), "the ontology is refused: "),
    ):
        mine.write_text(bad)
        assert reason in fails("ontology", "reload", flat, mine)
    with open_map(flat, read_only=True) as semantic_map:
        assert set(semantic_map.engine) == before


def test_a_file_that_leaves_out_what_the_map_knows_is_refused_unless_it_is_the_whole(
    flat: Path, mine: Path, prints: Run, fails: Run
) -> None:
    core = "https://w3id.org/hereabouts/ontology/objects"
    mine.write_text(
        mine.read_text()
        .replace("https://w3id.org/hereabouts/ontology/commonsense", core)
        .replace("here:locatedAt here:Office", 'rdfs:seeAlso "nothing"')
    )
    assert f"leaves out <{core.replace('objects', 'commonsense')}>" in fails(
        "ontology", "reload", flat, mine
    )
    told = prints("ontology", "reload", flat, mine, "--whole")
    assert "- category 'kitchen' removed" in told


def test_what_is_exported_loads_again_without_a_change(flat, tmp_path, prints):
    path = tmp_path / "flat.owl"
    prints("ontology", "export", flat, "-o", path)
    assert prints("ontology", "check", path) == ""
    told = prints("ontology", "reload", flat, path).splitlines()
    assert [line for line in told if "ontology" not in line] == []


def test_nothing_at_the_path_is_said(flat: Path, mine: Path, tmp_path: Path, fails: Run) -> None:
    absent = tmp_path / "absent.ttl"
    assert f"no ontology at {absent}" in fails("ontology", "check", absent)
    assert f"no ontology at {absent}" in fails("ontology", "reload", flat, absent)
    assert "no map at" in fails("ontology", "reload", tmp_path / "no.map", mine)


def test_a_header_that_says_little_is_warned_of_and_taken(flat, mine, prints):
    said = re.sub(r"rdfs:label .*?;\n|owl:versionInfo .*", "", MUG, count=2)
    bare = said.replace("commonsense> ;", "commonsense> .")
    mine.write_text(mine.read_text().replace(MUG, bare))
    assert "should have an owl:versionInfo" in prints("ontology", "check", mine)
    assert "+ category 'mug' added under cup" in prints("ontology", "reload", flat, mine)


def test_a_number_that_is_none_is_a_finding_and_no_traceback(mine, caplog):
    with mine.open("a") as file:
        file.write('here:nearBy here:probability "often"^^xsd:double .\n')
    assert main(["ontology", "check", str(mine)]) == 1
    assert caplog.records == []


def test_an_empty_file_is_not_all_well(tmp_path: Path, prints: Run) -> None:
    path = tmp_path / "empty.ttl"
    path.touch()
    assert "holds no statement" in prints("ontology", "check", path)

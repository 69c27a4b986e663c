"""`ontology check` beside hostile files: they are refused, and kill the check of no other."""

import json

import pytest

from benchmarks.attack.exhaustion import document_bombs
from hereabouts.cli import main

HARMLESS = """@prefix owl: <http://www.w3.org/2002/07/owl#> .
@prefix rdfs: <http://www.w3.org/2000/01/rdf-schema#> .
<urn:mine> a owl:Ontology ; owl:imports <urn:other> ; rdfs:label "mine"@en ;
    rdfs:comment "A test."@en ; owl:versionInfo "1" ;
    <http://purl.org/dc/terms/license> <https://creativecommons.org/publicdomain/zero/1.0/> .
"""
NEIGHBOURS = [
    (ending, body)
    for kind, body in document_bombs()
    for ending in {"application/rdf+xml": [".owl"], "text/turtle": [".ttl"]}.get(kind, [])
]


@pytest.mark.parametrize("number", range(len(NEIGHBOURS)))
def test_a_hostile_file_is_refused_in_one_line(tmp_path, number, capsys):
    ending, body = NEIGHBOURS[number]
    file = tmp_path / f"hostile{ending}"
    file.write_bytes(body)
    assert main(["ontology", "check", str(file)]) == 1
    error = capsys.readouterr()
    assert not error.err or error.err.count("\n") == 1


def test_hostile_neighbours_do_not_keep_a_harmless_file_from_its_check(tmp_path, capsys):
    for number, (ending, body) in enumerate(NEIGHBOURS):
        (tmp_path / f"a{number}{ending}").write_bytes(body)
    (tmp_path / "mine.ttl").write_text(HARMLESS)
    (tmp_path / "z.ttl").write_text("<urn:other> a <http://www.w3.org/2002/07/owl#Ontology> .")
    main(["ontology", "check", str(tmp_path / "mine.ttl"), "--json"])
    told = capsys.readouterr()
    assert "error:" not in told.err
    assert {row["file"] for row in json.loads(told.out)} <= {
        "",
        str(tmp_path / "mine.ttl"),
        str(tmp_path / "z.ttl"),
    }

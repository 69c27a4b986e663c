"""`python -m benchmarks.graph` measures what it names, on answers that are right."""

import json
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import pytest
from pyoxigraph import NamedNode, Quad

from benchmarks.graph.__main__ import main
from benchmarks.graph.building import BASE, Building
from benchmarks.graph.loading import furnished
from benchmarks.graph.ours import LOOKUPS
from kg.maps.query.query_files import shipped_queries
from kg.maps.semantic_map import SemanticMap
from kg.model import vocabulary as v
from kg.serving.opening import create_map, in_memory_map


@pytest.fixture(autouse=True)
def _brief(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("benchmarks.graph.timing.BUDGET", 0.0)


def test_every_question_is_measured(prints: Callable[..., str]) -> None:
    words = ("--sizes", "40,90", "--seconds", "0.3", "--frames", "40", "--rivals-up-to", "40")
    result = json.loads(prints("benchmarks.graph", *words, "--json"))
    measured = {(t["operation"], t["store"], t["objects"]) for t in result["timings"]}
    for size in (40, 90):
        asked = {name for name, store, n in measured if (store, n) == ("hereabouts on disk", size)}
        assert asked >= {"update by a frame", "export as N-Triples", "a class", "a cell"}
        assert asked >= {question.name for question in shipped_queries()} - {"graph-sizes"}
    beside = {(store, n) for _, store, n in measured if store != "hereabouts on disk"}
    stores = "pyoxigraph on disk", "rdflib in memory", "owlready2 on disk"
    assert beside == {(store, 40) for store in stores}
    assert all(t["milliseconds"]["median"] > 0 for t in result["timings"])
    for run in ("live", "leaping"):
        assert result[run]["frames"] == 9
        assert result[run]["reads"] > 0
    assert result["updateRatio"] > 0
    slowest = result["slowestLookup"]
    assert (slowest["objects"], slowest["operation"] in LOOKUPS) == (90, True)
    assert set(result["lastTenthOverFirst"]) >= {"update", "lookup", "memory", "disk"}


def test_a_map_loaded_whole_says_what_the_writer_writes(tmp_path: Path) -> None:
    with create_map(tmp_path / "written", base=BASE) as written:
        building = Building(230, written.catalogue)
        building.furnish(written)
        loaded, same = furnished(tmp_path / "loaded", 230)
        with loaded:
            assert _says(loaded) == _says(written)
            for semantic_map, of in ((written, building), (loaded, same)):
                semantic_map.apply(of.frame(0))
            assert _says(loaded) == _says(written)
            assert loaded.new_object_iri() == written.new_object_iri()
            assert len(loaded.at(0).objects()) == 230  # its history begins with all of it


def _says(semantic_map: SemanticMap) -> set[Quad]:
    apart = {NamedNode(iri) for iri in (v.SEQUENCE, v.DCT_CREATED, v.DCT_TITLE)}
    return {quad for quad in semantic_map.engine if quad.predicate not in apart}


def test_a_robot_that_drives_sees_most_of_what_it_just_saw(tmp_path: Path) -> None:
    with in_memory_map(base=BASE) as semantic_map:
        building = Building(200, semantic_map.catalogue)
    frames = [{record.iri for record in building.drive(n).objects} for n in range(600)]
    assert all(len(seen) == 20 for seen in frames)
    met = [len(one & other) for one, other in pairwise(frames)]
    assert set(met) == {0, 19, 20}  # 0 where it begins anew
    assert len(set.union(*frames)) == 199


@pytest.mark.parametrize("sizes", ["ten", "5", "", "100,-1"])
def test_sizes_that_make_no_sense_are_wrong_usage(sizes: str) -> None:
    with pytest.raises(SystemExit) as stopped:
        main(["--sizes", sizes])
    assert stopped.value.code == 2

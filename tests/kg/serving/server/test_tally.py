"""What the server counts by itself stays right, whoever writes and whatever."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import pytest

from kg.maps.semantic_map import SemanticMap
from kg.model import vocabulary as v
from kg.model.records import MapUpdate

if TYPE_CHECKING:
    from conftest import Served


def scraped(served: Served) -> int:
    found = re.search(r"^hereabouts_objects (\S+)$", served.get("metrics").text, re.MULTILINE)
    assert found is not None
    return int(float(found[1]))


def counted(semantic_map: SemanticMap) -> int:
    return sum(int(str(row["count"])) for row in semantic_map.query("summary").records())


def test_a_scrape_asks_the_map_nothing(served: Served, monkeypatch: pytest.MonkeyPatch) -> None:
    assert scraped(served) == 2

    def refuse(*_: object, **__: object) -> None:
        raise AssertionError("a scrape asked the map")

    monkeypatch.setattr(SemanticMap, "query", refuse)
    monkeypatch.setattr(served.server.serving.pool, "run", refuse)
    served.map.update("INSERT DATA { <object/9> a here:Cup ; here:x 1 ; here:y 1 }")
    assert scraped(served) == 3


def test_counts_are_right_after_updates_from_outside(served: Served) -> None:
    steps = (
        "INSERT DATA { <object/9> a here:Cup ; here:x 1 ; here:y 1 }",
        "INSERT DATA { <http://example.org/mine> a here:Chair ; here:x 1 ; here:y 1 }",
        "DELETE DATA { <object/9> a here:Cup } ; INSERT DATA { <object/9> a here:Bowl }",
        "DELETE WHERE { <object/9> ?p ?o }",
        'INSERT DATA { <place/1> rdfs:comment "no object" }',
        "DELETE { ?o ?p ?x } WHERE { ?o a here:Chair ; ?p ?x }",
    )
    expected = (3, 4, 4, 3, 3, 1)
    for update, count in zip(steps, expected, strict=True):
        assert served.write(update).status_code == 200
        assert scraped(served) == count == counted(served.map), update
    served.map.assertions.add("object/1", "category", "bowl", by="ann")
    assert scraped(served) == 1
    served.map.assertions.retract("object/1", "category")
    served.map.apply(MapUpdate(removed=(served.map.base + "object/1",)))
    assert scraped(served) == 0 == counted(served.map)


def test_counts_follow_the_ontology(served: Served) -> None:
    served.map.ontology.learn(["gizmo"], "object", model="net")
    gizmo = served.map.catalogue.find("gizmo").iri
    served.write(f"INSERT DATA {{ <object/9> a <{gizmo}> ; here:x 1 ; here:y 1 }}")
    assert scraped(served) == 3 == counted(served.map)
    isa = f"{{ GRAPH graph:commonsense {{ <{gizmo}> <{v.IS_A}> <{v.OBJECT}> }} }}"
    served.map.update(f"DELETE DATA {isa}", allow=("commonsense",))
    assert scraped(served) == 2 == counted(served.map)
    served.map.update(f"INSERT DATA {isa}", allow=("commonsense",))
    assert scraped(served) == 3 == counted(served.map)

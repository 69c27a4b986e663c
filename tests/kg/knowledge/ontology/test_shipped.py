"""The shipped ontology is compiled once, and again where it changes."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from pyoxigraph import Store

from kg.knowledge.ontology import shipped
from kg.knowledge.ontology.catalogue import Catalogue, StoredCatalogue
from kg.knowledge.ontology.lint import check_map
from kg.knowledge.ontology.shipped import shipped_ontology
from kg.model import vocabulary as v
from kg.model.resources import ONTOLOGIES
from kg.serving.opening import in_memory_map


@pytest.fixture
def edited(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of the shipped ontologies, in their place."""
    folder = tmp_path / "ontologies"
    shutil.copytree(ONTOLOGIES, folder)
    monkeypatch.setattr(shipped, "ONTOLOGIES", folder)
    return folder


def test_a_new_map_holds_the_compiled_ontology_and_knows_its_categories() -> None:
    for _ in range(2):  # compiled, and from the cache
        with in_memory_map() as home:
            assert home.catalogue == Catalogue.from_store(home.engine)
            assert check_map(home.store.native) == []


def test_an_edit_of_the_files_is_seen_by_the_next_map(edited: Path) -> None:
    assert shipped_ontology() is shipped_ontology()
    assert shipped_ontology().catalogue.get("teasmade") is None
    objects = edited / "objects.ttl"
    more = "here:Teasmade a owl:Class ; rdfs:subClassOf here:Object ; rdfs:label 'teasmade' ."
    objects.write_text(f"{objects.read_text()}\n{more}\n")
    assert shipped_ontology().catalogue.find("teasmade").iri == v.HERE + "Teasmade"


def test_categories_read_while_the_ontology_changes_are_read_again() -> None:
    old, new = Store(), Store()
    with in_memory_map() as home:
        new.bulk_extend(home.engine)
    engines = iter([old, new])

    def changes_meanwhile() -> Store:
        engine = next(engines)
        if engine is old:
            catalogue.forget()
        return engine

    catalogue = StoredCatalogue(changes_meanwhile)
    assert catalogue().categories == ()
    assert catalogue().find("cup").kind == "object"
    assert catalogue() is catalogue()

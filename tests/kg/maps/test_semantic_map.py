"""The front door: create, open, write, close, open again."""

from pathlib import Path

import numpy as np
import pytest

from kg.model.errors import GraphError, MapNotFoundError
from kg.model.records import MapUpdate, PlaceRecord, RecordingRecord, RobotRecord
from kg.serving.opening import create_map, in_memory_map, open_map, open_or_create_map
from kg.store.transactional import TransactionalStore
from tests.kg.conftest import thing


def test_everything_is_there_after_reopening(tmp_path: Path) -> None:
    path = tmp_path / "rooms" / "lab"
    with create_map(path) as chart:
        base = chart.base
        kitchen = chart.catalogue.find("kitchen").iri
        update = MapUpdate(
            objects=(thing(chart, "chair"),),
            places=(PlaceRecord(chart.place_iri(1), "room", 0, 3, 0, 3, 4, {kitchen: 0.5}),),
            robot=RobotRecord(np.array([1.0, 0, 0]), 0.5, 9.0),
            recording=RecordingRecord("run", 3, "frame-2", np.eye(4)),
        )
        chart.apply(update)
    with open_map(path, read_only=True) as chart:
        assert (chart.description.title, chart.base) == ("lab", base)
        assert chart.objects()[0].iri == base + "object/1"
        assert chart.places() == update.places
        robot = chart.robot()
        assert robot is not None
        assert (robot.heading, robot.stamp) == (0.5, 9.0)
        assert chart.recordings()[0].frames_applied == 3


def test_a_number_is_never_used_twice_also_across_restarts(tmp_path: Path) -> None:
    with create_map(tmp_path / "map") as chart:
        first, second = thing(chart, "chair"), thing(chart, "chair")
        chart.apply(MapUpdate(objects=(first, second)))
        chart.apply(MapUpdate(removed=(second.iri,)))
    with open_map(tmp_path / "map") as chart:
        assert chart.new_object_iri() == chart.base + "object/3"


def test_open_or_create_creates_once(tmp_path: Path) -> None:
    with open_or_create_map(tmp_path / "map", title="lab", base="urn:lab:/") as chart:
        assert (chart.description.title, chart.base) == ("lab", "urn:lab:/")
    with open_or_create_map(tmp_path / "map", title="other") as chart:
        assert chart.description.title == "lab"


def test_a_base_that_is_no_iri_is_refused_and_nothing_created(tmp_path: Path) -> None:
    with pytest.raises(GraphError, match="absolute IRI"):
        create_map(tmp_path / "map", base="not an iri")
    assert list(tmp_path.iterdir()) == []


def test_a_store_that_says_nothing_of_a_map_is_no_map(tmp_path: Path) -> None:
    TransactionalStore.create(tmp_path / "map", []).close()
    with pytest.raises(MapNotFoundError, match="describes no"):
        open_map(tmp_path / "map")
    TransactionalStore.open(tmp_path / "map").close()  # the failed open let go of the lock


def test_a_new_map_knows_common_sense() -> None:
    chart = in_memory_map()
    places = {row["place"] for row in chart.query("located-at", category="banana").records()}
    assert "kitchen" in places
    assert chart.objects() == chart.places() == chart.recordings() == ()
    assert chart.robot() is None


def test_the_rdflib_view_is_live_both_ways() -> None:
    chart = in_memory_map(base="http://example.org/lab/")
    record = thing(chart, "chair")
    chart.apply(MapUpdate(objects=(record,)))
    asked = "SELECT ?x WHERE { ?o a here:Chair ; here:x ?x }"
    assert [float(row.x) for row in chart.dataset.query(asked)] == [1.0]  # type: ignore[union-attr]
    chart.dataset.update(f'INSERT DATA {{ <{record.iri}> rdfs:comment "wobbly" }}')
    found = chart.query("SELECT ?c WHERE { $o rdfs:comment ?c }", o=record.iri)
    assert found.rows == (("wobbly",),)

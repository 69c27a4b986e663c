"""Facts in the frame of another map."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely

from kg.knowledge.ontology.catalogue import Catalogue
from kg.knowledge.ontology.loading import load_ontologies
from kg.maps.facts.coordinate_frames import moved
from kg.maps.facts.objects_and_places import RecordCodec
from kg.model.records import ObjectRecord

BASE = "http://example.org/lab/"


@pytest.mark.parametrize("degrees", [0, 30, 90, 145, -170])
def test_a_box_turns_with_its_map(degrees: float) -> None:
    facts = RecordCodec(BASE, Catalogue.from_quads(load_ontologies().quads))
    kind = facts.catalogue.find("dining table", "object").iri
    where, extent = np.array([1.0, 2.0, 0.4]), np.array([1.2, 0.8, 0.8])
    table = ObjectRecord(
        BASE + "object/1", kind, where, 1.0, 0.9, 3, 0.0, 1.0, extent=extent, yaw=0.3
    )
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    T = np.array([[c, -s, 0, 4], [s, c, 0, -2], [0, 0, 1, 0], [0, 0, 0, 1]])
    (seen,) = facts.objects_among(moved(facts.of_object(table), T, BASE + "crs"))
    assert table.footprint is not None and seen.footprint is not None
    wanted = shapely.Polygon(table.footprint @ T[:2, :2].T + T[:2, 3])
    assert wanted.symmetric_difference(shapely.Polygon(seen.footprint)).area < 0.01

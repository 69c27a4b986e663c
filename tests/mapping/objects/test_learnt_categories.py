"""A map that takes an ontology in while it is being mapped: the mappers go on with it."""

from __future__ import annotations

import pytest
from pyoxigraph import Literal, NamedNode, Quad

from kg.model import vocabulary as v
from kg.model.areas import Rectangle
from mapping.objects.object_mapper import ReferenceObjectMapper
from mapping.places.layout import Layout, LayoutPlace
from mapping.places.place_mapper import PlaceMapper
from mapping.places.place_registry import PlaceRegistry
from mapping.reference.settings import ReferenceSettings
from perception.frames import SceneScores

SETTINGS = ReferenceSettings(stride=1)
MIDDLE = (30.0, 22.0, 34.0, 26.0)


def learn(semantic_map, name, above, label):
    said = {
        v.RDF_TYPE.value: NamedNode(v.OWL_CLASS),
        v.RDFS_SUB_CLASS_OF: NamedNode(above),
        v.RDFS_LABEL: Literal(label),
    }
    learnt = [Quad(NamedNode(v.HERE + name), NamedNode(p), o) for p, o in said.items()]
    semantic_map.ontology.replace([*semantic_map.ontology.quads(), *learnt])


def test_an_object_category_learnt_meanwhile_is_mapped_from_the_next_frame_on(
    semantic_map, make_frame, make_detections
):
    mapper = ReferenceObjectMapper(semantic_map, SETTINGS)
    seen = make_detections(("flux capacitor", 0.9, MIDDLE))
    mapper.add(make_frame(2.0), seen)
    assert mapper.objects() == ()
    learn(semantic_map, "Flux", v.OBJECT, "flux capacitor")
    mapper.add(make_frame(2.0), seen)
    (record,) = mapper.objects()
    assert record.category == v.HERE + "Flux"


@pytest.mark.parametrize("belief_filter", ["mean", "bayes"])
def test_a_place_category_learnt_meanwhile_is_believed_from_the_next_view_on(
    semantic_map, make_frame, belief_filter
):
    layout = Layout((LayoutPlace(1, "west", Rectangle(-9, 9, -9, 9)),))
    chosen = ReferenceSettings(stride=1, belief_filter=belief_filter)
    mapper = PlaceMapper(semantic_map, PlaceRegistry(semantic_map, layout), chosen)
    scores = SceneScores({"kitchen": 0.2, "holodeck": 0.8})
    iri = mapper.viewed_place(make_frame(2.0))
    assert set(mapper.view(iri, make_frame(2.0), scores).beliefs) <= {v.HERE + "Kitchen"}
    learn(semantic_map, "Holodeck", v.PLACE, "holodeck")
    assert v.HERE + "Holodeck" in mapper.view(iri, make_frame(2.0), scores).beliefs

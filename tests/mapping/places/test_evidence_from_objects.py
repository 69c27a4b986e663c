"""Objects count in what a place is believed to be: beside its views, or where it has none."""

import numpy as np
import pytest

from kg.knowledge.ontology.lint import check_map
from kg.maps.semantic_map import SemanticMap
from kg.model.areas import Rectangle
from kg.model.records import ObjectRecord
from mapping.mapping_options import MappingOptions
from mapping.places.layout import Layout, LayoutPlace
from mapping.places.place_mapper import ObjectEvidence, presence
from mapping.places.place_registry import PlaceRegistry
from mapping.recording_mapper import map_recording
from mapping.reference.settings import ReferenceSettings

SETTINGS = ReferenceSettings(stride=1, places_from_objects=True)
PLAIN = ReferenceSettings(stride=1)
ROOM = Layout((LayoutPlace(1, "room", Rectangle(-9, 9, -9, 9)),))
LEFT, MIDDLE, RIGHT = (8.0, 22.0, 12.0, 26.0), (30.0, 22.0, 34.0, 26.0), (52.0, 22.0, 56.0, 26.0)
OF_KITCHENS = ("refrigerator", "oven", "sink")


@pytest.fixture
def drive(make_frame, list_recording):
    """Callable: name -> five frames that differ enough to be five views."""

    def make(name: str = "room"):
        frames = []
        for n in range(5):
            frame = make_frame(2.0, id=f"frame-{n:06d}", stamp=1e6 + n)
            T = frame.T_map_cam.copy()
            T[2, 3] += 0.2 * n
            frames.append(make_frame(2.0, T=T, id=frame.id, stamp=frame.stamp))
        return list_recording(frames, name=name)

    return make


@pytest.fixture
def kitchen_things(make_detections, scripted_detector):
    """A detector that sees a refrigerator, an oven and a sink in every frame."""
    boxes = zip(OF_KITCHENS, (LEFT, MIDDLE, RIGHT), strict=True)
    return scripted_detector({}, make_detections(*((label, 0.9, box) for label, box in boxes)))


def run(recording, semantic_map, *networks, reference: ReferenceSettings = SETTINGS) -> None:
    options = MappingOptions(layout=ROOM, reference=reference)
    map_recording(recording, semantic_map, *networks, options=options)


def believed(semantic_map: SemanticMap) -> dict[str, float]:
    (place,) = semantic_map.places()
    return {semantic_map.catalogue.label(c): p for c, p in place.beliefs.items()}


def sure_of(beliefs: dict[str, float]) -> str:
    return max(beliefs, key=lambda label: (beliefs[label], label))


def test_objects_settle_what_views_leave_open(semantic_map, drive, kitchen_things, scripted_scene):
    scene = scripted_scene({"office": 0.4, "kitchen": 0.35, "bar": 0.25})
    run(drive(), semantic_map, kitchen_things, scene, reference=PLAIN)
    assert sure_of(believed(semantic_map)) == "office"
    run(drive("later"), semantic_map, kitchen_things, scene)
    assert sure_of(believed(semantic_map)) == "kitchen"
    (place,) = semantic_map.places()
    assert place.from_views[semantic_map.catalogue.find("office").iri] == pytest.approx(0.4)
    assert set(place.evidence_objects) == {record.iri for record in semantic_map.objects()}


def test_a_place_without_views_is_told_by_its_objects_alone(semantic_map, drive, kitchen_things):
    run(drive(), semantic_map, kitchen_things)
    beliefs = believed(semantic_map)
    assert beliefs["kitchen"] == max(beliefs.values())
    assert beliefs["kitchen"] > 4 * beliefs.get("office", 0.0)
    assert len(semantic_map.places("kitchen")) + len(semantic_map.places("kitchenette")) == 1


def test_the_reference_mode_does_not_use_them(semantic_map, drive, kitchen_things, scripted_scene):
    scene = scripted_scene({"office": 0.6, "kitchen": 0.4})
    map_recording(drive(), semantic_map, kitchen_things, scene, options=MappingOptions(layout=ROOM))
    assert believed(semantic_map) == pytest.approx({"office": 0.6, "kitchen": 0.4})
    assert semantic_map.places()[0].evidence_objects == ()


def test_what_a_person_said_of_a_place_outranks_its_objects(
    semantic_map, drive, kitchen_things, scripted_scene
):
    scene = scripted_scene({"office": 0.6, "kitchen": 0.4})
    run(drive(), semantic_map, kitchen_things, scene)
    (place,) = semantic_map.places()
    semantic_map.assertions.add(place.iri, "category", "pantry", by="anna")
    run(drive("later"), semantic_map, kitchen_things, scene)
    assert believed(semantic_map) == {"pantry": 1.0}
    semantic_map.assertions.retract(place.iri, "category")
    assert believed(semantic_map)["kitchen"] > 0.5


def test_beliefs_go_back_to_the_views_where_the_objects_go(semantic_map, scripted_scene):
    kitchen = semantic_map.catalogue.find("kitchen").iri
    fridge = semantic_map.catalogue.find("refrigerator").iri
    places = PlaceRegistry(semantic_map, ROOM)
    told = ObjectEvidence(semantic_map, places, SETTINGS)
    (place,) = places.places()
    thing = ObjectRecord(
        "https://example.org/map/object/1", fridge, np.zeros(3), 2.0, 0.7, 3, 1.0, 2.0, place.iri
    )
    told.update([thing])
    assert kitchen in places.places()[0].beliefs
    told.update([])
    assert places.places()[0] == place


def test_two_objects_of_a_kind_are_surer_to_hold_one():
    def thing(number: int, existence: float) -> ObjectRecord:
        return ObjectRecord(f"o{number}", "cup", np.zeros(3), 1.0, existence, 1, 0.0, 0.0)

    assert presence([thing(1, 0.5), thing(2, 0.5)]) == {"cup": 0.75}


def test_why_names_the_objects_and_what_the_views_say(
    semantic_map, drive, kitchen_things, scripted_scene
):
    scene = scripted_scene({"kitchen": 0.6, "office": 0.4})
    run(drive(), semantic_map, kitchen_things, scene)
    (reason,) = semantic_map.history.explain("place/1")
    steps = [step.text for _, step in reason.walk()]
    assert any("refrigerator" in text and "existence" in text for text in steps)
    assert "by the views alone 60 %" in steps
    assert any(text.startswith("5 views of the room (kitchen)") for text in steps)
    assert check_map(semantic_map.engine.quads_for_pattern(None, None, None, None)) == []


def test_unseen_rooms_are_what_rooms_of_homes_are(semantic_map):
    evidence = ObjectEvidence(semantic_map, PlaceRegistry(semantic_map), SETTINGS)
    prior = evidence.prior({})
    kind = {name: semantic_map.catalogue.find(name, "place").iri for name in ("bedroom", "office")}
    assert sum(prior.values()) == pytest.approx(1)
    assert prior[kind["bedroom"]] > 5 * prior[kind["office"]] > 0
    views = evidence.prior({kind["office"]: 0.9, kind["bedroom"]: 0.1})
    assert views[kind["office"]] > views[kind["bedroom"]]  # what was seen outweighs what is usual

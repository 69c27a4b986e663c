"""Labels of detectors and the categories that they mean."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from kg.knowledge.ontology.catalogue import shipped_ontology
from kg.model.errors import LabelsError
from mapping.labels.label_resolver import LabelMeaning, LabelTable, check_labels, load_label_table
from mapping.mapping_options import MappingOptions
from mapping.objects.object_mapper import ReferenceObjectMapper
from mapping.places.place_mapper import PlaceMapper
from mapping.places.place_registry import PlaceRegistry
from mapping.recording_mapper import map_recording
from mapping.reference.settings import ReferenceSettings
from perception.frames import SceneScores
from tests.shipped_ontology import CATALOGUE as SHIPPED

SETTINGS = ReferenceSettings(stride=1, unknown_labels="provisional")
MIDDLE = (30.0, 22.0, 34.0, 26.0)
OPEN_IMAGES = {  # names of Open Images' boxes for categories of COCO
    "Man": "person",
    "Mug": "cup",
    "Sofa bed": "couch",
    "Kitchen & dining room table": "dining table",
    "Television": "tv",
    "Computer mouse": "mouse",
    "Mobile phone": "cell phone",
    "Gas stove": "oven",
}


@pytest.fixture
def table(tmp_path):
    """Callable: text of a labels map -> LabelTable."""

    def make(text: str) -> LabelTable:
        path = tmp_path / "labels.csv"
        path.write_text(text, encoding="utf-8")
        return load_label_table(path)

    return make


@pytest.mark.parametrize(("label", "category"), OPEN_IMAGES.items())
def test_names_of_open_images_mean_categories_of_coco(label, category):
    assert SHIPPED.for_label(label, "object").label == category


@pytest.mark.parametrize(
    ("label", "category"),
    [
        ("pub/indoor", "bar"),
        ("office_cubicles", "office"),
        ("television_room", "living room"),
        ("dining_hall", "cafeteria"),
        ("parking_garage/indoor", "parking lot"),
    ],
)
def test_names_of_places365_mean_places(label, category):
    assert SHIPPED.for_label(label, "place").label == category


def test_an_unknown_object_is_mapped_as_what_the_detector_calls_it(
    semantic_map, step_back, make_detections, list_recording, scripted_detector
):
    drive = [step_back(n) for n in range(3)]
    found = make_detections(("Espresso gizmo", 0.9, MIDDLE))
    detector = scripted_detector({}, found)
    report = map_recording(
        list_recording(drive), semantic_map, detector, options=MappingOptions(reference=SETTINGS)
    )
    assert report.provisional == ("Espresso gizmo",)
    assert report.unknown_labels == {}
    (record,) = semantic_map.objects("espresso gizmo")
    assert record.observations == 3
    again = map_recording(
        list_recording(drive),
        semantic_map,
        detector,
        options=MappingOptions(reference=SETTINGS),
        again=True,
    )
    assert again.provisional == ("Espresso gizmo",)
    assert len(semantic_map.objects("espresso gizmo")) == 1


def test_a_faint_detection_makes_no_category(semantic_map, make_frame, make_detections):
    mapper = ReferenceObjectMapper(
        semantic_map, ReferenceSettings(min_score=0.5, unknown_labels="provisional")
    )
    mapper.add(make_frame(2.0), make_detections(("warp core", 0.4, MIDDLE)))
    assert semantic_map.catalogue.get("warp core") is None


def test_an_unknown_kind_of_place_is_believed_once_a_view_says_so_clearly(semantic_map, make_frame):
    mapper = PlaceMapper(semantic_map, book := PlaceRegistry(semantic_map), SETTINGS, model="net")
    frame = make_frame(2.0)
    book.observe(frame.T_map_cam[None, :3, 3] + [[0, -9, 0], [0, 9, 0], [9, 0, 0]])
    (iri,) = [place.iri for place in book.places()]
    scores = SceneScores({"kitchen": 0.35, "holodeck": 0.6, "tundra": 0.05})
    beliefs = mapper.view(iri, frame, scores).beliefs
    said = {semantic_map.catalogue.label(c): p for c, p in beliefs.items()}
    assert said == pytest.approx({"kitchen": 0.35, "holodeck": 0.6})
    assert mapper.labels.unknown_labels == {"tundra": 1}


def test_a_table_decides_what_labels_mean_and_which_mean_nothing(
    semantic_map, make_frame, make_detections, table
):
    labels = table("label,category\n# ours\nEspresso gizmo,toaster\ncup,-\n")
    mapper = ReferenceObjectMapper(semantic_map, SETTINGS, labels=labels)
    seen = make_detections(("espresso_gizmo", 0.9, MIDDLE), ("cup", 0.9, (5.0, 5.0, 9.0, 9.0)))
    mapper.add(make_frame(2.0), seen)
    (record,) = mapper.objects()
    assert semantic_map.catalogue.label(record.category) == "toaster"
    assert mapper.labels.unknown_labels == {}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "maps no label"),
        ("label,category\n", "maps no label"),
        ("cup\n", "line 1: expected label,category"),
        ("cup,mug,glass\n", "line 1: expected label,category"),
        (",cup\n", "line 1: expected label,category"),
        ("# x\nCup,bowl\ncup,vase\n", "line 3: 'cup' is given two categories"),
        ('"cup,bowl\n', "no CSV"),
    ],
)
def test_a_badly_made_table_is_refused(table, text, message):
    with pytest.raises(LabelsError, match=message):
        table(text)


def test_a_table_that_is_no_text_is_refused(tmp_path):
    path = tmp_path / "labels.csv"
    path.write_bytes(b"\xff\xfe\x00cup,bowl")
    with pytest.raises(LabelsError, match="UTF-8"):
        load_label_table(path)
    with pytest.raises(LabelsError, match="cannot read"):
        load_label_table(tmp_path / "none.csv")


@pytest.mark.parametrize(
    ("name", "message"), [("bananna", "did you mean banana"), ("food", "that is a supercategory")]
)
def test_a_table_of_unknown_categories_leaves_the_map_as_it_is(
    semantic_map,
    make_frame,
    make_detections,
    list_recording,
    scripted_detector,
    table,
    name,
    message,
):
    before = semantic_map.sequence
    detector = scripted_detector({}, make_detections())
    labels = table(f"cup,{name}\n")
    with pytest.raises(LabelsError, match=message):
        map_recording(
            list_recording([make_frame(2.0)]),
            semantic_map,
            detector,
            options=MappingOptions(labels=labels),
        )
    assert semantic_map.sequence == before


@given(st.text())
def test_any_text_is_a_table_or_a_clear_refusal(tmp_path_factory, text):
    path = tmp_path_factory.mktemp("labels") / "labels.csv"
    path.write_text(text, encoding="utf-8", errors="replace", newline="")
    try:
        assert load_label_table(path).names
    except LabelsError as error:
        assert "\n" not in str(error)


def test_labels_are_told_with_the_category_that_they_get_and_what_is_missing() -> None:
    labels = ["Chair", "coffee mug", "Armchair", "Kettle", "Windsor seat", "Chair"]
    found = check_labels(labels, shipped_ontology().catalogue)
    assert found.labels == (
        LabelMeaning("Chair", "category", "chair"),
        LabelMeaning("coffee mug", "name of a category", "cup"),
        LabelMeaning("Armchair", "new class", "chair"),
        LabelMeaning("Kettle", "new class", ""),
        LabelMeaning("Windsor seat", "provisional class", ""),
    )
    assert "vase" in found.unseen
    assert "cup" not in found.unseen

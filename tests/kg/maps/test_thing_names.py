import pytest

from kg.maps.thing_names import MAX_NAME, checked_name, nearest_category
from kg.model.errors import InvalidFactError
from kg.serving.opening import in_memory_map, open_map

CUP = (
    "INSERT DATA { <object/1> a here:Cup ; here:x 1 ; here:y 2 . "
    "<object/2> a here:Cup ; here:x 3 ; here:y 2 }"
)


@pytest.fixture
def den():
    with in_memory_map(base="https://example.org/map/") as semantic_map:
        semantic_map.update(CUP)
        yield semantic_map


def category(semantic_map, number: int = 1) -> str:
    record = semantic_map.objects()[number - 1]
    return semantic_map.catalogue.label(record.category)


@pytest.mark.parametrize("given", ["coffee machine", "Anna Müller", "コーヒー", "mug no. 2"])
def test_names_stay_as_they_are(given):
    assert checked_name(f"  {given} ") == given


NO_NAMES = (
    *("", "  ", "123", "4.5e3", "0x1F", "<b>mug</b>", "a" * (MAX_NAME + 1), "x" * 10_000),
    *("mug\n2", "m\u202eug", "\ud800x", "object/2", "Object/2", "place/1", "cup 2", "Cup 99"),
    *("https://example.org/map/object/2", "here:Cup", "urn:uuid:1"),
)


def test_what_is_no_name_is_refused_and_nothing_is_lost(den):
    before = den.sequence
    for given in NO_NAMES:
        with pytest.raises(InvalidFactError) as refused:
            den.assertions.add("object/1", "name", given, by="ann")
        assert "\n" not in str(refused.value) and len(str(refused.value)) < 300
    assert den.sequence == before and category(den) == "cup"


def test_the_label_of_an_object_is_no_name_of_another(den):
    den.assertions.add("object/2", "label", "the queen", by="ann")
    with pytest.raises(InvalidFactError, match="'the queen' is the label of one object"):
        den.assertions.add("object/1", "name", "the queen", by="ann")
    for given in ("object/1", "https://example.org/map/object/1"):
        with pytest.raises(InvalidFactError, match="'cup by the sink' would work"):
            den.assertions.add("object/2", "label", given, by="ann")
    den.assertions.add("object/1", "label", "cup", by="ann")
    den.assertions.add("object/2", "name", "cup", by="ann")  # a category that is known
    assert category(den) == "cup"


def test_a_new_word_is_a_category_below_the_nearest_known_one(den):
    den.assertions.add("object/1", "name", "my red mug", by="ann")
    assert category(den) == "my red mug"
    below = {record.iri for record in den.objects("cup")}
    assert below == {record.iri for record in den.objects()}
    (named,) = den.assertions.all("object/1")
    assert (named.property, named.by, named.since) == ("category", "ann", None)
    assert den.assertions.conflicts() == ()
    assert nearest_category(den.catalogue, "coffee machine") is None
    assert nearest_category(den.catalogue, "armchair").label == "chair"


@pytest.mark.parametrize(("given", "label"), [("Sofas", "couch"), ("remote control", "remote")])
def test_a_known_word_is_its_category(den, given, label):
    den.assertions.add("object/1", "name", given, by="ann")
    assert category(den) == label


def test_a_kind_of_place_is_no_name_of_a_thing(den):
    with pytest.raises(InvalidFactError, match="kind of place"):
        den.assertions.add("object/1", "name", "kitchen", by="ann")


def test_the_name_goes_with_its_retraction_and_the_last_use(den):
    for thing in ("object/1", "object/2"):
        den.assertions.add(thing, "name", "my mug", by="ann")
    assert den.catalogue.get("my mug") is not None
    den.assertions.retract("object/1", "category", by="ann")
    assert category(den) == "cup" and den.catalogue.get("my mug") is not None
    den.assertions.retract("object/2", "category", by="ann")
    assert category(den, 2) == "cup" and den.catalogue.get("my mug") is None


def test_a_name_is_there_when_the_map_is_opened_again(tmp_path):
    from kg.serving.opening import create_map

    with create_map(tmp_path / "den.map", base="https://example.org/map/") as semantic_map:
        semantic_map.update(CUP)
        semantic_map.assertions.add("object/1", "name", "my mug", by="ann")
    with open_map(tmp_path / "den.map") as semantic_map:
        assert category(semantic_map) == "my mug"
        semantic_map.assertions.retract("object/1", "category", by="ann")
        assert category(semantic_map) == "cup"

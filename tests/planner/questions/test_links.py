"""Links of an answer: which thing its words name."""

from collections.abc import Iterator

import pytest

from kg.maps.semantic_map import SemanticMap
from kg.serving.opening import in_memory_map
from planner.questions.answers import about
from planner.search.goals.place_names import titled_places
from tests.planner.flat import fill


@pytest.fixture
def flat() -> Iterator[SemanticMap]:
    with in_memory_map() as semantic_map:
        fill(semantic_map)
        semantic_map.assertions.add("place/3", "category", "kitchen", by="ann")
        semantic_map.assertions.add("object/2", "label", "cup 1 of two", by="ann")
        yield semantic_map


def test_a_link_has_the_longest_name_that_stands_in_the_answer(flat: SemanticMap) -> None:
    """Of each place its label and its title: label and kind where two are alike."""
    titled = titled_places(flat)
    assert sum(title.startswith(place.label) for place, title in titled) == 2
    for place, title in titled:
        for said in (place.label, title):
            (link,) = about(flat, [f"Nothing is in {said}, as far as it was seen."])
            assert link == {"iri": place.iri, "name": said}
    (link,) = about(flat, ["cup 1 of two is on the floor"])
    assert link == {"iri": f"{flat.base}object/2", "name": "cup 1 of two"}


def test_links_stand_in_the_order_of_the_words_and_no_part_of_a_word_is_a_name(
    flat: SemanticMap,
) -> None:
    bed = f"{flat.base}object/3"
    (label,) = (one["label"] for one in flat.query("objects").records() if one["object"] == bed)
    links = about(flat, [f"{label}, cup 1 of two", f"x{label}x"], ["object/1"])
    assert [one["iri"].removeprefix(flat.base) for one in links] == [
        *("object/3", "object/2", "object/1")
    ]
    assert about(flat, [f"x{label}x"]) == []

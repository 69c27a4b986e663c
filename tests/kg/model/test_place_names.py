"""Names of places: a kind is not said twice, and is known all the same."""

import pytest

from kg.model.place_names import in_brackets, likely_kind


@pytest.mark.parametrize(
    ("name", "belief", "kind", "brackets"),
    [
        ("place 4", 0.9, "home office", " (home office)"),
        ("place 4", 0.3, "perhaps home office", " (perhaps home office)"),
        ("Ann's Home-Office", 0.9, "home office", ""),
        ("icl_homeoffice", 0.9, "home office", ""),
        ("icl_homeoffice", 0.3, "perhaps home office", ""),
        ("home offices", 0.9, "home office", " (home office)"),
        ("officehome", 0.9, "home office", " (home office)"),
    ],
)
def test_a_name_that_has_its_kind_gets_no_brackets(name, belief, kind, brackets):
    beliefs = {"HomeOffice": belief, "Kitchen": 0.1}
    label = {"HomeOffice": "home office", "Kitchen": "kitchen"}.__getitem__
    assert likely_kind(beliefs, label) == kind
    assert in_brackets(name, beliefs, label) == brackets


def test_a_short_kind_at_the_end_of_a_word_is_chance() -> None:
    assert in_brackets("Marshall", {"Hall": 0.9}, {"Hall": "hall"}.__getitem__) == " (hall)"
    assert likely_kind({}, str) == in_brackets("place 1", {}, str) == ""

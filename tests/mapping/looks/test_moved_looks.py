from __future__ import annotations

import pytest

from mapping.looks.known_things import MovedLooks
from mapping.objects.settings import ObjectSettings
from mapping.objects.tracks import track_of


@pytest.fixture
def tracks(furnished):
    """Callable: (category, picture) ... -> looks of such a map, and tracks of its things."""

    def tracked(*things):
        semantic_map = furnished(*things)
        looks = MovedLooks(semantic_map.store.path, lambda shown: None)
        objects = semantic_map.objects()
        return looks, [track_of(one, ObjectSettings(), lambda category: None) for one in objects]

    return tracked


def test_a_thing_that_looks_the_same_is_likelier_it_than_one_that_does_not(tracks, cut_out):
    shown = [cut_out("banana"), cut_out("banana", 4.0), cut_out("other banana")]
    looks, (old, same, other) = tracks(*(("banana", picture) for picture in shown))
    assert looks.ratio(old, same, [other]) > 5 and looks.ratio(other, same, [old]) < 0.2


def test_a_thing_as_alike_as_another_one_says_little(tracks, cut_out):
    bears = [("teddy bear", cut_out("teddy bear", moved)) for moved in (0.0, 6.0, 12.0)]
    looks, (old, new, rival) = tracks(*bears)
    assert 1 / 3 < looks.ratio(old, new, [rival]) < 3


def test_without_a_picture_or_another_thing_looks_say_nothing(tracks, cut_out):
    looks, (old, new, other) = tracks(*[("cup", cut_out("cup"))] * 2, ("cup", b"damaged"))
    assert looks.ratio(old, new, []) == looks.ratio(old, new, [other]) == 1.0
    assert looks.ratio(old, other, [new]) == 1.0

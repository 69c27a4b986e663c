"""Place memory votes for the key frames that show the same place."""

from __future__ import annotations

import numpy as np
import pytest

from perception.odometry.features import FeatureDetector, Features, Image
from perception.odometry.key_graph import PlaceMemory
from tests.perception.box_room import papered_frame, pose

HEADINGS = (0.0, 1.6, 3.1, 4.7)


def seen(heading: float, seed: int = 0) -> Features:
    T = pose(-0.2, -0.6, heading)
    return FeatureDetector().features(Image.of(papered_frame(T, 0, seed)))


@pytest.fixture(scope="module")
def memory() -> PlaceMemory:
    made = PlaceMemory()
    for key, heading in enumerate(HEADINGS):
        made.add(key, seen(heading))
    return made


def test_a_view_beside_a_key_frame_is_similar_to_it(memory):
    everywhere = np.ones(4, np.bool_)
    for key, heading in enumerate(HEADINGS):
        assert memory.similar(seen(heading + 0.08), everywhere, 1) == [key]


def test_only_allowed_key_frames_are_named(memory):
    allowed = np.array([True, False, True, True])
    assert 1 not in memory.similar(seen(1.6), allowed, 4)
    assert memory.similar(seen(1.6), np.zeros(4, np.bool_), 4) == []


def test_no_more_than_wanted_the_best_first(memory):
    found = memory.similar(seen(3.15), np.ones(4, np.bool_), 2)
    assert found[0] == 2
    assert len(found) <= 2


def test_an_empty_view_is_similar_to_nothing(memory):
    none = seen(0.0)
    empty = Features(
        none.grey, none.samples, none.pixels[:0], none.points[:0], none.descriptors[:0]
    )
    assert memory.similar(empty, np.ones(4, np.bool_), 3) == []

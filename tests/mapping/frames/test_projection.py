"""Geometry of a camera in the map."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mapping.frames.projection import heading_of
from mapping.looks.word_looks import _view
from tests.perception.box_room import pose

COORDINATES = st.floats(-50, 50)


@given(COORDINATES, COORDINATES, st.floats(-math.pi, math.pi), st.floats(-1.4, 1.4))
def test_the_heading_is_where_a_camera_looks_seen_from_above(x, y, heading, pitch):
    T = pose(x, y, heading, pitch=pitch)
    ahead = (T @ np.array([0.0, 0.0, 1.0, 1.0]))[:2] - [x, y]
    expected = np.array([math.cos(heading), math.sin(heading)])
    assert ahead / np.linalg.norm(ahead) == pytest.approx(expected, abs=1e-6)
    shown = _view(("kitchen", "frame-1"), T, 0.5)
    for found in (heading_of(T), shown.heading):
        assert [math.cos(found), math.sin(found)] == pytest.approx(expected, abs=1e-6)
    assert (shown.x, shown.y) == (x, y)

"""The robot's pose and recordings become facts and come back."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pyoxigraph import Quad, Store

from kg.maps.facts.robot_and_recordings import recording_quads, recordings_in, robot_in, robot_quads
from kg.model.records import RecordingRecord, RobotRecord

BASE = "http://example.org/lab/"

metres = st.floats(-1e4, 1e4)
stamps = st.floats(0, 4e9)
texts = st.text(st.characters(exclude_categories=["Cs"]), min_size=1, max_size=20)


def stored(quads: list[Quad]) -> Store:
    store = Store()
    store.extend(quads)
    return store


@given(metres, metres, st.floats(-math.pi, math.pi), stamps)
def test_the_robot_comes_back(x: float, y: float, heading: float, stamp: float) -> None:
    store = stored(robot_quads(RobotRecord(np.array([x, y, 1.0]), heading, stamp), BASE))
    back = robot_in(store, BASE)
    assert back is not None
    np.testing.assert_allclose(back.p_map, [x, y, 1.0], atol=0.00501)
    assert back.heading == pytest.approx(heading, abs=0.00501)
    assert back.stamp == pytest.approx(stamp, abs=0.501)


@given(texts, st.lists(st.floats(-1e9, 1e9), min_size=16, max_size=16))
def test_a_recording_comes_back_with_its_transform_to_the_last_bit(
    name: str, numbers: list[float]
) -> None:
    record = RecordingRecord(name, 57, "frame-000056", np.array(numbers).reshape(4, 4))
    (back,) = recordings_in(stored(recording_quads(record, BASE)), BASE)
    assert (back.name, back.frames_applied, back.last_frame) == (name, 57, "frame-000056")
    np.testing.assert_array_equal(back.T_map_world, record.T_map_world)

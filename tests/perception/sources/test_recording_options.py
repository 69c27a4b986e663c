from pathlib import Path

import numpy as np
import pytest

from kg.model.errors import RecordingError
from perception.sources.listing import FrameEntry
from perception.sources.recording_options import Selection


def entry(number: int, x: float = 0.0, degrees: float = 0.0) -> FrameEntry:
    """Frame `number`, 0.1 s after the one before, at x [m] and turned about the vertical."""
    T = np.eye(4)
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    T[:2, :2] = [[c, -s], [s, c]]
    T[0, 3] = x
    return FrameEntry(str(number), Path("a.png"), Path("b.png"), T, 0.1 * number)


def chosen(selection: Selection, entries: list[FrameEntry]) -> str:
    return " ".join(one.id for one in selection.of(entries, "room"))


def test_key_frames_are_those_from_a_new_point_of_view():
    creep = [entry(n, x=0.04 * n) for n in range(8)]
    assert chosen(Selection(keyframes=True), creep) == "0 3 6"
    turn = [entry(n, degrees=2 * n) for n in range(8)]
    assert chosen(Selection(keyframes=True), turn) == "0 3 6"
    assert chosen(Selection(keyframes=True), [entry(n) for n in range(8)]) == "0"


def test_a_slow_way_there_and_back_is_measured_from_the_last_key_frame():
    way = [0.0, 0.06, 0.12, 0.06, 0.0]
    assert chosen(Selection(keyframes=True), [entry(n, x) for n, x in enumerate(way)]) == "0 2 4"


def test_times_come_first_then_key_frames_then_every_nth_then_the_limit():
    creep = [entry(n, x=0.06 * n) for n in range(20)]
    selection = Selection(every=2, limit=3, start=0.35, keyframes=True)
    assert chosen(selection, creep) == "4 8 12"


def test_nothing_selected_says_how_long_the_recording_is():
    with pytest.raises(RecordingError, match=r"no frames selected; its 3 frames last 0.20 s"):
        Selection(start=5.0).of([entry(n) for n in range(3)], "room")


@pytest.mark.parametrize(("every", "limit"), [(1, 1), (1, 4), (3, 1), (3, 4)])
def test_what_is_reached_ends_with_the_last_frame_that_is_selected(every, limit):
    entries = [entry(n) for n in range(20)]
    selection = Selection(every=every, limit=limit)
    reached = selection.reached.of(entries, "room")
    assert reached[-1] == selection.of(entries, "room")[-1]
    assert selection.thinned.of(reached, "room") == selection.of(entries, "room")

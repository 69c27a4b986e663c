"""Occupancy tiles: frames add to log-odds, from which cells are classified."""

import numpy as np
import pytest

from kg.model.records import FREE, LOW, TALL, UNKNOWN
from mapping.occupancy.occupancy_settings import OccupancySettings
from mapping.occupancy.tiles import OccupancyTile, TileEvidence, view_evidence, views_of_known

SETTINGS = OccupancySettings()
NOTHING = np.zeros((SETTINGS.side, SETTINGS.side), np.bool_)
ALL = ~NOTHING
UNVIEWED = np.zeros((2, SETTINGS.side // SETTINGS.view, SETTINGS.side // SETTINGS.view), np.bool_)
EMPTY = TileEvidence(ALL, NOTHING, NOTHING, UNVIEWED, views_only=False)
BELOW = TileEvidence(NOTHING, ALL, NOTHING, UNVIEWED, views_only=False)  # its lower part alone
TOP = TileEvidence(NOTHING, ALL, ALL, UNVIEWED, views_only=False)


def state(tile: OccupancyTile, *frames: TileEvidence) -> int:
    for frame in frames:
        tile.add(frame, 1e9, SETTINGS)
    (found,) = np.unique(tile.states(SETTINGS))
    return int(found)


def test_one_frame_that_shows_the_top_outweighs_two_of_the_lower_part() -> None:
    tile = OccupancyTile(SETTINGS)
    assert state(tile, BELOW) == LOW
    assert state(tile, TOP) == TALL
    assert state(tile, BELOW, BELOW) == TALL
    assert state(tile, BELOW) == LOW


def test_what_was_tall_for_long_becomes_low_within_nine_frames() -> None:
    tile = OccupancyTile(SETTINGS)
    assert state(tile, *[TOP] * 40) == TALL
    assert state(tile, *[BELOW] * 8) == TALL
    assert state(tile, BELOW) == LOW


@pytest.mark.parametrize(("written", "contrary"), [(FREE, TOP), (LOW, EMPTY), (TALL, EMPTY)])
def test_a_written_state_outlasts_one_frame_to_the_contrary(written, contrary):
    states = np.full(NOTHING.shape, written, np.uint8)
    tile = OccupancyTile(SETTINGS, states)
    assert state(tile) == written
    assert state(tile, contrary) in (written, UNKNOWN)
    assert state(tile, *[contrary] * 5) == (TALL if contrary is TOP else FREE)


def test_a_written_tall_cell_stays_tall_for_two_frames_of_its_lower_part() -> None:
    tile = OccupancyTile(SETTINGS, np.full(NOTHING.shape, TALL, np.uint8))
    assert state(tile, BELOW, BELOW) == TALL
    assert state(tile, BELOW) == LOW


def test_views_are_of_the_cells_that_hold_their_points() -> None:
    side = SETTINGS.cell * SETTINGS.view
    points = np.array([[0.0, side], [-0.01, 0.01], [SETTINGS.span, 0.0], [0.0, -0.01]])
    seen = dict(view_evidence(points, np.array([True, False, False, False]), SETTINGS))
    assert {key: np.argwhere(viewed).tolist() for key, viewed in seen.items()} == {
        (0, 0): [[0, 0, 1], [1, 0, 1]],
        (-1, 0): [[1, len(UNVIEWED[0]) - 1, 0]],
        (1, 0): [[1, 0, 0]],
        (0, -1): [[1, 0, len(UNVIEWED[0]) - 1]],
    }


def test_only_views_of_known_floor_count() -> None:
    states = np.full(NOTHING.shape, UNKNOWN, np.uint8)
    states[SETTINGS.view - 1, 0] = FREE
    found = views_of_known(~UNVIEWED, states, SETTINGS)
    assert found.views_only
    assert np.argwhere(found.viewed[0]).tolist() == [[0, 0]]
    tile = OccupancyTile(SETTINGS)
    tile.add(found, 1e9, SETTINGS)
    assert tile.viewed[:, 0, 0].tolist() == [int(1e9 / 60)] * 2
    assert not tile.viewed[:, 1:, :].any()
    assert (tile.states(SETTINGS) == UNKNOWN).all()

"""The readers on real recordings: poses, intrinsics and depth must fit together."""

from dataclasses import replace

import numpy as np
import pytest

from perception.frames import Frame
from perception.sources.recording import open_recording
from perception.sources.recording_options import RecordingOptions

OPTIONS = RecordingOptions(T_map_world=np.eye(4), check=False)


def reprojection_error(a: Frame, b: Frame) -> float:
    """Median |depth difference| [m] of a's points seen from b."""
    v, u = np.mgrid[0 : a.depth.shape[0] : 8, 0 : a.depth.shape[1] : 8]
    z = a.depth[v, u]
    good = np.isfinite(z) & (z < 8)
    u, v, z = u[good], v[good], z[good]
    p_a = np.linalg.inv(a.K) @ np.stack([u, v, np.ones_like(u)]) * z
    T_b_a = np.linalg.inv(b.T_map_cam) @ a.T_map_cam
    p_b = T_b_a[:3, :3] @ p_a + T_b_a[:3, 3:]
    p_b = p_b[:, p_b[2] > 0.3]
    q = b.K @ p_b
    column, row = np.rint(q[0] / q[2]).astype(int), np.rint(q[1] / q[2]).astype(int)
    height, width = b.depth.shape
    inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    difference = b.depth[row[inside], column[inside]] - p_b[2, inside]
    assert np.isfinite(difference).sum() > 500
    return float(np.nanmedian(np.abs(difference)))


@pytest.mark.parametrize(
    ("folder", "format_", "frames"),
    [
        ("redkitchen", "7scenes", 250),
        ("redkitchen_tum", "tum", 250),
        ("icl_livingroom", "trajectory-log", 71),
    ],
)
def test_poses_intrinsics_and_depth_fit_together(shared, folder, format_, frames):
    recording = open_recording(shared(f"data/rgbd/{folder}"), OPTIONS)
    assert (recording.name, recording.format, len(recording)) == (folder, format_, frames)
    for start in (0, 40):
        stream = recording.frames(start)
        sequence = [next(stream) for _ in range(5)]
        assert reprojection_error(sequence[0], sequence[4]) < 0.03


def test_both_forms_of_the_kitchen_are_one_recording(shared):
    ours = open_recording(shared("data/rgbd/redkitchen"), OPTIONS)
    tum = open_recording(shared("data/rgbd/redkitchen_tum"), OPTIONS)
    for i in (0, 100, 249):
        a, b = next(ours.frames(i)), next(tum.frames(i))
        assert a.id == b.id
        np.testing.assert_allclose(a.T_map_cam, b.T_map_cam, atol=1e-5)
        np.testing.assert_array_equal(a.depth, b.depth)
        np.testing.assert_array_equal(a.rgb, b.rgb)
        np.testing.assert_allclose(a.K, b.K)


def test_frames_can_be_read_again_from_any_index(shared):
    options = replace(OPTIONS, start_time=1.7e9)
    recording = open_recording(shared("data/rgbd/icl_livingroom"), options)
    stream = recording.frames()
    first = [next(stream) for _ in range(4)]
    again = next(recording.frames(3))
    assert [frame.id for frame in first] == ["00000", "00003", "00006", "00009"]
    np.testing.assert_array_equal(again.depth, first[3].depth)
    np.testing.assert_array_equal(again.T_map_cam, first[3].T_map_cam)
    assert [frame.stamp for frame in first] == pytest.approx(
        [1.7e9, 1.7e9 + 0.1, 1.7e9 + 0.2, 1.7e9 + 0.3], abs=1e-4
    )
    assert list(recording.frames(71)) == []


def test_colour_is_rgb_and_depth_is_metres_with_nan_for_no_return(shared):
    frame = next(open_recording(shared("data/rgbd/redkitchen"), OPTIONS).frames(60))
    cupboard = frame.rgb[230:270, 30:100].reshape(-1, 3).mean(0)
    assert cupboard[0] > 2 * cupboard[2], "the kitchen's cupboards are red"
    assert np.isnan(frame.depth).any()
    assert 0.3 < np.nanmin(frame.depth) < np.nanmax(frame.depth) < 10


def test_the_annotated_cup_is_where_the_hand_made_truth_says(shared):
    frame = next(open_recording(shared("data/rgbd/redkitchen"), OPTIONS).frames(60))
    assert frame.id == "frame-000240"
    x0, y0, x1, y1 = 213, 303, 263, 355
    z = np.nanmedian(frame.depth[y0 + 15 : y1 - 15, x0 + 15 : x1 - 15])
    centre = np.array([(x0 + x1) / 2, (y0 + y1) / 2, 1])
    p = frame.T_map_cam[:3, :3] @ (np.linalg.inv(frame.K) @ centre * z) + frame.T_map_cam[:3, 3]
    assert np.linalg.norm(p - [-0.719, -0.142, 1.905]) < 0.12


def test_original_7_scenes_files_are_registered_to_the_colour_camera(few_frames, shared):
    folder = few_frames(".color.jpg", ".depth.png", ".pose.txt", extra=["camera-intrinsics.txt"])
    raw = open_recording(folder, OPTIONS)
    made = open_recording(shared("data/rgbd/redkitchen"), OPTIONS)
    a, b = next(raw.frames(1)), next(made.frames(60))
    assert a.id == b.id == "frame-000240"
    np.testing.assert_allclose(a.T_map_cam, b.T_map_cam, atol=1e-3)
    np.testing.assert_allclose(a.K, b.K, atol=0.1)
    both = np.isfinite(a.depth) & np.isfinite(b.depth)
    assert both.sum() > 0.9 * np.isfinite(b.depth).sum()
    assert np.median(np.abs(a.depth[both] - b.depth[both])) < 0.005


def test_relative_stamps_start_at_the_opening_unless_told(shared):
    import time

    before = time.time()
    recording = open_recording(shared("data/rgbd/redkitchen_tum"), OPTIONS)
    assert before <= next(recording.frames()).stamp <= time.time()

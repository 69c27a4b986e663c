"""Jumps and drift of poses are noticed by depth, once each; sound poses are not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mapping.frames.pose_monitor import PoseMonitor
from tests.perception.box_room import pose, room_frame, round_tour


def problems(frames):
    monitor = PoseMonitor("room")
    for frame in frames:
        monitor.add(frame)
    return monitor.problems


def shifted(frame, x, y):
    T = frame.T_map_cam.copy()
    T[:2, 3] += x, y
    return replace(frame, T_map_cam=T)


def test_sound_poses_have_no_problems():
    assert problems([room_frame(T, n) for n, T in enumerate(round_tour())]) == {}


def test_a_jump_is_noticed_where_it_happens():
    frames = [room_frame(T, n) for n, T in enumerate(round_tour())]
    jumped = [f if n < 17 else shifted(f, 0.35, -0.3) for n, f in enumerate(frames)]
    found = problems(jumped)
    assert list(found) == ["jump"]
    assert "jump at frame frame-000017" in found["jump"]
    assert "--poses FILE" in found["jump"]


def test_drift_is_noticed_where_the_camera_comes_by_again():
    t = np.linspace(0, 2 * np.pi, 60)
    there = [pose(-1.2 + 0.8 * np.sin(s), -0.6 + 0.9 * np.sin(s), 0.5) for s in np.tile(t, 2)]
    frames = [room_frame(T, n) for n, T in enumerate(there)]
    assert problems(frames) == {}
    drifting = [shifted(f, 0.004 * n, 0.003 * n) for n, f in enumerate(frames)]
    assert "the poses drift" in problems(drifting)["drift"]


def test_after_a_jump_what_was_seen_before_it_tells_no_drift():
    t = np.tile(np.linspace(0, 2 * np.pi, 60), 3)
    there = [pose(-1.2 + 0.8 * np.sin(s), -0.6 + 0.9 * np.sin(s), 0.5) for s in t]
    frames = [room_frame(T, n) for n, T in enumerate(there)]
    jumped = [f if n < 62 else shifted(f, 0.35, -0.3) for n, f in enumerate(frames)]
    assert list(problems(jumped)) == ["jump"]

"""Maps of a recording by true and by estimated poses, scored side by side."""

from __future__ import annotations

import json
import subprocess
import tempfile
from pathlib import Path
from typing import Any, Final

import numpy as np

from benchmarks.odometry.accuracy import aligned
from benchmarks.recordings_in_the_wild.trial import HEREABOUTS
from perception.camera.poses import quaternion_from_pose
from perception.odometry.tracking import tracked
from perception.sources.recording import open_recording
from perception.sources.recording_options import RecordingOptions

BELIEVED: Final = 0.5  # existence from which an object counts
TRUTH: Final = "objects_full_gt.json"


def map_rows(path: str, detectors: list[str]) -> list[str]:
    """Lines with recall and precision by true and by estimated poses, for each detector."""
    recording = open_recording(path, RecordingOptions(check=False))
    frames = list(recording.frames())
    odometry = tracked(lambda: frames)
    found = [(p, f) for p, f in zip(odometry.poses(), frames, strict=True) if p is not None]
    # estimated poses in the true world, as far as a rigid motion takes them there
    T_true_estimated = aligned([(p, f.T_map_cam) for p, f in found])
    T_world_map = np.linalg.inv(recording.T_map_world)
    rows = []
    with tempfile.TemporaryDirectory() as scratch:
        for name in ("true", "estimated"):
            poses = Path(scratch) / f"{name}.txt"
            lines = []
            for estimated, frame in found:
                T = frame.T_map_cam if name == "true" else T_true_estimated @ estimated
                T = T_world_map @ T
                numbers = (frame.stamp - recording.start_time, *T[:3, 3], *quaternion_from_pose(T))
                lines.append(" ".join(f"{number:.9f}" for number in numbers))
            poses.write_text("\n".join(lines) + "\n")
            for detector in detectors:
                score = _score(path, poses, detector)
                recall, precision = score["recall"], score["precision"]
                network = Path(detector).stem
                rows.append(f"{network:24} {name:10} recall {recall} precision {precision}")
    return rows


def _score(path: str, poses: Path, detector: str) -> dict[str, Any]:
    done = subprocess.run(
        [*HEREABOUTS, "evaluate", "map", "--recording", path, "--truth", str(Path(path) / TRUTH),
         "--poses", str(poses), "--detector", detector,
         "--scene", "none", "--no-floor", "--no-check", "--json"],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    if done.returncode:
        raise SystemExit(done.stderr)
    thresholds = json.loads(done.stdout)["runs"][0]["thresholds"]
    score: dict[str, Any] = next(one for one in thresholds if one["threshold"] == BELIEVED)
    return score

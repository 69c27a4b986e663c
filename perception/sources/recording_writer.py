"""Writer of recordings in the TUM layout: frames in, a folder that `open_recording` reads out."""

from __future__ import annotations

import json
from pathlib import Path
from types import TracebackType
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from kg.model.errors import RecordingError
from perception.camera.poses import quaternion_from_pose
from perception.frames import Frame

_PNG: Final = [cv2.IMWRITE_PNG_COMPRESSION, 1, cv2.IMWRITE_PNG_STRATEGY, 3]  # fast: run lengths
DEPTH_FACTOR: Final = 5000.0  # units a metre: steps of 0.2 mm, up to 13.1 m


class RecordingWriter:
    """Writes frames of one pinhole camera into an empty folder; close it, or use `with`.

    Poses are written to the last digit, colour as it is, depth rounded to 0.2 mm. Raises
    RecordingError where the folder holds something already or cannot be written.
    """

    def __init__(self, folder: Path, *, up: tuple[float, float, float] | None = None) -> None:
        self._folder = folder
        self._lines: dict[str, list[str]] = {"rgb.txt": [], "depth.txt": [], "groundtruth.txt": []}
        self._camera: Frame | None = None
        try:
            if folder.is_dir() and any(folder.iterdir()):
                raise RecordingError(f"{folder} is not empty; a new or an empty folder would work")
            for inner in ("rgb", "depth"):
                (folder / inner).mkdir(parents=True, exist_ok=True)
            if up is not None:
                text = " ".join(f"{-c:g}" for c in up)
                (folder / "gravity-direction.txt").write_text(f"{text}\n", encoding="utf-8")
        except OSError as error:
            raise RecordingError(f"cannot write into {folder}: {error.strerror}") from error

    def __enter__(self) -> RecordingWriter:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def add(self, frame: Frame, T_world_cam: NDArray[np.float64] | None = None) -> None:
        """Write one frame, with the pose `T_world_cam` (4, 4) instead of its own if given."""
        T = frame.T_map_cam if T_world_cam is None else T_world_cam
        raw = np.round(np.nan_to_num(frame.depth, nan=0.0) * DEPTH_FACTOR)
        depth = np.where(raw < np.iinfo(np.uint16).max, raw, 0).astype(np.uint16)
        stamp = f"{frame.stamp:.6f}"
        for kind in ("rgb", "depth"):
            self._lines[f"{kind}.txt"].append(f"{stamp} {kind}/{frame.id}.png")
        self._write(self._folder / f"rgb/{frame.id}.png", frame.rgb[:, :, ::-1])
        self._write(self._folder / f"depth/{frame.id}.png", depth)
        self._lines["groundtruth.txt"].append(pose_line(frame.stamp, T))
        self._camera = self._camera or frame

    def close(self) -> None:
        """Write the lists and the intrinsics."""
        if self._camera is None:
            return
        K, (height, width) = self._camera.K, self._camera.depth.shape
        intrinsics = {
            "fx": K[0, 0],
            "fy": K[1, 1],
            "cx": K[0, 2],
            "cy": K[1, 2],
            "width": width,
            "height": height,
            "depth_scale": DEPTH_FACTOR,
        }
        write_text(self._folder / "intrinsics.json", json.dumps(intrinsics, indent=1) + "\n")
        for name, lines in self._lines.items():
            write_text(self._folder / name, "\n".join(lines) + "\n")

    @staticmethod
    def _write(path: Path, image: NDArray[np.uint8] | NDArray[np.uint16]) -> None:
        encoded, data = cv2.imencode(".png", np.ascontiguousarray(image), _PNG)
        try:
            if not encoded:
                raise RecordingError(f"cannot write {path}: the image cannot be encoded")
            path.write_bytes(data.tobytes())
        except OSError as error:
            raise RecordingError(f"cannot write {path}: {error.strerror}") from error


def pose_line(stamp: float, T: NDArray[np.float64]) -> str:
    """A line of a TUM trajectory: `stamp tx ty tz qx qy qz qw` of a pose (4, 4)."""
    numbers = [*T[:3, 3], *quaternion_from_pose(T)]
    return " ".join([f"{stamp:.6f}", *(f"{x:.15g}" for x in numbers)])


def write_text(path: Path, text: str) -> None:
    """Write a file of a recording; raises RecordingError where that fails."""
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise RecordingError(f"cannot write {path}: {error.strerror}") from error

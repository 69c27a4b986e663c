"""Real rooms: recordings of the shared data folder that have a complete truth."""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from kg.errors import RecordingError
from mapping.evaluation.complete_truth import TrueObject, load_complete_truth
from perception.frames import Frame
from perception.recordings.recording import open_recording

TRUTH: Final = "objects_full_gt.json"
_CHECKOUT: Final = Path(__file__).resolve().parents[2]


@dataclass(frozen=True, slots=True, eq=False)
class Room:
    """A recording in memory, without its colours."""

    frames: tuple[Frame, ...]
    truth: tuple[TrueObject, ...]
    T_map_world: NDArray[np.float64]  # (4, 4) takes the truth's positions to the map frame


def shared_data() -> Path:
    """The shared data folder: HEREABOUTS_SHARED, or `shared` beside the checkout."""
    folder = Path(os.environ.get("HEREABOUTS_SHARED", _CHECKOUT.parent / "shared"))
    if not folder.is_dir():
        raise RecordingError(f"no shared data at {folder}: HEREABOUTS_SHARED=FOLDER would work")
    return folder


def room_folders() -> dict[str, Path]:
    """Name -> folder of each recording with a complete truth."""
    found = sorted((shared_data() / "data/rgbd").glob(f"*/{TRUTH}"))
    return {path.parent.name: path.parent for path in found}


@lru_cache(maxsize=1)
def read_room(folder: Path) -> Room:
    """The room in `folder`; the last one read stays in memory."""
    recording = open_recording(folder)
    frames, black = list[Frame](), None
    for frame in recording.frames():
        if black is None or black.shape != frame.rgb.shape:
            black = np.zeros_like(frame.rgb)
        frames.append(replace(frame, rgb=black))
    return Room(tuple(frames), load_complete_truth(folder / TRUTH), recording.T_map_world)

"""Rigid transforms given by file: how a recording's world sits in the map."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kg.model.errors import LayoutError, RecordingError, did_you_mean
from kg.model.regular_files import read_text
from perception.camera.poses import checked_pose


def load_transform(path: Path, sequence: str) -> NDArray[np.float64]:
    """T_map_world (4, 4) of `sequence` from a JSON file {"sequences": {NAME: {"T_map_world": ..}}}.

    Raises LayoutError where there is no such file or sequence, or the matrix is not rigid.
    """
    try:
        data: Any = json.loads(read_text(path))
    except (OSError, ValueError, RecursionError) as error:
        raise LayoutError(f"cannot read transforms from {path}: {error}") from error
    sequences = data.get("sequences") if isinstance(data, dict) else None
    if not isinstance(sequences, dict):
        raise LayoutError(f'{path} has no "sequences"; {{"sequences": {{NAME: ...}}}} would work')
    entry = sequences.get(sequence)
    if entry is None:
        raise LayoutError(
            f"no sequence {sequence!r} in {path}; there are: {', '.join(sorted(sequences))}"
            + did_you_mean(sequence, sequences)
        )
    matrix = entry.get("T_map_world") if isinstance(entry, dict) else None
    where = f"T_map_world of {sequence!r} in {path}"
    try:
        return checked_pose(np.asarray(matrix, dtype=np.float64), where)
    except RecordingError as error:
        raise LayoutError(str(error)) from None
    except (TypeError, ValueError):
        raise LayoutError(f"{where} is not a matrix of numbers; 4 rows of 4 would work") from None

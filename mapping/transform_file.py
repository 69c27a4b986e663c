"""Rigid transforms given by file: how a recording's world sits in the map."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kg.model.errors import LayoutError, did_you_mean


def checked_rigid(matrix: object, what: str) -> NDArray[np.float64]:
    """`matrix` as (4, 4) doubles; LayoutError, naming `what`, unless it is a rigid transform."""
    try:
        T = np.asarray(matrix, dtype=np.float64)
    except (TypeError, ValueError):
        raise LayoutError(f"{what} is not a matrix of numbers; 4 rows of 4 would work") from None
    if T.shape != (4, 4):
        raise LayoutError(f"{what} has shape {T.shape}; 4 rows of 4 numbers would work")
    if not np.all(np.isfinite(T)):
        raise LayoutError(f"{what} holds a number that is not finite")
    R = T[:3, :3]
    upright = np.allclose(R.T @ R, np.eye(3), atol=1e-3) and np.linalg.det(R) > 0
    if not upright or not np.allclose(T[3], [0, 0, 0, 1], atol=1e-6):
        raise LayoutError(
            f"{what} is not rigid; a rotation and a translation over the row 0 0 0 1 would work"
        )
    return T


def load_transform(path: Path, sequence: str) -> NDArray[np.float64]:
    """T_map_world (4, 4) of `sequence` from a JSON file {"sequences": {NAME: {"T_map_world": ..}}}.

    Raises LayoutError where the file, the sequence or the matrix does not make sense.
    """
    try:
        data: Any = json.loads(path.read_text(encoding="utf-8"))
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
    return checked_rigid(matrix, f"T_map_world of {sequence!r} in {path}")

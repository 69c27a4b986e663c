"""Truth of some classes of things, made by hand for a recording, read from a JSON file."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from kg.model.errors import RecordingError
from kg.model.regular_files import read_text
from mapping.reference.class_scores import Truth


def load_truth(path: Path) -> Truth:
    """Read {"objects": {NAME: {"cls", "position"}}, "complete_for": [...]}.

    Raises RecordingError, naming file and entry, where that is not what is there.
    """
    try:
        data: Any = json.loads(read_text(path))
    except (OSError, ValueError, RecursionError) as error:
        raise RecordingError(f"cannot read truth from {path}: {error}") from error
    try:
        objects = data["objects"]
        positions = [entry["position"] for entry in objects.values()]
        p_world = np.array(positions, dtype=np.float64).reshape(len(positions), 3)
        labels = tuple(str(entry["cls"]) for entry in objects.values())
        complete = data.get("complete_for", [])
        if not isinstance(complete, list):
            raise TypeError(f"complete_for must be a list of labels, not {complete!r}")
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise RecordingError(
            f'{path} is no truth ({error!r}); {{"objects": {{NAME: {{"cls": LABEL, '
            '"position": [x, y, z]}}} would work'
        ) from error
    if not np.all(np.isfinite(p_world)):
        raise RecordingError(f"{path} holds a position that is not finite")
    return Truth(tuple(objects), labels, p_world, tuple(map(str, complete)))

"""Complete truth: every object of a recording, with doubtful ones marked to count neither way.

JSON, {"objects": {NAME: {...}}} with, for each entry: "cls", "position" [m] in the recording's own
world, and optionally "also" (labels that count as right too), "ignore" (counts neither way),
"extent" (width, depth, height [m]), "reach" (greatest distance of a match [m]), "moved" (since the
session before) and "on" (name of the entry that it stands on, or anything else: the floor, a wall).
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from kg.model.errors import RecordingError
from kg.model.regular_files import read_text

_KEYS: Final = frozenset({"also", "ignore", "extent", "reach"})  # that no other truth has


@dataclass(frozen=True, slots=True, eq=False)
class TrueObject:
    """One entry of a complete truth."""

    name: str
    label: str  # object category
    p_world: NDArray[np.float64]  # (3,) [m] in the recording's own world
    also: tuple[str, ...] = ()  # labels that count as right too
    ignore: bool = False  # doubtful: counts neither way
    extent: tuple[float, ...] = ()  # width, depth, height [m]; empty where unknown
    reach: float | None = None  # [m] greatest distance of a match; None: by class
    moved: bool = False  # since the session before
    on: str | None = None  # name of the entry that it stands on, or "floor"; None: not known

    def accepts(self, label: str) -> bool:
        """Whether `label` counts as right."""
        return label == self.label or label in self.also


def is_complete_truth(path: Path) -> bool:
    """Whether a truth file has any of the keys of a complete truth; False where it has no JSON."""
    try:
        objects = json.loads(read_text(path))["objects"].values()
        return any(_KEYS & entry.keys() for entry in objects)
    except (OSError, ValueError, RecursionError, AttributeError, KeyError, TypeError):
        return False


def load_complete_truth(path: Path) -> tuple[TrueObject, ...]:
    """Read a complete truth; raises RecordingError, naming file and entry, for anything else."""
    try:
        objects: Any = json.loads(read_text(path))["objects"]
        entries = tuple(objects.items())
    except (OSError, ValueError, RecursionError) as error:
        raise RecordingError(f"cannot read truth from {path}: {error}") from error
    except (AttributeError, KeyError, TypeError) as error:
        raise RecordingError(
            f'{path} is no truth; {{"objects": {{NAME: ...}}}} would work'
        ) from error
    return tuple(_entry(path, name, entry) for name, entry in entries)


def _entry(path: Path, name: str, entry: Mapping[str, Any]) -> TrueObject:
    try:
        p_world = np.array(entry["position"], dtype=np.float64).reshape(3)
        extent = tuple(float(side) for side in entry.get("extent") or ())
        reach = entry.get("reach")
        found = TrueObject(
            name=name,
            label=str(entry["cls"]),
            p_world=p_world,
            also=tuple(map(str, entry.get("also") or ())),
            ignore=bool(entry.get("ignore")),
            extent=extent,
            reach=float(reach) if reach else None,
            moved=bool(entry.get("moved")),
            on=None if entry.get("on") is None else str(entry["on"]),
        )
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise RecordingError(
            f'{path}, {name}: {error!r}; {{"cls": LABEL, "position": [x, y, z]}} would work'
        ) from error
    if not np.isfinite([*p_world, *extent]).all():
        raise RecordingError(f"{path}, {name}: holds a number that is not finite")
    return found

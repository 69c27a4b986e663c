"""The thesis' search experiment as data: rows of Table 4.5 (section 4.4), printed and corrected.

The files lie in `lab/thesis/`.
"""

from __future__ import annotations

import csv
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from kg.model.errors import LayoutError

#: Folder of the tables.
DATA = Path(__file__).resolve().parent


@dataclass(frozen=True, slots=True)
class Published:
    """Row of the thesis' Table 4.5 for one search."""

    n_r: int  # rooms explored by the ontology's rule
    n_b: int  # rooms explored by brute force
    t_r: float  # [s]
    t_b: float  # [s]


@dataclass(frozen=True, slots=True, eq=False)
class Scenario:
    """One search of Table 4.5."""

    target: str
    object_place: int  # where the object is hidden, corrected
    start: NDArray[np.float64]  # (2,) [m], corrected
    printed_object: NDArray[np.float64]  # (2,) [m]
    printed_object_place: int
    printed_start: NDArray[np.float64]  # (2,) [m]
    printed_start_place: int
    published: Published


@dataclass(frozen=True, slots=True)
class Erratum:
    """Erratum: a row of Table 4.5 that contradicts itself, and what is computed with instead."""

    target: str
    what: str  # object_place or start
    printed: str
    used: str
    why: str


def rows_of(name: str, data: Path) -> list[dict[str, str]]:
    """Rows of one CSV file; raises LayoutError where it is not there."""
    path = data / name
    if not path.is_file():
        raise LayoutError(f"no {path}: expected the thesis' tables (lab/thesis)")
    with path.open(newline="", encoding="utf-8") as lines:
        return list(csv.DictReader(lines))


def corrections(data: Path = DATA) -> tuple[Erratum, ...]:
    """Rows of Table 4.5 that contradict themselves; raises LayoutError without the data."""
    return tuple(
        Erratum(row["object"], row["what"], row["printed"], row["used"], row["why"])
        for row in rows_of("corrections.csv", data)
    )


def scenarios(data: Path = DATA) -> tuple[Scenario, ...]:
    """The 18 searches of Table 4.5, corrected; raises LayoutError without the data."""
    used = {(fix.target, fix.what): fix.used for fix in corrections(data)}
    return tuple(_scenario(row, used) for row in rows_of("search_scenarios.csv", data))


def _scenario(row: dict[str, str], used: dict[tuple[str, str], str]) -> Scenario:
    start = np.array([float(row["start_x"]), float(row["start_y"])])
    place = int(row["object_place"])
    target = row["object"]
    fixed_start = used.get((target, "start"))
    return Scenario(
        target=target,
        object_place=int(used.get((target, "object_place"), place)),
        start=start if fixed_start is None else _position(fixed_start),
        printed_object=np.array([float(row["object_x"]), float(row["object_y"])]),
        printed_object_place=place,
        printed_start=start,
        printed_start_place=int(row["start_place"]),
        published=Published(
            int(row["rooms_ontology"]),
            int(row["rooms_brute_force"]),
            float(row["seconds_ontology"]),
            float(row["seconds_brute_force"]),
        ),
    )


def _position(text: str) -> NDArray[np.float64]:
    return np.array([float(number) for number in re.findall(r"-?\d+\.\d+", text)])

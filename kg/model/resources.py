"""Folders of the shipped ontologies and queries, and shipped tables.

In an installed wheel they are data of this package. In a source checkout (and an editable install)
they are top-level folders beside the package.
"""

from __future__ import annotations

import csv
from pathlib import Path

_HERE = Path(__file__).resolve().parents[1]


def shipped_folder(name: str) -> Path:
    """The folder of shipped data called `name`: ``ontologies`` or ``queries``."""
    packaged = _HERE / name
    return packaged if packaged.is_dir() else _HERE.parent / name


def table_rows(path: Path) -> list[dict[str, str]]:
    """The rows of a shipped table (CSV)."""
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


ONTOLOGIES = shipped_folder("ontologies")
QUERIES = shipped_folder("queries")

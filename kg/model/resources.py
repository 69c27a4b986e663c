"""Folders of the shipped ontologies and queries.

In an installed wheel they are data of this package. In a source checkout (and an editable install)
they are top-level folders beside the package.
"""

from __future__ import annotations

from pathlib import Path

_HERE = Path(__file__).resolve().parents[1]


def shipped_folder(name: str) -> Path:
    """The folder of shipped data called `name`: ``ontologies`` or ``queries``."""
    packaged = _HERE / name
    return packaged if packaged.is_dir() else _HERE.parent / name


ONTOLOGIES = shipped_folder("ontologies")
QUERIES = shipped_folder("queries")

"""Where the ontologies and the queries that ship with hereabouts lie.

In an installed wheel they are data of this package; in a source checkout (and an editable install)
they are the top-level folders beside it.
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

"""Exporters: formats of `hereabouts export` that other distributions add."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from kg.maps.semantic_map import SemanticMap


@dataclass(frozen=True, slots=True)
class Exporter:
    """An export format; its name is that of its entry point in `hereabouts.exporters`."""

    ending: str  # of its files, such as ".csv"
    write: Callable[[SemanticMap, Path], str]  # writes the file; returns a summary for people

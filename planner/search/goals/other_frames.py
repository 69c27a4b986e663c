"""Other frames: targets in maps of the same server without a known way to the frame of a plan."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from kg.maps.facts.coordinate_frames import apart_from, maps_in
from kg.maps.semantic_map import SemanticMap
from kg.model.errors import QueryParameterError
from planner.search.goals.known_objects import KnownObject, known_objects
from planner.search.goals.targets import Target, resolve


def known_elsewhere(
    opened: SemanticMap, here: SemanticMap, targets: Sequence[str]
) -> Iterator[tuple[str, KnownObject]]:
    """Title of a map without a known way to the frame of `here`, and a target that is in it.

    Args:
        opened: All maps of a server, or one.
        here: The map in whose frame a search is planned.
        targets: Texts that name targets.
    """
    if len(maps_in(opened.engine)) <= 1:
        return
    for frame in apart_from(opened.engine, here.base):
        other = opened.in_one_frame(frame.map)
        for target in _resolved(other, targets):
            for known in known_objects(other, target):
                if known.iri.startswith(frame.map):
                    yield frame.title, known


def _resolved(other: SemanticMap, targets: Sequence[str]) -> tuple[Target, ...]:
    """The targets in another map; those that are the label of one thing are of the first alone."""
    try:
        return resolve(other, targets)
    except QueryParameterError:
        return ()


def elsewhere_lines(
    opened: SemanticMap, here: SemanticMap, targets: Sequence[str], address: str
) -> Iterator[str]:
    """The targets in other frames in sentences, with the command that plans a search there."""
    home, words = here.description.title, " ".join(targets)
    for title, known in known_elsewhere(opened, here, targets):
        x, y = (float(value) for value in known.p_map)
        yield (
            f"{known.label} is in the map {title}, {known.where} at ({x:.1f}, {y:.1f}) of its own "
            f"frame; no way from the map {home} to it is known "
            f"(hereabouts find {address} {words} --in-map {title})"
        )

"""Optimistic concurrency control for updates of remote writers.

A remote mapper or robot cannot lock the map between reading and writing. It sends the number of the
last transaction that it has read. An update of a thing that others changed after that transaction
is refused; the writer has to read the thing again.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator
from typing import Final

from kg.maps.facts.assertions import Assertions
from kg.maps.map_extent import check_positions, check_sides
from kg.maps.stored_map import StoredMap
from kg.model import vocabulary as v
from kg.model.errors import ConflictError, HistoryError, InvalidFactError
from kg.model.records import MapUpdate
from kg.model.transactions import Cause, ChangeSet

_MAX_NAMED: Final = 3  # things listed in one message
_NUMBER: Final = r"(?:0|[1-9][0-9]{0,14})"
#: local names of things, N being a number
_NAMES: Final = {
    "object": "object/N",
    "place": "place/N",
    "door": "door/N-N",
    "search": "search/N",
    "look": "search/N/look/N",
    "obstacle": "search/N/obstacle/N",
}
_MAX_AHEAD: Final = 1_000_000  # of a new object number, from the next free one
_WATCHED: Final = {v.MAP_GRAPH.value, v.DATASET_GRAPH.value}


def apply_remote_update(
    semantic_map: StoredMap,
    update: MapUpdate,
    cause: Cause,
    *,
    known_sequence: int | None,
    own: Collection[int] = (),
) -> ChangeSet | None:
    """Apply `update`, whose writer has read up to `known_sequence` and made the transactions `own`.

    Without `known_sequence` the update is applied unconditionally. If an error is raised, nothing
    is written:

    - ConflictError, if others changed a thing that the update writes
    - InvalidFactError, for a thing of another map, or far from all that this one knows
    """
    with semantic_map.hold():
        _check_things(semantic_map, update)
        _check_where(semantic_map, update)
        if known_sequence is not None and known_sequence != semantic_map.sequence:
            _check_conflicts(semantic_map, update, known_sequence, own)
        return semantic_map.apply(update, cause)


def _check_conflicts(
    semantic_map: StoredMap, update: MapUpdate, known_sequence: int, own: Collection[int]
) -> None:
    base = semantic_map.base
    # all writers replace the robot's pose and the number of the next object
    writes = semantic_map.written_by(update) - {base, f"{base}robot"}
    try:
        touched = _touched(semantic_map, known_sequence, own) & writes
    except HistoryError as error:
        raise ConflictError(
            f"the changes since #{known_sequence} are not known: {error}", writes
        ) from error
    if touched:
        named = ", ".join(sorted(iri.removeprefix(base) for iri in touched)[:_MAX_NAMED])
        more = f" and {len(touched) - _MAX_NAMED} more" if len(touched) > _MAX_NAMED else ""
        raise ConflictError(
            f"others have changed {named}{more} since #{known_sequence}; read it again",
            sorted(touched),
        )


def _touched(semantic_map: StoredMap, known_sequence: int, own: Collection[int]) -> set[str]:
    """The things that others changed after the transaction `known_sequence`."""
    if known_sequence > semantic_map.sequence:
        raise HistoryError(f"the map is at #{semantic_map.sequence}")
    assertions = Assertions(semantic_map.base)
    found: set[str] = set()
    for change in semantic_map.history.changes(known_sequence):
        quads = () if change.sequence in own else (*change.added, *change.removed)
        for quad in quads:
            iri = getattr(quad.subject, "value", "")
            if getattr(quad.graph_name, "value", "") in _WATCHED:
                found.add(iri)
            elif (about := assertions.subject(iri)) is not None:
                found.add(about)
    return found


def _check_things(semantic_map: StoredMap, update: MapUpdate) -> None:
    """Raise InvalidFactError for records of things of another map."""
    base = semantic_map.base
    highest = semantic_map.next_object + _MAX_AHEAD
    unusual = {
        (iri, kind) for iri, kind in _things(update, base) if not _is_own(base, iri, kind, highest)
    }
    if not unusual:
        return
    # persons may have added things with other names
    known = {(record.iri, "object") for record in semantic_map.perceived.objects()}
    known |= {(record.iri, "place") for record in semantic_map.perceived.places()}
    known |= {(record.iri, "door") for record in semantic_map.doors()}
    for iri, kind in sorted(unusual - known):
        raise InvalidFactError(
            f"{iri[:200]!r} is no {kind} of this map; a new one is called {base}{_NAMES[kind]}"
        )


def _check_where(semantic_map: StoredMap, update: MapUpdate) -> None:
    """Raise InvalidFactError for positions and sizes that no object of this map has."""
    engine, base = semantic_map.engine, semantic_map.base
    check_positions(engine, [one.p_map.tolist() for one in update.objects], "position of an object")
    boxes = [(one.iri, one.extent) for one in update.objects if one.extent is not None]
    check_sides(engine, [(iri.removeprefix(base), sides.tolist()) for iri, sides in boxes])


def _things(update: MapUpdate, base: str) -> Iterator[tuple[str, str]]:
    yield from ((record.iri, "object") for record in update.objects)
    for iri in update.removed:
        kind = iri.removeprefix(base).partition("/")[0]
        yield iri, kind if kind in ("place", "door") else "object"
    yield from ((place.iri, "place") for place in update.places)
    if update.search is not None:
        yield update.search.iri, "search"
    for kind, records in (("look", update.looks), ("obstacle", update.obstacles)):
        yield from ((record.iri, kind) for record in records)
        yield from ((record.search, "search") for record in records)


def _is_own(base: str, iri: str, kind: str, highest: int) -> bool:
    """Whether an IRI has the form of a thing of this map; object numbers up to `highest`."""
    local = iri.removeprefix(base)
    if local == iri or not re.fullmatch(_NAMES[kind].replace("N", _NUMBER), local):
        return False
    return kind != "object" or int(local.removeprefix("object/")) <= highest

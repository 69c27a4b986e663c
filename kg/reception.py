"""What a mapper or a robot writes from afar, let in by the map it is for.

Its writer works on what it has read, and cannot keep others from writing meanwhile. So it says up
to where it has heard of them: where somebody else has changed since then what it would write,
nothing is written, and it has to look again.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator
from typing import Final

from kg import vocabulary as v
from kg.assertions import Assertions
from kg.commits import Cause, ChangeSet
from kg.errors import ConflictError, HistoryError, InvalidFactError
from kg.records import MapUpdate
from kg.semantic_map import SemanticMap

_TOLD: Final = 3  # things named in one message
_NUMBER: Final = r"(?:0|[1-9][0-9]{0,14})"
#: what things are called in their map, N being a number
_NAMES: Final = {
    "object": "object/N",
    "place": "place/N",
    "search": "search/N",
    "look": "search/N/look/N",
    "obstacle": "search/N/obstacle/N",
}
_AHEAD: Final = 1_000_000  # a number this far beyond the next one would use them up
_WATCHED: Final = {v.MAP_GRAPH, v.DATASET_GRAPH}


def receive(
    semantic_map: SemanticMap,
    update: MapUpdate,
    cause: Cause,
    *,
    seen: int | None,
    own: Collection[int] = (),
) -> ChangeSet | None:
    """Apply `update`, whose writer has heard of the transactions up to `seen` and made those `own`.

    Without `seen` it insists, whatever others wrote. Raises ConflictError where others changed what
    it writes, InvalidFactError for what is no thing of this map; nothing is then written.
    """
    with semantic_map.hold():
        _refuse_strange(semantic_map, update)
        if seen is not None and seen != semantic_map.sequence:
            _refuse_conflicts(semantic_map, update, seen, own)
        return semantic_map.write(update, cause)


def _refuse_conflicts(
    semantic_map: SemanticMap, update: MapUpdate, seen: int, own: Collection[int]
) -> None:
    base = semantic_map.base
    # where the robot is, and how many objects there are, each writer says anew
    writes = semantic_map.written_by(update) - {base, f"{base}robot"}
    try:
        touched = _touched(semantic_map, seen, own) & writes
    except HistoryError as error:
        raise ConflictError(f"what changed since #{seen} is not known: {error}", writes) from error
    if touched:
        named = ", ".join(sorted(iri.removeprefix(base) for iri in touched)[:_TOLD])
        more = f" and {len(touched) - _TOLD} more" if len(touched) > _TOLD else ""
        raise ConflictError(
            f"others have changed {named}{more} since #{seen}; read it anew", sorted(touched)
        )


def _touched(semantic_map: SemanticMap, seen: int, own: Collection[int]) -> set[str]:
    """The things that others changed after the transaction `seen`."""
    if seen > semantic_map.sequence:
        raise HistoryError(f"the map is at #{semantic_map.sequence}")
    assertions = Assertions(semantic_map.base)
    found: set[str] = set()
    for change in semantic_map.changes(seen):
        if change.sequence in own:
            continue
        for quad in (*change.added, *change.removed):
            iri = getattr(quad.subject, "value", "")
            if getattr(quad.graph_name, "value", "") in _WATCHED:
                found.add(iri)
            elif (about := assertions.subject(iri)) is not None:
                found.add(about)
    return found


def _refuse_strange(semantic_map: SemanticMap, update: MapUpdate) -> None:
    """Refuse records of things that are no objects, places or searches of this map."""
    base = semantic_map.base
    most = semantic_map.next_object + _AHEAD
    strange = {(iri, kind) for iri, kind in _things(update) if not _is_own(base, iri, kind, most)}
    if not strange:
        return
    # people may have given things of their own other names
    known = {(record.iri, "object") for record in semantic_map.perceived_objects()}
    known |= {(record.iri, "place") for record in semantic_map.perceived_places()}
    for iri, kind in sorted(strange - known):
        raise InvalidFactError(
            f"{iri[:200]!r} is no {kind} of this map; a new one is called {base}{_NAMES[kind]}"
        )


def _things(update: MapUpdate) -> Iterator[tuple[str, str]]:
    yield from ((record.iri, "object") for record in update.objects)
    yield from ((iri, "object") for iri in update.removed)
    yield from ((place.iri, "place") for place in update.places)
    if update.search is not None:
        yield update.search.iri, "search"
    for kind, records in (("look", update.looks), ("obstacle", update.obstacles)):
        yield from ((record.iri, kind) for record in records)
        yield from ((record.search, "search") for record in records)


def _is_own(base: str, iri: str, kind: str, most: int) -> bool:
    """Whether a thing is called as one of the map is; of objects with a number up to `most`."""
    local = iri.removeprefix(base)
    if local == iri or not re.fullmatch(_NAMES[kind].replace("N", _NUMBER), local):
        return False
    return kind != "object" or int(local.removeprefix("object/")) <= most

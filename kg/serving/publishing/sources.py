"""Source of a copy: all quads of one state of a map, from its folder or its server."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

from pyoxigraph import Literal, Quad, RdfFormat, parse

from kg.maps.semantic_map import SemanticMap
from kg.model import vocabulary as v
from kg.rdf.skolem import named
from kg.serving.client.remote_map import RemoteMap

DUMP_WITHIN: Final = 600.0  # [s] to read a served map
MAX_DUMP: Final = 8 << 30  # [bytes]


@dataclass(frozen=True, slots=True)
class SourceSnapshot:
    """Quads of a map after transaction `sequence`, without blank nodes and the number."""

    sequence: int
    quads: tuple[Quad, ...]


def snapshot_of(semantic_map: SemanticMap) -> SourceSnapshot:
    """The current state of a map; raises RemoteError if its server breaks off."""
    sequence, quads = 0, []
    for quad in _stored(semantic_map):
        if quad.predicate.value == v.SEQUENCE and isinstance(quad.object, Literal):
            sequence = int(quad.object.value)
        else:
            quads.append(quad)
    return SourceSnapshot(sequence, tuple(named(quads)))


def _stored(semantic_map: SemanticMap) -> Iterable[Quad]:
    if not isinstance(semantic_map, RemoteMap):
        return semantic_map.engine
    dump = semantic_map.dump(seconds=DUMP_WITHIN, max_bytes=MAX_DUMP)
    return parse(dump, format=RdfFormat.N_QUADS)

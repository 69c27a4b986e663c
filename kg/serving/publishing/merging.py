"""Merge of several maps into one store in memory, so that a query can join over all of them."""

from __future__ import annotations

from collections.abc import Sequence

from kg.maps.frame_view import is_one_frame, quads_in_one_frame
from kg.maps.semantic_map import SemanticMap
from kg.maps.stored_map import StoredMap
from kg.model.errors import GraphError
from kg.serving.opening import open_map
from kg.serving.publishing.sources import snapshot_of
from kg.store.transactional import TransactionalStore
from kg.store.type_inference import complete_types


def merged(addresses: Sequence[str]) -> SemanticMap:
    """The maps at `addresses`, folders or servers, as one read-only map.

    IRIs are unique to each map, so their facts stay apart in the same graphs; relative IRIs of a
    query are those of the first map. Maps with a known transform to the frame of the first are
    moved into it; the others keep their own coordinates. Raises GraphError where two are the same
    map, or one cannot be read.
    """
    bases: dict[str, str] = {}
    store = TransactionalStore.in_memory((), read_only=True)
    for address in addresses:
        with open_map(address, read_only=True) as member:
            if member.base in bases:
                raise GraphError(
                    f"{address} is the same map as {bases[member.base]} ({member.base}); "
                    "give each map once"
                )
            bases[member.base] = address
            store.native.bulk_extend(snapshot_of(member).quads)
    if not bases:
        raise GraphError("no map to merge was given")
    complete_types(store.native)
    home = next(iter(bases))
    if is_one_frame(store.engine, home):
        return StoredMap(store, base=home)
    quads = quads_in_one_frame(store.engine, home, rest=True)
    return StoredMap(TransactionalStore.in_memory(quads, read_only=True), base=home)

"""Deletion guard: a change that removes a large share of a map needs a confirmation.

The history can restore a deletion, but `DELETE WHERE {?s ?p ?o}` is usually a mistake. The guard
counts objects and places, not triples, and refuses a change that removes more than
`DeletionLimit.count` of them and more than `DeletionLimit.share` of all.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

from pyoxigraph import NamedNode, Quad

from kg.maps.facts.objects_and_places import RecordCodec
from kg.maps.update.change_draft import ChangeDraft
from kg.maps.update.implicit_assertions import Read, categories
from kg.model import vocabulary as v
from kg.model.errors import UnconfirmedDeletionError
from kg.rdf.quad_store import Subject

_PLACE: Final = NamedNode(v.PLACE)


@dataclass(frozen=True, slots=True)
class DeletionLimit:
    """The largest deletion without confirmation; a deletion within either bound passes."""

    share: float = 0.1  # of all objects and places of the map, 0 to 1
    count: int = 10  # objects and places together


def check_confirmed(pending: ChangeDraft, facts: RecordCodec, limit: DeletionLimit) -> None:
    """Raise UnconfirmedDeletionError if `pending` removes more than `limit`."""
    lost = len(removed_things(pending, facts))
    if lost <= limit.count:
        return
    # no local variable for the iterator: the traceback would take it to another thread
    total = len(things_in(pending.before(None, v.RDF_TYPE, None, v.MAP_GRAPH), facts))
    if lost > limit.share * total:
        raise UnconfirmedDeletionError(
            f"this would delete {lost} of {total} objects and places, and nothing was written; "
            "confirm it with --yes (over HTTP the header Here-Confirm: delete, in Python "
            "confirmed=True), or delete fewer"
        )


def removed_things(pending: ChangeDraft, facts: RecordCodec) -> frozenset[Subject]:
    """Objects and places that the change removes."""
    before = things_in(pending.removed, facts)
    return frozenset(s for s in before if not _is_thing(pending.after, facts, s))


def added_things(pending: ChangeDraft, facts: RecordCodec) -> frozenset[Subject]:
    """Objects and places that the change adds."""
    after = things_in(pending.added, facts)
    return frozenset(s for s in after if not _is_thing(pending.before, facts, s))


def things_in(quads: Iterable[Quad], facts: RecordCodec) -> frozenset[Subject]:
    """Objects and places in `quads`: subjects that have such a type in graph:map."""
    return frozenset(
        quad.subject
        for quad in quads
        if quad.predicate == v.RDF_TYPE
        and quad.graph_name == v.MAP_GRAPH
        and (quad.object == _PLACE or facts.catalogue.by_iri(getattr(quad.object, "value", "")))
    )


def is_place(read: Read, facts: RecordCodec, subject: Subject) -> bool:
    """Whether a subject is a place in the state that `read` reads."""
    types = {quad.object for quad in read(subject, v.RDF_TYPE, None, v.MAP_GRAPH)}
    if _PLACE in types or not isinstance(subject, NamedNode):
        return _PLACE in types
    return bool(categories(read, facts, subject, "place"))


def _is_thing(read: Read, facts: RecordCodec, subject: Subject) -> bool:
    return bool(things_in(read(subject, v.RDF_TYPE, None, v.MAP_GRAPH), facts))

"""Identity switches: how often the object that matches a true object becomes another one.

As in CLEAR MOT (Bernardin and Stiefelhagen, 2008): after each transaction an object keeps the true
object that it matched before as long as it still may; the rest is matched nearest first. A true
object whose last match was another object counts one switch.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any, Final

from kg.maps.facts.objects_and_places import RecordCodec
from kg.maps.semantic_map import SemanticMap
from kg.model.records import ObjectRecord
from kg.model.transactions import ChangeSet
from kg.model.vocabulary import MAP_GRAPH
from mapping.evaluation.truth_matching import MappedObject, TruthMatcher

SHOWN: Final = 0.5  # existence from which an object takes part


def identity_switches(states: Iterable[Iterable[MappedObject]], matcher: TruthMatcher) -> int:
    """Number of switches over the states of a map, in order of time."""
    switches = 0
    last: dict[int, str] = {}  # true object -> IRI of its last match
    current: dict[int, str] = {}
    for state in states:
        shown = {o.iri: o for o in state if o.existence >= SHOWN}
        current = _correspondences(shown, current, matcher)
        switches += sum(last.get(i, iri) != iri for i, iri in current.items())
        last |= current
    return switches


def object_states(semantic_map: SemanticMap, since: int = 0) -> Iterator[tuple[ObjectRecord, ...]]:
    """The objects of a map after each transaction behind number `since` that changed one.

    Raises HistoryError where the map does not keep all of its past.
    """
    quads: dict[str, set[Any]] = {}  # of graph:map, by subject
    records: dict[str, ObjectRecord] = {}
    codec = RecordCodec(semantic_map.base, semantic_map.catalogue)
    for change in semantic_map.history.changes():
        changed = _apply(change, quads)
        found = {o.iri: o for iri in changed for o in codec.objects_among(quads[iri])}
        gone = changed & records.keys() - found.keys()
        for iri in gone:
            del records[iri]
        records |= found
        if (found or gone) and change.sequence > since:
            yield tuple(records.values())


def _apply(change: ChangeSet, quads: dict[str, set[Any]]) -> set[str]:
    """Apply a transaction to `quads`; returns the subjects that it changed."""
    changed = set()
    for edit, facts in ((set.discard, change.removed), (set.add, change.added)):
        for quad in facts:
            subject = str(getattr(quad.subject, "value", quad.subject))
            if quad.graph_name == MAP_GRAPH:
                edit(quads.setdefault(subject, set()), quad)
                changed.add(subject)
    return changed


def _correspondences(
    shown: Mapping[str, MappedObject], before: Mapping[int, str], matcher: TruthMatcher
) -> dict[int, str]:
    """True object -> IRI of its match: those of `before` that still hold, then the nearest."""
    kept = {i: iri for i, iri in before.items() if iri in shown and matcher.matches(shown[iri], i)}
    left = [o for iri, o in shown.items() if iri not in kept.values()]
    pairs = matcher.pairs(left, range(len(left)), taken=kept)
    return kept | {pair.true: left[pair.mapped].iri for pair in pairs}

"""Missed objects: what looks of a search should have shown and did not loses existence."""

from __future__ import annotations

from collections.abc import Sequence

from kg.records import ObjectRecord
from mapping.objects.object_mapper import ObjectChanges
from planner.execution.object_updates import ObjectUpdates
from planner.execution.search_log import SearchLog
from planner.execution.viewpoint_adapter import ViewpointAdapter


def decay_missed(
    records: Sequence[ObjectRecord],
    objects: ObjectUpdates,
    adapter: ViewpointAdapter,
    log: SearchLog,
) -> ObjectChanges:
    """Changes to those of `records` that later looks of the search covered in vain."""
    changes = ObjectChanges()
    for record in records:
        times = sum(
            adapter.shows(look, record.p_map)
            for look in log.looks
            if look.stamp > record.last_seen and not look.found
        )
        if times and record.iri not in log.record.found:
            changes = changes.followed_by(objects.decay(record.iri, times, adapter.recall))
    return changes

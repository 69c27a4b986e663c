"""Tasks of a worker on a map's history: past states, changes of a thing, differences, explanations.

A worker reads the history's file while another process writes it. One request reads one state.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from contextlib import closing, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from pyoxigraph import Store

from kg.history.map_state import Categories, present_state, state_after
from kg.history.point_in_time import PastStates, difference
from kg.history.reports.comparison import compare, timeline
from kg.history.reports.events import (
    comparison_text,
    difference_text,
    history_events,
    log_text,
    reasons_text,
)
from kg.history.reports.explanation import explain_fact
from kg.history.reports.prov_export import provenance
from kg.history.storage.log import HistoryLog
from kg.history.timestamps import iso, thing
from kg.maps.facts.robot import recordings_in
from kg.serving.client.record_codec import (
    comparison_to_json,
    difference_to_json,
    entry_to_json,
    reason_to_json,
    timeline_to_json,
)

JSON: Final = "application/json"
TEXT: Final = "text/plain"
TURTLE: Final = "text/turtle"


def past_store(states: PastStates, store: Store, request: Mapping[str, Any]) -> Store:
    """The state right after the transaction ``at``; `store` is a snapshot of the map."""
    with _frozen(request) as log:
        return states.at(log, store, int(request["at"]))


def history_report(store: Store, request: Mapping[str, Any]) -> str:
    """A report on the history, in the media type of the request."""
    with _frozen(request) as log:
        return _REPORTS[request["what"]](store, log, request)


def _log(store: Store, log: HistoryLog, request: Mapping[str, Any]) -> str:
    base = request["base"]
    entries = list(history_events(log, store, thing(request["iri"], base), base))
    if request["told"]:
        entries = [entry for entry in entries if entry.told]
    if request["last"] is not None:
        entries = entries[max(0, len(entries) - int(request["last"])) :]
    if request["media_type"] == TEXT:
        return log_text(entries)
    return _dumped([entry_to_json(entry) for entry in entries])


def _diff(store: Store, log: HistoryLog, request: Mapping[str, Any]) -> str:
    before, after = int(request["before"]), int(request["after"])
    log.check_kept(min(before, after))
    base, is_text = request["base"], request["media_type"] == TEXT
    if request["facts"]:
        facts = difference(log, before, after)
        return difference_text(facts, base) if is_text else _dumped(difference_to_json(facts))
    found = compare(log, Categories.of(store), base, before, after, request["far"])
    found = replace(found, surface=tuple(request["surface"]))
    return comparison_text(found) if is_text else _dumped(comparison_to_json(found))


def _timeline(store: Store, log: HistoryLog, request: Mapping[str, Any]) -> str:
    base = request["base"]
    state = present_state(store, Categories.of(store), base)
    there = {base + row["iri"] for row in state["objects"]}
    return _dumped(timeline_to_json(timeline(log, base, there)))


def map_state(store: Store, sequence: int, request: Mapping[str, Any]) -> str:
    """The state of the map that a page draws: after the transaction ``at``, or of `store`."""
    categories, base = Categories.of(store), request["base"]
    head: dict[str, object] = {"sequence": request.get("at", sequence)}
    head |= {"surface": request["surface"], "categories": categories.by_kind()}
    head["poses"] = [one.pose_estimate for one in recordings_in(store, base) if one.pose_estimate]
    if "at" in request:
        with _frozen(request) as log:
            state = state_after(log, int(request["at"]), categories, base)
            head["time"] = iso(log.time_of(int(request["at"])))
    else:
        state = present_state(store, categories, base)
    if not request["objects"]:
        del state["objects"], state["things"]
    return _dumped(head | state)


def _why(store: Store, log: HistoryLog, request: Mapping[str, Any]) -> str:
    reasons = explain_fact(store, log, request["base"], request["about"])
    if request["media_type"] == TURTLE:
        return provenance(*reasons)
    if request["media_type"] == TEXT:
        return reasons_text(reasons)
    return _dumped([reason_to_json(reason) for reason in reasons])


_REPORTS: Final[dict[str, Callable[[Store, HistoryLog, Mapping[str, Any]], str]]] = {
    "log": _log,
    "diff": _diff,
    "timeline": _timeline,
    "why": _why,
}


@contextmanager
def _frozen(request: Mapping[str, Any]) -> Iterator[HistoryLog]:
    """The history in one read transaction, unchanged by concurrent writes and pruning."""
    file, base = Path(request["log"]), request["base"]
    with closing(HistoryLog.open(file, base, read_only=True, live=True)) as log:
        log.db.execute("PRAGMA temp_store = MEMORY")  # a worker writes no files
        log.db.execute("BEGIN")
        log.refresh()
        yield log


def _dumped(report: object) -> str:
    return json.dumps(report, ensure_ascii=False) + "\n"

"""What a worker does with a map's history: ask it, make a state of it, and tell what is asked.

It reads the history's file beside whoever writes it, all of a request from one state of it.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import closing, contextmanager
from itertools import chain, islice
from pathlib import Path
from typing import Any, Final

from pyoxigraph import Quad, Store

from kg.history.instants import refuse_dropped
from kg.history.log import Log
from kg.history.moment import Moment
from kg.history.naming import thing
from kg.history.outline import difference_text, log_text, reasons_text
from kg.history.past import Difference, difference, quads_at
from kg.history.provenance import provenance
from kg.history.telling import tell
from kg.history.why import explain
from kg.store import sequence_quad, stored_sequence
from kg.wire import difference_to_json, entry_to_json, reason_to_json

JSON: Final = "application/json"
TEXT: Final = "text/plain"
TURTLE: Final = "text/turtle"
_AT_ONCE = 10_000  # quads of one transaction
_MUCH = 0.2  # share of a map that is sooner written anew than taken out
_KEPT = 100_000  # facts of a moment that may stay in memory; the rest of it is for queries


class LastMoment:
    """The moment that was asked last, kept for who asks of it again."""

    def __init__(self) -> None:
        self._moment: Moment | None = None

    @contextmanager
    def asked(self, store: Store, request: Mapping[str, Any]) -> Iterator[Moment]:
        """The moment ``at`` of a map that says what `store` does now, or did a while since."""
        sequence = int(request["at"])
        if self._moment is None or self._moment.sequence != sequence:
            self._moment = None
        with _frozen(request) as log:
            refuse_dropped(log, sequence)
            moment, self._moment = self._moment or Moment(log, lambda: store, sequence), None
            moment.log, moment.engine = log, lambda: store
            yield moment
        moment.engine = Store  # a snapshot that nobody reads any more is let go
        if len(moment) <= _KEPT:
            self._moment = moment


def make_past(store: Store, request: Mapping[str, Any]) -> None:
    """Change a copy of the map to what the map said right after the transaction `sequence`."""
    sequence, present = int(request["sequence"]), stored_sequence(store)
    with _frozen(request) as log:
        refuse_dropped(log, sequence)
        changed = difference(log, present, sequence)
        if len(changed.removed) > len(store) * _MUCH and present >= sequence:
            quads = quads_at(log, store, sequence)
            first = next(quads, None)  # now it has been read
            store.clear()
            store.bulk_extend(chain([] if first is None else [first], quads))
        else:
            _undo(store, changed, present, sequence)
    store.flush()


def _undo(store: Store, changed: Difference, present: int, sequence: int) -> None:
    number = (sequence_quad(present),) if present else ()
    for some in _parts((*number, *changed.removed)):
        store.update(f"DELETE DATA {{ {' '.join(map(_block, some))} }}")
    store.bulk_extend((*changed.added, *([sequence_quad(sequence)] if sequence else [])))


def tell_of_past(store: Store, request: Mapping[str, Any]) -> str:
    """What is asked of the past, in the media type that is asked for."""
    with _frozen(request) as log:
        return _TELLERS[request["what"]](store, log, request)


def _log(store: Store, log: Log, request: Mapping[str, Any]) -> str:
    base = request["base"]
    entries = list(tell(log, thing(request["iri"], base), base))
    if request["last"] is not None:
        entries = entries[max(0, len(entries) - int(request["last"])) :]
    if request["media_type"] == TEXT:
        return log_text(entries)
    return _dumped([entry_to_json(entry) for entry in entries])


def _diff(store: Store, log: Log, request: Mapping[str, Any]) -> str:
    before, after = int(request["before"]), int(request["after"])
    refuse_dropped(log, min(before, after))
    found = difference(log, before, after)
    if request["media_type"] == TEXT:
        return difference_text(found, request["base"])
    return _dumped(difference_to_json(found, request["base"]))


def _why(store: Store, log: Log, request: Mapping[str, Any]) -> str:
    reasons = explain(store, log, request["base"], request["about"])
    if request["media_type"] == TURTLE:
        return provenance(*reasons)
    if request["media_type"] == TEXT:
        return reasons_text(reasons)
    return _dumped([reason_to_json(reason) for reason in reasons])


_TELLERS: Final[dict[str, Callable[[Store, Log, Mapping[str, Any]], str]]] = {
    "log": _log,
    "diff": _diff,
    "why": _why,
}


@contextmanager
def _frozen(request: Mapping[str, Any]) -> Iterator[Log]:
    """The history as it is now, whatever is written to it and dropped from it meanwhile."""
    with closing(Log.open(Path(request["log"]), request["base"], read_only=True)) as log:
        log.db.execute("PRAGMA temp_store = MEMORY")  # a worker writes no files
        log.db.execute("BEGIN")
        log.refresh()
        yield log


def _parts(quads: Iterable[Quad]) -> Iterator[list[Quad]]:
    rest = iter(quads)
    while some := list(islice(rest, _AT_ONCE)):
        yield some


def _block(quad: Quad) -> str:
    return f"GRAPH {quad.graph_name} {{ {quad.triple} }}"


def _dumped(told: object) -> str:
    return json.dumps(told, ensure_ascii=False) + "\n"

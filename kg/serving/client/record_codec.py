"""JSON encoding of assertions, transactions, change sets and explanations, in both directions.

The server encodes, `kg.serving.client` decodes. Quads and terms are N-Quads; times are ISO 8601 in
UTC.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict
from typing import Any, TypeVar, get_args

from pyoxigraph import Quad, RdfFormat, parse

from kg.history.point_in_time import Difference
from kg.history.reports.comparison import Comparison, Timeline
from kg.history.reports.events import HistoryEvent
from kg.history.reports.explanation import Explanation
from kg.history.reports.explanation import Kind as ReasonKind
from kg.history.timestamps import iso, moment
from kg.maps.update.restoration import Restored
from kg.model.errors import InvalidFactError, RemoteError
from kg.model.records import Assertion
from kg.model.transactions import Cause, ChangeSet, Kind
from kg.serving.client.update_codec import codec_of

Json = dict[str, Any]
A = TypeVar("A")
T = TypeVar("T")


#: errors of the decoders for a reply of another form
_FOREIGN = (KeyError, TypeError, ValueError, SyntaxError, RecursionError, InvalidFactError)


def decoded_reply(where: str, decode: Callable[[A], T], reply: A) -> T:
    """Decode a reply of the server `where`; raises RemoteError for another form."""
    try:
        return decode(reply)
    except _FOREIGN as error:
        raise RemoteError(
            f"{where} sent a reply that is not of this version of `hereabouts serve` "
            f"({type(error).__name__})"
        ) from error


def assertion_to_json(assertion: Assertion) -> Json:
    """An assertion, with perception's estimate of the same property."""
    return {
        "thing": assertion.subject,
        "property": assertion.property,
        "value": assertion.value,
        "by": assertion.by,
        "time": iso(assertion.stamp),
        "perceived": assertion.perceived,
        "strength": assertion.strength,
        "contradicted": assertion.since is not None,
        "since": None if assertion.since is None else iso(assertion.since),
        "beliefs": dict(assertion.beliefs),
    }


def assertion_from_json(data: Mapping[str, Any]) -> Assertion:
    """The inverse of `assertion_to_json`."""
    return Assertion(
        subject=data["thing"],
        property=data["property"],
        value=data["value"],
        by=data["by"],
        stamp=moment(data["time"]),
        perceived=data["perceived"],
        strength=data["strength"],
        since=None if data["since"] is None else moment(data["since"]),
        beliefs=data["beliefs"],
    )


def cause_to_json(cause: Cause) -> Json:
    """The cause of a transaction: kind, author, note."""
    return {"kind": cause.kind, "by": cause.by, "note": cause.note}


def cause_from_json(data: Mapping[str, Any]) -> Cause:
    """The inverse of `cause_to_json`."""
    if data["kind"] not in get_args(Kind):
        raise RemoteError(f"a transaction of an unknown kind, {data['kind']!r}")
    return Cause(data["kind"], data["by"], data["note"])


def change_to_json(change: ChangeSet) -> Json:
    """A change set, its quads as N-Quads, a line each."""
    return {
        "sequence": change.sequence,
        "time": iso(change.time),
        "cause": cause_to_json(change.cause),
        "removed": lines(change.removed),
        "added": lines(change.added),
        **({"notes": list(change.notes)} if change.notes else {}),
    }


def change_from_json(data: Mapping[str, Any]) -> ChangeSet:
    """The inverse of `change_to_json`."""
    cause, time = cause_from_json(data["cause"]), moment(data["time"])
    added, removed = quads_from_lines(data["added"]), quads_from_lines(data["removed"])
    notes = tuple(map(str, data.get("notes", ())))
    return ChangeSet(data["sequence"], time, cause, added, removed, notes)


def restored_from_json(data: Mapping[str, Any]) -> Restored:
    """The inverse of the reply of `/restore`: counts of a restoration."""
    restored: Restored = codec_of(Restored).decode(data, "restored")
    return restored


def entry_to_json(entry: HistoryEvent) -> Json:
    """A history event: one transaction, as far as it concerns one thing."""
    return {
        "sequence": entry.sequence,
        "time": iso(entry.time),
        **cause_to_json(entry.cause),
        "changes": list(entry.changes),
        "told": list(entry.told),
        "cause": entry.cause_words,
    }


def entry_from_json(data: Mapping[str, Any]) -> HistoryEvent:
    """The inverse of `entry_to_json`."""
    changes = tuple(data["changes"])
    told = tuple(data["told"]) if "told" in data else changes
    cause = cause_from_json(data)
    words = str(data.get("cause", f"{cause.kind} {cause.note}".strip()))
    return HistoryEvent(data["sequence"], moment(data["time"]), cause, changes, told, words)


def difference_to_json(found: Difference) -> Json:
    """A difference between two states as quads."""
    return {
        "before": found.before,
        "after": found.after,
        "added": lines(found.added),
        "removed": lines(found.removed),
    }


def difference_from_json(data: Mapping[str, Any]) -> Difference:
    """The inverse of `difference_to_json`."""
    added, removed = quads_from_lines(data["added"]), quads_from_lines(data["removed"])
    return Difference(data["before"], data["after"], added, removed)


def comparison_to_json(found: Comparison) -> Json:
    """The changes of objects and rooms between two moments."""
    changes = [
        {**asdict(one), "metres": None if one.metres is None else round(one.metres, 3)}
        for one in found.changes
    ]
    return {**asdict(found), "changes": changes}


def comparison_from_json(data: Mapping[str, Any]) -> Comparison:
    """The inverse of `comparison_to_json`."""
    changes = [{name: told[name] for name in told.keys() - {"metres"}} for told in data["changes"]]
    found: Comparison = codec_of(Comparison).decode({**data, "changes": changes}, "comparison")
    return found


def timeline_to_json(found: Timeline) -> Json:
    """A timeline, with times as ISO 8601."""
    return {
        "first": _moment_to_json(*found.first),
        "last": _moment_to_json(*found.last),
        "spans": [[iso(start), iso(end)] for start, end in found.spans],
        "marks": [{**asdict(mark), "time": iso(mark.time)} for mark in found.marks],
    }


def _moment_to_json(sequence: int, time: float) -> Json:
    return {"sequence": sequence, "time": iso(time)}


def reason_to_json(reason: Explanation) -> Json:
    """An explanation, with the reasons it is based on."""
    return {
        "kind": reason.kind,
        "text": reason.text,
        "iri": reason.iri,
        "fact": None if reason.fact is None else [str(term) for term in reason.fact],
        "time": None if reason.time is None else iso(reason.time),
        "because": [reason_to_json(inner) for inner in reason.because],
    }


def reason_from_json(data: Mapping[str, Any]) -> Explanation:
    """The inverse of `reason_to_json`."""
    if data["kind"] not in {kind for choice in get_args(ReasonKind) for kind in get_args(choice)}:
        raise RemoteError(f"a reason of an unknown kind, {data['kind']!r}")
    fact = None
    if data["fact"] is not None:
        (quad,) = quads_from_lines([" ".join(data["fact"]) + " ."])
        fact = quad.subject, quad.predicate, quad.object
    time = None if data["time"] is None else moment(data["time"])
    because = tuple(reason_from_json(inner) for inner in data["because"])
    return Explanation(data["kind"], data["text"], data["iri"], because, fact, time)


def lines(quads: Iterable[Quad]) -> list[str]:
    """Quads as N-Quads, a line each."""
    return [f"{quad} ." for quad in quads]


def quads_from_lines(data: Iterable[str]) -> tuple[Quad, ...]:
    """The inverse of `lines`."""
    return tuple(parse("\n".join(data).encode(), format=RdfFormat.N_QUADS))

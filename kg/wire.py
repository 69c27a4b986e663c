"""What a served map tells as JSON, there and back: assertions, transactions, changes, reasons.

The server writes it, `kg.served` reads it. Quads and terms are N-Quads; times ISO 8601 in UTC.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any, TypeVar, get_args

from pyoxigraph import Quad, RdfFormat, parse

from kg.commits import Cause, ChangeSet, Kind
from kg.errors import RemoteError
from kg.history.instants import iso, moment
from kg.history.past import Difference
from kg.history.telling import Entry
from kg.history.why import Kind as ReasonKind
from kg.history.why import Reason
from kg.records import Assertion

Json = dict[str, Any]
A = TypeVar("A")
T = TypeVar("T")
_ROW = ("change", "subject", "predicate", "before", "after")


def understood(where: str, read: Callable[[A], T], told: A) -> T:
    """What `read` makes of what was told at `where`; RemoteError where that is none of ours."""
    try:
        return read(told)
    except (KeyError, TypeError, ValueError, SyntaxError, RecursionError) as error:
        raise RemoteError(
            f"{where} answered what no `hereabouts serve` of this version answers "
            f"({type(error).__name__})"
        ) from error


def assertion_to_json(said: Assertion) -> Json:
    """What somebody said, and what perception believes of it."""
    return {
        "thing": said.subject,
        "property": said.property,
        "value": said.value,
        "by": said.by,
        "time": iso(said.stamp),
        "perceived": said.perceived,
        "strength": said.strength,
        "contradicted": said.since is not None,
        "since": None if said.since is None else iso(said.since),
        "beliefs": dict(said.beliefs),
    }


def assertion_of(told: Mapping[str, Any]) -> Assertion:
    """What `assertion_to_json` was given."""
    return Assertion(
        subject=told["thing"],
        property=told["property"],
        value=told["value"],
        by=told["by"],
        stamp=moment(told["time"]),
        perceived=told["perceived"],
        strength=told["strength"],
        since=None if told["since"] is None else moment(told["since"]),
        beliefs=told["beliefs"],
    )


def cause_to_json(cause: Cause) -> Json:
    """Why a transaction was made."""
    return {"kind": cause.kind, "by": cause.by, "note": cause.note}


def cause_of(told: Mapping[str, Any]) -> Cause:
    """What `cause_to_json` was given."""
    if told["kind"] not in get_args(Kind):
        raise RemoteError(f"a transaction of an unknown kind, {told['kind']!r}")
    return Cause(told["kind"], told["by"], told["note"])


def change_to_json(change: ChangeSet) -> Json:
    """A change set, its quads as N-Quads, a line each."""
    return {
        "sequence": change.sequence,
        "time": iso(change.time),
        "cause": cause_to_json(change.cause),
        "removed": lines(change.removed),
        "added": lines(change.added),
    }


def change_of(told: Mapping[str, Any]) -> ChangeSet:
    """What `change_to_json` was given."""
    cause, time = cause_of(told["cause"]), moment(told["time"])
    added, removed = quads_of(told["added"]), quads_of(told["removed"])
    return ChangeSet(told["sequence"], time, cause, added, removed)


def entry_to_json(entry: Entry) -> Json:
    """One transaction, as far as it concerns one thing."""
    return {
        "sequence": entry.sequence,
        "time": iso(entry.time),
        **cause_to_json(entry.cause),
        "changes": list(entry.changes),
    }


def entry_of(told: Mapping[str, Any]) -> Entry:
    """What `entry_to_json` was given."""
    return Entry(told["sequence"], moment(told["time"]), cause_of(told), tuple(told["changes"]))


def rows_to_json(found: Difference, base: str) -> list[Json]:
    """What differs, in words, by thing."""
    return [dict(zip(_ROW, row, strict=True)) for row in found.rows(base)]


def difference_to_json(found: Difference, base: str) -> Json:
    """What differs, in words and as quads."""
    return {
        "before": found.before,
        "after": found.after,
        "changes": rows_to_json(found, base),
        "added": lines(found.added),
        "removed": lines(found.removed),
    }


def difference_of(told: Mapping[str, Any]) -> Difference:
    """What `difference_to_json` was given."""
    added, removed = quads_of(told["added"]), quads_of(told["removed"])
    return Difference(told["before"], told["after"], added, removed)


def reason_to_json(reason: Reason) -> Json:
    """A step of an explanation, and all behind it."""
    return {
        "kind": reason.kind,
        "text": reason.text,
        "iri": reason.iri,
        "fact": None if reason.fact is None else [str(term) for term in reason.fact],
        "time": None if reason.time is None else iso(reason.time),
        "because": [reason_to_json(behind) for behind in reason.because],
    }


def reason_of(told: Mapping[str, Any]) -> Reason:
    """What `reason_to_json` was given."""
    if told["kind"] not in {kind for choice in get_args(ReasonKind) for kind in get_args(choice)}:
        raise RemoteError(f"a reason of an unknown kind, {told['kind']!r}")
    fact = None
    if told["fact"] is not None:
        (quad,) = quads_of([" ".join(told["fact"]) + " ."])
        fact = quad.subject, quad.predicate, quad.object
    time = None if told["time"] is None else moment(told["time"])
    because = tuple(reason_of(behind) for behind in told["because"])
    return Reason(told["kind"], told["text"], told["iri"], because, fact, time)


def lines(quads: Iterable[Quad]) -> list[str]:
    """Quads as N-Quads, a line each."""
    return [f"{quad} ." for quad in quads]


def quads_of(told: Iterable[str]) -> tuple[Quad, ...]:
    """What `lines` was given."""
    return tuple(parse("\n".join(told).encode(), format=RdfFormat.N_QUADS))

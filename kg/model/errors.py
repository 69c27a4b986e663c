"""All errors that hereabouts raises on purpose, in one tree.

    HereaboutsError
    ├── GraphError               the store on disk cannot be opened, read or written
    │   ├── MapNotFoundError     no map at that path
    │   ├── MapBusyError         another process is writing the map
    │   ├── DiskFullError        the disk of the map has no space
    │   ├── HistoryError         a past state is not kept, or the log cannot be read
    │   ├── ConflictError        another writer changed the same facts in the meantime
    │   ├── InvalidFactError     a record cannot become facts (not finite, unknown class, ...)
    │   │   ├── ShapeError       an update breaks a SHACL shape or uses an undeclared term
    │   │   ├── ProtectedError   an update writes facts that have another way to be written
    │   │   └── UnconfirmedDeletionError   a large deletion is not confirmed
    │   └── RemoteError          a server refuses, fails, or breaks off its answer
    │       ├── UnreachableError no server answers at the address
    │       └── NotAllowedError  a server wants a token, or only reads
    ├── QueryError               a query cannot be evaluated
    │   ├── UnknownQueryError    no query file of that name
    │   ├── QueryParameterError  a parameter is missing, unknown or malformed
    │   ├── QueryRefusedError    a query reaches outside the map, writes, or nests too deeply
    │   ├── QueryTimeoutError    a query reached its time limit
    │   ├── QueryTooLargeError   a query reached its limit of memory or of result bytes
    │   ├── EngineFailureError   the query engine failed
    │   ├── WorkerDiedError      a worker was ended by something other than its limits
    │   ├── NotAcceptableError   no accepted format can carry the answer
    │   └── PoolBusyError        all query workers are busy and the queue is full
    ├── OntologyError            an ontology does not parse, or breaks its shapes
    │   ├── UnknownCategoryError no category has that label
    │   │   └── UndetectableError  the word is known, and no category includes such things
    │   └── ConceptNetError      ConceptNet, or a file of it, cannot be read
    ├── RecordingError           a recording cannot be read: poses, images, intrinsics
    │   └── FrameError           a frame or its detections are invalid; a ValueError too
    ├── ModelError               a network cannot be loaded, fetched or understood
    ├── LayoutError              a file of places or transforms is invalid
    ├── LabelsError              a table of the labels of a network is invalid
    ├── RobotError               a robot does not answer, or breaks the protocol
    ├── ExtensionError           an extension of another distribution cannot be used
    ├── ServerError              a server cannot start as configured, or refuses a request
    └── PictureError             a picture or a file for viewers cannot be written

A message is one line: the fault, the given value, and a value that would work. The command line
prints the message after ``error:`` and exits with 1. Any other exception is a bug and keeps its
traceback.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping


class HereaboutsError(Exception):
    """Root of all errors that are not bugs."""


class GraphError(HereaboutsError):
    """The store on disk cannot be opened, read or written."""


class MapNotFoundError(GraphError):
    """There is no map at that path."""


class MapBusyError(GraphError):
    """Another process holds the map, or maps the same recording into it."""


class DiskFullError(GraphError):
    """The disk of the map has no space; nothing was written. It works again when there is some."""


class HistoryError(GraphError):
    """A past state of the map is not kept, or the log cannot be read."""


class ConflictError(GraphError):
    """Another writer changed the same facts after they were read; nothing was written.

    `things` has the IRIs of the changed objects and places. Read them again and retry.
    """

    def __init__(self, message: str, things: Iterable[str] = ()) -> None:
        super().__init__(message)
        self.things = tuple(things)


class InvalidFactError(GraphError):
    """A record cannot become facts of the map."""


class ShapeError(InvalidFactError):
    """An update would break a SHACL shape, or uses a term that no ontology declares."""


class ProtectedError(InvalidFactError):
    """An update writes facts that have another way to be written; the message names it."""


class UnconfirmedDeletionError(InvalidFactError):
    """A change would delete a large share of the map, and its author has not confirmed it."""


class RemoteError(GraphError):
    """A server that holds a map refuses, fails, or breaks off its answer."""


class UnreachableError(RemoteError):
    """Nothing answers at the address of a server."""


class NotAllowedError(RemoteError):
    """A server refuses this user: it wants a token, or only reads."""


class QueryError(HereaboutsError):
    """A query does not parse or cannot be evaluated."""


class UnknownQueryError(QueryError):
    """No query file has that name."""


class QueryParameterError(QueryError):
    """A parameter of a query is missing, unknown or malformed."""


class QueryRefusedError(QueryError):
    """An untrusted query reaches outside the map, writes, is too long or nested too deeply."""


class QueryTimeoutError(QueryError):
    """A query was stopped at its time limit."""


class QueryTooLargeError(QueryError):
    """A query was stopped at its limit of memory, or of result bytes."""


class EngineFailureError(QueryError):
    """The query engine failed during the evaluation of a query: a defect of the engine."""


class WorkerDiedError(QueryError):
    """A worker was ended by something other than its limits."""


class NotAcceptableError(QueryError):
    """The client accepts no format that can carry the answer."""


class PoolBusyError(QueryError):
    """All query workers are busy and the queue is full."""


class OntologyError(HereaboutsError):
    """An ontology does not parse, or breaks its own shapes."""


class UnknownCategoryError(OntologyError):
    """No category has that label."""


class UndetectableError(UnknownCategoryError):
    """The word is known, and no category includes such things: no detector can see them."""


class ConceptNetError(OntologyError):
    """ConceptNet, or a file of it, cannot be read: unreachable, wrong format, or truncated."""


class RecordingError(HereaboutsError):
    """A recording cannot be read."""


class FrameError(RecordingError, ValueError):
    """A frame or its detections are invalid: shapes, types, depth, pose, intrinsics, stamp."""


class ModelError(HereaboutsError):
    """A network cannot be loaded, fetched or understood."""


class LayoutError(HereaboutsError):
    """A file of places or transforms is invalid."""


class LabelsError(HereaboutsError):
    """A table of the labels of a network cannot be read, or names no category."""


class RobotError(HereaboutsError):
    """A robot cannot be reached, falls silent, or does not speak the protocol."""


class ExtensionError(HereaboutsError):
    """An extension of another distribution cannot be imported, or has the wrong type."""


class ServerError(HereaboutsError):
    """A server cannot start as configured (host, port, token file), or refuses a request."""


class PictureError(HereaboutsError):
    """A picture or a viewer's file cannot be written: unknown format, or no such folder."""


def did_you_mean(given: str, known: Iterable[str], shown: Mapping[str, str] | None = None) -> str:
    """A clause that names the known name of the closest spelling, or an empty string.

    Case does not matter. `shown` has the text to show for each name, if it is not the name itself.

    >>> did_you_mean("bananna", ["banana", "apple"])
    '; did you mean banana?'
    """
    names = {name.lower(): (shown or {}).get(name, name) for name in reversed(list(known))}
    close = difflib.get_close_matches(given.lower(), names, n=1, cutoff=0.6)
    return f"; did you mean {names[close[0]]}?" if close else ""


def in_one_line(error: object) -> str:
    """The message of an error of somebody else's code in one line; its type where it has none."""
    return " ".join(str(error).split()) or type(error).__name__

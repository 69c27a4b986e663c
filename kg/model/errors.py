"""Every error hereabouts raises on purpose, in one tree.

    HereaboutsError
    ├── GraphError               the store on disk
    │   ├── MapNotFoundError     no map at that path
    │   ├── MapBusyError         another process is writing it
    │   ├── HistoryError         a past that is not kept, or a log that cannot be read
    │   ├── ConflictError        somebody else has changed meanwhile what would be written
    │   ├── InvalidFactError     a record that cannot become facts (not finite, unknown class, ...)
    │   │   ├── ShapeError       an update that would leave the map badly made
    │   │   ├── ProtectedError   an update of what is not written that way
    │   │   └── UnconfirmedDeletionError   a large deletion that nobody confirmed
    │   └── RemoteError          a server that refuses, fails, or breaks off its answer
    │       └── UnreachableError nothing answers at the address
    ├── QueryError               a query that cannot be evaluated
    │   ├── UnknownQueryError    no query file of that name
    │   ├── QueryParameterError  missing, unknown or malformed parameter
    │   ├── QueryRefusedError    reaches outside the map, writes, or is nested too deeply
    │   ├── QueryTimeoutError    stopped at its time limit
    │   ├── QueryTooLargeError   stopped at its limit of memory or of result bytes
    │   ├── EngineFailureError   the query engine broke down on it
    │   ├── NotAcceptableError   no format the asker accepts can carry the answer
    │   └── PoolBusyError        all query workers are busy and the queue is full
    ├── OntologyError            an ontology that does not parse, or breaks its shapes
    │   ├── UnknownCategoryError a label no category carries; says which come close
    │   └── ConceptNetError      ConceptNet, or a file of it, that cannot be read
    ├── RecordingError           a recording that cannot be read: poses, images, intrinsics
    │   └── FrameError           a frame, or its detections, that cannot be mapped; a ValueError too
    ├── ModelError               a network that cannot be loaded, fetched or understood
    ├── LayoutError              places or transforms given by file that make no sense
    ├── LabelsError              a table of what a network's labels mean that makes no sense
    ├── RobotError               a robot that does not answer, or says what makes no sense
    ├── ExtensionError           an extension of another distribution that cannot be used
    ├── ServerError              a server that cannot start as configured, or a request it refuses
    └── PictureError             a picture or a file for viewers that cannot be written

A message is one line: what was wrong, what was given, and what would have worked. The command line
prints it after ``error:`` and exits with 1. Anything outside this tree is a bug and keeps its
traceback.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class HereaboutsError(Exception):
    """Root of all errors that are not bugs."""


class GraphError(HereaboutsError):
    """The store on disk cannot be opened, read or written."""


class MapNotFoundError(GraphError):
    """There is no map at that path."""


class MapBusyError(GraphError):
    """Another process holds the map, or maps the same recording into it."""


class HistoryError(GraphError):
    """A past that the map does not keep, or a log of it that cannot be read."""


class ConflictError(GraphError):
    """Others changed what was to be written after the writer had read it; nothing was written.

    `things` has the IRIs of what they changed. Reading it anew, and writing what follows from
    that, would work.
    """

    def __init__(self, message: str, things: Iterable[str] = ()) -> None:
        super().__init__(message)
        self.things = tuple(things)


class InvalidFactError(GraphError):
    """A record that cannot become facts of the map."""


class ShapeError(InvalidFactError):
    """An update from outside would break a shape, or use a term that no ontology declares."""


class ProtectedError(InvalidFactError):
    """An update from outside would write what is kept by other means; says by which."""


class UnconfirmedDeletionError(InvalidFactError):
    """A change would delete a large share of the map, and its author has not confirmed it."""


class RemoteError(GraphError):
    """A server that holds a map refuses, fails, or breaks off its answer."""


class UnreachableError(RemoteError):
    """Nothing answers at the address of a server."""


class QueryError(HereaboutsError):
    """A query that does not parse or cannot be evaluated."""


class UnknownQueryError(QueryError):
    """No query file of that name."""


class QueryParameterError(QueryError):
    """A parameter of a query is missing, unknown or malformed."""


class QueryRefusedError(QueryError):
    """An untrusted query reaches outside the map, writes, is too long or nested too deeply."""


class QueryTimeoutError(QueryError):
    """A query was stopped at its time limit."""


class QueryTooLargeError(QueryError):
    """A query was stopped at its limit of memory, or of result bytes."""


class EngineFailureError(QueryError):
    """The query engine broke down while it evaluated a query: a defect of the engine."""


class NotAcceptableError(QueryError):
    """The asker accepts no format that can carry the answer."""


class PoolBusyError(QueryError):
    """All query workers are busy, and as many queries wait already as may."""


class OntologyError(HereaboutsError):
    """An ontology does not parse, or breaks its own shapes."""


class UnknownCategoryError(OntologyError):
    """No category carries that label."""


class ConceptNetError(OntologyError):
    """ConceptNet, or a file of it, cannot be read: not reached, not its format, broken off."""


class RecordingError(HereaboutsError):
    """A recording cannot be read."""


class FrameError(RecordingError, ValueError):
    """A frame or its detections cannot be right: shapes, types, depth, pose, intrinsics, stamp."""


class ModelError(HereaboutsError):
    """A network cannot be loaded, fetched or understood."""


class LayoutError(HereaboutsError):
    """Places or transforms given by file make no sense."""


class LabelsError(HereaboutsError):
    """A table of what a network's labels mean cannot be read, or names no category."""


class RobotError(HereaboutsError):
    """A robot cannot be reached, falls silent, or does not speak the protocol."""


class ExtensionError(HereaboutsError):
    """An extension that another distribution adds cannot be imported, or is none."""


class ServerError(HereaboutsError):
    """A server cannot start as configured (host, port, token file), or refuses a request."""


class PictureError(HereaboutsError):
    """A picture or a viewer's file cannot be written: unknown format, or nowhere to write to."""


def did_you_mean(given: str, known: Iterable[str]) -> str:
    """A clause that names up to three close spellings, or an empty string.

    >>> did_you_mean("bananna", ["banana", "apple"])
    '; did you mean banana?'
    """
    close = difflib.get_close_matches(given.lower(), list(known), n=3, cutoff=0.6)
    return f"; did you mean {' or '.join(close)}?" if close else ""

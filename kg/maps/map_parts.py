"""Protocols of the parts of a map, which a map in a store and a map on a server implement.

A part is made at its first use (`lazy`), so that a question passes no code of writers.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Iterator
from typing import TYPE_CHECKING, Any, Generic, Protocol, TypeVar, cast

from pyoxigraph import Quad

from kg.history.point_in_time import Difference
from kg.history.reports.comparison import FAR, Comparison
from kg.history.storage.log import HistoryLog
from kg.history.timestamps import Instant
from kg.model.records import Assertion
from kg.model.room_edit import RoomEdit
from kg.model.transactions import ChangeSet

if TYPE_CHECKING:
    from kg.history.reports.events import HistoryEvent
    from kg.history.reports.explanation import Explanation
    from kg.history.storage.maintenance import Compaction
    from kg.knowledge.ontology.replacement import Replacement


T = TypeVar("T")
_LOCK = threading.RLock()


# lazy initialisation: made once for all threads, unless it was assigned; the attribute's own
# docstring is the one to show
class _LazyPart(Generic[T]):
    def __init__(self, make: Callable[[Any], T]) -> None:
        self._make = make

    def __set_name__(self, owner: type, name: str) -> None:
        self._name = name

    def __get__(self, instance: object, owner: type) -> T:
        if instance is None:
            raise AttributeError(self._name)  # of the class, as an attribute that is only declared
        with _LOCK:
            made: dict[str, T] = vars(instance)
            if self._name not in made:
                made[self._name] = self._make(instance)
            return made[self._name]


def lazy(make: Callable[[Any], T]) -> T:
    """An attribute of a class that `make` makes of the instance at its first use."""
    return cast(T, _LazyPart(make))


class MapHistory(Protocol):
    """The transactions of a map, what they changed, and the reasons for its facts.

    All methods raise HistoryError for a past that is not kept.
    """

    @property
    def log(self) -> HistoryLog:
        """The log of all transactions; HistoryError where it is not in this process."""

    def changes(self, since: int = 0) -> Iterator[ChangeSet]:
        """Change sets numbered above `since`, in order."""

    def state_of(self, iri: str, when: Instant) -> tuple[Quad, ...]:
        """All quads about one thing at `when`, without replaying the whole map."""

    def diff(self, t1: Instant, t2: Instant) -> Difference:
        """The quads of `t2` that `t1` lacks, and the other way round.

        A time `t1` before the history begins means the first moment that it keeps.
        """

    def compare(self, t1: Instant, t2: Instant | None = None, far: float = FAR) -> Comparison:
        """The objects that appeared, are gone, moved or have another name, from `t1` to `t2`.

        `t1` is as for `diff`, `t2` is now by default; `far` [m] is the shortest move
        (`kg.history.reports.comparison`).
        """

    def events(self, iri: str) -> Iterator[HistoryEvent]:
        """The history events of one thing, one a transaction; `iri` may be short (object/17)."""

    def explain(self, what: str) -> tuple[Explanation, ...]:
        """The explanation of a thing (object/17), or of a fact ("object/17 here:inPlace").

        Terms may be short (`kg.history.timestamps`). A map without a history explains what it can.
        Raises QueryParameterError for a fact that the map never had.
        """

    def compact(self, keep: float | None = None) -> Compaction:
        """Drop the past older than `keep` seconds (None: keep all), and pack the history."""

    def retain(self, keep: float) -> None:
        """Retain the last `keep` seconds of history while the map is open; drop older ones.

        Raises GraphError where the map is read-only.
        """


class MapOntology(Protocol):
    """The ontology of a map."""

    def quads(self) -> tuple[Quad, ...]:
        """The quads of the ontology, with blank nodes, sorted."""

    def replace(
        self, quads: Iterable[Quad], *, by: str | None = None, whole: bool = False
    ) -> Replacement:
        """Replace the ontology by `quads` in one transaction, while the map is in use.

        Facts that were written directly into graph:commonsense stay. Raises OntologyError, with
        nothing changed, if the quads are malformed, lack terms that the map uses, or (without
        `whole`) leave out ontologies of the map. `kg.knowledge.ontology.diagnostics` reads and
        validates files.
        """

    def learn(self, labels: Iterable[str], kind: str, *, model: str) -> dict[str, str]:
        """The IRI of a category for each label of a network; labels like "none" are left out.

        Labels without a category of that `kind` ("object" or "place") get a provisional one, in one
        transaction of `model`. Labels without a printable character are ignored.
        """

    def reread(self) -> None:
        """Read the categories from the store again at their next use."""


class MapAssertions(Protocol):
    """Assertions of persons about objects and places; they override perception."""

    def all(self, iri: str | None = None) -> tuple[Assertion, ...]:
        """Assertions, with the perceived values; of one thing or of all."""

    def conflicts(self) -> tuple[Assertion, ...]:
        """The assertions that perception contradicts, with time and strength of the conflict."""

    def add(self, iri: str, prop: str, value: object, *, by: str = "") -> ChangeSet | None:
        """Assert a property, which overrides perception until it is retracted.

        - `iri`: an object or place; ``object/17`` is short for its IRI
        - `prop`: of an object category, position, extent, existence, label, on or inside; of a
          place category, label or area. The name of an object asserts the category of that name,
          and adds it to the ontology below the nearest known one if it is new
        - `value`: a category's label or IRI, (x, y, z) [m], (dx, dy, dz, yaw) [m, rad],
          "present" or "absent", a label, or an object
        - `by`: the author; on a server the holder of the token

        Raises UnknownCategoryError, and InvalidFactError for unknown things, invalid properties or
        values, and a missing author.
        """

    def retract(self, iri: str, prop: str, *, by: str | None = None) -> ChangeSet | None:
        """Retract an assertion: perception's estimate takes effect again.

        Raises InvalidFactError if there is no such assertion.
        """


class MapRooms(Protocol):
    """Edits of the rooms of a map by persons; they outrank the rooms found in the floor."""

    def edit(self, edit: RoomEdit, *, by: str = "") -> ChangeSet | None:
        """Apply an edit in one transaction; None if nothing changed.

        `by` is the author; on a server the holder of the token. Raises InvalidFactError, with
        nothing written, if the edit is not possible.
        """

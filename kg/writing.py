"""What a map is written by: records of a mapper, updates, what people say, ontologies, labels."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Collection, Iterable, Iterator

from pyoxigraph import Quad

from kg.blank_nodes import anonymous
from kg.categories import Catalogue
from kg.commits import Cause, ChangeSet
from kg.consequences import draw_consequences
from kg.door import Door
from kg.editing.inspection import refuse_malformed
from kg.editing.taking_in import Taken, take_in
from kg.facts import Facts
from kg.identity import identity
from kg.ontology import Ontology
from kg.outside import work_out
from kg.provisional import clean, learn
from kg.reading import Reading
from kg.records import MapUpdate
from kg.sayings import Sayings
from kg.store import MapStore
from kg.writer import Writer

LONGEST_NOTE = 500  # characters of an update kept with its transaction


class Writing(Reading):
    """A map that is written, by one thread at a time."""

    def __init__(
        self, store: MapStore, *, base: str | None = None, catalogue: Catalogue | None = None
    ) -> None:
        super().__init__(store)
        self._guard = threading.RLock()
        self.base, self.title = identity(store, base)
        self.catalogue = catalogue or Catalogue.from_store(store.engine)
        self._facts = Facts(self.base, self.catalogue)
        self._writer = Writer(store, self._facts)
        self._sayings = Sayings(store, self._facts, self._writer)
        self._door: Door | None = None  # made when somebody first comes

    def new_object_iri(self) -> str:
        """``<base>object/N`` with a number no object of this map has had or will have."""
        with self._guard:
            return self._writer.new_object_iri()

    @property
    def next_object(self) -> int:
        """The number of the next object."""
        with self._guard:
            return self._writer.next_number

    def place_iri(self, number: int) -> str:
        """``<base>place/N``."""
        return f"{self.base}place/{number}"

    def apply(self, update: MapUpdate, cause: Cause | None = None) -> int:
        """Write what changed in one transaction; returns the number of triples that changed.

        Without a `cause` it is the mapper's, for the frame that `update` says. Raises
        InvalidFactError, with nothing written, where a record cannot become facts.
        """
        change = self.write(update, cause)
        return len(change) if change else 0

    def write(self, update: MapUpdate, cause: Cause | None = None) -> ChangeSet | None:
        """As `apply`; returns the transaction."""
        with self._guard:
            return self._writer.change(update, cause or frame_cause(update))

    def written_by(self, update: MapUpdate) -> frozenset[str]:
        """IRIs of the things whose facts `update` may change."""
        return frozenset(node.value for node in self._writer.subjects(update))

    def update(
        self, sparql: str, *, by: str | None = None, allow: Collection[str] = ()
    ) -> ChangeSet | None:
        """Apply a SPARQL 1.1 Update of a person or program as one transaction; None: no change.

        A triple without GRAPH is one of graph:map; WHERE reads all graphs; relative IRIs are the
        map's (``<object/17>``). What follows from the edit is written with it (`kg.consequences`).
        `allow` has names of graphs ("ontology", "commonsense", "dataset", "history", "assertions")
        that may be written though they usually may not. Raises QueryError for what does not parse
        or would reach out, ProtectedError and ShapeError for what may not be written; the graph is
        then untouched.
        """
        with self._guard:
            self._store.refuse_read_only()
            door = self._door = self._door or Door(self._store)
            pending = work_out(self._store, sparql, self.base)
            door.refuse_protected(pending, allow)
            draw_consequences(pending, self._facts, by)
            door.refuse_malformed(pending)
            cause = Cause("update", by, " ".join(sparql.split())[:LONGEST_NOTE])
            change = self._store.commit(pending.removed, pending.added, cause)
            if allow and change is not None:
                self.reread_ontology()
            return change

    def take_ontology(
        self, quads: Iterable[Quad], *, by: str | None = None, whole: bool = False
    ) -> Taken:
        """Make the quads this map's ontology, in one transaction, while it is in use.

        What was written into graph:commonsense by other means stays. Raises OntologyError, with
        nothing changed, where they are not well made, lack what the map speaks of, or leave out
        ontologies of the map and are not said to be the `whole`; `kg.editing` reads and checks
        files.
        """
        ontology = Ontology(tuple(anonymous(quads)), ())
        refuse_malformed(ontology)
        with self._guard:
            taken = take_in(self._store, ontology.quads, by, whole=whole)
            if taken.commit is not None:
                self.reread_ontology()
            return taken

    def learn(self, labels: Iterable[str], kind: str, *, model: str) -> dict[str, str]:
        """A category for each label of a network: its IRI; None-like labels are left out.

        Labels that no category of that `kind` ("object" or "place") is called get a provisional
        one, in one transaction of `model`. Labels without a printable character mean nothing.
        """
        names = {label: clean(label) for label in labels}
        with self._guard:
            self._store.refuse_read_only()
            unknown = [n for n in names.values() if n and not self.catalogue.for_label(n, kind)]
            if learn(self._store, self.catalogue, unknown, kind, model) is not None:
                self.reread_ontology()
            found = {label: self.catalogue.for_label(n, kind) for label, n in names.items() if n}
        return {label: category.iri for label, category in found.items() if category is not None}

    def assert_(self, iri: str, prop: str, value: object, *, by: str) -> ChangeSet | None:
        """Have something be as said, whatever perception believes, until it is retracted.

        Of an object: category (label or IRI), position ((x, y, z) [m]), existence ("present" or
        "absent"), label; of a place: category, label. ``object/17`` is short for its IRI. Raises
        UnknownCategoryError, and InvalidFactError for what is not there or cannot be said.
        """
        with self._guard:
            return self._sayings.assert_(iri, prop, value, by)

    def retract(self, iri: str, prop: str, *, by: str | None = None) -> ChangeSet | None:
        """Take back what was said: the map believes what perception does again.

        Raises InvalidFactError where nothing was said of that.
        """
        with self._guard:
            return self._sayings.retract(iri, prop, by)

    @contextlib.contextmanager
    def hold(self) -> Iterator[None]:
        """Keep other threads from writing for the length of a block: between reading and writing.

        Blocks those who write until it ends; keep it to milliseconds.
        """
        with self._guard:
            yield

    def reread_ontology(self) -> None:
        """Know the categories of the ontology as it stands in the store by now."""
        self.catalogue = Catalogue.from_store(self.engine)
        self._facts.catalogue = self.catalogue
        self._door = None


def frame_cause(update: MapUpdate) -> Cause:
    """The mapper's, for the frame that `update` says."""
    recording = update.recording
    note = f"{recording.name}/{recording.last_frame}" if recording else ""
    return Cause("frame", note=note)

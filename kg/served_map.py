"""The map of a running `hereabouts serve`, from afar: read by SPARQL, written by its one writer.

What a plain SPARQL server cannot do, this one can: it knows the past, and validates what is said.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from datetime import datetime
from typing import Never

from pyoxigraph import NamedNode, Quad

from kg.commits import Cause, ChangeSet
from kg.errors import GraphError, HistoryError
from kg.history.instants import Instant, moment
from kg.history.log import BACKGROUND
from kg.history.past import Difference
from kg.history.telling import Entry
from kg.history.why import Reason
from kg.records import Assertion, MapUpdate
from kg.remote import RemoteEngine
from kg.semantic_map import SemanticMap
from kg.served import Served
from kg.store import MapStore


class ServedMap(SemanticMap):
    """As `SemanticMap`; a server's token, in HEREABOUTS_TOKEN, says on whose account it is written.

    What only the process of the mapper does (`apply`, `learn`) it refuses.
    """

    def __init__(self, store: MapStore, served: Served) -> None:
        super().__init__(store)
        self._served = served

    @classmethod
    def found_at(cls, store: MapStore) -> ServedMap | None:
        """The map behind a store on a server, where that is a `hereabouts serve`; else None."""
        engine = store.engine
        if not isinstance(engine, RemoteEngine) or not engine.query_url.endswith("/sparql"):
            return None
        served = Served.at(engine.query_url.removesuffix("/sparql"))
        return None if served is None else cls(store, served)

    @property
    def sequence(self) -> int:
        """The number of the last transaction; 0 before the first."""
        return self._served.sequence

    def at(self, when: Instant) -> SemanticMap:
        """The map as believed at `when`, asked of the server question by question."""
        number = self._served.sequence_at(text_of(when))
        store = MapStore(
            RemoteEngine(self._served.root, always=(("at", str(number)),)),
            where=f"#{number} of {self._served.where}",
            read_only=True,
            lock=None,
        )
        try:
            return SemanticMap(store)
        except BaseException:
            store.close()
            raise

    def state_of(self, iri: str, when: Instant) -> tuple[Quad, ...]:
        """All quads about one thing as of `when`."""
        try:
            node = NamedNode(iri)
        except ValueError:
            raise HistoryError(f"needs an absolute IRI, got {iri!r}") from None
        with self.at(when) as then:
            quads = then.engine.quads_for_pattern(node, None, None)
            return tuple(sorted((q for q in quads if q.graph_name not in BACKGROUND), key=str))

    def diff(self, t1: Instant, t2: Instant) -> Difference:
        """What the map says at `t2` and not at `t1`, and the other way round."""
        return self._served.diff(text_of(t1), text_of(t2))

    def log(self, iri: str) -> Iterator[Entry]:
        """Each transaction that changed one thing, in words; `iri` may be short (object/17)."""
        yield from self._served.log(iri)

    def why(self, what: str) -> tuple[Reason, ...]:
        """Why the map says so: of a thing (object/17), or of a fact ("object/17 here:inPlace")."""
        return self._served.why(what)

    def assert_(
        self, iri: str, prop: str, value: object, *, by: str | None = None
    ) -> ChangeSet | None:
        """Have something be as said; whoever `by` names, the token's holder is who says it."""
        self._store.refuse_read_only()
        return self._served.assert_(iri, prop, value)

    def retract(self, iri: str, prop: str, *, by: str | None = None) -> ChangeSet | None:
        """Take back what was said, on the account of the token's holder."""
        self._store.refuse_read_only()
        return self._served.retract(iri, prop)

    def assertions(self, iri: str | None = None) -> tuple[Assertion, ...]:
        """What people said, and what perception believes of it; of one thing or of all."""
        return self._served.assertions(iri)

    def update(
        self, sparql: str, *, by: str | None = None, allow: Collection[str] = ()
    ) -> ChangeSet | None:
        """Apply a SPARQL 1.1 Update through the server, on the account of the token's holder."""
        self._store.refuse_read_only()
        if allow:
            self._refuse("graphs that are usually not written")
        return self._served.update(sparql)

    def apply(self, update: MapUpdate, cause: Cause | None = None) -> int:
        """Refused: a served map has its mapper in the server."""
        self._refuse("what a mapper saw")

    def learn(self, labels: object, kind: str, *, model: str) -> Never:
        """Refused: a served map has its mapper in the server."""
        self._refuse("what a mapper saw")

    def take_ontology(self, quads: object, *, by: str | None = None, whole: bool = False) -> Never:
        """Refused; `kg.editing.reloading.reload` takes an ontology in, here too."""
        self._refuse("an ontology")

    def _refuse(self, what: str) -> Never:
        raise GraphError(
            f"the map at {self._served.where} is served, and {what} is not written into it from "
            "afar: write by assert, retract, update or `hereabouts ontology reload`; map with "
            "`hereabouts serve --recording`, or where its folder is"
        )


def text_of(when: Instant) -> str:
    """A moment as the server takes it."""
    if isinstance(when, datetime):
        return datetime.fromtimestamp(moment(when)).astimezone().isoformat()
    return str(when)

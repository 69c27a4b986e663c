"""rdflib store over a live map: read like any other, written by validated updates only."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NoReturn, Protocol

import pyoxigraph
import rdflib
from oxrdflib import OxigraphStore
from rdflib import BNode
from rdflib.plugins.sparql.sparql import Query, Update
from rdflib.query import Result
from rdflib.term import Identifier

from kg.model import vocabulary as v
from kg.model.errors import ProtectedError
from kg.rdf.sparql.engine_gaps import FUNCTIONS
from kg.rdf.sparql.lexer import has_word, insert_into_pattern
from kg.rdf.sparql.vetting import check_nesting, check_no_service


class ApplyUpdate(Protocol):
    """Applies SPARQL Update to the map, as `SemanticMap.update` does."""

    def __call__(self, sparql: str, /, *, confirmed: bool = False) -> object:
        """Apply the update; a large deletion must be `confirmed`."""


class DatasetView(OxigraphStore):
    """An rdflib store over a live map.

    ``Dataset.update`` works as `SemanticMap.update`, with ``confirmed=True`` too. Adding and
    removing single triples is refused, since most facts of a map consist of several triples.
    """

    def __init__(self, engine: pyoxigraph.Store, update: ApplyUpdate) -> None:
        super().__init__(store=engine)
        self._apply = update

    @property
    def _inner(self) -> Any:
        return _WithFunctions(super()._inner)

    def query(
        self,
        query: Query | str,
        initNs: Mapping[str, Any],
        initBindings: Mapping[str, Identifier],
        queryGraph: str,
        **kwargs: object,
    ) -> Result:
        """The result of a query given as text; `initBindings` bind variables of its pattern.

        The engine substitutes variables of the SELECT clause alone, so others become VALUES.
        """
        terms = {name: term for name, term in initBindings.items() if not isinstance(term, BNode)}
        if terms and isinstance(query, str) and not has_word(query, "construct"):
            rows = (f" VALUES ?{name} {{ {term.n3()} }}" for name, term in terms.items())
            query = insert_into_pattern(query, "".join(rows))
            initBindings = {n: term for n, term in initBindings.items() if n not in terms}
        return super().query(query, initNs, initBindings, queryGraph, **kwargs)

    def update(
        self,
        update: Update | str,
        initNs: Mapping[str, object],
        initBindings: Mapping[str, object],
        queryGraph: object,
        **kwargs: object,
    ) -> None:
        """Apply SPARQL Update, given as text; raises as `SemanticMap.update`."""
        if not isinstance(update, str) or initBindings:
            raise ProtectedError("give the update as text without bindings: SemanticMap.update")
        declared = "".join(f"PREFIX {name}: <{iri}>\n" for name, iri in initNs.items())
        self._apply(declared + update, confirmed=kwargs.get("confirmed") is True)

    def add(self, *args: object, **kwargs: object) -> NoReturn:
        """Refused."""
        raise _refusal()

    def addN(self, *args: object, **kwargs: object) -> NoReturn:  # noqa: N802
        """Refused."""
        raise _refusal()

    def remove(self, *args: object, **kwargs: object) -> NoReturn:
        """Refused."""
        raise _refusal()

    def add_graph(self, graph: object) -> None:
        """Does nothing: a graph of a map exists while it holds triples."""

    def remove_graph(self, graph: object) -> NoReturn:
        """Refused."""
        raise _refusal()


class _WithFunctions:
    """An engine whose queries know the extension functions."""

    def __init__(self, engine: pyoxigraph.Store) -> None:
        self._engine = engine

    def query(self, query: str, **options: Any) -> object:
        """As `Store.query`; raises QueryRefusedError as `SemanticMap.query`."""
        check_nesting(query)
        check_no_service(query)
        return self._engine.query(query, custom_functions=FUNCTIONS, **options)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._engine, name)


def dataset_of(engine: pyoxigraph.Store, update: ApplyUpdate) -> rdflib.Dataset:
    """The view as an rdflib dataset with the usual prefixes; its default graph is the union."""
    dataset = rdflib.Dataset(store=DatasetView(engine, update), default_union=True)
    for prefix, namespace in v.PREFIXES.items():
        dataset.bind(prefix, namespace)
    return dataset


def _refusal() -> ProtectedError:
    return ProtectedError(
        "the rdflib view of a map does not write single triples; "
        "write with SemanticMap.update(sparql, by=...) or the view's own update(sparql)"
    )

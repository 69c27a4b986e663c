"""Evaluation of SPARQL Update to ground quads: the quads that each operation deletes and inserts.

Evaluation writes nothing, so that the result can be validated and committed as one transaction. It
may run in another process than the writer (`kg.serving.workers.evaluation.ingestion`). The engine
parses every part and evaluates every WHERE; this module instantiates the templates (SPARQL 1.1
Update, sections 3.1 and 4.1). A triple without GRAPH belongs to graph:map; a WHERE without WITH or
USING reads the union of all graphs, as queries do.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Iterator, Mapping
from contextlib import AbstractContextManager
from functools import partial
from types import TracebackType
from typing import Protocol, Self

from pyoxigraph import BlankNode, DefaultGraph, Literal, NamedNode, Quad, QuerySolution, Store
from pyoxigraph import Triple as TripleTerm

from kg.knowledge.ontology.declared_terms import known_terms
from kg.maps.update.change_draft import GroundUpdate, QuadChange, Term
from kg.model import vocabulary as v
from kg.model.errors import QueryError
from kg.rdf.sparql.engine_gaps import FUNCTIONS
from kg.rdf.sparql.update_parser import (
    VARIABLE,
    Operation,
    UnclearError,
    check_blank_labels,
    operations,
    variables_as_iris,
)
from kg.rdf.sparql.vetting import (
    check_nesting,
    check_no_load,
    check_no_service,
    check_unicode,
    explained,
)
from kg.store.type_inference import inferred_changes

# fails at evaluation, so that the engine parses the whole request and changes nothing
_NOTHING = "CLEAR GRAPH <urn:hereabouts:nothing>; "


class Dataset(Protocol):
    """The state of a map that an update is evaluated against; a `TransactionalStore` is one."""

    @property
    def native(self) -> Store:
        """The quads, for reading."""

    def copied(self) -> AbstractContextManager[Store]:
        """A copy that may be written."""


def evaluate_update(dataset: Dataset, sparql: str, base: str | None = None) -> GroundUpdate:
    """The quads that each operation of a request deletes and inserts, in their order.

    Each operation sees the effect of those before it. Nothing is written to `dataset`. Relative
    IRIs are resolved against `base`, where the request has no BASE of its own.

    Raises QueryError, in one line, for a text that is not Unicode or does not parse (with the
    position), for SERVICE and LOAD, and for a CLEAR, DROP, CREATE, COPY, MOVE or ADD that fails by
    the standard.
    """
    check_unicode(sparql)
    check_nesting(sparql)
    check_no_service(sparql)
    check_no_load(sparql)
    prologue = "" if base is None else f"BASE <{base}> "
    try:
        parts = tuple(operations(sparql, prologue))
    except UnclearError:
        _check_syntax(dataset, sparql, Operation("", prologue, sparql), guard="")
        raise
    for part in parts:
        _check_syntax(dataset, sparql, part)
    check_blank_labels(parts)
    with _View(dataset) as view:
        for operation in parts:
            delete, insert = _effect(view, operation)
            view.change(delete, insert)
    reads = any(part.verb not in ("INSERT DATA", "DELETE DATA") for part in parts)
    return GroundUpdate(tuple(view.steps), reads=reads)


class _View:
    """The dataset after the operations so far; a copy is made by the first change."""

    def __init__(self, dataset: Dataset) -> None:
        self._dataset = dataset
        self.steps: list[QuadChange] = []
        self._copies = contextlib.ExitStack()
        self._copy: Store | None = None

    @property
    def engine(self) -> Store:
        if not self.steps:
            return self._dataset.native
        if self._copy is None:
            self._copy = self._copies.enter_context(self._dataset.copied())
            for step in self.steps:
                _write(self._copy, step.delete, step.insert)
        return self._copy

    def change(self, delete: Iterable[Quad], insert: Iterable[Quad]) -> None:
        step = QuadChange(tuple(delete), tuple(insert))
        if not (step.delete or step.insert):
            return
        self.steps.append(step)
        if self._copy is not None:
            _write(self._copy, step.delete, step.insert)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._copy = None
        self._copies.__exit__(kind, error, trace)


def _write(engine: Store, delete: tuple[Quad, ...], insert: tuple[Quad, ...]) -> None:
    gone, new = inferred_changes(engine, delete, insert)
    for quad in (*delete, *gone):
        engine.remove(quad)
    engine.extend((*insert, *new))


def _effect(view: _View, operation: Operation) -> tuple[Iterable[Quad], Iterable[Quad]]:
    if operation.verb == "INSERT DATA":
        return (), _read(operation.prologue, operation.insert)
    if operation.verb == "DELETE DATA":
        return _read(operation.prologue, operation.delete), ()
    if operation.verb == "MODIFY":
        return _modified(view.engine, operation)
    if operation.verb == "LOAD":
        raise QueryError("LOAD is refused: an update cannot read other sources; write INSERT DATA")
    return _managed(view.engine, operation)


def _check_syntax(dataset: Dataset, sparql: str, part: Operation, *, guard: str = _NOTHING) -> None:
    """Raise QueryError with the cause if the engine cannot parse one operation of a request."""
    head = part.prologue + guard
    blank = "".join(mark if mark == "\n" else " " for mark in sparql[: part.start])
    try:
        Store().update(head + blank + part.text, prefixes=v.PREFIXES)
    except SyntaxError as error:
        cause = explained(sparql, str(error), len(head), partial(known_terms, dataset.native))
        raise QueryError(f"update: {cause}") from error
    except (OSError, RuntimeError, ValueError):
        return  # it parses, and failed only on the empty store


def _read(prologue: str, template: str, graph: NamedNode = v.MAP_GRAPH) -> list[Quad]:
    """The quads of a template or of data; triples without GRAPH are in `graph`."""
    scratch = Store()
    try:
        scratch.update(f"{prologue}INSERT DATA {variables_as_iris(template)}", prefixes=v.PREFIXES)
    except (SyntaxError, OSError, RuntimeError, ValueError) as error:
        raise QueryError(f"update: {' '.join(str(error).split())}") from error
    return [
        Quad(q.subject, q.predicate, q.object, graph)
        if isinstance(q.graph_name, DefaultGraph)
        else q
        for q in scratch
    ]


def _modified(engine: Store, operation: Operation) -> tuple[list[Quad], list[Quad]]:
    within = _iri(operation.prologue, operation.within) if operation.within else v.MAP_GRAPH
    delete = _read(operation.prologue, operation.delete, within)
    insert = _read(operation.prologue, operation.insert, within)
    names = {name for quad in (*delete, *insert) for name in _variables(quad)}
    deleted: dict[Quad, None] = {}
    inserted: dict[Quad, None] = {}
    for solution in _solutions(engine, operation, within, sorted(names)):
        terms = {name: term for name in names if (term := solution[name]) is not None}
        deleted.update(dict.fromkeys(_filled(delete, terms)))
        inserted.update(dict.fromkeys(_filled(insert, terms)))
    return list(deleted), list(inserted)


def _solutions(
    engine: Store, operation: Operation, within: NamedNode, names: list[str]
) -> Iterator[QuerySolution]:
    chosen = " ".join(f"?{name}" for name in names) or "(1 AS ?hereabouts_one)"
    text = f"{operation.prologue}SELECT {chosen}\n{operation.using}WHERE {operation.where}"
    given = bool(operation.using)
    alone = bool(operation.within) and not given
    try:
        yield from engine.query(  # type: ignore[misc]
            text,
            prefixes=v.PREFIXES,
            use_default_graph_as_union=not given and not alone,
            default_graph=[within] if alone else None,
            custom_functions=FUNCTIONS,
        )
    except (SyntaxError, OSError, RuntimeError, ValueError) as error:
        raise QueryError(f"update: {' '.join(str(error).split())}") from error


def _variables(quad: Quad) -> Iterator[str]:
    terms: list[object] = [quad.subject, quad.predicate, quad.object, quad.graph_name]
    while terms:
        term = terms.pop()
        if isinstance(term, TripleTerm):
            terms += [term.subject, term.predicate, term.object]
        elif isinstance(term, NamedNode) and term.value.startswith(VARIABLE):
            yield term.value.removeprefix(VARIABLE)


def _filled(template: list[Quad], terms: Mapping[str, Term]) -> Iterator[Quad]:
    """The template's quads for one solution; illegal and incomplete ones are left out."""
    fresh: dict[BlankNode, BlankNode] = {}
    for quad in template:
        graph = _substituted(quad.graph_name, terms, fresh)
        triple = _substituted(quad.triple, terms, fresh)
        if isinstance(triple, TripleTerm) and isinstance(graph, NamedNode):
            yield Quad(triple.subject, triple.predicate, triple.object, graph)


def _substituted(
    term: object, terms: Mapping[str, Term], fresh: dict[BlankNode, BlankNode]
) -> Term | None:
    if isinstance(term, NamedNode) and term.value.startswith(VARIABLE):
        return terms.get(term.value.removeprefix(VARIABLE))
    if isinstance(term, BlankNode):
        return fresh.setdefault(term, BlankNode())
    if isinstance(term, TripleTerm):
        subject = _substituted(term.subject, terms, fresh)
        predicate = _substituted(term.predicate, terms, fresh)
        value = _substituted(term.object, terms, fresh)
        if not isinstance(subject, NamedNode | BlankNode) or value is None:
            return None
        return TripleTerm(subject, predicate, value) if isinstance(predicate, NamedNode) else None
    return term if isinstance(term, NamedNode | Literal) else None


def _iri(prologue: str, written: str) -> NamedNode:
    thing = "<urn:hereabouts:thing>"
    (quad,) = _read(prologue, f"{{ GRAPH {written} {{ {thing} {thing} {thing} }} }}")
    if not isinstance(quad.graph_name, NamedNode):
        raise QueryError(f"update: a graph is named by an IRI, got {written}")
    return quad.graph_name


def _managed(engine: Store, operation: Operation) -> tuple[Iterable[Quad], Iterable[Quad]]:
    """CLEAR, DROP, CREATE, ADD, COPY, MOVE; a graph exists while it has quads."""
    if operation.verb in ("CLEAR", "DROP", "CREATE"):
        return _one_graph(engine, operation)
    source, target = (_graph(operation, written) for written in operation.graphs)
    quads = _quads_of(engine, source)
    if not quads and source != v.MAP_GRAPH and not operation.silent:
        raise QueryError(f"{operation.verb}: there is no graph {source}")
    if source == target:
        return (), ()
    copies = [Quad(q.subject, q.predicate, q.object, target) for q in quads]
    replaced = [] if operation.verb == "ADD" else _quads_of(engine, target)
    return [*replaced, *(quads if operation.verb == "MOVE" else ())], copies


def _one_graph(engine: Store, operation: Operation) -> tuple[Iterable[Quad], Iterable[Quad]]:
    (written,) = operation.graphs
    if written in ("ALL", "NAMED"):
        return tuple(engine), ()
    graph = _graph(operation, written)
    quads = _quads_of(engine, graph)
    creates = operation.verb == "CREATE"
    if bool(quads) == creates and graph != v.MAP_GRAPH and not operation.silent:
        what = "is a graph already" if creates else "is no graph of this map"
        raise QueryError(f"{operation.verb}: {graph} {what}; with SILENT that is no error")
    return () if creates else quads, ()


def _graph(operation: Operation, written: str) -> NamedNode:
    return v.MAP_GRAPH if written == "DEFAULT" else _iri(operation.prologue, written)


def _quads_of(engine: Store, graph: NamedNode) -> list[Quad]:
    return list(engine.quads_for_pattern(None, None, None, graph))

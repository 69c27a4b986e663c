"""SPARQL Update from people and programs, worked out to the quads it adds and removes.

Nothing is written here: what an update would do can so be checked, and then be one transaction
with its cause. The engine parses every part and evaluates every WHERE; only templates are filled
in here (SPARQL 1.1 Update, sections 3.1 and 4.1). A triple without GRAPH is one of graph:map;
a WHERE without WITH or USING reads the union of all graphs, as questions do.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Iterator, Mapping
from types import TracebackType
from typing import Self

from pyoxigraph import BlankNode, DefaultGraph, Literal, NamedNode, Quad, QuerySolution, Store
from pyoxigraph import Triple as TripleTerm

from kg import vocabulary as v
from kg.answers import located
from kg.assertions import is_unicode
from kg.errors import QueryError
from kg.functions import FUNCTIONS
from kg.pending import Pending, Term
from kg.store import MapStore
from kg.update_text import VARIABLE, Operation, UnclearError, marked, operations, refuse_loading

_MAP = NamedNode(v.MAP_GRAPH)
# fails before anything is evaluated, so that the whole request is parsed and nothing is done
_NOTHING = "CLEAR GRAPH <urn:hereabouts:nothing>; "


def work_out(store: MapStore, sparql: str, base: str | None = None) -> Pending:
    """What the request would add and remove; each operation sees what those before it did.

    Relative IRIs are resolved against `base`, where the request has no BASE of its own.

    Raises QueryError, in one line, for what is no Unicode or does not parse (saying where), for
    SERVICE and LOAD, and for a CLEAR, DROP, CREATE, COPY, MOVE or ADD that fails by the standard.
    """
    if not is_unicode(sparql):
        raise QueryError(f"update: {sparql[:100]!r} is no Unicode text; write it in UTF-8")
    refuse_loading(sparql)
    prologue = "" if base is None else f"BASE <{base}> "
    try:
        parts = tuple(operations(sparql, prologue))
    except UnclearError:
        _refuse_unparsable(sparql, 0, sparql, prologue, guard="")
        raise
    for part in parts:
        _refuse_unparsable(sparql, part.start, part.text, part.prologue)
    pending = Pending(store)
    with _View(store, pending) as view:
        for operation in parts:
            delete, insert = _effect(view, operation)
            view.take_in(delete, insert)
    return pending


class _View:
    """The graph as the next operation sees it: the live one until something is pending."""

    def __init__(self, store: MapStore, pending: Pending) -> None:
        self._store, self.pending = store, pending
        self._copies = contextlib.ExitStack()
        self._copy: Store | None = None

    @property
    def engine(self) -> Store:
        if not self.pending:
            return self._store.native
        if self._copy is None:
            self._copy = self._copies.enter_context(self._store.copied())
            _write(self._copy, self.pending.removed, self.pending.added)
        return self._copy

    def take_in(self, delete: Iterable[Quad], insert: Iterable[Quad]) -> None:
        delete, insert = tuple(delete), tuple(insert)
        self.pending.change(delete, insert)
        if self._copy is not None:
            _write(self._copy, delete, insert)

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


def _write(engine: Store, delete: Iterable[Quad], insert: Iterable[Quad]) -> None:
    for quad in delete:
        engine.remove(quad)
    engine.extend(insert)


def _effect(view: _View, operation: Operation) -> tuple[Iterable[Quad], Iterable[Quad]]:
    if operation.verb == "INSERT DATA":
        return (), _read(operation.prologue, operation.insert)
    if operation.verb == "DELETE DATA":
        return _read(operation.prologue, operation.delete), ()
    if operation.verb == "MODIFY":
        return _modified(view.engine, operation)
    if operation.verb == "LOAD":
        raise QueryError("LOAD is refused: an update reaches nothing outside; write INSERT DATA")
    return _managed(view.engine, operation)


def _refuse_unparsable(
    sparql: str, start: int, text: str, prologue: str, guard: str = _NOTHING
) -> None:
    """Have the engine parse one operation, at its place in the request."""
    head = prologue + guard
    blank = "".join(mark if mark == "\n" else " " for mark in sparql[:start])
    try:
        Store().update(head + blank + text, prefixes=v.PREFIXES)
    except SyntaxError as error:
        raise QueryError(f"update: {located(str(error), len(head))}") from error
    except (OSError, RuntimeError, ValueError):
        return  # it parses; that nothing can be done with an empty store is no fault of its


def _read(prologue: str, template: str, graph: NamedNode = _MAP) -> list[Quad]:
    """The quads of a template or of data; what names no graph is in `graph`."""
    scratch = Store()
    try:
        scratch.update(f"{prologue}INSERT DATA {marked(template)}", prefixes=v.PREFIXES)
    except (SyntaxError, OSError, RuntimeError, ValueError) as error:
        raise QueryError(f"update: {' '.join(str(error).split())}") from error
    return [
        Quad(q.subject, q.predicate, q.object, graph)
        if isinstance(q.graph_name, DefaultGraph)
        else q
        for q in scratch
    ]


def _modified(engine: Store, operation: Operation) -> tuple[list[Quad], list[Quad]]:
    within = _iri(operation.prologue, operation.within) if operation.within else _MAP
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
        graph = _put_in(quad.graph_name, terms, fresh)
        triple = _put_in(quad.triple, terms, fresh)
        if isinstance(triple, TripleTerm) and isinstance(graph, NamedNode):
            yield Quad(triple.subject, triple.predicate, triple.object, graph)


def _put_in(
    term: object, terms: Mapping[str, Term], fresh: dict[BlankNode, BlankNode]
) -> Term | None:
    if isinstance(term, NamedNode) and term.value.startswith(VARIABLE):
        return terms.get(term.value.removeprefix(VARIABLE))
    if isinstance(term, BlankNode):
        return fresh.setdefault(term, BlankNode())
    if isinstance(term, TripleTerm):
        subject = _put_in(term.subject, terms, fresh)
        predicate = _put_in(term.predicate, terms, fresh)
        value = _put_in(term.object, terms, fresh)
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
    """CLEAR, DROP, CREATE, ADD, COPY, MOVE; a graph is there while it holds something."""
    if operation.verb in ("CLEAR", "DROP", "CREATE"):
        return _one_graph(engine, operation)
    source, target = (_graph(operation, written) for written in operation.graphs)
    held = _held(engine, source)
    if not held and source != _MAP and not operation.silent:
        raise QueryError(f"{operation.verb}: there is no graph {source}")
    if source == target:
        return (), ()
    copies = [Quad(q.subject, q.predicate, q.object, target) for q in held]
    replaced = [] if operation.verb == "ADD" else _held(engine, target)
    return [*replaced, *(held if operation.verb == "MOVE" else ())], copies


def _one_graph(engine: Store, operation: Operation) -> tuple[Iterable[Quad], Iterable[Quad]]:
    (written,) = operation.graphs
    if written in ("ALL", "NAMED"):
        return tuple(engine), ()
    graph = _graph(operation, written)
    held = _held(engine, graph)
    creates = operation.verb == "CREATE"
    if bool(held) == creates and graph != _MAP and not operation.silent:
        what = "is a graph already" if creates else "is no graph of this map"
        raise QueryError(f"{operation.verb}: {graph} {what}; SILENT lets that pass")
    return () if creates else held, ()


def _graph(operation: Operation, written: str) -> NamedNode:
    return _MAP if written == "DEFAULT" else _iri(operation.prologue, written)


def _held(engine: Store, graph: NamedNode) -> list[Quad]:
    return list(engine.quads_for_pattern(None, None, None, graph))

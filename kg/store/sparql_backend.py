"""Engine of a map on any SPARQL 1.1 server, with the interface of an embedded engine, for reading.

A read by pattern becomes a SELECT. The union of all named graphs as default graph is requested with
Oxigraph's parameter, or by listing the graphs as in the SPARQL protocol. A round trip costs more
than a lookup, so subjects that will be read are announced (`reading_ahead`): two requests get them.
"""

from __future__ import annotations

import re
import threading
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

from pyoxigraph import BlankNode, DefaultGraph, Literal, NamedNode, Quad, QueryBoolean, Store

from kg.model import vocabulary as v
from kg.model.errors import GraphError, QueryError, RemoteError
from kg.rdf.quad_store import Functions, Object, QuadStore, Subject
from kg.rdf.sparql.lexer import has_relative, has_word
from kg.store.sparql_client import Answer, Solutions, SparqlClient
from kg.store.transaction_quads import stored_sequence
from kg.store.transactional import TransactionalStore

ROOT_STEPS = 24  # of Newton's method: exact to a double above 1e-6, within 1e-7 below

_PARTS = tuple(map(NamedNode, (v.HAS_BELIEF, v.HAS_RELATION, v.HAS_LABEL_BELIEF)))
_UNION = ("union-default-graph", "true")
#: The named graphs of a map.
GRAPHS = (
    *(v.ONTOLOGY_GRAPH.value, v.COMMONSENSE_GRAPH.value, v.MAP_GRAPH.value),
    *(v.HISTORY_GRAPH.value, v.ASSERTIONS_GRAPH.value, v.DATASET_GRAPH.value),
    v.INFERRED_GRAPH.value,
)
_SPELT_OUT = tuple(
    (name, graph) for graph in GRAPHS for name in ("default-graph-uri", "named-graph-uri")
)
_ROOT = re.compile(r"BIND\s*\(\s*math:sqrt\((\?\w+)\)\s+AS\s+(\?\w+)\s*\)", re.IGNORECASE)


class SparqlBackend:
    """The dataset of a SPARQL server, as `kg.rdf.quad_store.QuadStore`.

    Every query is sent with the parameters `always`.
    """

    def __init__(
        self, address: str, always: Sequence[tuple[str, str]] = (), *, token: str | None = None
    ) -> None:
        self.endpoint = SparqlClient.at(address, always, token=token)
        self.where = self.endpoint.where
        self._thread = threading.local()
        # parameters that make the union of all named graphs this server's default graph
        probe = f"ASK {{ ?map a <{v.SEMANTIC_MAP}> }}"
        self._union = (_UNION,) if self.endpoint.ask(probe, (_UNION,)) else _SPELT_OUT

    @property
    def query_url(self) -> str:
        """The address of queries."""
        return self.endpoint.query_url

    def not_before(self, sequence: int) -> None:
        """Require that transaction in all later answers of a `hereabouts serve`."""
        self.endpoint.min_sequence = sequence

    def close(self) -> None:
        """Close the connections."""
        self.endpoint.close()

    def quads_for_pattern(
        self,
        subject: Subject,
        predicate: NamedNode | None,
        object: Object,
        graph_name: NamedNode | BlankNode | DefaultGraph | None = None,
        /,
    ) -> Iterator[Quad]:
        """The matching quads; None matches anything. Blank nodes cannot be looked up."""
        copied = self._copied.get(subject) if isinstance(subject, NamedNode) else None
        if copied is None:
            return self._select(subject, predicate, object, graph_name)
        return (
            quad
            for quad in copied
            if predicate in (None, quad.predicate)
            and object in (None, quad.object)
            and graph_name in (None, quad.graph_name)
        )

    def query(
        self,
        query: str,
        /,
        *,
        base_iri: str | None = None,
        prefixes: dict[str, str] | None = None,
        use_default_graph_as_union: bool = False,
        custom_functions: Functions | None = None,
    ) -> Answer:
        """The whole answer; raises SyntaxError where the server cannot parse the query.

        The server does not have our extension functions: math:sqrt is rewritten in standard SPARQL,
        others fail.
        """
        declared = _prologue(query, prefixes or {}, base_iri)
        united = use_default_graph_as_union and not has_word(query, "from")
        # Virtuoso nests the steps of Newton's method and doubles the expression with each
        root = r"BIND(bif:sqrt(\1) AS \2)" if self.endpoint.virtuoso else _newton
        text = f"{declared} {_ROOT.sub(root, query)}"
        try:
            return self.endpoint.ask(text, self._union if united else ())
        except SyntaxError as error:
            raise SyntaxError(_moved(str(error), len(declared) + 1)) from error

    def fetch(
        self,
        query: str,
        default_graphs: Sequence[str],
        named_graphs: Sequence[str],
        *,
        base: str | None = None,
        seconds: float,
        max_bytes: int,
    ) -> tuple[str, bytes]:
        """Media type and body of an answer, within limits (`SparqlClient.fetch`).

        Args:
            query: the query; its default graph is the union of all graphs unless it has FROM.
            default_graphs: IRIs of other default graphs.
            named_graphs: IRIs of other named graphs.
            base: base of relative IRIs.
            seconds: time limit [s].
            max_bytes: limit of the body.
        """
        declared = _prologue(query, v.PREFIXES, base)
        graphs = [("default-graph-uri", iri) for iri in default_graphs]
        graphs += [("named-graph-uri", iri) for iri in named_graphs]
        parameters = graphs or (() if has_word(query, "from") else self._union)
        try:
            return self.endpoint.fetch(
                f"{declared} {query}", parameters, seconds=seconds, max_bytes=max_bytes
            )
        except SyntaxError as error:
            raise QueryError(f"{self.where}: {_moved(str(error), len(declared) + 1)}") from error

    def __contains__(self, quad: Any, /) -> bool:
        if isinstance(quad.subject, BlankNode) or isinstance(quad.object, BlankNode):
            return False  # blank nodes of the server have other labels
        if (copied := self._copied.get(quad.subject)) is not None:
            return quad in copied
        answer = self.endpoint.ask(f"ASK {{ GRAPH {quad.graph_name} {{ {quad.triple} }} }}")
        return bool(answer)

    def __iter__(self) -> Iterator[Quad]:
        return self._select(None, None, None, None)

    @contextmanager
    def reading_ahead(self, subjects: Iterable[NamedNode]) -> Iterator[None]:
        """For the length of a block, read the facts of `subjects` and of their beliefs from a copy.

        The copy is made at the start, in two requests, for this thread only.
        """
        before = self._copied
        copied = dict(before)
        new = [s for s in dict.fromkeys(subjects) if s not in copied]
        copied.update(self._all_of(new))
        parts = {q.object for s in new for q in copied[s] if q.predicate in _PARTS}
        copied.update(self._all_of([s for s in parts if isinstance(s, NamedNode)]))
        self._thread.copied = copied
        try:
            yield
        finally:
            self._thread.copied = before

    @property
    def _copied(self) -> dict[Any, frozenset[Quad]]:
        """Facts of this thread's copy, by subject."""
        return getattr(self._thread, "copied", {})

    def _all_of(self, subjects: list[NamedNode]) -> dict[Any, frozenset[Quad]]:
        if not subjects:
            return {}
        values = " ".join(map(str, subjects))
        answer = self.endpoint.ask(
            f"SELECT ?s ?p ?o ?g WHERE {{ VALUES ?s {{ {values} }} GRAPH ?g {{ ?s ?p ?o }} }}"
        )
        facts: dict[Any, set[Quad]] = {subject: set() for subject in subjects}
        for quad in _quads(answer, self.where):
            facts[quad.subject].add(quad)
        return {subject: frozenset(quads) for subject, quads in facts.items()}

    def _select(
        self,
        subject: Subject,
        predicate: NamedNode | None,
        object: Object,
        graph: NamedNode | BlankNode | DefaultGraph | None,
    ) -> Iterator[Quad]:
        terms = {"s": subject, "p": predicate, "o": object, "g": graph}
        bound = " ".join(f"BIND({term} AS ?{name})" for name, term in terms.items() if term)
        s, p, o, g = (str(term or f"?{name}") for name, term in terms.items())
        answer = self.endpoint.ask(
            f"SELECT ?s ?p ?o ?g WHERE {{ GRAPH {g} {{ {s} {p} {o} }} {bound} }}"
        )
        return iter(_quads(answer, self.where))


class ServerStore(TransactionalStore):
    """The store on the SPARQL 1.1 server at `url`; raises RemoteError if none answers.

    It is read there: `commit` refuses, and only the server of a `RemoteMap` writes.
    """

    def __init__(self, url: str, *, read_only: bool = False) -> None:
        self._backend = SparqlBackend(url)
        where = self._backend.where
        super().__init__(self._backend, where=where, read_only=read_only, lock=None)

    @property
    def shared(self) -> bool:
        """True: the server's other clients may write."""
        return True

    @property
    def native(self) -> Store:
        """Refused: there is no embedded store."""
        raise GraphError(
            f"the map at {self.where} is on a server; open the folder of a map for this"
        )

    @property
    def sequence(self) -> int:
        """The number of the last transaction, or published one; of several maps the sum."""
        if number := stored_sequence(self.engine):
            return number
        marks = self.engine.quads_for_pattern(None, NamedNode(v.SEQUENCE), None, v.PUBLISHED_GRAPH)
        return sum(int(q.object.value) for q in marks if isinstance(q.object, Literal))

    def close(self) -> None:
        """Close the connections; idempotent."""
        super().close()
        self._backend.close()


@contextmanager
def reading_ahead(engine: QuadStore, subjects: Iterable[NamedNode]) -> Iterator[None]:
    """`SparqlBackend.reading_ahead` for an engine on a server; nothing for an embedded one."""
    if isinstance(engine, SparqlBackend):
        with engine.reading_ahead(subjects):
            yield
    else:
        yield


def graph_blocks(quads: Iterable[Quad]) -> str:
    """The quads in SPARQL syntax: a GRAPH block for each graph."""
    triples: dict[str, list[str]] = {}
    for quad in quads:
        triples.setdefault(str(quad.graph_name), []).append(f"{quad.triple} .\n")
    return "".join(f"GRAPH {graph} {{\n{''.join(rows)}}}\n" for graph, rows in triples.items())


def _quads(answer: Answer, where: str) -> list[Quad]:
    if isinstance(answer, Solutions):
        return [Quad(row["s"], row["p"], row["o"], row["g"]) for row in answer.rows]
    kind = "a boolean" if isinstance(answer, QueryBoolean) else "triples"
    raise RemoteError(f"{where} answered a SELECT with {kind}; it is no SPARQL 1.1 server")


def _prologue(query: str, prefixes: Mapping[str, str], base: str | None) -> str:
    declared = " ".join(f"PREFIX {name}: <{iri}>" for name, iri in prefixes.items())
    return f"{declared} BASE <{base}>" if base is not None and has_relative(query) else declared


def _moved(message: str, columns: int) -> str:
    """The error message with its column of line 1 reduced by the length of the prologue."""
    return re.sub(
        r"(error at 1:|at line 1, column )(\d+)",
        lambda match: f"{match[1]}{int(match[2]) - columns}",
        message,
        count=1,
    )


def _newton(match: re.Match[str]) -> str:
    """A square root by Newton's method in standard SPARQL arithmetic."""
    radicand, name = match.groups()
    step = f"?{name[1:]}Step"
    lines = [f"BIND(({radicand} + {Literal(1.0)}) / {Literal(2.0)} AS {step}0)"]
    for k in range(1, ROOT_STEPS):
        last = f"{step}{k - 1}"
        lines.append(f"BIND(({last} + {radicand} / {last}) / {Literal(2.0)} AS {step}{k})")
    return " ".join([*lines, f"BIND({step}{ROOT_STEPS - 1} AS {name})"])

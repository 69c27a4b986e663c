"""A map behind any SPARQL 1.1 server, seen as the engine that an embedded map has.

Reads by pattern become SELECT, a commit one update request, which servers apply as a whole or not
at all. The union of all named graphs as default graph is requested as Oxigraph has it, else spelt
out in the terms of the SPARQL protocol. A round trip costs more than a lookup, so a writer
announces what it will read (`reading_ahead`), and gets it in two requests.
"""

from __future__ import annotations

import re
import threading
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from pyoxigraph import BlankNode, DefaultGraph, Literal, NamedNode, Quad, QueryBoolean

from kg.model import vocabulary as v
from kg.model.errors import QueryError, RemoteError
from kg.rdf.quad_store import Functions, Object, QuadStore, Subject
from kg.rdf.sparql.parameters import has_relative, has_word
from kg.store.sparql_client import Answer, Solutions, SparqlClient
from kg.store.virtuoso import loads

ROOT_STEPS = 24  # of Newton's method: exact to a double above 1e-6, within 1e-7 below

_PARTS = tuple(map(NamedNode, (v.HAS_BELIEF, v.HAS_RELATION, v.HAS_LABEL_BELIEF)))
_UNION = ("union-default-graph", "true")
#: The named graphs of a map.
GRAPHS = (
    *(v.ONTOLOGY_GRAPH.value, v.COMMONSENSE_GRAPH.value, v.MAP_GRAPH.value),
    *(v.HISTORY_GRAPH.value, v.ASSERTIONS_GRAPH.value, v.DATASET_GRAPH.value),
)
_SPELT_OUT = tuple(
    (name, graph) for graph in GRAPHS for name in ("default-graph-uri", "named-graph-uri")
)
_ROOT = re.compile(r"BIND\s*\(\s*math:sqrt\((\?\w+)\)\s+AS\s+(\?\w+)\s*\)", re.IGNORECASE)


class SparqlBackend:
    """The dataset of a SPARQL server, as `kg.rdf.quad_store.QuadStore`.

    Every query is sent with the parameters `always`.
    """

    def __init__(self, address: str, always: Sequence[tuple[str, str]] = ()) -> None:
        self._endpoint = SparqlClient.at(address, always)
        self.where = self._endpoint.where
        self._ahead = threading.local()
        self._union = self._how_to_unite()

    @property
    def query_url(self) -> str:
        """The address that queries go to."""
        return self._endpoint.query_url

    def not_before(self, sequence: int) -> None:
        """Have a running `hereabouts serve` answer with that transaction in it, from now on."""
        self._endpoint.least = sequence

    def close(self) -> None:
        """Let go of the connections."""
        self._endpoint.close()

    def quads_for_pattern(
        self,
        subject: Subject,
        predicate: NamedNode | None,
        object: Object,
        graph_name: NamedNode | BlankNode | DefaultGraph | None = None,
        /,
    ) -> Iterator[Quad]:
        """The quads that match; None matches anything. Blank nodes cannot be looked up."""
        known = self._known().get(subject) if isinstance(subject, NamedNode) else None
        if known is not None:
            wanted = (predicate, object, graph_name)
            return (q for q in known if _matches(q, *wanted))
        return self._select(subject, predicate, object, graph_name)

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

        Functions of ours do not run there: math:sqrt is put in SPARQL's own terms, others fail.
        """
        declared = " ".join(f"PREFIX {name}: <{iri}>" for name, iri in (prefixes or {}).items())
        if base_iri is not None and has_relative(query):
            declared += f" BASE <{base_iri}>"
        united = use_default_graph_as_union and not has_word(query, "from")
        text = f"{declared} {_ROOT.sub(self._root, query)}"
        try:
            return self._endpoint.ask(text, self._union if united else ())
        except SyntaxError as error:
            raise SyntaxError(_moved(str(error), len(declared) + 1)) from error

    def fetch(
        self,
        query: str,
        default_graphs: Sequence[str],
        named_graphs: Sequence[str],
        *,
        base: str | None = None,
        at: str | None = None,
        seconds: float,
        most: int,
    ) -> tuple[str, bytes]:
        """The answer as it came, within limits (`SparqlClient.fetch`).

        Without graphs, and without FROM in the query, the default graph is the union of all.
        Relative IRIs are of `base`. `at` is a moment of the past, for servers that keep one.
        """
        declared = " ".join(f"PREFIX {name}: <{iri}>" for name, iri in v.PREFIXES.items())
        if base is not None and has_relative(query):
            declared += f" BASE <{base}>"
        graphs = [("default-graph-uri", iri) for iri in default_graphs]
        graphs += [("named-graph-uri", iri) for iri in named_graphs]
        united = () if has_word(query, "from") else self._union
        given = [*(graphs or united), *([] if at is None else [("at", at)])]
        try:
            return self._endpoint.fetch(f"{declared} {query}", given, seconds=seconds, most=most)
        except SyntaxError as error:
            raise QueryError(f"{self.where}: {_moved(str(error), len(declared) + 1)}") from error

    def update(self, update: str, /) -> None:
        """Run an update in one request; raises RemoteError where the server did not do it."""
        self._endpoint.update(update)

    def load(self, quads: Iterable[Quad]) -> None:
        """Add quads, blank nodes among them, in one request; on Virtuoso in several, in order."""
        if not self._endpoint.virtuoso:
            self.update(f"INSERT DATA {{\n{graph_blocks(quads)}}}")
            return
        for part in loads(quads):
            self.update(f"INSERT {{\n{graph_blocks(part)}}} WHERE {{}}")

    def __contains__(self, quad: Any, /) -> bool:
        if isinstance(quad.subject, BlankNode) or isinstance(quad.object, BlankNode):
            return False  # a name of ours says nothing of a node there
        if (known := self._known().get(quad.subject)) is not None:
            return quad in known
        answer = self._endpoint.ask(f"ASK {{ GRAPH {quad.graph_name} {{ {quad.triple} }} }}")
        return bool(answer)

    def __iter__(self) -> Iterator[Quad]:
        return self._select(None, None, None, None)

    @contextmanager
    def reading_ahead(self, subjects: Iterable[NamedNode]) -> Iterator[None]:
        """Within, the facts of `subjects` and of their beliefs are read from a copy.

        The copy is made now, in two requests, for this thread alone.
        """
        before = self._known()
        known = dict(before)
        wanted = [s for s in dict.fromkeys(subjects) if s not in known]
        known.update(self._all_of(wanted))
        held = {q.object for s in wanted for q in known[s] if q.predicate in _PARTS}
        known.update(self._all_of([s for s in held if isinstance(s, NamedNode)]))
        self._ahead.known = known
        try:
            yield
        finally:
            self._ahead.known = before

    def _root(self, match: re.Match[str]) -> str:
        # Virtuoso puts each step of Newton's method into the next, 2 to the power of them in all
        own = r"BIND(bif:sqrt(\1) AS \2)"
        return match.expand(own) if self._endpoint.virtuoso else _newton(match)

    def _known(self) -> dict[Any, frozenset[Quad]]:
        return getattr(self._ahead, "known", {})

    def _all_of(self, subjects: list[NamedNode]) -> dict[Any, frozenset[Quad]]:
        if not subjects:
            return {}
        values = " ".join(map(str, subjects))
        answer = self._endpoint.ask(
            f"SELECT ?s ?p ?o ?g WHERE {{ VALUES ?s {{ {values} }} GRAPH ?g {{ ?s ?p ?o }} }}"
        )
        found: dict[Any, set[Quad]] = {subject: set() for subject in subjects}
        for quad in _quads(answer, self.where):
            found[quad.subject].add(quad)
        return {subject: frozenset(quads) for subject, quads in found.items()}

    def _select(
        self,
        subject: Subject,
        predicate: NamedNode | None,
        object: Object,
        graph: NamedNode | BlankNode | DefaultGraph | None,
    ) -> Iterator[Quad]:
        given = {"s": subject, "p": predicate, "o": object, "g": graph}
        bound = " ".join(f"BIND({term} AS ?{name})" for name, term in given.items() if term)
        s, p, o, g = (str(term or f"?{name}") for name, term in given.items())
        answer = self._endpoint.ask(
            f"SELECT ?s ?p ?o ?g WHERE {{ GRAPH {g} {{ {s} {p} {o} }} {bound} }}"
        )
        return iter(_quads(answer, self.where))

    def _how_to_unite(self) -> tuple[tuple[str, str], ...]:
        """Query parameters that make the union of named graphs this server's default graph."""
        probe = f"ASK {{ ?map a <{v.SEMANTIC_MAP}> }}"
        return (_UNION,) if self._endpoint.ask(probe, (_UNION,)) else _SPELT_OUT


@contextmanager
def reading_ahead(engine: QuadStore, subjects: Iterable[NamedNode]) -> Iterator[None]:
    """Announce what will be read of a far engine; nothing to do for one in this process."""
    if isinstance(engine, SparqlBackend):
        with engine.reading_ahead(subjects):
            yield
    else:
        yield


def graph_blocks(quads: Iterable[Quad]) -> str:
    """The quads as SPARQL writes them between braces: a block for each graph."""
    triples: dict[str, list[str]] = {}
    for quad in quads:
        triples.setdefault(str(quad.graph_name), []).append(f"{quad.triple} .\n")
    return "".join(f"GRAPH {graph} {{\n{''.join(rows)}}}\n" for graph, rows in triples.items())


def _quads(answer: Answer, where: str) -> list[Quad]:
    if isinstance(answer, Solutions):
        return [Quad(row["s"], row["p"], row["o"], row["g"]) for row in answer.rows]
    kind = "a boolean" if isinstance(answer, QueryBoolean) else "triples"
    raise RemoteError(f"{where} answered a SELECT with {kind}; it is no SPARQL 1.1 server")


def _matches(
    quad: Quad,
    predicate: NamedNode | None,
    object: Object,
    graph: NamedNode | BlankNode | DefaultGraph | None,
) -> bool:
    return (
        (predicate is None or quad.predicate == predicate)
        and (object is None or quad.object == object)
        and (graph is None or quad.graph_name == graph)
    )


def _moved(message: str, columns: int) -> str:
    """An error of line 1, where the prefixes were put in front, at its column without them."""
    return re.sub(
        r"error at 1:(\d+)", lambda found: f"error at 1:{int(found[1]) - columns}", message, count=1
    )


def _newton(match: re.Match[str]) -> str:
    """A square root in what every SPARQL server can count: plus, times and divided by."""
    of, name = match.groups()
    step = f"?{name[1:]}Step"
    lines = [f"BIND(({of} + {Literal(1.0)}) / {Literal(2.0)} AS {step}0)"]
    for k in range(1, ROOT_STEPS):
        last = f"{step}{k - 1}"
        lines.append(f"BIND(({last} + {of} / {last}) / {Literal(2.0)} AS {step}{k})")
    return " ".join([*lines, f"BIND({step}{ROOT_STEPS - 1} AS {name})"])

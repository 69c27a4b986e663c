"""The W3C's SPARQL 1.0 and 1.1 query suites, through a real `/sparql`.

Whatever pyoxigraph by itself answers, the server answers alike: the same rows, the same graph, or
an error of the client's. The answers are also compared with the W3C's own: those that differ are
named in docs/reference/standards.md. SERVICE is left out. The suites' data are user graphs of the
map named by their files, which `default-graph-uri` and `named-graph-uri` choose; blank nodes are
kept, since no update is involved.
"""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import pytest
import requests
from pyoxigraph import (
    BlankNode,
    CanonicalizationAlgorithm,
    Dataset,
    Literal,
    NamedNode,
    Quad,
    QueryBoolean,
    QueryResultsFormat,
    RdfFormat,
    Store,
    parse,
    parse_query_results,
)

from kg.model import vocabulary as v
from kg.serving.opening import in_memory_map
from kg.serving.server import Limits, MapServer, Settings

if TYPE_CHECKING:
    from collections.abc import Callable

TESTS = "http://www.w3.org/2001/sw/DataAccess/tests/test-"
RDF = "http://www.w3.org/1999/02/22-rdf-syntax-ns#"
MF, QT = f"{TESTS}manifest#", f"{TESTS}query#"
ROOT = "http://w3c.example/"
BASE = "https://example.org/maps/suites/"
FORMATS = {".ttl": RdfFormat.TURTLE, ".nt": RdfFormat.N_TRIPLES, ".rdf": RdfFormat.RDF_XML}
#: tests of the suites as of 2024: of answers, and of syntax alone
EVALUATED, PARSED = 589, 310
#: of other protocols, and what calls out
LEFT_OUT = {"service", "syntax-fed", "protocol", "http-rdf-update"}
LEFT_OUT |= {"graph-store-protocol", "service-description"}
ACCEPTED = "application/sparql-results+json, application/n-triples"
#: a graph that there is not
NOTHING = "urn:w3c:nothing"


@dataclass(frozen=True)
class Case:
    """One test of a manifest: its text, and the graphs it reads."""

    name: str
    kind: str
    text: str
    default: tuple[str, ...]
    named: tuple[str, ...]
    result: str = ""  # the file of the W3C's answer, in the folder of the suites

    @property
    def short(self) -> str:
        """``suite#test``."""
        suite, _, test = self.name.partition("/manifest#")
        return f"{suite.rpartition('/')[2]}#{test}"

    @property
    def syntax(self) -> bool:
        """Whether it is but a matter of whether the text is a query."""
        return "Syntax" in self.kind


def iri_of(root: Path, path: Path) -> str:
    return ROOT + path.relative_to(root).as_posix()


def cases(root: Path) -> Iterator[Case]:
    for manifest in sorted(root.glob("sparql1*/*/manifest.ttl")):
        if manifest.parent.name in LEFT_OUT:
            continue
        base = iri_of(root, manifest)
        store = Store()
        store.extend(parse(path=str(manifest), format=RdfFormat.TURTLE, base_iri=base))

        def values(subject: Any, name: str, store: Store = store) -> list[Any]:
            return [q.object for q in store.quads_for_pattern(subject, NamedNode(name), None)]

        for quad in store.quads_for_pattern(None, NamedNode(f"{MF}action"), None):
            types = values(quad.subject, f"{RDF}type")
            kind = next((t.value for t in types if "Test" in t.value), "")
            action, blank = quad.object, isinstance(quad.object, BlankNode)
            queries = values(action, f"{QT}query") if blank else [action]
            if "Update" in kind or not queries:
                continue
            text = (root / queries[0].value.removeprefix(ROOT)).read_text(encoding="utf-8")
            graphs = [
                tuple(value.value for value in values(action, QT + name)) if blank else ()
                for name in ("data", "graphData")
            ]
            answers = values(quad.subject, f"{MF}result")
            result = next(
                (a.value.removeprefix(ROOT) for a in answers if isinstance(a, NamedNode)), ""
            )
            if "service" not in text.lower().split():
                yield Case(quad.subject.value, kind, f"BASE <{base}>\n{text}", *graphs, result)


@pytest.fixture(scope="module")
def suites(shared: Callable[[str], Path]) -> Path:
    return shared("data/w3c-sparql")


@pytest.fixture(scope="module")
def data(suites: Path) -> list[Quad]:
    """Every data file of the suites as a graph named by it."""
    quads = []
    for path in sorted(suites.glob("sparql1*/*/*")):
        form = FORMATS.get(path.suffix)
        if form is None or "manifest" in path.name:
            continue
        iri = iri_of(suites, path)
        try:
            found = list(parse(path=str(path), format=form, base_iri=iri, rename_blank_nodes=True))
        except SyntaxError:
            continue  # results of tests of bad syntax
        quads += [Quad(q.subject, q.predicate, q.object, NamedNode(iri)) for q in found]
    return quads


@pytest.fixture(scope="module")
def endpoint(data: list[Quad]) -> Iterator[str]:
    """The address of a server of a map that holds the data."""
    limits = Limits(query_seconds=120.0)
    with in_memory_map(base=BASE) as semantic_map:
        cast(Store, semantic_map.engine).extend(data)
        with MapServer(semantic_map, Settings(port=0, limits=limits)) as server:
            yield server.url


def graphs_of(case: Case) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """The graphs to choose in the request; none where FROM chooses.

    Without either, a test's dataset is empty, where that of the server is the union of its graphs.
    """
    if re.search(r"\bfrom\s+(named\s+)?<", case.text, re.I):
        return (), ()
    none = not case.default and not case.named
    return ((NOTHING,), ()) if case.syntax or none else (case.default, case.named)


def asked(endpoint, session, case, accept=ACCEPTED):
    """The server's answer in one of the formats of `accept`."""
    default, named = graphs_of(case)
    given = {"query": case.text, "default-graph-uri": default, "named-graph-uri": named}
    return session.post(f"{endpoint}sparql", data=given, headers={"Accept": accept})


Rows = list[dict[str, Any]]
RESULTS = "http://www.w3.org/2001/sw/DataAccess/tests/result-set#"
RESULT_FORMATS = {
    ".srx": QueryResultsFormat.XML,
    ".srj": QueryResultsFormat.JSON,
    ".tsv": QueryResultsFormat.TSV,
}
NUMBERS = {v.XSD + name for name in ("integer", "decimal", "double", "float", "int")}


def by_value(term: Any) -> Any:
    """A term whose number, truth value or time zone is written in one way."""
    if not isinstance(term, Literal):
        return term
    kind, text = term.datatype, term.value
    if kind.value in NUMBERS and re.fullmatch(r"[-+.\dEe]+", text):
        text = repr(float(text))
    elif kind.value == f"{v.XSD}boolean":
        text = {"1": "true", "0": "false"}.get(text, text)
    elif kind.value in (f"{v.XSD}date", f"{v.XSD}dateTime"):
        text = text.replace("+00:00", "Z")
    return term if text == term.value else Literal(text, datatype=kind)


def canonical(rows: Rows, lax: bool = False) -> object:
    """Rows, in any order, with any names of blank nodes; with `lax` each counts once (REDUCED)."""
    found = Dataset()
    for row in rows:
        node = BlankNode()
        found.add(Quad(node, NamedNode("urn:row"), Literal("")))
        for name, term in row.items():
            found.add(Quad(node, NamedNode(f"urn:variable:{name}"), by_value(term)))
    found.canonicalize(CanonicalizationAlgorithm.UNSTABLE)
    cells: dict[str, list[str]] = {}
    for quad in found:
        cells.setdefault(str(quad.subject), []).append(f"{quad.predicate} {quad.object}")
    if lax:
        return {tuple(sorted(one)) for one in cells.values()}
    return Counter(tuple(sorted(one)) for one in cells.values())


def graph_of(triples: Any) -> object:
    """Triples with any names of blank nodes."""
    found = Dataset(Quad(t.subject, t.predicate, by_value(t.object)) for t in triples)
    found.canonicalize(CanonicalizationAlgorithm.UNSTABLE)
    return frozenset(map(str, found))


def told_rows(found: Any) -> bool | Rows:
    if isinstance(found, QueryBoolean):
        return bool(found)
    names = [variable.value for variable in found.variables]
    return [{k: row[k] for k in names if row[k] is not None} for row in found]


def result_of(path: Path, iri: str) -> bool | Rows | list[Any]:
    """The answer in a file of the W3C: a truth value, rows, or triples."""
    if form := RESULT_FORMATS.get(path.suffix):
        return told_rows(parse_query_results(path.read_bytes(), format=form))
    store = Store()
    store.extend(parse(path=str(path), format=FORMATS[path.suffix], base_iri=iri))

    def values(subject: Any, name: str) -> list[Any]:
        return [q.object for q in store.quads_for_pattern(subject, NamedNode(RESULTS + name), None)]

    for truth in values(None, "boolean"):
        return bool(truth.value == "true")
    kind = NamedNode(f"{RESULTS}ResultSet")
    sets = [q.subject for q in store.quads_for_pattern(None, NamedNode(f"{RDF}type"), kind)]
    if not sets:
        return [quad.triple for quad in store]
    return [
        {values(b, "variable")[0].value: values(b, "value")[0] for b in values(solution, "binding")}
        for one in sets
        for solution in values(one, "solution")
    ]


def csv_rows(text: str) -> Rows:
    """Rows of CSV, whose cells are texts and blank nodes."""
    return [
        {k: BlankNode(c[2:]) if c.startswith("_:") else number(c) for k, c in row.items()}
        for row in csv.DictReader(text.splitlines())
    ]


def number(text: str) -> Literal:
    return Literal(repr(float(text)) if re.fullmatch(r"[-+.\dEe]*\d[.\dEe]*", text) else text)


def agrees(endpoint: str, session: requests.Session, case: Case, suites: Path) -> bool:
    """Whether the server's answer is the one that the W3C expects."""
    path = suites / case.result
    answer = asked(endpoint, session, case, "text/csv" if path.suffix == ".csv" else ACCEPTED)
    if case.syntax:
        return (answer.status_code == 200) != ("Negative" in case.kind)
    if answer.status_code != 200:
        return False
    if path.suffix == ".csv":
        return canonical(csv_rows(answer.text)) == canonical(csv_rows(path.read_text("utf-8")))
    wanted = result_of(path, iri_of(suites, path))
    if answer.headers["Content-Type"].startswith("application/n-triples"):
        triples = [quad.triple for quad in parse(answer.content, format=RdfFormat.N_TRIPLES)]
        return isinstance(wanted, list) and graph_of(triples) == graph_of(wanted)
    found = told_rows(parse_query_results(answer.content, format=QueryResultsFormat.JSON))
    if isinstance(found, bool) or isinstance(wanted, bool):
        return found == wanted
    lax = "reduced" in case.text.lower()
    return canonical(found, lax) == canonical(wanted, lax)


def test_answers_are_the_ones_of_the_w3c_but_for_those_that_the_page_names(suites, endpoint):
    """Entailment is no part of SPARQL's own semantics."""
    page = (Path(__file__).parents[4] / "docs/reference/standards.md").read_text("utf-8")
    named = set(re.findall(r"`([\w-]+#[\w-]+)`", page))
    found = [case for case in cases(suites) if "/entailment/" not in case.name]
    with requests.Session() as session:
        other = {c.short for c in found if not agrees(endpoint, session, c, suites)}
    assert sorted(other) == sorted(named)
    count = Counter((case.syntax, case.short not in other) for case in found)
    for kind, right in (("answers", count[False, True]), ("syntax", count[True, True])):
        total = right + count[kind == "syntax", False]
        assert f"| {kind} | {total} | {right} |" in page

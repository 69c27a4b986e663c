"""The W3C's SPARQL 1.1 Update suites: all in a map, and two of each through a real `/sparql`.

A test's default graph is graph:map; its named graphs are graphs of the map. What pyoxigraph makes
of the request is what has to be in these graphs afterwards. Blank nodes, which an update makes
IRIs of `/.well-known/genid/`, are compared as blank nodes. Deliberate deviations are in `REFUSED`
and `CASCADING`.
"""

from __future__ import annotations

import re
from collections import Counter, defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import pytest
import requests
from pyoxigraph import BlankNode, DefaultGraph, NamedNode, Quad, RdfFormat, Store, parse

from kg.maps.semantic_map import SemanticMap
from kg.model import vocabulary as v
from kg.model.errors import HereaboutsError
from kg.rdf.sparql.update_parser import with_graphs
from kg.serving.opening import in_memory_map
from kg.serving.server import BearerTokens, Limits, MapServer, Settings

if TYPE_CHECKING:
    from collections.abc import Callable

TESTS = "http://www.w3.org/2009/sparql/tests/test-update#"
MF = "http://www.w3.org/2001/sw/DataAccess/tests/test-manifest#"
RDF_TYPE, LABEL = v.RDF_TYPE, NamedNode(v.RDFS_LABEL)
ROOT = "http://w3c.example/"
BASE = "https://example.org/maps/suites/"
TOKEN = "a-token-of-the-suites-0123"
MAP = v.MAP_GRAPH
#: what reaches outside, and what would remove the ontology and the map's counters
REFUSED = re.compile(r"\bload\b|\b(clear|drop)\s+(silent\s+)?(all|named)\b", re.IGNORECASE)
#: in a map a subject that loses all its facts takes along those that point at it
CASCADING = {"delete/manifest#dawg-delete-01", "delete/manifest#dawg-delete-05"}
CASCADING |= {"delete/manifest#dawg-delete-using-01"}
#: tests of the suites as of 2024, by what becomes of them
COUNTS = {"same": 123, "refused": 23, "cascading": 3}


@dataclass(frozen=True)
class Case:
    """One test of a manifest: its request, and the quads that it starts from."""

    name: str
    kind: str
    text: str
    before: tuple[Quad, ...]


def cases(root: Path) -> Iterator[Case]:
    for manifest in sorted(root.glob("sparql11/*/manifest.ttl")):
        base = ROOT + manifest.relative_to(root).as_posix()
        store = Store()
        store.extend(parse(path=str(manifest), format=RdfFormat.TURTLE, base_iri=base))

        def one(subject: Any, iri: str, store: Store = store) -> Any:
            quads = store.quads_for_pattern(subject, NamedNode(iri), None)
            return next((q.object for q in quads), None)

        def data(value: Any, graph: Any) -> Iterator[Quad]:
            path = root / value.value.removeprefix(ROOT)
            for quad in parse(path=str(path), format=RdfFormat.TURTLE, base_iri=value.value):
                yield Quad(quad.subject, quad.predicate, quad.object, graph)

        for quad in store.quads_for_pattern(None, RDF_TYPE, None):
            kind = getattr(quad.object, "value", "").rpartition("#")[2]
            if "Update" not in kind or kind == "UpdateService":
                continue
            action = one(quad.subject, f"{MF}action")
            request = one(action, f"{TESTS}request") or action
            text = (root / request.value.removeprefix(ROOT)).read_text(encoding="utf-8")
            before: list[Quad] = []
            for found in store.quads_for_pattern(action, None, None):
                if found.predicate.value == f"{TESTS}data":
                    before += data(found.object, DefaultGraph())
                elif found.predicate.value == f"{TESTS}graphData":
                    name = one(found.object, v.RDFS_LABEL).value
                    before += data(one(found.object, f"{TESTS}graph"), NamedNode(name))
            identifier = quad.subject.value.rpartition("data-sparql11/")[2]
            yield Case(identifier, kind, f"BASE <{base}>\n{text}", tuple(before))


@pytest.fixture(scope="module")
def suites(shared: Callable[[str], Path]) -> Path:
    return shared("data/w3c-sparql")


@dataclass(frozen=True)
class Updated:
    """An otherwise empty map, whose graphs a test may fill, update and read."""

    map: SemanticMap

    @property
    def engine(self) -> Store:
        return cast(Store, self.map.engine)

    def update(self, text: str, default: list[str], named: list[str]) -> int:
        """The status that a server would give."""
        try:
            self.map.update(with_graphs(text, default, named), by="w3c")
        except HereaboutsError:
            return 400
        return 200

    def fill(self, quads: tuple[Quad, ...]) -> None:
        """Make these the quads of graph:map and of the graphs that a test may use."""
        emptied = [f"CLEAR SILENT GRAPH {name}" for name in (MAP, *self.graphs())]
        data = " ".join(
            f"GRAPH {MAP if q.graph_name == DefaultGraph() else q.graph_name} {{ {q.triple} }}"
            for q in quads
        )
        self.map.update(" ;\n".join([*emptied, f"INSERT DATA {{ {data} }}"]), confirmed=True)

    def graphs(self) -> list[NamedNode]:
        names = cast("list[NamedNode]", list(self.engine.named_graphs()))
        return [name for name in names if not name.value.startswith(v.GRAPH)]

    def state(self) -> Counter[str]:
        quads = [
            Quad(q.subject, q.predicate, q.object, DefaultGraph() if graph == MAP else graph)
            for graph in (MAP, *self.graphs())
            for q in self.engine.quads_for_pattern(None, None, None, graph)
        ]
        return masked(quads)


@dataclass(frozen=True)
class Served(Updated):
    """Such a map, updated through its server."""

    url: str

    def update(self, text: str, default: list[str], named: list[str]) -> int:
        chosen = {"using-graph-uri": default, "using-named-graph-uri": named}
        headers = {"Authorization": f"Bearer {TOKEN}", "Content-Type": "application/sparql-update"}
        where, data = f"{self.url}sparql", text.encode()
        return requests.post(
            where, params=chosen, data=data, headers=headers, timeout=120
        ).status_code


def masked(quads: Any) -> Counter[str]:
    """Quads with every blank node, and what stands for one, under the same name."""

    def name(term: Any) -> str:
        blank = isinstance(term, BlankNode) or getattr(term, "value", "").startswith(v.GENID)
        return "_:b" if blank else str(term)

    return Counter(" ".join(map(name, quad)) for quad in quads)


def expected(case: Case) -> tuple[bool, Counter[str]]:
    """Whether pyoxigraph carries the request out, and the quads afterwards."""
    store = Store()
    store.extend(case.before)
    try:
        store.update(case.text, prefixes=v.PREFIXES)
    except (SyntaxError, OSError, RuntimeError, ValueError):
        return False, masked(store)
    return True, masked(store)


def answered(of: Updated, case: Case) -> tuple[int, Counter[str]]:
    """Status and quads afterwards; WHERE reads graph:map instead of the union of all graphs."""
    of.fill(case.before)
    words = case.text.upper().split()
    chosen = "WITH" not in words and "USING" not in words
    names = [name.value for name in of.graphs()]
    status = of.update(case.text, *(([MAP.value], names) if chosen else ([], [])))
    return status, of.state()


def verdict(of: Updated, case: Case) -> str:
    status, after = answered(of, case)
    if REFUSED.search(case.text):
        unchanged = after == masked(case.before)
        return "refused" if status in (400, 403) and unchanged else f"{status}, not refused"
    done, quads = expected(case)
    if done != (status == 200) or (not done and status != 400):
        return f"{status}, done by the engine: {done}"
    if case.name in CASCADING:
        lost = quads - after
        return "cascading" if not after - quads and sum(lost.values()) == 1 else f"lost {lost}"
    return "same" if after == quads else f"lacks {quads - after}, has too much {after - quads}"


def test_every_update_does_what_it_does_in_the_engine_alone(suites: Path) -> None:
    with in_memory_map(base=BASE) as semantic_map:
        found = {case.name: verdict(Updated(semantic_map), case) for case in cases(suites)}
    assert {name: said for name, said in found.items() if said not in COUNTS} == {}
    assert Counter(found.values()) == COUNTS


def test_two_updates_of_each_suite_do_it_through_a_server(suites: Path) -> None:
    of_suite: dict[str, list[Case]] = defaultdict(list)
    for case in cases(suites):
        of_suite[case.name.partition("#")[0]].append(case)
    few = [case for some in of_suite.values() for case in some[:2]]
    limits = Limits(query_seconds=120.0)
    settings = Settings(port=0, limits=limits, tokens=BearerTokens((("w3c", TOKEN.encode()),)))
    with in_memory_map(base=BASE) as semantic_map, MapServer(semantic_map, settings) as server:
        found = {case.name: verdict(Served(semantic_map, server.url), case) for case in few}
    assert {name: said for name, said in found.items() if said not in COUNTS} == {}
    assert len(found) >= 2 * 9

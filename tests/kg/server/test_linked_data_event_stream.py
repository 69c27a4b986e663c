"""`/changes` as a Linked Data Event Stream: who follows TREE relations gets each change once."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
import rdflib

from kg import vocabulary as v
from kg.server.feeds import linked_data_event_stream as ldes

if TYPE_CHECKING:
    import requests
    from conftest import Served

PAGE = Path(__file__).resolve().parents[3] / "docs" / "how-to" / "serve.md"
TURTLE = {"Accept": "text/turtle"}


def read(served: Served, url: str) -> tuple[requests.Response, rdflib.Graph]:
    answer = served.get(url.removeprefix(served.url), headers=TURTLE)
    assert answer.status_code == 200, answer.text
    return answer, rdflib.Graph().parse(data=answer.text, format="turtle")


@pytest.fixture
def moved(served: Served, monkeypatch: pytest.MonkeyPatch) -> Served:
    """Transactions #1 to #8, in pages of three."""
    monkeypatch.setattr(ldes, "PAGE", 3)
    for step in range(2, 9):
        served.move(1, float(step))
    return served


def test_a_client_that_follows_relations_gets_every_change_once(moved: Served) -> None:
    _, described = read(moved, f"{moved.url}changes")
    stream = rdflib.URIRef(f"{moved.url}changes")
    assert (stream, rdflib.RDF.type, rdflib.URIRef(v.LDES_EVENT_STREAM)) in described
    page = str(described.value(stream, rdflib.URIRef(v.TREE_VIEW)))
    numbers, immutable = [], []
    while page:
        answer, graph = read(moved, page)
        members = list(graph.objects(stream, rdflib.URIRef(v.TREE_MEMBER)))
        numbers += sorted(int(graph.value(m, rdflib.URIRef(v.SEQUENCE))) for m in members)
        immutable.append("immutable" in answer.headers["Cache-Control"])
        page = str(next(graph.objects(predicate=rdflib.URIRef(v.TREE_NODE_OF)), ""))
    assert numbers == list(range(1, moved.map.sequence + 1))
    assert immutable == [True] * (moved.map.sequence // 3) + [False]


def test_a_member_has_what_was_added_and_removed(moved: Served) -> None:
    _, graph = read(moved, f"{moved.url}changes?page=1")
    member = rdflib.URIRef(f"{moved.map.base}commit/4")

    def xs(predicate: str) -> set[float]:
        return {
            float(graph.value(statement, rdflib.RDF.object))
            for statement in graph.objects(member, rdflib.URIRef(predicate))
            if graph.value(statement, rdflib.RDF.predicate) == rdflib.URIRef(v.X)
        }

    assert (xs(v.CS_REMOVAL), xs(v.CS_ADDITION)) == ({3.0}, {4.0})


@pytest.mark.parametrize(("page", "status"), [("99", 404), ("x", 400)])
def test_no_such_page(moved: Served, page: str, status: int) -> None:
    assert moved.get(f"changes?page={page}", headers=TURTLE).status_code == status


def test_the_documented_client_prints_every_change(
    moved: Served, capsys: pytest.CaptureFixture[str]
) -> None:
    (code,) = re.findall(
        r"^```python\n(.*?)^```", PAGE.read_text("utf-8"), re.DOTALL | re.MULTILINE
    )
    assert "http://127.0.0.1:8008/" in code
    exec(code.replace("http://127.0.0.1:8008/", moved.url), {})
    commits = [line.split()[0] for line in capsys.readouterr().out.splitlines()]
    assert commits == [f"{moved.map.base}commit/{n}" for n in range(1, moved.map.sequence + 1)]

"""Who writes what does not parse is told where, in the text as they wrote it."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import pytest

from kg.model.errors import QueryError
from kg.serving.opening import open_map

if TYPE_CHECKING:
    from conftest import Served

#: a text, and the line and column behind the brace that is too much
QUERIES = (
    ("SELECT * { <object/1> ?p ?o }}", 1, 31),
    ("SELECT * { ?s ?p ?o }}", 1, 23),
    ("SELECT *\n  { <object/1> ?p ?o }}", 2, 24),
    ("PREFIX e: <e/>\nSELECT * { <object/1> e:p ?o }}", 2, 32),
)
UPDATES = (
    ("DELETE WHERE { <object/1> ?p ?o }}", 1, 35),
    ("DELETE WHERE\n { <object/1> ?p ?o }}", 2, 23),
    ("DELETE WHERE { <object/1> ?p 1 } ;\nDELETE WHERE { <object/1> ?p ?o }}", 2, 35),
)


def place(message: str) -> tuple[int, int]:
    found = re.search(r"line (\d+), column (\d+)|error at (\d+):(\d+)", message)
    assert found is not None, message
    line, column = (int(number) for number in found.groups() if number)
    return line, column


@pytest.mark.parametrize(("text", "line", "column"), QUERIES)
def test_where_a_query_does_not_parse(lasting: Served, text: str, line: int, column: int) -> None:
    for given in ({"query": text}, {"query": text, "at": "0"}):
        answer = lasting.get("sparql", params=given)
        assert answer.status_code == 400
        assert place(answer.text) == (line, column)
    with pytest.raises(QueryError) as here:
        lasting.map.query(text)
    assert place(str(here.value)) == (line, column)
    with open_map(lasting.url, read_only=True) as far, pytest.raises(QueryError) as there:
        far.query(text)
    assert place(str(there.value)) == (line, column)


@pytest.mark.parametrize(("text", "line", "column"), UPDATES)
def test_where_an_update_does_not_parse(lasting: Served, text: str, line: int, column: int) -> None:
    answer = lasting.write(text)
    assert answer.status_code == 400
    assert place(answer.text) == (line, column)


def test_relative_iris_are_the_maps_everywhere(lasting: Served) -> None:
    query = 'SELECT ?l { <object/1> rdfs:label ?l FILTER(IRI("object/2") != <object/1>) }'
    assert lasting.rows(query) == [{"l": "cup 1"}]
    assert lasting.map.query(query).rows == (("cup 1",),)
    with open_map(lasting.url, read_only=True) as far:
        assert far.query(query).rows == (("cup 1",),)
    own = f"BASE <{lasting.map.base}object/>\n" + query.replace("<object/1>", "<1>")
    assert lasting.rows(own) == [{"l": "cup 1"}]

"""Accept headers to media types."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from kg.model.errors import NotAcceptableError
from kg.serving.workers.content_negotiation import GRAPH_TYPES, RESULT_TYPES, negotiate

JSON, XML = RESULT_TYPES[:2]


@pytest.mark.parametrize(
    ("accept", "chosen"),
    [
        (None, JSON),
        ("", JSON),
        ("*/*", JSON),
        (XML, XML),
        ("text/csv;q=0.5, application/sparql-results+xml;q=0.9", XML),
        ("TEXT/CSV", "text/csv"),
        ("text/*", "text/csv"),
        (f"*/*;q=0.1, text/csv;q=0, {XML};q=0.2", XML),
        (f"{JSON};q=0, application/*", XML),
        ("text/csv; charset=utf-8; q=0.3, image/png", "text/csv"),
        ("application/json", "application/json"),
        ("text/html, application/xhtml+xml, */*;q=0.8", JSON),
        ("text/csv;q=nonsense, text/tab-separated-values;q=0.1", "text/tab-separated-values"),
    ],
)
def test_tables(accept: str | None, chosen: str) -> None:
    assert negotiate(accept, RESULT_TYPES) == chosen


def test_triples_prefer_turtle_and_offer_what_tables_cannot() -> None:
    assert negotiate("*/*", GRAPH_TYPES) == "text/turtle"
    assert negotiate("application/ld+json", GRAPH_TYPES) == "application/ld+json"
    with pytest.raises(NotAcceptableError, match="text/turtle"):
        negotiate("text/csv", GRAPH_TYPES)


@given(st.text(max_size=60))
def test_no_header_breaks_it(accept: str) -> None:
    try:
        chosen = negotiate(accept, RESULT_TYPES)
    except NotAcceptableError:
        return
    assert chosen in RESULT_TYPES


@given(st.permutations(GRAPH_TYPES[:4]))
def test_the_highest_quality_wins_in_any_order(types: list[str]) -> None:
    accept = ", ".join(f"{name};q={0.9 - 0.2 * rank:.1f}" for rank, name in enumerate(types))
    assert negotiate(accept, GRAPH_TYPES) == types[0]

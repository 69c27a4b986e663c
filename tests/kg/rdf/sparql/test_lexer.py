"""The one lexer: its tokens cover the text, and end where the engine ends them."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pyoxigraph import Literal, Store

from kg.model.errors import QueryRefusedError
from kg.rdf.sparql.lexer import keywords_of, replace_tokens, tokens_of
from kg.rdf.sparql.parameters import substitute
from kg.rdf.sparql.update_parser import with_graphs
from kg.rdf.sparql.vetting import vet

SYNTAX = st.text(st.sampled_from("aA0:_?$@<>'\"\\\\#\n{}()[];.-% \u00e9\u3001u"), max_size=60)


@given(SYNTAX | st.text(max_size=60))
def test_tokens_are_in_order_and_only_white_space_and_comments_lie_between(sparql: str) -> None:
    end = 0
    for token in tokens_of(sparql):
        between = sparql[end : token.start].strip()
        assert not between or between.startswith("#")
        assert sparql[token.start : token.end] == token.text
        end = token.end


@given(SYNTAX)
def test_a_text_of_ascii_has_the_same_tokens_within_a_text_beyond_ascii(sparql: str) -> None:
    text = sparql.encode("ascii", "ignore").decode()
    alone = [(token.kind, token.text) for token in tokens_of(text)]
    both = [(token.kind, token.text) for token in tokens_of(f"\u20ac \n{text}")]
    assert both[1:] == alone


@given(SYNTAX)
def test_replacing_no_token_leaves_the_text_as_it_is(sparql: str) -> None:
    assert replace_tokens(sparql, lambda _: None) == sparql


def test_clauses_of_an_update_are_found_behind_what_is_no_long_string() -> None:
    update = "DELETE { } WHERE { VALUES ?x { '''a' } } #\\q'''"
    assert with_graphs(update, ["urn:g"], []).startswith("DELETE { } USING <urn:g> WHERE")


def test_variables_end_where_the_engine_ends_them() -> None:
    text = "SELECT * { BIND($\u00e9\u00b7 AS ?x) }"
    given = substitute(text, {"\u00e9\u00b7": Literal("x")})
    assert given == 'SELECT * { BIND("x" AS ?x) }'
    assert Store().query(text) is not None
    assert list(keywords_of(text)) == ["SELECT", "BIND", "AS"]


@pytest.mark.parametrize("quote", ["\\u0022", "\\U00000022"])
def test_nesting_behind_an_escaped_quote_is_counted_as_the_engine_reads_it(quote: str) -> None:
    deep = "(" * 400 + "1" + ")" * 400
    with pytest.raises(QueryRefusedError, match="nest"):
        vet(f'ASK {{ BIND("{quote}" AS ?y) BIND({deep} AS ?x) }}')

"""Names with escapes are written as full IRIs; nothing else of a document changes."""

import re

from hypothesis import given
from hypothesis import strategies as st
from pyoxigraph import Literal, NamedNode, RdfFormat, Triple, parse, serialize

from kg.export.serialization import with_full_iris

BASE = "https://example.org/"
PREFIXES = {"object": f"{BASE}object/", "o": f"{BASE}o#", "": BASE}
NAME = st.text("ab1/.~!$&'()*+,;=-_:", min_size=1, max_size=6).filter(lambda t: "//" not in t)
IRI = st.builds(
    lambda space, name: NamedNode(PREFIXES[space] + name), st.sampled_from([*PREFIXES]), NAME
)
TEXT = st.text('a"\\<>:/ .\n', max_size=12).map(Literal)
TYPED = st.builds(lambda text, kind: Literal(text.value, datatype=kind), TEXT, IRI)


@given(st.lists(st.builds(Triple, IRI, IRI, IRI | TEXT | TYPED), min_size=1, max_size=5))
def test_the_same_triples_and_no_escaped_name(triples: list[Triple]) -> None:
    written = (serialize(triples, format=RdfFormat.TURTLE, prefixes=PREFIXES) or b"").decode()
    text = with_full_iris(written, PREFIXES)
    back = [quad.triple for quad in parse(text, format=RdfFormat.TURTLE)]
    assert set(back) == set(triples)
    # without strings and IRIs nothing is left to escape
    assert "\\" not in re.sub(r'"(?:[^"\\]|\\.)*"|<[^>]*>', "", text)


def test_a_geometry_is_named_in_full() -> None:
    text = with_full_iris('object:1\\/geometry a o:G ; o:b "o:a\\\\/b" .', PREFIXES)
    assert text == f'<{BASE}object/1/geometry> a o:G ; o:b "o:a\\\\/b" .'

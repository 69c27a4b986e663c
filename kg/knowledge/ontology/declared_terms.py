"""Declared terms of the vocabulary and an ontology, and near spellings of undeclared ones."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import islice
from typing import Final

from pyoxigraph import NamedNode, Store

from kg.model import vocabulary as v
from kg.model.errors import did_you_mean
from kg.rdf.quad_store import QuadStore
from kg.rdf.sparql.lexer import tokens_of

MAX_LENGTH: Final = 20_000  # characters
MAX_TERMS: Final = 50  # of one query

_INVERSE_OF: Final = NamedNode(v.OWL_INVERSE_OF)
_MAX_GRAPHS = 8  # named in a message
_NO_TERMS: Final = ("^", "BASE", "SERVICE", "SILENT")  # what follows is no term of the map
#: properties that queries may use though no statement has them
_ENTAILED: Final = {v.RDF_TYPE.value, v.RDFS_SUB_CLASS_OF}


def declared_terms(engine: QuadStore) -> set[str]:
    """IRIs in ``here:`` that the vocabulary module or the ontology in the store declares."""
    quads = engine.quads_for_pattern(None, v.RDF_TYPE, None, v.ONTOLOGY_GRAPH)
    declared = {q.subject.value for q in quads if isinstance(q.subject, NamedNode)}
    return {iri for iri in v.TERMS | declared if iri.startswith(v.HERE)} | {v.HERE}


def known_terms(engine: QuadStore) -> set[str]:
    """IRIs that a query may use: the vocabulary's, and those that the ontology declares."""
    return declared_terms(engine) | v.TERMS


def absent_terms(sparql: str, engine: QuadStore) -> tuple[str, ...]:
    """A message for each term and graph of a query that no statement of the map has.

    Such a term matches nothing and causes no error. Relative IRIs, and texts of more than
    `MAX_LENGTH` characters, are not looked up.
    """
    used = dict(islice(_used(sparql), MAX_TERMS)) if len(sparql) <= MAX_LENGTH else {}
    if not used:
        return ()
    declared = declared_terms(engine)
    found = (_absence(iri, engine, declared, graphs) for iri, graphs in used.items())
    return tuple(message for message in found if message)


def _used(sparql: str) -> Iterator[tuple[str, frozenset[str] | None]]:
    """The absolute IRIs of a query, with the graphs that its patterns are limited to there.

    They are None for an IRI that names a graph, and empty for the union of all graphs. Functions,
    datatypes, endpoints and declarations of prefixes are left out.
    """
    tokens = list(tokens_of(sparql))
    namespaces = dict(v.PREFIXES)
    dataset, named = frozenset[str](), frozenset[str]()  # by FROM; by the last GRAPH
    groups: list[frozenset[str]] = []
    for at, token in enumerate(tokens):
        before, after = (tokens[k].text if 0 <= k < len(tokens) else "" for k in (at - 1, at + 1))
        if token.text == "{":
            groups.append(named or (groups[-1] if groups else dataset))
            named = frozenset()
        elif token.text == "}":
            del groups[-1:]
        elif before.upper() == "PREFIX":
            namespaces[token.text.rstrip(":")] = after[1:-1]
        elif token.kind == "iri" and ":" in before and tokens[at - 2].keyword == "PREFIX":
            continue
        elif token.kind in ("iri", "name") and before.upper() not in _NO_TERMS and after != "(":
            prefix, _, local = token.text.partition(":")
            iri = token.text[1:-1] if token.kind == "iri" else namespaces.get(prefix, "") + local
            if ":" not in iri or "\\" in iri:
                continue
            if before.upper() == "GRAPH":
                named = frozenset([iri])
            elif before.upper() == "FROM":
                dataset |= {iri}
            is_graph = before.upper() in ("GRAPH", "FROM", "NAMED")
            yield iri, None if is_graph else groups[-1] if groups else dataset


def _absence(iri: str, engine: QuadStore, declared: set[str], graphs: frozenset[str] | None) -> str:
    """The message for an IRI that the map lacks; empty for one that it has."""
    try:
        node = NamedNode(iri)
    except ValueError:
        return ""
    if graphs is None:
        if _has(engine, None, None, None, node):
            return ""
        known = sorted({q.graph_name for q in engine} if isinstance(engine, Store) else (), key=str)
        names = ", ".join(v.curie(getattr(name, "value", "")) for name in known[:_MAX_GRAPHS])
        return f"the map has no graph {v.curie(iri)}{f'; it has {names}' if names else ''}"
    if iri.startswith(v.HERE) and iri not in declared:
        return undeclared(iri, declared)
    if _has(engine, None, node, None, None) or iri in _ENTAILED:
        return ""
    kinds = {q.object for q in engine.quads_for_pattern(node, v.RDF_TYPE, None, v.ONTOLOGY_GRAPH)}
    is_property = any(str(kind).endswith("Property>") for kind in kinds)
    places = ((node, None, None, None), (None, None, node, None), (None, None, None, node))
    if is_property:
        return f"no statement of the map has the property {v.curie(iri)}{_as_inverse(node, engine)}"
    if any(_has(engine, *place) for place in places) or iri in declared:
        return _as_inferred(node, engine, graphs)
    why = ", though exports may have it" if iri in v.TERMS else like_declared(iri, declared)
    return f"no statement of the map has {v.curie(iri)}{why}"


def _as_inverse(node: NamedNode, engine: QuadStore) -> str:
    """A hint for a property whose inverse alone is stated; empty for other properties."""
    for quad in engine.quads_for_pattern(node, _INVERSE_OF, None, v.ONTOLOGY_GRAPH):
        if isinstance(quad.object, NamedNode) and _has(engine, None, quad.object, None, None):
            return f", which states its inverse: write ^{v.curie(quad.object.value)}"
    return ""


def _as_inferred(node: NamedNode, engine: QuadStore, graphs: frozenset[str]) -> str:
    """Why graph:map alone has no thing of a class; empty for other graphs and stated classes."""
    if v.MAP_GRAPH.value not in graphs or v.INFERRED_GRAPH.value in graphs:
        return ""
    stated, inferred = (
        _has(engine, None, v.RDF_TYPE, node, graph) for graph in (v.MAP_GRAPH, v.INFERRED_GRAPH)
    )
    if stated or not inferred:
        return ""
    return (
        f"graph:map states the most specific class of a thing; {v.curie(node.value)} follows from "
        "it in graph:inferred: leave out GRAPH or FROM"
    )


def _has(engine: QuadStore, *pattern: NamedNode | None) -> bool:
    return next(iter(engine.quads_for_pattern(*pattern)), None) is not None


def undeclared(iri: str, declared: set[str]) -> str:
    """The message for an undeclared ``here:`` term, with the closest declared one."""
    return f"no ontology declares {v.curie(iri)}{like_declared(iri, declared)}"


def like_declared(iri: str, declared: Iterable[str]) -> str:
    """A clause that names the term with the closest local name, whatever its namespace.

    Terms are the `declared` ones, and the vocabulary's. The clause is empty without a close name.
    """
    known = sorted({*declared, *v.TERMS} - {iri}, key=lambda term: not term.startswith(v.HERE))
    names = {v.local_name(term): v.curie(term) for term in reversed(known)}
    given = v.local_name(iri)
    if not iri.startswith(tuple(v.PREFIXES.values())):
        # in a namespace of others, only the same name is no accident
        names = {name: text for name, text in names.items() if name.lower() == given.lower()}
    return did_you_mean(given, names, names)

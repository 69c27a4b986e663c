"""Serialisation of maps for other tools: Turtle, TriG, N-Quads, N-Triples, JSON-LD, RDF/XML.

An export has the map and dataset graphs, the assertions, optionally the ontology, and derived
triples in standard vocabularies (`kg.rdf.standard_terms`). TriG and N-Quads keep the graphs and
ontologies apart, and have the inferred types in graph:inferred. The other formats hold one graph
without inferred types, with the ontology an OWL 2 DL document without imports, from which a
reasoner infers them. The same map gives the same text.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Final, TypeVar, cast

from pyoxigraph import BlankNode, Literal, NamedNode, Quad, RdfFormat, Triple, serialize

from kg.export.owl_document import owl_document, with_one_header
from kg.maps.facts.objects_and_places import RecordCodec
from kg.maps.semantic_map import SemanticMap
from kg.model import vocabulary as v
from kg.model.errors import GraphError, OntologyError, did_you_mean
from kg.rdf.literals import by_subject, in_xml
from kg.rdf.quad_store import Subject
from kg.rdf.skolem import anonymous
from kg.rdf.standard_terms import geometry_quads, standard_quads, to_jsonld
from kg.store.folder import write_atomically
from kg.store.scheduling import in_pieces

#: format -> endings of its files
FORMATS: Final[dict[str, tuple[str, ...]]] = {
    "ttl": (".ttl",),
    "trig": (".trig",),
    "nq": (".nq",),
    "nt": (".nt",),
    "jsonld": (".jsonld", ".json"),
    "rdfxml": (".rdf", ".owl", ".xml"),
}
#: the engine's formats; it writes JSON-LD without a context
_NATIVE: Final = {
    "ttl": RdfFormat.TURTLE,
    "trig": RdfFormat.TRIG,
    "nq": RdfFormat.N_QUADS,
    "nt": RdfFormat.N_TRIPLES,
    "rdfxml": RdfFormat.RDF_XML,
}
#: aliases of the formats in other RDF tools
_ALIASES: Final = {
    "turtle": "ttl",
    "nquads": "nq",
    "n-quads": "nq",
    "ntriples": "nt",
    "n-triples": "nt",
    "json-ld": "jsonld",
    "rdf/xml": "rdfxml",
    "xml": "rdfxml",
}

_WITH_GRAPHS: Final = ("trig", "nq")
_GRAPHS = (
    v.DATASET_GRAPH.value,
    v.MAP_GRAPH.value,
    v.ASSERTIONS_GRAPH.value,
    v.HISTORY_GRAPH.value,
)
_FIRST = {v.RDF_TYPE.value: 0, v.RDFS_LABEL: 1}
_PIECE: Final = 2000  # quads read between two rests for a writer
_DOUBLE = NamedNode(v.XSD + "double")
_Prefixes = dict[str, str]
_Statement = TypeVar("_Statement", Quad, Triple)

_TURTLE_TOKEN: Final = re.compile(
    r"""
      "(?:[^"\\]|\\.)*" | <[^>]*>
    | (?P<prefix>[\w-]*):(?P<local>(?:[^\s\\;,()\[\]"<>]|\\.)*)
    """,
    re.VERBOSE,
)
_ESCAPE: Final = re.compile(r"\\(.)")

#: endings of files that `export_ontology` writes
_ENDINGS: Final = {
    ".ttl": RdfFormat.TURTLE,
    ".owl": RdfFormat.RDF_XML,
    ".rdf": RdfFormat.RDF_XML,
    ".nt": RdfFormat.N_TRIPLES,
}


def export_map(
    semantic_map: SemanticMap,
    path: Path | str,
    format: str | None = None,
    *,
    ontology: bool = True,
) -> int:
    """Write the map to `path` atomically; returns the number of triples, in all graphs.

    `format` is one of `FORMATS`; without it the ending of `path` decides. Raises GraphError for an
    unknown format and where `path` cannot be written.
    """
    path = Path(path)
    chosen = format or _format_of(path)
    statements = _statements(semantic_map, chosen, ontology=ontology)
    write_atomically(path, _text(statements, chosen, prefixes_of(semantic_map.base)))
    return len(statements)


def export_text(semantic_map: SemanticMap, format: str, *, ontology: bool = True) -> str:
    """The map as text in one of `FORMATS`; raises GraphError for an unknown one."""
    statements = _statements(semantic_map, format, ontology=ontology)
    return _text(statements, format, prefixes_of(semantic_map.base))


def export_quads(semantic_map: SemanticMap, *, ontology: bool = True) -> list[Quad]:
    """Quads of an export in their order, with geometries."""
    parts = _graphs(semantic_map, ontology=ontology)
    return [quad for quads in parts for quad in _in_order(quads)]


def _graphs(semantic_map: SemanticMap, *, ontology: bool) -> Iterator[Iterator[Quad]]:
    """Quads of each graph of an export, in no order."""
    graphs = (*_GRAPHS, v.ONTOLOGY_GRAPH.value) if ontology else _GRAPHS
    engine = semantic_map.engine
    quads = {
        graph: tuple(engine.quads_for_pattern(None, None, None, NamedNode(graph)))
        for graph in graphs
    }
    codec = RecordCodec(semantic_map.base, semantic_map.catalogue)
    stored = by_subject(in_pieces(quads[v.MAP_GRAPH.value], _PIECE))
    things = codec.objects_of(stored), semantic_map.places()
    base = semantic_map.base
    described = {quad.triple for quad in quads[v.DATASET_GRAPH.value]}
    derived = (*geometry_quads(base, *things, semantic_map.robot()), *standard_quads(base, stored))
    quads[v.MAP_GRAPH.value] += tuple(q for q in derived if q.triple not in described)
    for graph in graphs:
        yield map(_with_exponent, anonymous(quads[graph]))


def _statements(
    semantic_map: SemanticMap, form: str, *, ontology: bool
) -> list[Quad] | list[Triple]:
    """Statements of a file in that format: all graphs, an OWL 2 document, or one graph."""
    if keeps_graphs(form):
        inferred = semantic_map.engine.quads_for_pattern(None, None, None, v.INFERRED_GRAPH)
        return [*export_quads(semantic_map, ontology=ontology), *_in_order(inferred)]
    parts = _graphs(semantic_map, ontology=ontology)
    triples = [quad.triple for quads in parts for quad in quads]
    if ontology:
        iri, label = semantic_map.base + "ontology", f"ontology of {semantic_map.description.title}"
        triples = owl_document(triples, iri, label)
    return _in_order(triples)


def _text(statements: list[Quad] | list[Triple], form: str, prefixes: _Prefixes) -> str:
    name = _known(form)
    if name == "jsonld":
        return to_jsonld(cast(list[Triple], statements), prefixes) + "\n"
    native = _NATIVE[name]
    if native in (RdfFormat.TURTLE, RdfFormat.TRIG):
        return _tidy(statements, native, prefixes)
    return serialised(statements, native, prefixes if native == RdfFormat.RDF_XML else {})


def is_format(form: str) -> bool:
    """Whether `export_map` has a format of that name or alias."""
    return _ALIASES.get(form.lower(), form.lower()) in FORMATS


def keeps_graphs(form: str) -> bool:
    """Whether a format has named graphs, so that it holds quads; raises GraphError."""
    return _known(form) in _WITH_GRAPHS


def _known(form: str) -> str:
    """Canonical name of a format; raises GraphError for an unknown one."""
    known = _ALIASES.get(form.lower(), form.lower())
    if not is_format(form):
        hint = did_you_mean(known, FORMATS)
        raise GraphError(f"no export format {known!r}; there are: {', '.join(FORMATS)}{hint}")
    return known


def _format_of(path: Path) -> str:
    for form, endings in FORMATS.items():
        if path.suffix.lower() in endings:
            return form
    known = ", ".join(ending for endings in FORMATS.values() for ending in endings)
    raise GraphError(
        f"cannot tell the format of {path.name!r} from its ending; name a format "
        f"({', '.join(FORMATS)}) or end it with one of: {known}"
    )


def prefixes_of(base: str) -> _Prefixes:
    """The prefixes of the vocabulary, and of the things of the map with IRI `base`."""
    things = {name: f"{base}{name}/" for name in ("object", "observation", "place", "recording")}
    return {**v.PREFIXES, "map": base, **things}


def serialised(
    statements: Iterable[Quad] | Iterable[Triple], form: RdfFormat, prefixes: _Prefixes
) -> str:
    """Statements in a format of the engine, corrected for its XML and its prefixed names."""
    text = (serialize(statements, format=form, prefixes=prefixes) or b"").decode()
    if form in (RdfFormat.TURTLE, RdfFormat.TRIG):
        return with_full_iris(text, prefixes)
    return in_xml(text.encode()).decode() if form == RdfFormat.RDF_XML else text


def _tidy(
    statements: Iterable[Quad] | Iterable[Triple], form: RdfFormat, prefixes: _Prefixes
) -> str:
    """Prefixes in order, one empty line between subjects; strings never span lines here."""
    text = serialised(statements, form, prefixes)
    # not splitlines, which splits strings at U+2028 and others
    lines = text.replace("\t", "    ").split("\n")
    declared = sorted(line for line in lines if line.startswith("@prefix"))
    body = [line for line in lines if not line.startswith("@prefix")]
    spaced = [line + "\n" if line.endswith(" .") else line for line in body]
    return "\n".join([*declared, "", *spaced]).rstrip("\n") + "\n"


def _with_exponent(quad: Quad) -> Quad:
    """The quad with doubles as 1.23e0, which Turtle writes without quotes."""
    term = quad.object
    if not isinstance(term, Literal) or term.datatype != _DOUBLE:
        return quad
    text = repr(float(term.value))
    if "e" not in text and math.isfinite(float(term.value)):
        text += "e0"
    text = {"inf": "INF", "-inf": "-INF", "nan": "NaN"}.get(text, text)
    return Quad(quad.subject, quad.predicate, Literal(text, datatype=_DOUBLE), quad.graph_name)


def _in_order(statements: Iterable[_Statement]) -> list[_Statement]:
    """Statements by subject, in the order of their numbers, without duplicates."""
    about: dict[Subject, dict[tuple[object, ...], _Statement]] = {}
    for one in statements:
        rank = _rank(one.predicate.value, str(one.object))
        about.setdefault(one.subject, {})[rank] = one
    return [
        facts[rank]
        for subject, facts in sorted(about.items(), key=lambda item: _number(item[0]))
        for rank in sorted(facts)
    ]


def _number(subject: Subject) -> tuple[object, ...]:
    name = str(getattr(subject, "value", subject))
    kind, _, last = name.rpartition("/")
    return isinstance(subject, BlankNode), kind if last.isdigit() else name, len(name), name


_BY_LENGTH: Final = (v.HAS_BELIEF, v.HAS_RELATION, v.HAS_LABEL_BELIEF)


def _rank(predicate: str, value: str) -> tuple[object, ...]:
    length = len(value) if predicate in _BY_LENGTH else 0
    return _FIRST.get(predicate, 2), predicate, length, value


def with_full_iris(turtle: str, prefixes: Mapping[str, str]) -> str:
    """A Turtle or TriG document of the engine, with full IRIs for names that contain an escape.

    ``object:1\\/geometry`` is valid Turtle 1.1, but the OWLAPI (5.1.9) does not read it.
    Strings must be on one line, in double quotes.
    """
    if "\\" not in turtle:
        return turtle

    def written(match: re.Match[str]) -> str:
        local, namespace = match["local"], prefixes.get(match["prefix"] or "")
        if local is None or namespace is None or "\\" not in local:
            return match[0]
        return "<" + namespace + _ESCAPE.sub(r"\1", local) + ">"

    return _TURTLE_TOKEN.sub(written, turtle)


def export_ontology(semantic_map: SemanticMap, path: Path) -> int:
    """Write the ontology of the map to `path`, imports included; returns the number of triples.

    The file has one OWL header, with the name of the map's ontology. Raises OntologyError for an
    ending other than .ttl, .owl, .rdf or .nt, and GraphError if the file cannot be written.
    """
    form = _ENDINGS.get(path.suffix.lower())
    if form is None:
        raise OntologyError(
            f"cannot tell the format of {path.name!r} from its ending; use {', '.join(_ENDINGS)}"
        )
    merged = with_one_header(
        (quad.triple for quad in semantic_map.ontology.quads()),
        semantic_map.base + "ontology",
        f"ontology of {semantic_map.description.title}",
    )
    triples = sorted(set(merged), key=_ontology_order)
    # without a prefix for new terms, the OWLAPI saves them in Turtle under a namespace of its own
    own = {"": f"{semantic_map.base}ontology#"} if form == RdfFormat.TURTLE else {}
    write_atomically(path, serialised(triples, form, v.PREFIXES | own))
    return len(triples)


def _ontology_order(triple: Triple) -> tuple[bool, str, bool, str, str]:
    subject = str(triple.subject)
    is_type = triple.predicate == v.RDF_TYPE
    return subject.startswith("_:"), subject, not is_type, str(triple.predicate), str(triple.object)

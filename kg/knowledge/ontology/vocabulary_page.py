"""The vocabulary as a page for people: every term and category an ontology declares."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator
from typing import Final

from pyoxigraph import Literal, NamedNode, Quad

from kg.knowledge.ontology.catalogue import Catalogue, Category
from kg.knowledge.ontology.relations import Relation, relations
from kg.model import vocabulary as v

_KINDS: Final = (
    (v.OWL_CLASS, "Classes"),
    (v.OWL_OBJECT_PROPERTY, "Properties between things"),
    (v.OWL_DATATYPE_PROPERTY, "Properties with values"),
    (v.OWL_ANNOTATION_PROPERTY, "Properties between classes, and of terms"),
)
_PropertiesBySubject = dict[str, dict[str, list[NamedNode | Literal]]]

_HEAD: Final = """# Vocabulary

What the ontologies declare; made from them by

    hereabouts ontology vocabulary -o docs/reference/vocabulary.md

`here:` is `{here}`. What it is all for: [Ontology](../explanation/ontology.md);
how it lies in a map: [Architecture](../explanation/architecture.md).
"""


def vocabulary_page(quads: Iterable[Quad]) -> str:
    """Markdown: the terms by kind, then supercategories, objects and places; always the same text.

    Raises OntologyError where relations are malformed (`kg.knowledge.ontology.relations`).
    """
    quads = tuple(quads)
    catalogue = Catalogue.from_quads(quads)
    properties = _properties_by_subject(quads)
    parts = [_HEAD.format(here=v.HERE)]
    for kind, heading in _KINDS:
        parts.append(_section(heading, _terms(kind, properties, catalogue)))
    found = relations(quads)
    parts.append(_section("Supercategories of objects", _supercategories(catalogue, properties)))
    parts.append(_section("Object categories", _objects(catalogue, properties, found)))
    parts.append(_section("Place categories", _places(catalogue)))
    return "\n".join(parts)


def _section(heading: str, rows: Iterable[tuple[str, ...]]) -> str:
    head, *body = rows
    lines = [f"| {' | '.join(row)} |" for row in body]
    rule = "|" + "---|" * len(head)
    return "\n".join([f"## {heading}", "", f"| {' | '.join(head)} |", rule, *lines, ""])


def _properties_by_subject(quads: Iterable[Quad]) -> _PropertiesBySubject:
    properties: _PropertiesBySubject = defaultdict(lambda: defaultdict(list))
    for quad in quads:
        if isinstance(quad.subject, NamedNode) and isinstance(quad.object, NamedNode | Literal):
            properties[quad.subject.value][quad.predicate.value].append(quad.object)
    return properties


def _terms(
    kind: str, properties: _PropertiesBySubject, catalogue: Catalogue
) -> Iterator[tuple[str, ...]]:
    yield "term", "label", "of", "value", "meaning"
    for iri in sorted(properties):
        about = properties[iri]
        if NamedNode(kind) in about[v.RDF_TYPE.value] and catalogue.by_iri(iri) is None:
            yield (
                f"`{_short(iri)}`",
                _texts(about[v.RDFS_LABEL]),
                _texts(about[v.RDFS_DOMAIN] or about[v.RDFS_SUB_CLASS_OF]),
                _texts(about[v.RDFS_RANGE]),
                _texts(about[v.RDFS_COMMENT]),
            )


def _supercategories(
    catalogue: Catalogue, properties: _PropertiesBySubject
) -> Iterator[tuple[str, ...]]:
    yield "label", "term", "also called", "objects"
    for category in _of(catalogue, "supercategory"):
        node = NamedNode(category.iri)
        below = [c.label for c in catalogue.categories if node in _above(c, properties)]
        yield category.label, _term(category), _synonyms(category), ", ".join(sorted(below))


def _objects(
    catalogue: Catalogue, properties: _PropertiesBySubject, found: tuple[Relation, ...]
) -> Iterator[tuple[str, ...]]:
    yield (
        "label",
        "term",
        "also called",
        "a kind of",
        "located at (p)",
        "near (p)",
        "networks' names",
    )
    for category in _of(catalogue, "object"):
        above = [catalogue.by_iri(term.value) for term in _above(category, properties)]
        kinds = sorted(c.label for c in above if c is not None)
        yield (
            category.label,
            _term(category),
            _synonyms(category),
            ", ".join(kinds),
            *(_targets(category, kind, found, catalogue) for kind in (v.LOCATED_AT, v.NEAR_BY)),
            _hidden(category),
        )


def _targets(
    category: Category, kind: str, found: tuple[Relation, ...], catalogue: Catalogue
) -> str:
    edges = [r for r in found if (r.kind, r.subject) == (kind, category.iri)]
    named = [(catalogue.by_iri(r.target), r) for r in edges]
    return ", ".join(sorted(f"{c.label} ({r.probability:g})" for c, r in named if c is not None))


def _places(catalogue: Catalogue) -> Iterator[tuple[str, ...]]:
    yield "label", "term", "also called", "networks' names"
    for category in _of(catalogue, "place"):
        yield category.label, _term(category), _synonyms(category), _hidden(category)


def _of(catalogue: Catalogue, kind: str) -> list[Category]:
    return [category for category in catalogue.categories if category.kind == kind]


def _above(category: Category, properties: _PropertiesBySubject) -> list[NamedNode | Literal]:
    return properties[category.iri][v.RDFS_SUB_CLASS_OF]


def _term(category: Category) -> str:
    return f"`{_short(category.iri)}`"


def _synonyms(category: Category) -> str:
    return ", ".join(_escaped(name) for name in category.synonyms)


def _hidden(category: Category) -> str:
    return ", ".join(_escaped(name) for name in category.hidden)


def _texts(terms: Iterable[NamedNode | Literal]) -> str:
    return "; ".join(
        sorted(
            f"`{_short(term.value)}`" if isinstance(term, NamedNode) else _escaped(term.value)
            for term in terms
        )
    )


def _escaped(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")


def _short(iri: str) -> str:
    for prefix, namespace in v.PREFIXES.items():
        if iri.startswith(namespace) and iri != namespace:
            return f"{prefix}:{iri.removeprefix(namespace)}"
    return iri

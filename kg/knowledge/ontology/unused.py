"""Unused statements: warnings for what an ontology says and a map does not use.

A map uses names, named superclasses, relations of common sense and carriers. Other axioms of OWL
stay in graph:ontology, where queries and reasoners find them, but no category, name or search
depends on them. Their authors should know. Statements of the shipped ontology are not reported.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable, Iterator
from contextlib import suppress
from itertools import groupby
from typing import Final

from pyoxigraph import BlankNode, Literal, NamedNode, Quad

from kg.knowledge.ontology.catalogue import Catalogue, Category, name_key, shipped_ontology
from kg.knowledge.ontology.import_closure import headers
from kg.knowledge.ontology.loading import superclasses
from kg.knowledge.ontology.relations import KINDS, annotated_key
from kg.model import vocabulary as v
from kg.model.errors import did_you_mean
from kg.rdf.findings import Finding

MAX_ALIKE: Final = 20  # warnings about one property; then their number

_OWL, _RDFS, _SKOS = v.PREFIXES["owl"], v.PREFIXES["rdfs"], v.PREFIXES["skos"]
_SYNONYM = "put one class under the other (rdfs:subClassOf), or add a skos:altLabel"
_OURS = "state here:locatedAt or here:nearBy itself"
#: what works instead of an axiom; other terms of RDFS and OWL than these and `_USED` have no advice
_INSTEAD: Final = {
    v.OWL_EQUIVALENT_CLASS: _SYNONYM,
    _OWL + "sameAs": _SYNONYM,
    _OWL + "deprecated": "the term stays in use; delete it, or put it under its successor",
    _OWL + "equivalentProperty": _OURS,
    _OWL + "inverseOf": _OURS,
    _RDFS + "subPropertyOf": _OURS,
    _SKOS + "prefLabel": "the name is its rdfs:label, other names are skos:altLabel",
    _SKOS + "broader": "superclasses are rdfs:subClassOf",
    _SKOS + "narrower": "superclasses are rdfs:subClassOf",
}
_RELATED = "relate the classes themselves (here:locatedAt, here:nearBy)"
#: terms of RDFS and OWL that maps use, or that only document
_USED: Final = {
    *(v.RDFS_LABEL, v.RDFS_COMMENT, v.RDFS_SUB_CLASS_OF, v.OWL_IMPORTS, v.OWL_VERSION_INFO),
    *(v.OWL_DISJOINT_WITH, v.RDF_TYPE.value),
    *(_RDFS + name for name in ("seeAlso", "isDefinedBy", "domain", "range")),
    *(
        _OWL + name
        for name in ("versionIRI", "priorVersion", "backwardCompatibleWith", "incompatibleWith")
    ),
}
_OF_AXIOMS: Final = (v.OWL_ANNOTATED_SOURCE, v.OWL_ANNOTATED_PROPERTY, v.OWL_ANNOTATED_TARGET)
#: types that declare a term, or that a map reads
_DECLARING: Final = {
    *(v.OWL_CLASS, v.OWL_OBJECT_PROPERTY, v.OWL_DATATYPE_PROPERTY, v.OWL_ANNOTATION_PROPERTY),
    *(v.OWL_ONTOLOGY, v.OWL_NAMED_INDIVIDUAL, v.RDFS_DATATYPE, v.ROOM_STATISTICS),
    *(_OWL + "FunctionalProperty", _RDFS + "Class", v.PREFIXES["rdf"] + "Property"),
}
#: properties of ours that an ontology may state about its own terms
_OF_TERMS: Final = {
    *KINDS,
    *(v.PROBABILITY, v.CARRIES, v.BACK_HEIGHT, v.USED_FOR, v.ALSO_USED_FOR),
    *(v.PROVISIONAL_MARK, v.MARKER),
    *(v.IMPORTED_RELATIONS, v.STATISTICS_OBJECT, v.STATISTICS_PLACE),
    *(v.ROOM_COUNT, v.ROOMS_WITH_OBJECT, v.SURFACE_TEXT),
}


def unused_statements(quads: Iterable[Quad]) -> list[Finding]:
    """Warnings for statements that a map does not use, names that do not serve, and terms that are
    no category; sorted, at most `MAX_ALIKE` about one property."""
    known = set(shipped_ontology().quads)
    quads = tuple(q for q in quads if not str(getattr(q.subject, "value", "")).startswith(v.WORD))
    own = [q for q in quads if q not in known]
    if not own:
        return []
    catalogue = Catalogue.from_quads(quads)
    found = [finding for q in own for finding in _of_statement(q, catalogue)]
    found += _of_axioms(own)
    above = superclasses(quads)
    found += _of_classes(own, catalogue, above)
    found += _of_labels(own, quads, catalogue)
    found += _of_names(catalogue, above)
    return [*_limited(found)]


def unresolved_imports(quads: Iterable[Quad]) -> list[Finding]:
    """Warnings for imports of a document, whose other ontologies nobody looked for."""
    quads = tuple(quads)
    versions = {
        getattr(q.object, "value", "") for q in quads if q.predicate.value == _OWL + "versionIRI"
    }
    message = "imports an ontology that is not part of the document; nothing is fetched"
    return [
        _warning(q.subject, message, q.predicate.value, q.object)
        for q in quads
        if q.predicate.value == v.OWL_IMPORTS
        and getattr(q.object, "value", "") not in headers(quads) | versions
    ]


def _warning(subject: object, message: str, path: str = "", value: object = "") -> Finding:
    text = str(getattr(value, "value", value))
    of_node = isinstance(value, BlankNode) or text.startswith(v.GENID)
    focus = str(getattr(subject, "value", subject))
    return Finding(focus, message, path, "" if of_node else text, "warning")


def _of_statement(quad: Quad, catalogue: Catalogue) -> Iterator[Finding]:
    """Warnings for a statement about a term, by its property."""
    predicate, value = quad.predicate.value, getattr(quad.object, "value", "")
    if _is_node(quad.subject):
        return
    unused = None
    if predicate == v.RDF_TYPE.value:
        unused = _unused_type(value)
    elif predicate.startswith(v.HERE):
        unused = _unused_of_ours(predicate, value, _kind(catalogue, quad.subject))
    elif predicate == v.RDFS_SUB_CLASS_OF and _is_node(quad.object):
        unused = f"no superclass that has no name is used (a restriction, union, ...); {_RELATED}"
    elif predicate == _OWL + "deprecated" and value not in ("true", "1"):
        return
    elif predicate in _INSTEAD or (predicate.startswith((_OWL, _RDFS)) and predicate not in _USED):
        unused = _unused(predicate)
    if unused is not None:
        yield _warning(quad.subject, unused, predicate, quad.object)


def _unused_of_ours(predicate: str, value: str, kind: str) -> str | None:
    """Why a statement with a property of ours about a term of some kind is not used, if so."""
    if predicate in v.TERMS and predicate not in _OF_TERMS:
        return f"{v.curie(predicate)} is a property of things in a map; of a term it is not used"
    if predicate == v.CARRIES and value not in (v.ON, v.INSIDE):
        return "here:carries is used with here:on and here:inside only"
    if predicate == v.BACK_HEIGHT and not _is_number(value):
        return "here:backHeight is used with a number [m] only"
    if predicate in KINDS and kind not in ("object", "supercategory"):
        return f"{v.curie(predicate)} is used of objects only, and this is no kind of here:Object"
    return None


def _unused(predicate: str) -> str:
    advice = _INSTEAD.get(predicate)
    names = {v.local_name(term): v.curie(term) for term in sorted(_USED)}
    other = f"; {advice}" if advice else did_you_mean(v.local_name(predicate), names, names)
    return f"{v.curie(predicate)} is not used{other}"


def _unused_type(iri: str) -> str | None:
    if iri in _DECLARING:
        return None
    if iri.startswith((_OWL, _RDFS)):
        return f"{v.curie(iri)} is not used"
    return (
        f"is an individual of {v.curie(iri)} in the ontology, and no thing of a map; "
        "add things to the map (hereabouts update, assert)"
    )


def _of_axioms(own: Iterable[Quad]) -> Iterator[Finding]:
    """Warnings for axioms without a name: what annotates no relation, and unused kinds."""
    nodes: dict[object, list[tuple[str, object]]] = defaultdict(list)
    for q in own:
        if _is_node(q.subject):
            nodes[q.subject].append((q.predicate.value, q.object))
    for notes in nodes.values():
        properties = dict(notes)
        kind = getattr(properties.get(v.RDF_TYPE.value), "value", "")
        if kind == v.OWL_AXIOM and {v.PROBABILITY, v.WEIGHT} & properties.keys():
            key = annotated_key(notes)
            if key is None:
                lacking = next(part for part in _OF_AXIOMS if part not in properties)
                message = f"an owl:Axiom with a here:probability has no {v.curie(lacking)}"
                yield _warning(properties.get(v.OWL_ANNOTATED_SOURCE, "owl:Axiom"), message)
            elif key[0] not in KINDS:
                message = f"a here:probability of {v.curie(key[0])} is not used; {_OURS}"
                yield _warning(key[1], message, key[0], NamedNode(key[2]))
        elif kind.startswith(_OWL + "Negative") or kind == _OWL + "AllDifferent":
            yield _warning(v.curie(kind), "is not used")
        elif v.RDFS_SUB_CLASS_OF in properties:
            message = f"an axiom about a class without a name is not used; {_RELATED}"
            yield _warning(properties[v.RDFS_SUB_CLASS_OF], message, v.RDFS_SUB_CLASS_OF)


def _of_classes(
    own: Iterable[Quad], catalogue: Catalogue, above: dict[str, tuple[str, ...]]
) -> Iterator[Finding]:
    """Warnings for named classes that are no category, and nothing of the map's own."""
    for quad in own:
        iri = getattr(quad.subject, "value", "")
        declares = quad.predicate == v.RDF_TYPE and quad.object == NamedNode(v.OWL_CLASS)
        if not declares or _is_node(quad.subject) or catalogue.by_iri(iri) is not None:
            continue
        if all(kind == iri or not kind.startswith(v.HERE) for kind in above.get(iri, ())):
            message = "is under neither here:Object nor here:Place, so it is no category"
            yield _warning(iri, message)


def _of_labels(
    own: Iterable[Quad], quads: Iterable[Quad], catalogue: Catalogue
) -> Iterator[Finding]:
    """Warnings for labels of one language, and for names in other languages only."""
    touched = {q.subject for q in own if q.predicate.value == v.RDFS_LABEL}
    labels: dict[object, list[Literal]] = defaultdict(list)
    for q in quads:
        if (
            q.subject in touched
            and q.predicate.value == v.RDFS_LABEL
            and isinstance(q.object, Literal)
        ):
            labels[q.subject].append(q.object)
    for subject, given in labels.items():
        category = catalogue.by_iri(getattr(subject, "value", ""))
        if category is None:
            continue
        plain = sorted(label.value for label in given if not label.language)
        if len(plain) > 1:
            others = ", ".join(map(repr, plain[1:]))
            message = (
                f"has {len(plain)} labels without a language, of which {plain[0]!r} is its name; "
                f"make {others} a skos:altLabel"
            )
            yield _warning(subject, message, v.RDFS_LABEL)
        elif not plain and not any((label.language or "").startswith("en") for label in given):
            message = (
                f"has no English label, nor one without a language: its name is {category.label!r}"
            )
            yield _warning(subject, message, v.RDFS_LABEL)


def _of_names(catalogue: Catalogue, above: dict[str, tuple[str, ...]]) -> Iterator[Finding]:
    """Warnings for synonyms that mean another category, whose label or IRI comes first.

    A synonym that became a class of its own below (mug, under cup) is none.
    """
    shipped = shipped_ontology().catalogue
    for category in catalogue.categories:
        if category.derived:
            continue
        for name in category.synonyms:
            first = catalogue.named(name_key(name), category.kind)
            if first is None or category.iri in above[first.iri]:
                continue
            if _as_shipped(shipped, first, category):
                continue
            message = f"has the synonym {name!r}, which means {v.curie(first.iri)}"
            yield _warning(category.iri, message, v.SKOS_ALT_LABEL)


def _as_shipped(shipped: Catalogue, *categories: Category) -> bool:
    return all(shipped.by_iri(category.iri) == category for category in categories)


def _limited(found: Iterable[Finding]) -> Iterator[Finding]:
    for path, alike in groupby(sorted(set(found), key=lambda f: (f.path, f)), lambda f: f.path):
        first, *others = alike
        yield from (first, *others[: MAX_ALIKE - 1])
        if len(others) >= MAX_ALIKE:
            what = f"of {v.curie(path)}" if path else "of this kind"
            message = f"and {len(others) + 1 - MAX_ALIKE} more statements {what} are not used"
            yield _warning("owl:Ontology", message, path)


def _kind(catalogue: Catalogue, term: object) -> str:
    category = catalogue.by_iri(str(getattr(term, "value", "")))
    return category.kind if category else ""


def _is_number(text: str) -> bool:
    with suppress(ValueError):
        return math.isfinite(float(text))
    return False


def _is_node(term: object) -> bool:
    return isinstance(term, BlankNode) or str(getattr(term, "value", "")).startswith(v.GENID)

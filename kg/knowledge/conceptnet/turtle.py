"""Turtle serialiser of an import, in the style of commonsense.ttl; deterministic."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from typing import Final

from pyoxigraph import Literal, NamedNode, RdfFormat, Triple, serialize

from kg.knowledge.conceptnet.relate import ImportedRelation
from kg.knowledge.ontology.import_digest import mark_of
from kg.knowledge.ontology.relations import Key
from kg.model import vocabulary as v

ATTRIBUTION: Final = (
    "This work includes data from ConceptNet 5, compiled by the Commonsense Computing Initiative"
)
#: Prefixes of the file; IRIs of other namespaces are written in full.
_PREFIXES: Final = {name: v.PREFIXES[name] for name in ("here", "owl", "rdfs", "xsd", "dct")}
_LOCAL: Final = re.compile(r"[A-Za-z][A-Za-z0-9]*")
_SECTIONS: Final = {
    v.LOCATED_AT: "Where objects are found",
    v.NEAR_BY: "Objects near other objects (to find the first, look near the second)",
    v.RDFS_SUB_CLASS_OF: "Kinds of objects",
}
_COMMENT: Final = (
    "Relations between categories, imported from ConceptNet (conceptnet.io). "
    f"{ATTRIBUTION} (CC BY-SA 4.0). Each carries its weight, its sources, their licences and "
    "wording. Edit freely: what is changed, added or removed by hand stays so at the next import."
)


def key_of(found: ImportedRelation) -> Key:
    """Key of a relation."""
    return found.kind, found.subject, found.target


def notes_of(found: ImportedRelation) -> list[tuple[str, NamedNode | Literal]]:
    """Properties of a relation's owl:Axiom node, its digest last."""
    notes: list[tuple[str, NamedNode | Literal]] = [
        (v.OWL_ANNOTATED_SOURCE, NamedNode(found.subject)),
        (v.OWL_ANNOTATED_PROPERTY, NamedNode(found.kind)),
        (v.OWL_ANNOTATED_TARGET, NamedNode(found.target)),
    ]
    if found.probability is not None:
        notes.append((v.PROBABILITY, _double(found.probability)))
    notes.append((v.WEIGHT, _double(found.weight)))
    if found.weight_against:
        notes.append((v.WEIGHT_AGAINST, _double(found.weight_against)))
    notes += [(v.DCT_SOURCE, NamedNode(source)) for source in found.sources]
    notes += [(v.DCT_LICENSE, NamedNode(license)) for license in found.licenses]
    notes += [(v.SURFACE_TEXT, Literal(text)) for text in found.surfaces]
    return [*notes, (v.IMPORT_MARK, Literal(mark_of(notes)))]


def file_text(
    found: Iterable[ImportedRelation],
    listed: Iterable[Key],
    header: Iterable[Triple],
    people: list[Triple],
) -> str:
    """The whole file.

    Args:
        found: the relations to write, in order.
        listed: all relations ever imported; people removed those that are not in `found`.
        header: statements of people in the ontology's header.
        people: all other statements of people.
    """
    parts = [*_head(listed, header)]
    section = ""
    for relation in found:
        if relation.kind != section:
            section = relation.kind
            parts.append(f"### {_SECTIONS[section]}\n")
        parts.append(_block(relation))
    if people:
        parts += ["### Written or edited by people\n", _turtle(people)]
    return "\n".join(parts)


def listing(keys: Iterable[Key]) -> str:
    """Listing of relations for the header: one line for each, with prefixed IRIs."""
    return "\n".join(sorted(" ".join(prefixed(part) for part in (s, k, t)) for k, s, t in keys))


def listed_in(text: str) -> set[Key]:
    """Relations parsed from a listing; invalid lines are skipped."""
    lines = [line.split() for line in text.splitlines()]
    terms = [tuple(full_iri(word) for word in line) for line in lines if len(line) == 3]
    return {(kind, subject, target) for subject, kind, target in terms}


def _head(listed: Iterable[Key], added: Iterable[Triple]) -> Iterator[str]:
    lines = [f"@prefix {name}: <{iri}> ." for name, iri in _PREFIXES.items()]
    imports = f"<{v.OBJECTS_ONTOLOGY}> ,\n        <{v.PLACES_ONTOLOGY}>"
    yield "\n".join([*lines, ""])
    yield f"""<{v.CONCEPTNET_ONTOLOGY}> a owl:Ontology ;
    owl:imports {imports} ;
    rdfs:label "hereabouts: ConceptNet" ;
    rdfs:comment {_literal(Literal(_COMMENT))} ;
    owl:versionInfo "0.1.0" ;
    dct:license <{v.LICENSES}by-sa/4.0/> ;
    dct:source <{v.CONCEPTNET}> ;
    here:importedRelations {_literal(Literal(listing(listed)))} .
"""
    if added := list(added):
        yield _turtle(added)


def _block(found: ImportedRelation) -> str:
    kind, subject, target = (prefixed(iri) for iri in key_of(found))
    notes = [f"{prefixed(p)} {_object(o)}" for p, o in notes_of(found)]
    axiom = " ;\n    ".join(["[] a owl:Axiom", *notes])
    return f"{subject} {kind} {target} .\n{axiom} .\n"


def _turtle(triples: list[Triple]) -> str:
    text = (serialize(triples, format=RdfFormat.TURTLE, prefixes=_PREFIXES) or b"").decode()
    return text.split("\n", len(_PREFIXES))[-1]


def prefixed(iri: str) -> str:
    """An IRI with a prefix of the file, or in angle brackets."""
    for name, namespace in _PREFIXES.items():
        if iri.startswith(namespace) and _LOCAL.fullmatch(iri[len(namespace) :]):
            return f"{name}:{iri[len(namespace) :]}"
    return str(NamedNode(iri))


def full_iri(term: str) -> str:
    """The IRI of a term as `prefixed` writes it."""
    name, _, local = term.partition(":")
    return _PREFIXES[name] + local if name in _PREFIXES else term.strip("<>")


def _object(term: NamedNode | Literal) -> str:
    return prefixed(term.value) if isinstance(term, NamedNode) else _literal(term)


def _literal(literal: Literal) -> str:
    return literal.value if literal.datatype == v.XSD_DOUBLE else str(literal)


def _double(value: float) -> Literal:
    return Literal(f"{value!r}e0", datatype=v.XSD_DOUBLE)

"""Turtle serialiser of an import, in the style of commonsense.ttl; deterministic."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from pyoxigraph import BlankNode, Literal, NamedNode, RdfFormat, Triple, serialize

from kg.knowledge.conceptnet.relate import ImportedRelation
from kg.knowledge.ontology.relations import Key, Notes, annotated_key, as_imported, mark_of
from kg.model import vocabulary as v
from kg.model.errors import ConceptNetError, OntologyError
from kg.rdf.parsing import parse_file
from kg.rdf.skolem import StableNodes

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
    return "\n".join(sorted(" ".join(map(prefixed, (s, k, t))) for k, s, t in keys))


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
    kind, subject, target = map(prefixed, found.key)
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


#: Header properties that the importer writes; people wrote the others.
_OF_HEADER: Final = (
    *(v.RDF_TYPE.value, v.RDFS_LABEL, v.RDFS_COMMENT, v.DCT_LICENSE, v.DCT_SOURCE),
    *(v.OWL_VERSION_INFO, v.IMPORTED_RELATIONS),
)
_IMPORTS: Final = (NamedNode(v.OBJECTS_ONTOLOGY), NamedNode(v.PLACES_ONTOLOGY))


@dataclass(frozen=True, slots=True)
class RelationChange:
    """Difference in one relation of a file between before and after an import."""

    what: str  # added, removed, changed, yours (edited by people), left out (removed by people)
    kind: str  # IRI
    subject: str  # IRI
    target: str  # IRI
    before: float | None = None  # probability
    after: float | None = None


@dataclass(slots=True)
class ImportedFile:
    """Parsed imported file: the importer's relations, and statements of people."""

    imported: dict[Key, tuple[float | None, str]] = field(default_factory=dict)  # p, digest
    listed: set[Key] = field(default_factory=set)
    edited_by_people: set[Key] = field(default_factory=set)  # relations people wrote or edited
    header: list[Triple] = field(default_factory=list)
    people: list[Triple] = field(default_factory=list)

    @property
    def removed(self) -> set[Key]:
        """Imported relations that people removed."""
        return self.listed - set(self.imported) - self.edited_by_people


def read_imported_file(path: Path) -> ImportedFile:
    """Parse the file of an earlier import; empty if there is no file.

    Raises:
        ConceptNetError: the file does not parse, or no import wrote it.
    """
    if not path.exists():
        return ImportedFile()
    try:
        triples = [quad.triple for quad in parse_file(path)]
    except OntologyError as error:
        raise ConceptNetError(str(error)) from None
    header = Triple(NamedNode(v.CONCEPTNET_ONTOLOGY), v.RDF_TYPE, NamedNode(v.OWL_ONTOLOGY))
    if header not in triples:
        raise ConceptNetError(
            f"{path} is no file of this importer (no ontology <{v.CONCEPTNET_ONTOLOGY}> in it): "
            "name a new file, the import would overwrite this one"
        )
    return _classified(triples)


def _classified(triples: list[Triple]) -> ImportedFile:
    file = ImportedFile()
    notes: dict[object, Notes] = defaultdict(list)
    for t in triples:
        notes[t.subject].append((t.predicate.value, t.object))
    keys = {node: key for node, found in notes.items() if (key := annotated_key(found))}
    imported: dict[object, Key] = {
        node: key
        for node, key in keys.items()
        if isinstance(node, BlankNode) and as_imported(notes[node])
    }
    edited = {key for node, key in keys.items() if node not in imported}
    for node, key in imported.items():
        file.imported[key] = (_probability(notes[node]), _literal_text(notes[node], v.IMPORT_MARK))
    stated = {key for t in triples if (key := _stated(t))}
    file.imported = {key: notes for key, notes in file.imported.items() if key in stated - edited}
    file.edited_by_people = stated - set(file.imported)
    for t in triples:
        _assign(t, file, imported)
    stable = StableNodes("p")  # in order of occurrence, so that the output is stable
    file.header, file.people = (
        [Triple(stable(t.subject), t.predicate, stable(t.object)) for t in triples]
        for triples in (file.header, file.people)
    )
    return file


def _assign(t: Triple, file: ImportedFile, imported: dict[object, Key]) -> None:
    """Add a triple to the header or to people's triples, unless the importer wrote it."""
    if t.subject == NamedNode(v.CONCEPTNET_ONTOLOGY):
        if t.predicate.value == v.IMPORTED_RELATIONS and isinstance(t.object, Literal):
            file.listed |= listed_in(t.object.value)
        elif t.predicate.value not in _OF_HEADER and not (
            t.predicate.value == v.OWL_IMPORTS and t.object in _IMPORTS
        ):
            file.header.append(t)
    elif t.subject not in imported and _stated(t) not in file.imported:
        file.people.append(t)


def _stated(t: Triple) -> Key | None:
    if t.predicate.value not in _SECTIONS:
        return None
    if isinstance(t.subject, NamedNode) and isinstance(t.object, NamedNode):
        return t.predicate.value, t.subject.value, t.object.value
    return None


def _literal_text(notes: Notes, predicate: str) -> str:
    return next((o.value for p, o in notes if p == predicate and isinstance(o, Literal)), "")


def _probability(notes: Notes) -> float | None:
    text = _literal_text(notes, v.PROBABILITY)
    return float(text) if text else None


def merge(
    file: ImportedFile, found: Iterable[ImportedRelation]
) -> tuple[str, list[RelationChange]]:
    """Merge an import into a file; returns the new text and the changes, sorted by relation."""
    new = {relation.key: relation for relation in found}
    removed = file.removed
    written = {k: r for k, r in new.items() if k not in file.edited_by_people and k not in removed}
    changes = [RelationChange("left out", *key) for key in removed & set(new)]
    changes += [RelationChange("yours", *key) for key in file.edited_by_people & set(new)]
    for key in set(written) | set(file.imported):
        changes += _change(key, file.imported.get(key), written.get(key))
    # relations that people edited or removed stay in the list
    listed = set(written) | removed | (file.listed & file.edited_by_people)
    text = file_text(written.values(), listed, file.header, file.people)
    return text, sorted(changes, key=lambda c: (c.kind, c.subject, c.target))


def _change(
    key: Key, old: tuple[float | None, str] | None, new: ImportedRelation | None
) -> list[RelationChange]:
    before = None if old is None else old[0]
    after = None if new is None else new.probability
    if old is None or new is None:
        return [RelationChange("added" if old is None else "removed", *key, before, after)]
    if _literal_text([*notes_of(new)], v.IMPORT_MARK) != old[1]:
        return [RelationChange("changed", *key, before, after)]
    return []

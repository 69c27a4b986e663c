"""What people did to an imported file since it was written, and how an import leaves it be.

An imported relation carries a mark of what was imported (`kg.marks`); where the mark no longer
fits, a person edited the relation, and it is theirs. The header lists what was ever imported; what
is listed and gone, a person removed. Everything without a mark is people's own.
"""

from __future__ import annotations

import os
from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, TypeVar

from pyoxigraph import BlankNode, Literal, NamedNode, Triple

from kg import vocabulary as v
from kg.conceptnet.relate import Found
from kg.conceptnet.turtle import Key, file_text, key_of, listed_in, notes_of
from kg.errors import ConceptNetError, OntologyError
from kg.marks import as_imported
from kg.syntaxes import parse_file

_KINDS: Final = (v.LOCATED_AT, v.NEAR_BY, v.RDFS_SUB_CLASS_OF)
#: What the importer says of its file; other properties of the header are people's.
_OF_HEADER: Final = (
    *(v.RDF_TYPE, v.RDFS_LABEL, v.RDFS_COMMENT, v.DCT_LICENSE, v.DCT_SOURCE),
    *(v.OWL_VERSION_INFO, v.IMPORTED_RELATIONS),
)
_IMPORTS: Final = (v.OBJECTS_ONTOLOGY, v.PLACES_ONTOLOGY)

_Notes = list[tuple[str, object]]
_Term = TypeVar("_Term")


@dataclass(frozen=True, slots=True)
class Change:
    """One difference between what a file said of a relation and what it says after an import."""

    what: str  # added, removed, changed, yours (kept as edited), left out (as you removed it)
    kind: str  # IRI
    subject: str  # IRI
    target: str  # IRI
    before: float | None = None  # probability
    after: float | None = None


@dataclass(slots=True)
class Standing:
    """An imported file as it stands: what is still the importer's, and what is people's."""

    imported: dict[Key, tuple[float | None, str]] = field(default_factory=dict)  # p, mark
    listed: set[Key] = field(default_factory=set)
    theirs: set[Key] = field(default_factory=set)  # relations people wrote or edited
    header: list[Triple] = field(default_factory=list)
    people: list[Triple] = field(default_factory=list)

    @property
    def removed(self) -> set[Key]:
        """Relations that were imported once and that a person took out."""
        return self.listed - set(self.imported) - self.theirs


def read_standing(path: Path) -> Standing:
    """What a file holds that an earlier import wrote; nothing where there is no such file.

    Raises:
        ConceptNetError: it does not parse, or no import wrote it.
    """
    if not path.exists():
        return Standing()
    triples = _parsed(path)
    header = Triple(
        NamedNode(v.CONCEPTNET_ONTOLOGY), NamedNode(v.RDF_TYPE), NamedNode(v.OWL_ONTOLOGY)
    )
    if header not in triples:
        raise ConceptNetError(
            f"{path} is no file of this importer (no ontology <{v.CONCEPTNET_ONTOLOGY}> in it): "
            "name a new file, the import would overwrite this one"
        )
    return _sorted_out(triples)


def _parsed(path: Path) -> list[Triple]:
    try:
        return [quad.triple for quad in parse_file(path)]
    except OntologyError as error:
        raise ConceptNetError(str(error)) from None


def _renamed(triples: Iterable[Triple], names: dict[object, BlankNode]) -> list[Triple]:
    """The same with blank nodes named in the order they come, so that a file stays as it is."""

    def stable(term: _Term) -> _Term | BlankNode:
        if not isinstance(term, BlankNode):
            return term
        return names.setdefault(term, BlankNode(f"p{len(names)}"))

    return [Triple(stable(t.subject), t.predicate, stable(t.object)) for t in triples]


def _sorted_out(triples: list[Triple]) -> Standing:
    standing = Standing()
    notes: dict[object, _Notes] = defaultdict(list)
    for t in triples:
        notes[t.subject].append((t.predicate.value, t.object))
    ours = {node: key for node, said in notes.items() if (key := _imported_key(node, said))}
    edited = {key for node, said in notes.items() if node not in ours and (key := _key(said))}
    for node, key in ours.items():
        standing.imported[key] = (_probability(notes[node]), _text(notes[node], v.IMPORT_MARK))
    stated = {key for t in triples if (key := _stated(t))}
    standing.imported = {
        key: said for key, said in standing.imported.items() if key in stated - edited
    }
    standing.theirs = stated - set(standing.imported)
    for t in triples:
        _put(t, standing, ours)
    names: dict[object, BlankNode] = {}
    standing.header = _renamed(standing.header, names)
    standing.people = _renamed(standing.people, names)
    return standing


def _put(t: Triple, standing: Standing, ours: dict[object, Key]) -> None:
    """One triple to whom it belongs."""
    if t.subject == NamedNode(v.CONCEPTNET_ONTOLOGY):
        if t.predicate.value == v.IMPORTED_RELATIONS and isinstance(t.object, Literal):
            standing.listed |= listed_in(t.object.value)
        elif t.predicate.value not in _OF_HEADER and not _is_import(t):
            standing.header.append(t)
    elif t.subject not in ours and _stated(t) not in standing.imported:
        standing.people.append(t)


def _is_import(t: Triple) -> bool:
    return (
        t.predicate.value == v.OWL_IMPORTS
        and isinstance(t.object, NamedNode)
        and t.object.value in _IMPORTS
    )


def _stated(t: Triple) -> Key | None:
    if t.predicate.value not in _KINDS:
        return None
    if isinstance(t.subject, NamedNode) and isinstance(t.object, NamedNode):
        return t.predicate.value, t.subject.value, t.object.value
    return None


def _imported_key(node: object, said: _Notes) -> Key | None:
    return _key(said) if isinstance(node, BlankNode) and as_imported(said) else None


def _key(said: _Notes) -> Key | None:
    by_predicate = dict(said)
    parts = (v.OWL_ANNOTATED_PROPERTY, v.OWL_ANNOTATED_SOURCE, v.OWL_ANNOTATED_TARGET)
    terms = [by_predicate.get(part) for part in parts]
    if not all(isinstance(term, NamedNode) for term in terms):
        return None
    kind, subject, target = (term.value for term in terms if isinstance(term, NamedNode))
    return kind, subject, target


def _text(said: _Notes, predicate: str) -> str:
    return next((o.value for p, o in said if p == predicate and isinstance(o, Literal)), "")


def _probability(said: _Notes) -> float | None:
    text = _text(said, v.PROBABILITY)
    return float(text) if text else None


def merge(standing: Standing, found: Iterable[Found]) -> tuple[str, list[Change]]:
    """The file's new text, and what changes in it, in the order of the relations."""
    new = {key_of(relation): relation for relation in found}
    kept_out = standing.removed
    written = {k: r for k, r in new.items() if k not in standing.theirs and k not in kept_out}
    changes = [Change("left out", *key) for key in kept_out & set(new)]
    changes += [Change("yours", *key) for key in standing.theirs & set(new)]
    for key in set(written) | set(standing.imported):
        changes += _change(key, standing.imported.get(key), written.get(key))
    # what people edited or removed must be known as such for good
    listed = set(written) | kept_out | (standing.listed & standing.theirs)
    text = file_text(written.values(), listed, standing.header, standing.people)
    return text, sorted(changes, key=lambda c: (c.kind, c.subject, c.target))


def _change(key: Key, old: tuple[float | None, str] | None, new: Found | None) -> list[Change]:
    if old is None and new is not None:
        return [Change("added", *key, None, new.probability)]
    if new is None and old is not None:
        return [Change("removed", *key, old[0], None)]
    if old is not None and new is not None and _text([*notes_of(new)], v.IMPORT_MARK) != old[1]:
        return [Change("changed", *key, old[0], new.probability)]
    return []


def write_text(path: Path, text: str) -> bool:
    """Put `text` in place of a file, whole or not at all; False where it says so already.

    Raises:
        ConceptNetError: it cannot be written.
    """
    data = text.encode()
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        if path.exists() and path.read_bytes() == data:
            return False
        with part.open("wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        part.replace(path)
    except OSError as error:
        part.unlink(missing_ok=True)
        raise ConceptNetError(f"{path}: {error.strerror or error}") from None
    return True

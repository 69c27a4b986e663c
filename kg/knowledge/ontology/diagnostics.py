"""Validation of an edited ontology, with file and line of each finding.

`owl_dl_findings` checks the parts of the OWL 2 DL profile that need no reasoner; the OWLAPI checks
the rest (docs/how-to/protege.md), and `kg.knowledge.ontology.lint` the kinds of properties.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Final

from pyoxigraph import Literal, NamedNode, Quad

from kg.knowledge.ontology.declared_terms import like_declared
from kg.knowledge.ontology.lint import check_quads, shapes_of
from kg.knowledge.ontology.loading import Ontology
from kg.knowledge.ontology.relations import Notes, annotated_key
from kg.knowledge.ontology.unused import unresolved_imports, unused_statements
from kg.model import vocabulary as v
from kg.model.errors import OntologyError
from kg.rdf.findings import Finding
from kg.rdf.skolem import named

_BETWEEN_CLASSES: Final = {
    v.RDFS_SUB_CLASS_OF,
    v.OWL_EQUIVALENT_CLASS,
    v.OWL_DISJOINT_WITH,
}
_RESERVED: Final = tuple(v.PREFIXES[name] for name in ("rdf", "rdfs", "owl", "xsd"))
_DECLARING: Final = {
    v.OWL_CLASS,
    v.OWL_OBJECT_PROPERTY,
    v.OWL_DATATYPE_PROPERTY,
    v.OWL_ANNOTATION_PROPERTY,
    v.RDFS_DATATYPE,
}
_DECIMAL = r"[+-]?(\d+(\.\d*)?|\.\d+)"
_DOUBLE = rf"{_DECIMAL}([eE][+-]?\d+)?|[+-]?INF|NaN"
_LEXICAL: Final = {
    v.XSD + "double": re.compile(_DOUBLE),
    v.XSD + "float": re.compile(_DOUBLE),
    v.XSD + "decimal": re.compile(_DECIMAL),
    v.XSD + "integer": re.compile(r"[+-]?\d+"),
    v.XSD + "boolean": re.compile("true|false|0|1"),
}


def owl_dl_findings(quads: Iterable[Quad]) -> list[Finding]:
    """Violations of the profile: undeclared classes, terms that are both class and datatype,
    redeclared terms of OWL, and literals with an invalid lexical form."""
    quads = tuple(quads)
    kinds: dict[str, set[str]] = defaultdict(set)
    for quad in quads:
        if quad.predicate == v.RDF_TYPE and isinstance(quad.subject, NamedNode):
            kinds[quad.subject.value].add(getattr(quad.object, "value", ""))
    found = [*_undeclared_classes(quads, kinds), *_declared_wrongly(kinds), *_ill_typed(quads)]
    found += _restricted_annotations(quads, kinds)
    return sorted(set(found))


def _undeclared_classes(quads: Iterable[Quad], kinds: dict[str, set[str]]) -> Iterator[Finding]:
    for quad in quads:
        if quad.predicate.value not in _BETWEEN_CLASSES:
            continue
        for term in (quad.subject, quad.object):
            if (
                isinstance(term, NamedNode)
                and v.OWL_CLASS not in kinds.get(term.value, ())
                and term.value not in (v.OWL_THING, v.OWL_NOTHING)
            ):
                message = "is used as a class and not declared one"
                classes = {iri for iri, types in kinds.items() if v.OWL_CLASS in types}
                yield Finding(term.value, message + like_declared(term.value, classes))


def _restricted_annotations(quads: Iterable[Quad], kinds: dict[str, set[str]]) -> Iterator[Finding]:
    """Restrictions on annotation properties; OWL 2 DL has them on object and data properties."""
    restricted: dict[object, str] = {
        q.subject: q.object.value
        for q in quads
        if q.predicate.value == v.OWL_ON_PROPERTY
        and isinstance(q.object, NamedNode)
        and v.OWL_ANNOTATION_PROPERTY in kinds.get(q.object.value, ())
    }
    for quad in quads:
        if quad.object in restricted and isinstance(quad.subject, NamedNode):
            prop = restricted[quad.object].replace(v.HERE, "here:")
            message = (
                f"has a restriction on {prop}, an annotation property; "
                f"relate the classes by {prop} itself"
            )
            yield Finding(quad.subject.value, message, quad.predicate.value)


def _declared_wrongly(kinds: dict[str, set[str]]) -> Iterator[Finding]:
    for iri, types in kinds.items():
        if {v.OWL_CLASS, v.RDFS_DATATYPE} <= types:
            yield Finding(focus=iri, message="is a class and a datatype")
        if iri.startswith(_RESERVED) and types & _DECLARING and iri not in _ALLOWED:
            yield Finding(focus=iri, message="is a term of OWL itself and cannot be declared anew")


#: built-in terms that editors declare redundantly
_ALLOWED: Final = (
    {v.OWL_THING, v.OWL_NOTHING}
    | {
        v.PREFIXES["rdfs"] + name
        for name in ("label", "comment", "seeAlso", "isDefinedBy", "Literal")
    }
    | {v.PREFIXES["owl"] + name for name in ("versionInfo", "deprecated")}
    | {v.XSD + name for name in ("string", "double", "integer", "dateTime", "boolean", "decimal")}
)


def _ill_typed(quads: Iterable[Quad]) -> Iterator[Finding]:
    for quad in quads:
        value = quad.object
        if not isinstance(value, Literal):
            continue
        lexical = _LEXICAL.get(value.datatype.value)
        if lexical is not None and not lexical.fullmatch(value.value):
            kind = value.datatype.value.replace(v.XSD, "xsd:")
            yield Finding(
                focus=getattr(quad.subject, "value", ""),
                message=f"holds a text that is no {kind}",
                path=quad.predicate.value,
                value=value.value,
            )


_MAX_LISTED = 3  # findings named in one message

_BEGINNINGS: Final = ("", "<owl:Class rdf:about=", "<rdf:Description rdf:about=")
_MAX_TERMS: Final = 8  # of a finding that are looked for
_TERM: Final = re.compile(r"here:[\w-]+")


def inspect(ontology: Ontology, *, reason: bool = False) -> list[Finding]:
    """Validation findings of SHACL, undeclared terms, OWL 2 DL and, with `reason`, of HermiT;
    warnings for what a map does not use (`kg.knowledge.ontology.unused`).

    Annotating blank nodes have the name of their statement.

    Raises:
        OntologyError: with `reason`, there is no Java, or the whole ontology is contradictory.
    """
    quads = ontology.quads
    shapes = shapes_of(ontology.files[0].parent) if ontology.files else None
    found = check_quads(quads, shapes) if shapes else check_quads(quads)
    found += [*owl_dl_findings(quads), *ontology.findings, *unused_statements(quads)]
    if not ontology.files:
        found += unresolved_imports(quads)
    if not quads and ontology.files:
        found.append(Finding(ontology.files[0].name, "holds no statement", severity="warning"))
    if reason and not any(finding.severity == "violation" for finding in found):
        from kg.knowledge.ontology.reasoning import inconsistent_classes, load_world

        message = "can have no members: HermiT"
        found += [Finding(iri, message) for iri in inconsistent_classes(load_world(quads))]
    is_told = any(v.GENID in f"{f.focus} {f.value}" for f in found)
    statements = _annotated(named(quads)) if is_told else {}
    return sorted(
        {_with_words(finding, statements) for finding in found},
        key=lambda f: (f.severity != "violation", f),
    )


def _with_words(finding: Finding, statements: Mapping[str, str]) -> Finding:
    """The finding with words for the IRIs that stand for blank nodes."""
    focus, value = finding.focus, finding.value
    if focus.startswith(v.GENID):
        focus = statements.get(focus, "an axiom")
    return replace(finding, focus=focus, value="" if value.startswith(v.GENID) else value)


def check_valid(ontology: Ontology, *, reason: bool = False) -> list[Finding]:
    """The warnings of `inspect`; raises OntologyError, with file and line, for violations."""
    found = inspect(ontology, reason=reason)
    violations = [f for f in found if f.severity == "violation"]
    if violations:
        listed = [finding_line(f, ontology.files) for f in violations[:_MAX_LISTED]]
        if more := violations[_MAX_LISTED:]:
            listed.append(f"and {len(more)} more")
        raise OntologyError(f"the ontology is refused: {'; '.join(listed)}")
    return found


def finding_line(finding: Finding, files: Iterable[Path]) -> str:
    """A finding as one line: file, line, focus and message."""
    value = f" (found {_short(finding.value)})" if finding.value else ""
    place = line_of(finding, files)
    where = f"{place[0].name}, line {place[1]}: " if place else ""
    return f"{where}{_short(finding.focus)}: {finding.message}{value}"


def line_of(finding: Finding, files: Iterable[Path]) -> tuple[Path, int] | None:
    """File and line number (from 1) of a finding.

    The line has the subject and as many other terms of the finding as possible. Among equal lines,
    one that begins with a term is preferred, then the first.
    """
    text = " ".join((_short(finding.focus), finding.message, _short(finding.value)))
    subject = _short(finding.focus).partition(" ")[0]
    if subject == _short(v.PROBABILITY) and (related := _TERM.match(finding.message)):
        subject = related[0]
    terms = dict.fromkeys([subject, *_TERM.findall(text)])
    patterns = [*filter(None, map(_pattern, list(terms)[:_MAX_TERMS]))]
    best = (False, 0, False)
    found = None
    for path in files:
        for number, line in enumerate(_lines(path, path.stat().st_mtime_ns), start=1):
            matches = [match for pattern in patterns if (match := pattern.search(line))]
            begins = any(line[: match.start()].strip() in _BEGINNINGS for match in matches)
            rank = any(match.re is patterns[0] for match in matches), len(matches), begins
            if matches and rank > best:
                best, found = rank, (path, number)
    return found


@lru_cache(maxsize=8)
def _lines(path: Path, _modified: int) -> list[str]:
    return path.read_text("utf-8", "replace").splitlines()


def _pattern(term: str) -> re.Pattern[str] | None:
    """Pattern of the forms of a term in Turtle, N-Triples and RDF/XML."""
    full = term.replace("here:", v.HERE, 1) if term.startswith("here:") else term
    local = re.escape(re.split("[#/]", full)[-1])
    if not local:
        return None
    return re.compile(rf"<{re.escape(full)}>|[\w-]*:{local}\b|[\"'#;/]{local}[\"']")


def _annotated(quads: Iterable[Quad]) -> dict[str, str]:
    """IRI of each annotating node without a name -> its statement as text."""
    notes: dict[str, Notes] = defaultdict(list)
    for quad in quads:
        if str(quad.subject).startswith(f"<{v.GENID}"):
            notes[str(quad.subject)[1:-1]].append((quad.predicate.value, quad.object))
    keys = {node: annotated_key(axiom) for node, axiom in notes.items()}
    return {
        node: " ".join(map(_short, (key[1], key[0], key[2])))
        for node, key in keys.items()
        if key is not None
    }


def _short(iri: str) -> str:
    return iri.replace(v.HERE, "here:")

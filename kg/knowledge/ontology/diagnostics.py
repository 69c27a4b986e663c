"""Validation of an edited ontology, with file and line of each finding."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Final

from pyoxigraph import Quad

from kg.knowledge.ontology.dl_profile import owl_dl_findings
from kg.knowledge.ontology.lint import check_quads, shapes_of
from kg.knowledge.ontology.loading import Ontology
from kg.knowledge.ontology.relations import Notes, annotated_key
from kg.knowledge.ontology.unused import unresolved_imports, unused_statements
from kg.model import vocabulary as v
from kg.model.errors import OntologyError
from kg.rdf.findings import Finding
from kg.rdf.skolem import named

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
    statements = _annotated(named(quads))
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

"""Everything an edited ontology is held to, and where in its files the fault is."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Final

from pyoxigraph import BlankNode, NamedNode, Quad

from kg import vocabulary as v
from kg.check import check_quads, shapes_of
from kg.editing.owl_dl import owl_dl_findings
from kg.errors import OntologyError
from kg.ontology import Ontology
from kg.shapes import Finding

_TOLD = 3  # findings named in one message
_PARTS: Final = (v.OWL_ANNOTATED_SOURCE, v.OWL_ANNOTATED_PROPERTY, v.OWL_ANNOTATED_TARGET)
_TERM: Final = re.compile(r"here:[\w-]+")


def inspect(ontology: Ontology, *, reason: bool = False) -> list[Finding]:
    """What is wrong: SHACL, undeclared terms, OWL 2 DL and, with `reason`, what HermiT finds.

    HermiT needs Java; raises OntologyError where there is none, and where the ontology as a whole
    contradicts itself. Blank nodes are named by the statement they annotate.
    """
    quads = ontology.quads
    shapes = shapes_of(ontology.files[0].parent) if ontology.files else None
    found = check_quads(quads, shapes) if shapes else check_quads(quads)
    found += owl_dl_findings(quads)
    if reason and not any(finding.severity == "violation" for finding in found):
        found += _contradictions(quads)
    statements = _annotated(quads)
    named = (_renamed(finding, statements) for finding in found)
    return sorted(set(named), key=lambda f: (f.severity != "violation", f))


def refuse_malformed(ontology: Ontology, *, reason: bool = False) -> list[Finding]:
    """The warnings of `inspect`; raises OntologyError, with file and line, for the violations."""
    found = inspect(ontology, reason=reason)
    wrong = [told(f, ontology.files) for f in found if f.severity == "violation"]
    if wrong:
        more = f"; and {len(wrong) - _TOLD} more" if len(wrong) > _TOLD else ""
        raise OntologyError(f"the ontology is refused: {'; '.join(wrong[:_TOLD])}{more}")
    return found


def told(finding: Finding, files: Iterable[Path]) -> str:
    """A finding as one line: file, line, what, and what is wrong with it."""
    value = f" (found {_short(finding.value)})" if finding.value else ""
    place = line_of(finding, files)
    where = f"{place[0].name}, line {place[1]}: " if place else ""
    return f"{where}{_short(finding.focus)}: {finding.message}{value}"


def line_of(finding: Finding, files: Iterable[Path]) -> tuple[Path, int] | None:
    """File and line, from 1, where a finding's term is described, or else first mentioned."""
    focus = finding.focus.partition(" ")[0]
    terms = [focus, *_TERM.findall(finding.message)]
    if finding.value.startswith(v.HERE):
        terms.insert(0, finding.value)
    mentions: list[tuple[bool, int, Path, int]] = []
    for rank, term in enumerate(dict.fromkeys(terms)):
        for path in files:
            for number, begins in _mentions(term, path):
                mentions.append((not begins, rank, path, number))
    if not mentions:
        return None
    _, _, path, number = min(mentions)
    return path, number


def _mentions(term: str, path: Path) -> Iterator[tuple[int, bool]]:
    """Lines that mention a term, and whether it is what they begin with."""
    full = term.replace("here:", v.HERE, 1) if term.startswith("here:") else term
    local = re.escape(re.split("[#/]", full)[-1])
    if not local:
        return
    written = re.compile(rf"(<{re.escape(full)}>|[\w-]*:{local}\b|[\"'#;/]{local}[\"'])")
    for number, line in enumerate(path.read_text("utf-8", "replace").splitlines(), start=1):
        if match := written.search(line):
            head = line[: match.start()].strip()
            yield number, head in ("", "<owl:Class rdf:about=", "<rdf:Description rdf:about=")


def _contradictions(quads: tuple[Quad, ...]) -> list[Finding]:
    from kg.owl import inconsistent_classes, load_world

    classes = inconsistent_classes(load_world(quads))
    return [Finding(focus=iri, message="can have no members: HermiT") for iri in classes]


def _annotated(quads: Iterable[Quad]) -> dict[str, str]:
    """Name of each annotating blank node to the statement that it annotates, in short."""
    parts: dict[str, dict[str, str]] = {}
    for quad in quads:
        node, value = quad.subject, quad.object
        if (
            quad.predicate.value in _PARTS
            and isinstance(node, BlankNode)
            and isinstance(value, NamedNode)
        ):
            parts.setdefault(node.value, {})[quad.predicate.value] = _short(value.value)
    return {
        node: " ".join(said[part] for part in (_PARTS[0], _PARTS[1], _PARTS[2]))
        for node, said in parts.items()
        if len(said) == len(_PARTS)
    }


def _renamed(finding: Finding, statements: dict[str, str]) -> Finding:
    name = statements.get(finding.focus.removeprefix("_:"))
    if name is None:
        return finding
    return Finding(name, finding.message, finding.path, finding.value, finding.severity)


def _short(iri: str) -> str:
    return iri.replace(v.HERE, "here:")

"""Digest of imported axioms, to detect later edits by people."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from typing import Final

from pyoxigraph import Literal, NamedNode

from kg.model import vocabulary as v

#: Predicates outside of an axiom's content.
_FORM: Final = (v.RDF_TYPE.value, v.IMPORT_MARK)
_NUMBERS: Final = tuple(v.XSD + name for name in ("double", "decimal", "integer", "float"))


def mark_of(notes: Iterable[tuple[str, object]]) -> str:
    """Short digest of an axiom's content: (predicate IRI, term) in any order.

    Numbers count by value: an ontology editor may write 0.2e0 as 0.2.
    """
    lines = sorted({f"{p} {_canonical(o)}" for p, o in notes if p not in _FORM})
    return hashlib.sha256("\n".join(lines).encode()).hexdigest()[:16]


def as_imported(notes: Iterable[tuple[str, object]]) -> bool:
    """Whether an axiom has an importer's digest that still matches its content."""
    notes = tuple(notes)
    marks = {o.value for p, o in notes if p == v.IMPORT_MARK and isinstance(o, Literal)}
    return marks == {mark_of(notes)}


def _canonical(term: object) -> str:
    if isinstance(term, Literal):
        if term.datatype.value in _NUMBERS:
            return _number(term.value)
        return f'"{term.value}"@{term.language or ""}'
    return f"<{term.value}>" if isinstance(term, NamedNode) else "[]"


def _number(text: str) -> str:
    try:
        return repr(float(text))
    except ValueError:
        return text

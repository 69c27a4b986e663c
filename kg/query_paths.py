"""The property paths of a SPARQL query, for a parser: which predicates they step along."""

from __future__ import annotations

from typing import NamedTuple

from pyoxigraph import NamedNode

from kg import vocabulary as v
from kg.query_terms import Words


class Path(NamedTuple):
    """The predicates of a property path, whether it is but one, whether it may be of no step."""

    predicates: tuple[NamedNode | None, ...]
    single: bool
    empty: bool


def verb(words: Words) -> Path:
    """Take what stands between a subject and an object."""
    if words.peek()[0] == "variable":
        words.next()
        return Path((None,), True, False)
    return _path(words)


def _path(words: Words) -> Path:
    found = _sequence(words)
    while words.took("|"):
        other = _sequence(words)
        steps = found.predicates + other.predicates
        found = Path(steps, False, found.empty or other.empty)
    return found


def _sequence(words: Words) -> Path:
    found = _step(words)
    while words.took("/"):
        other = _step(words)
        steps = found.predicates + other.predicates
        found = Path(steps, False, found.empty and other.empty)
    return found


def _step(words: Words) -> Path:
    back = words.took("^")
    if words.took("("):
        found = _path(words)
        words.expect(")")
    elif words.took("a"):
        found = Path((NamedNode(v.RDF_TYPE),), True, False)
    else:
        name = words.named()  # no !: what is not so is everything
        found = Path((name,), True, False)
    if words.took("*", "?"):
        return Path(found.predicates, False, True)
    more = words.took("+")
    return found._replace(single=found.single and not (more or back))

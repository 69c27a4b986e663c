"""The property paths of a SPARQL query, for a parser: which predicates they step along."""

from __future__ import annotations

from collections.abc import Callable, Iterable
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
    return _joined(words, "|", _sequence, any)


def _sequence(words: Words) -> Path:
    return _joined(words, "/", _step, all)


def _joined(
    words: Words, mark: str, part: Callable[[Words], Path], of: Callable[[Iterable[bool]], bool]
) -> Path:
    """One part, or several with `mark` between; `of` says whether such may be of no step."""
    parts = [part(words)]
    while words.took(mark):
        parts.append(part(words))
    if len(parts) == 1:
        return parts[0]
    steps = tuple(step for each in parts for step in each.predicates)
    return Path(steps, False, of(each.empty for each in parts))


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

"""Facts told by pattern: all that match, or those of them whose subjects are among some."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final, NamedTuple

from pyoxigraph import NamedNode


class Pattern(NamedTuple):
    """Facts with these terms; None matches any."""

    subject: NamedNode | None = None
    predicate: NamedNode | None = None
    value: NamedNode | None = None
    graph: NamedNode | None = None

    def covers(self, other: Iterable[object]) -> bool:
        """Whether a quad is matched, or all that another pattern matches."""
        return all(mine is None or mine == its for mine, its in zip(self, other, strict=True))


class Among(NamedTuple):
    """Subjects of which a graph says by a predicate one of some values.

    The values are given, or are the subjects of the facts of a background graph that match `above`.
    """

    predicate: NamedNode
    graph: NamedNode
    values: frozenset[NamedNode]
    above: Pattern | None


class Narrow(NamedTuple):
    """A pattern that is seen only of the subjects that are among all of these."""

    pattern: Pattern
    among: frozenset[Among]


class Seen(NamedTuple):
    """What a query sees."""

    whole: frozenset[Pattern]
    narrow: frozenset[Narrow] = frozenset()


EVERYTHING: Final = Pattern()

"""Subclass inference: a class in a query stands for its subclasses too.

Things state their most specific class alone. So `?o a here:Furniture` is evaluated along the
compiled closure of rdfs:subClassOf, as `?o a/here:isA here:Furniture`. A path inside of GRAPH reads
one graph only, so the pattern there becomes `?o a ?kind` with `GRAPH graph:commonsense { ?kind
here:isA ... }`. Variables in place of the class, paths, templates and SERVICE are left unchanged.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Final

from pyoxigraph import NamedNode

from kg.model import vocabulary as v
from kg.rdf.quad_store import QuadStore
from kg.rdf.sparql.lexer import Token, tokens_of

#: classes that their things state themselves, beside a more specific class
_STATED: Final = frozenset({v.PLACE, v.BOT_SPACE, v.VOID_DATASET})
_GAP: Final = r"(?:\s|\#[^\n\r]*[\n\r])*+"
_NAME: Final = r"(?:<[^<>\s]*>|[\w-]*:[\w-]+)"
#: a verb and its classes; found in little time, and also in strings and comments
_TYPED: Final = re.compile(rf"(?:\ba\b|type>?){_GAP}({_NAME}(?:{_GAP},{_GAP}{_NAME})*)")
_PATH: Final = ("^", "!", "/", "|")

#: whether a class, by its IRI, has subclasses
IsSuperclass = Callable[[str], bool]


def superclasses_of(engine: QuadStore) -> IsSuperclass:
    """A test whether a class has subclasses in the compiled ontology of `engine`."""

    def has_subclasses(iri: str) -> bool:
        try:
            above, is_a = NamedNode(iri), NamedNode(v.IS_A)
        except ValueError:  # a relative IRI
            return False
        found = engine.quads_for_pattern(None, is_a, above, v.COMMONSENSE_GRAPH)
        return any(quad.subject != above for quad in found)

    return has_subclasses


def with_subclasses(sparql: str, is_superclass: IsSuperclass) -> str:
    """The query with the subclasses of each class that `is_superclass`; often unchanged.

    A query with FROM reads only the graphs that it names, and is unchanged. The rewriting of an
    unusual text may not parse; the caller then evaluates the text itself.
    """
    if not _may_need_it(sparql, is_superclass):
        return sparql
    tokens = list(tokens_of(sparql))
    if any(token.keyword == "FROM" for token in tokens):
        return sparql
    return _Rewriting(sparql, tokens, is_superclass).text()


def _may_need_it(sparql: str, is_superclass: IsSuperclass) -> bool:
    """Whether a query may name a superclass; a quick test, since a rewriting takes 0.1 ms."""
    names = {name for found in _TYPED.finditer(sparql) for name in re.findall(_NAME, found[1])}
    if not names or "prefix" in sparql.casefold():
        return bool(names)
    iris = (_iri_of(name, v.PREFIXES) for name in names)
    return any(iri and iri not in _STATED and is_superclass(iri) for iri in iris)


def _iri_of(name: str, prefixes: Mapping[str, str]) -> str | None:
    """The IRI of a prefixed name or of an IRI in brackets; None for other texts."""
    if name.startswith("<"):
        return name[1:-1]
    prefix, colon, local = name.partition(":")
    return prefixes[prefix] + local if colon and prefix in prefixes else None


@dataclass(slots=True)
class _Group:
    """A group in braces that begins at `start`."""

    start: int
    in_graph: bool = False
    kept: bool = False  # a template, or a pattern for another endpoint
    kinds: list[str] = field(default_factory=list)  # patterns to insert at its beginning


class _Rewriting:
    """Edits of one query: the span that is replaced, and its new text."""

    def __init__(self, sparql: str, tokens: list[Token], is_superclass: IsSuperclass) -> None:
        self._sparql, self._tokens, self._is_superclass = sparql, tokens, is_superclass
        self._edits: list[tuple[int, int, str]] = []
        self._prefixes = v.PREFIXES | {
            name.text[:-1]: iri.text[1:-1]
            for word, name, iri in zip(tokens, tokens[1:], tokens[2:], strict=False)
            if word.keyword == "PREFIX" and iri.kind == "iri"
        }

    def text(self) -> str:
        """The rewritten query."""
        self._read_groups()
        if self._edits:
            self._complete_template()
        pieces, done = [], 0
        for start, end, text in sorted(self._edits):
            pieces += [self._sparql[done:start], text]
            done = end
        return "".join([*pieces, self._sparql[done:]])

    def _read_groups(self) -> None:
        groups = [_Group(0, kept=True)]
        for at, token in enumerate(self._tokens):
            if token.text == "{":
                groups.append(self._group(at, groups[-1]))
            elif token.text == "}" and len(groups) > 1:
                self._close(groups.pop())
            elif not groups[-1].kept and self._is_verb(at):
                self._read_classes(at, groups[-1])

    def _group(self, at: int, outer: _Group) -> _Group:
        before = [token.keyword for token in self._tokens[max(at - 3, 0) : at]]
        other = before[-1:] == ["CONSTRUCT"] or "SERVICE" in before
        graph = outer.in_graph or before[-2:-1] == ["GRAPH"]
        nested = outer.kept and outer.start > 0
        return _Group(self._tokens[at].end, graph, kept=other or nested)

    def _close(self, group: _Group) -> None:
        if group.kinds:
            self._edits.append((group.start, group.start, " " + "".join(group.kinds)))

    def _is_verb(self, at: int) -> bool:
        token, before = self._tokens[at], self._tokens[at - 1].text
        is_type = token.text == "a" or self._iri(token) == v.RDF_TYPE.value
        return is_type and before not in _PATH

    def _read_classes(self, at: int, group: _Group) -> None:
        """Rewrite the classes after one verb; each rewritten class gets its own verb."""
        verb, ended = self._tokens[at], False
        for index in range(at + 1, len(self._tokens), 2):
            cls, comma = self._tokens[index], self._tokens[index - 1]
            iri = self._iri(cls)
            wanted = iri is not None and iri not in _STATED and self._is_superclass(iri)
            if ended or (wanted and comma is not verb):
                self._edits.append((comma.start, comma.end, f" ; {verb.text}"))
            if wanted and group.in_graph:
                self._edits.append((cls.start, cls.end, self._kind(cls.text, group)))
            elif wanted:
                self._edits.append((cls.start, cls.start, f"/<{v.IS_A}> "))
            ended = wanted
            if index + 1 >= len(self._tokens) or self._tokens[index + 1].text != ",":
                return

    def _kind(self, cls: str, group: _Group) -> str:
        """A new variable for the class of a thing, bound in the common sense."""
        number = 1
        while f"?kind{number}" in self._sparql or any(
            f"?kind{number}" == text for *_, text in self._edits
        ):
            number += 1
        name = f"?kind{number}"
        group.kinds.append(f"GRAPH {v.COMMONSENSE_GRAPH} {{ {name} <{v.IS_A}> {cls} }} ")
        return name

    def _iri(self, token: Token) -> str | None:
        """IRI of a class or property; None for other tokens and for relative IRIs."""
        return _iri_of(token.text, self._prefixes) if token.kind in ("iri", "name") else None

    def _complete_template(self) -> None:
        """Write the template of CONSTRUCT WHERE: the pattern before the rewriting."""
        words = [token.keyword for token in self._tokens]
        for at, pair in enumerate(pairwise(words)):
            if pair == ("CONSTRUCT", "WHERE"):
                start, end = self._tokens[at + 2].start, self._tokens[-1].end
                ends = [t.end for t in self._tokens[at + 2 :] if t.text == "}"]
                pattern = self._sparql[start : ends[-1] if ends else end]
                self._edits.append((self._tokens[at].end, self._tokens[at].end, f" {pattern} "))

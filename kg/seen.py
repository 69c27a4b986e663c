"""Which facts a query can see: patterns such that no other fact changes its answer.

A query of a state that has yet to be made needs no more of it than these. The text is read by a
parser of our own: it follows the grammar (SPARQL 1.1, section 19.8) just as far as to find the
triple patterns, in a fiftieth of the time that rdflib's takes, and what it does not understand sees
everything. Filters and bindings see nothing, but for what stands in their EXISTS.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from functools import lru_cache
from typing import Final, Literal, NamedTuple

from pyoxigraph import NamedNode

from kg import vocabulary as v


class Pattern(NamedTuple):
    """Facts with these terms; None matches any."""

    subject: NamedNode | None = None
    predicate: NamedNode | None = None
    value: NamedNode | None = None
    graph: NamedNode | None = None

    def covers(self, other: Iterable[object]) -> bool:
        """Whether a quad is matched, or all that another pattern matches."""
        return all(mine is None or mine == its for mine, its in zip(self, other, strict=True))


EVERYTHING: Final = Pattern()
_ALL: Final = frozenset((EVERYTHING,))
_MOST = 20_000  # characters; a longer text sees everything
_LOCAL = r"(?:[\w:-]|%[0-9A-Fa-f]{2})"
_TOKEN: Final = re.compile(
    rf"""
      (?P<gap> \s+ | \#[^\n\r]* )
    | (?P<iri> <[^<>"{{}}|^`\\\x00-\x20]*> )
    | (?P<literal> \"\"\"(?:[^"\\] | \\. | "(?!""))*\"\"\" | '''(?:[^'\\] | \\. | '(?!''))*'''
        | "(?:[^"\\\n\r] | \\.)*" | '(?:[^'\\\n\r] | \\.)*' )
    | (?P<variable> [?$]\w+ )
    | (?P<blank> _:\w(?:[\w.-]*[\w-])? )
    | (?P<name> (?:[^\W\d_][\w.-]*)?:(?:(?!-){_LOCAL}(?:\.*{_LOCAL})*)? )
    | (?P<number> \d+\.\d*[eE][+-]?\d+ | (?:\d+(?:\.\d+)? | \.\d+)(?:[eE][+-]?\d+)? )
    | (?P<language> @[A-Za-z]+(?:-[A-Za-z0-9]+)* )
    | (?P<word> [A-Za-z_]\w* )
    | (?P<mark> \^\^ | && | \|\| | [<>!]=? | [][{{}}().,;|/^*?+=-] )
    """,
    re.VERBOSE | re.DOTALL,
)
_ABSOLUTE = re.compile(r"[A-Za-z][A-Za-z0-9+.-]*:")
_PLAIN = re.compile(r"\w+(?:/\w+)*", re.ASCII)  # relative, and resolved by appending
_RDF = v.RDF_TYPE.removesuffix("type")
_OPERANDS = frozenset(("iri", "name", "literal", "variable", "number", "language", "word"))
_END: Final = ("end", "")

Term = NamedNode | Literal["a literal"] | None  # None for what is open: a variable, a blank node


class _UnreadError(Exception):
    """What stands here is not understood."""


class _Path(NamedTuple):
    """The predicates of a property path, whether it is but one, whether it may be of no step."""

    predicates: tuple[NamedNode | None, ...]
    single: bool
    empty: bool


def seen_by(
    sparql: str, prefixes: Mapping[str, str] | None = None, base: str | None = None
) -> frozenset[Pattern]:
    """Patterns of all the facts that the answer of a query depends on.

    `prefixes` are those predeclared, relative IRIs are of `base`. What is not understood sees
    everything; so does what does not parse, for the engine has yet to say what is wrong with it.
    """
    if len(sparql) > _MOST or "\\u" in sparql.lower():
        return _ALL
    return _seen_by(sparql, tuple((prefixes or {}).items()), base)


@lru_cache(maxsize=256)
def _seen_by(
    sparql: str, prefixes: tuple[tuple[str, str], ...], base: str | None
) -> frozenset[Pattern]:
    try:
        return _Reader(sparql, dict(prefixes), base).query()
    except (_UnreadError, ValueError, RecursionError):
        return _ALL


def _tokens(sparql: str) -> Iterator[tuple[str, str]]:
    """Kind and text of each token; keywords in lower case, as their case does not matter."""
    at = 0
    while at < len(sparql):
        match = _TOKEN.match(sparql, at)
        if match is None:
            raise _UnreadError(sparql[at : at + 20])
        at, kind = match.end(), str(match.lastgroup)
        if kind == "word" and match[0] != "a":
            yield kind, match[0].lower() if match[0] != "A" else "A"
        elif kind != "gap":
            yield kind, match[0]


class _Reader:
    """Goes through the tokens of one query; each method takes what the grammar calls so."""

    def __init__(self, sparql: str, prefixes: dict[str, str], base: str | None) -> None:
        self._tokens = [*_tokens(sparql)]
        self._at = 0
        self._prefixes = prefixes
        self._base = base
        self._found: set[Pattern] = set()

    def query(self) -> frozenset[Pattern]:
        self._prologue()
        form = self._next()
        if form == ("word", "select"):
            self._projection()
        elif form == ("word", "construct"):
            if self._peek() == ("mark", "{"):
                self._data()
        elif form != ("word", "ask"):  # DESCRIBE: what it tells is the engine's to decide
            raise _UnreadError(form)
        while self._took("from"):
            self._took("named")
            self._term()
        self._rest(None)
        if self._peek() != _END:
            raise _UnreadError(self._peek())
        return frozenset(self._found)

    def _peek(self) -> tuple[str, str]:
        return self._tokens[self._at] if self._at < len(self._tokens) else _END

    def _next(self) -> tuple[str, str]:
        token = self._peek()
        self._at += 1
        return token

    def _took(self, *texts: str) -> bool:
        """Whether one of these keywords or marks was next, and is now taken."""
        kind, text = self._peek()
        if kind in ("word", "mark") and text in texts:
            self._at += 1
            return True
        return False

    def _expect(self, text: str) -> None:
        if not self._took(text):
            raise _UnreadError(text)

    def _prologue(self) -> None:
        while True:
            if self._took("base"):
                self._next()
                self._base = None
            elif self._took("prefix"):
                name, iri = self._next(), self._next()
                if name[0] != "name" or iri[0] != "iri" or not name[1].endswith(":"):
                    raise _UnreadError(name)
                self._prefixes[name[1][:-1]] = iri[1][1:-1]
            else:
                return

    def _projection(self) -> None:
        self._took("distinct", "reduced")
        while self._peek()[0] == "variable" or self._peek() in (("mark", "*"), ("mark", "(")):
            if self._peek() == ("mark", "("):
                self._expression(None)
            else:
                self._next()

    def _rest(self, graph: NamedNode | None) -> None:
        """From WHERE to the end of a query or of a subquery."""
        self._took("where")
        self._group(graph)
        while (token := self._peek()) not in (_END, ("mark", "}")):
            if self._took("values"):
                self._values()
            elif token == ("mark", "("):
                self._expression(graph)
            elif token[0] in ("word", "variable", "number", "iri", "name"):
                self._next()  # GROUP BY, HAVING, ORDER BY, LIMIT, OFFSET and what they name
            else:
                raise _UnreadError(token)

    def _group(self, graph: NamedNode | None) -> bool:
        """A group in braces; whether it has no solution where the graph holds no fact."""
        self._expect("{")
        if self._took("select"):
            self._projection()
            self._rest(graph)
            self._expect("}")
            return False  # a count of nothing is a solution
        certain = False
        while not self._took("}"):
            if not self._took("."):
                certain |= self._element(graph)
        return certain

    def _element(self, graph: NamedNode | None) -> bool:
        if self._peek() == ("mark", "{"):
            return self._union(graph)
        if self._took("optional", "minus"):
            self._group(graph)
        elif self._took("graph"):
            self._graph()
        elif self._took("filter"):
            self._filter(graph)
        elif self._took("bind"):
            self._expression(graph)
        elif self._took("values"):
            self._values()
        else:
            return self._triples(graph)
        return False

    def _union(self, graph: NamedNode | None) -> bool:
        certain = self._group(graph)
        while self._took("union"):
            certain &= self._group(graph)
        return certain

    def _graph(self) -> None:
        name = self._term()
        # else it matters which graphs there are
        if not self._group(name if isinstance(name, NamedNode) else None):
            raise _UnreadError("graph")

    def _filter(self, graph: NamedNode | None) -> None:
        self._took("not")
        if self._took("exists"):
            self._group(graph)
            return
        if self._peek()[0] in ("word", "iri", "name"):  # a function
            self._next()
        self._expression(graph)

    def _expression(self, graph: NamedNode | None) -> None:
        """All from a bracket to its end: only what EXISTS asks sees facts."""
        self._expect("(")
        depth, before = 1, ""
        while depth:
            if self._took("exists"):
                self._group(graph)
                before = ""
                continue
            kind, text = self._next()
            if text in ("{", "}", "[", "]", "") or (kind == "iri" and before in _OPERANDS):
                raise _UnreadError(text)  # what looks like an IRI may be a less-than
            depth += (text == "(") - (text == ")")
            before = "word" if text == ")" else kind

    def _values(self) -> None:
        if self._took("("):
            while not self._took(")"):
                self._only("variable")
        else:
            self._only("variable")
        self._data()

    def _only(self, kind: str) -> str:
        found, text = self._next()
        if found != kind:
            raise _UnreadError(text)
        return text

    def _data(self) -> None:
        """Braces with nothing that is matched."""
        self._expect("{")
        while not self._took("}"):
            kind, text = self._next()
            if kind == "end" or text == "{":
                raise _UnreadError(text)

    def _triples(self, graph: NamedNode | None) -> bool:
        whole = self._peek() in (("mark", "["), ("mark", "("))  # may stand by itself
        subject = self._node(graph)
        if whole and self._peek()[1] in (".", "}"):
            return False
        return self._properties(subject, graph)

    def _properties(self, subject: Term, graph: NamedNode | None) -> bool:
        """What is asked of a subject; whether at least one fact is."""
        certain = False
        while True:
            path = self._verb()
            while True:
                certain |= self._ask(subject, path, self._node(graph), graph)
                if not self._took(","):
                    break
            if not self._took(";"):
                return certain
            while self._took(";"):
                pass
            if self._peek()[1] in (".", "}", "]"):
                return certain

    def _ask(self, subject: Term, path: _Path, value: Term, graph: NamedNode | None) -> bool:
        if path.empty:
            self._stay(subject, value)
        ends = (subject, value) if path.single else (None, None)
        one, other = (end if isinstance(end, NamedNode) else None for end in ends)
        self._found.update(Pattern(one, step, other, graph) for step in path.predicates)
        return not path.empty

    def _stay(self, *ends: Term) -> None:
        """A path of no step: it leads from a node to itself, so it matters what nodes there are."""
        if ends == (None, None) or "a literal" in ends:
            raise _UnreadError("every node is joined with itself")
        for end in ends:
            if isinstance(end, NamedNode):
                self._found.update(EVERYTHING._replace(**{at: end}) for at in Pattern._fields)

    def _verb(self) -> _Path:
        if self._peek()[0] == "variable":
            self._next()
            return _Path((None,), True, False)
        return self._path()

    def _path(self) -> _Path:
        found = self._sequence()
        while self._took("|"):
            other = self._sequence()
            steps = found.predicates + other.predicates
            found = _Path(steps, False, found.empty or other.empty)
        return found

    def _sequence(self) -> _Path:
        found = self._step()
        while self._took("/"):
            other = self._step()
            steps = found.predicates + other.predicates
            found = _Path(steps, False, found.empty and other.empty)
        return found

    def _step(self) -> _Path:
        back = self._took("^")
        if self._took("("):
            found = self._path()
            self._expect(")")
        elif self._took("a"):
            found = _Path((NamedNode(v.RDF_TYPE),), True, False)
        else:
            name = self._named()  # no !: what is not so is everything
            found = _Path((name,), True, False)
        if self._took("*", "?"):
            return _Path(found.predicates, False, True)
        return found._replace(single=found.single and not (self._took("+") or back))

    def _named(self) -> NamedNode | None:
        if self._peek()[0] not in ("iri", "name"):
            raise _UnreadError(self._peek())
        name = self._term()
        return name if isinstance(name, NamedNode) else None

    def _node(self, graph: NamedNode | None) -> Term:
        """A term where a subject or an object may be, and what is asked within it."""
        if self._took("["):
            if not self._took("]"):
                self._properties(None, graph)
                self._expect("]")
            return None
        if self._took("("):
            return self._collection(graph)
        return self._term()

    def _collection(self, graph: NamedNode | None) -> Term:
        if self._took(")"):
            return NamedNode(_RDF + "nil")
        for predicate in ("first", "rest"):
            self._found.add(Pattern(None, NamedNode(_RDF + predicate), None, graph))
        while not self._took(")"):
            self._node(graph)
        return None

    def _term(self) -> Term:
        signed = self._took("+", "-")
        kind, text = self._next()
        if kind == "number" or (kind == "word" and text in ("true", "false") and not signed):
            return "a literal"
        if signed:
            raise _UnreadError(text)
        if kind == "literal":
            if self._took("^^"):
                self._named()
            elif self._peek()[0] == "language":
                self._next()
            return "a literal"
        if kind in ("variable", "blank"):
            return None
        return self._iri(kind, text)

    def _iri(self, kind: str, text: str) -> NamedNode | None:
        """The IRI; None for one that is relative to what is not known here."""
        if kind == "name":
            prefix, _, local = text.partition(":")
            if prefix not in self._prefixes:
                raise _UnreadError(text)
            iri = self._prefixes[prefix] + local
        elif kind == "iri":
            iri = text[1:-1]
        else:
            raise _UnreadError(text)
        if self._base and self._base.endswith("/") and _PLAIN.fullmatch(iri):
            iri = self._base + iri
        if not _ABSOLUTE.match(iri):
            return None
        if "/." in iri:  # the engine may leave such steps out
            raise _UnreadError(iri)
        return NamedNode(iri)

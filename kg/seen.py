"""Which facts a query can see: patterns such that no other fact changes its answer.

A query of a state that has yet to be made needs no more of it than these. The text is read by a
parser of our own: it follows the grammar (SPARQL 1.1, section 19.8) just as far as to find the
triple patterns, in a fiftieth of the time that rdflib's takes, and what it does not understand sees
everything. Filters and bindings see nothing, but for what stands in their EXISTS.

Where a query asks of things in some cells, in one place or of one kind, it sees of the others no
more than that they are not (`Narrow`). That holds for what must be so of every solution: patterns
of the outermost group, and those of an OPTIONAL in it that ask more of what was bound before.
A fact left out there would only have made solutions that fail in the end.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import lru_cache
from typing import Final, Literal, NamedTuple

from pyoxigraph import NamedNode, Variable

from kg import vocabulary as v
from kg.patterns import EVERYTHING, Among, Narrow, Pattern, Seen
from kg.query_words import UnreadError, words_of

_ALL: Final = Seen(frozenset((EVERYTHING,)))
_MOST = 200_000  # characters; a longer text sees everything
_BACKGROUND: Final = (NamedNode(v.ONTOLOGY_GRAPH), NamedNode(v.COMMONSENSE_GRAPH))
_FREE, _MUST, _MAY = range(3)  # where a pattern stands: anywhere, in every solution, in an OPTIONAL
_ABSOLUTE = re.compile(r"[A-Za-z][A-Za-z0-9+.-]*:")
_PLAIN = re.compile(r"\w+(?:/\w+)*", re.ASCII)  # relative, and resolved by appending
_RDF = v.RDF_TYPE.removesuffix("type")
_OPERANDS = frozenset(("iri", "name", "literal", "variable", "number", "language", "word"))
_END: Final = ("end", "")

Term = NamedNode | Variable | Literal["a literal"] | None  # None for a blank node, and the like


class _Path(NamedTuple):
    """The predicates of a property path, whether it is but one, whether it may be of no step."""

    predicates: tuple[NamedNode | None, ...]
    single: bool
    empty: bool


def seen_by(
    sparql: str, prefixes: Mapping[str, str] | None = None, base: str | None = None
) -> Seen:
    """All the facts that the answer of a query depends on.

    `prefixes` are those predeclared, relative IRIs are of `base`. What is not understood sees
    everything; so does what does not parse, for the engine has yet to say what is wrong with it.
    """
    if len(sparql) > _MOST or "\\u" in sparql.lower():
        return _ALL
    return _seen_by(sparql, tuple((prefixes or {}).items()), base)


@lru_cache(maxsize=64)
def _seen_by(sparql: str, prefixes: tuple[tuple[str, str], ...], base: str | None) -> Seen:
    try:
        return _Reader(sparql, dict(prefixes), base).query()
    except (UnreadError, ValueError, RecursionError):
        return _ALL


class _Reader:
    """Goes through the tokens of one query; each method takes what the grammar calls so."""

    def __init__(self, sparql: str, prefixes: dict[str, str], base: str | None) -> None:
        self._tokens = [*words_of(sparql)]
        self._at_token = 0
        self._prefixes = prefixes
        self._base = base
        self._found: set[Pattern] = set()
        self._where = _FREE
        self._bound: set[Variable] = set()  # by what stands before in this group
        self._must: list[tuple[Variable, Pattern, Term]] = []  # subject, pattern, object
        self._may: list[tuple[Variable, Pattern]] = []
        self._given: dict[Variable, frozenset[NamedNode]] = {}  # by VALUES

    def query(self) -> Seen:
        self._prologue()
        form = self._next()
        if form == ("word", "select"):
            self._projection()
        elif form == ("word", "construct"):
            if self._peek() == ("mark", "{"):
                self._data()
        elif form != ("word", "ask"):  # DESCRIBE: what it tells is the engine's to decide
            raise UnreadError(form)
        while self._took("from"):
            self._took("named")
            self._term()
        self._took("where")
        with self._at(_MUST):
            self._group(None)
        self._tail(None)
        if self._peek() != _END:
            raise UnreadError(self._peek())
        return self._seen()

    def _seen(self) -> Seen:
        among: dict[Variable, set[Among]] = {}
        for subject, pattern, value in self._must:
            if (found := self._among(pattern, value)) is not None:
                among.setdefault(subject, set()).add(found)
        narrow = set()
        for subject, pattern in (*((one, two) for one, two, _ in self._must), *self._may):
            if subject in among and pattern.graph not in _BACKGROUND:
                narrow.add(Narrow(pattern, frozenset(among[subject])))
            else:
                self._found.add(pattern)
        return Seen(frozenset(self._found), frozenset(narrow))

    def _among(self, pattern: Pattern, value: Term) -> Among | None:
        """The subjects that a pattern of every solution leaves."""
        _, predicate, constant, graph = pattern
        if predicate is None or graph is None or graph in _BACKGROUND:
            return None
        if constant is not None:
            return Among(predicate, graph, frozenset((constant,)), None)
        if not isinstance(value, Variable):
            return None
        if value in self._given:
            return Among(predicate, graph, self._given[value], None)
        for subject, other, _ in self._must:
            if subject == value and other.value is not None and other.graph in _BACKGROUND:
                self._found.add(other)
                return Among(predicate, graph, frozenset(), other)
        return None

    @contextmanager
    def _at(self, where: int) -> Iterator[None]:
        """Within, patterns stand there."""
        self._where, before = where, self._where
        yield
        self._where = before

    def _peek(self) -> tuple[str, str]:
        return self._tokens[self._at_token] if self._at_token < len(self._tokens) else _END

    def _next(self) -> tuple[str, str]:
        token = self._peek()
        self._at_token += 1
        return token

    def _took(self, *texts: str) -> bool:
        """Whether one of these keywords or marks was next, and is now taken."""
        kind, text = self._peek()
        if kind in ("word", "mark") and text in texts:
            self._at_token += 1
            return True
        return False

    def _expect(self, text: str) -> None:
        if not self._took(text):
            raise UnreadError(text)

    def _prologue(self) -> None:
        while True:
            if self._took("base"):
                self._next()
                self._base = None
            elif self._took("prefix"):
                name, iri = self._next(), self._next()
                if name[0] != "name" or iri[0] != "iri" or not name[1].endswith(":"):
                    raise UnreadError(name)
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

    def _tail(self, graph: NamedNode | None) -> None:
        """What comes after the pattern of a query or of a subquery."""
        while (token := self._peek()) not in (_END, ("mark", "}")):
            if self._took("values"):
                self._values()
            elif token == ("mark", "("):
                self._expression(graph)
            elif token[0] in ("word", "variable", "number", "iri", "name"):
                self._next()  # GROUP BY, HAVING, ORDER BY, LIMIT, OFFSET and what they name
            else:
                raise UnreadError(token)

    def _group(self, graph: NamedNode | None) -> bool:
        """A group in braces; whether it has no solution where the graph holds no fact."""
        self._expect("{")
        if self._took("select"):
            with self._at(_FREE):
                self._projection()
                self._took("where")
                self._group(graph)
                self._tail(graph)
            self._expect("}")
            return False  # a count of nothing is a solution
        certain = False
        while not self._took("}"):
            if not self._took("."):
                certain |= self._element(graph)
        return certain

    def _element(self, graph: NamedNode | None) -> bool:
        if self._peek() == ("mark", "{"):
            with self._at(_FREE):
                return self._union(graph)
        if self._took("optional"):
            with self._at(_MAY if self._where == _MUST else _FREE):
                self._group(graph)
        elif self._took("minus"):
            with self._at(_FREE):
                self._group(graph)
        elif self._took("graph"):
            self._graph()
        elif self._took("filter"):
            self._filter(graph)
        elif self._took("bind"):
            self._expression(graph)
        elif self._took("values"):
            self._values(binding=self._where == _MUST)
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
        before = self._bound
        if self._where == _MUST:
            self._bound = set()  # an OPTIONAL in it adds to what stands in it alone
        # else it matters which graphs there are
        if not self._group(name if isinstance(name, NamedNode) else None):
            raise UnreadError("graph")
        self._bound |= before

    def _filter(self, graph: NamedNode | None) -> None:
        self._took("not")
        if self._took("exists"):
            with self._at(_FREE):
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
                with self._at(_FREE):
                    self._group(graph)
                before = ""
                continue
            kind, text = self._next()
            if text in ("{", "}", "[", "]", "") or (kind == "iri" and before in _OPERANDS):
                raise UnreadError(text)  # what looks like an IRI may be a less-than
            depth += (text == "(") - (text == ")")
            before = "word" if text == ")" else kind

    def _values(self, *, binding: bool = False) -> None:
        if self._took("("):
            while not self._took(")"):
                self._variable()
            self._data()
            return
        variable, start = self._variable(), self._at_token + 1
        self._data()
        given = self._tokens[start : self._at_token - 1]
        if binding and all(kind in ("iri", "name") for kind, _ in given):
            names = [self._iri(*token) for token in given]
            if all(names):
                self._given[variable] = frozenset(name for name in names if name)

    def _variable(self) -> Variable:
        kind, text = self._next()
        if kind != "variable":
            raise UnreadError(text)
        return Variable(text[1:])

    def _data(self) -> None:
        """Braces with nothing that is matched."""
        self._expect("{")
        while not self._took("}"):
            kind, text = self._next()
            if kind == "end" or text == "{":
                raise UnreadError(text)

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
        if not path.single:
            self._found.update(Pattern(None, step, None, graph) for step in path.predicates)
            return not path.empty
        one, other = (end if isinstance(end, NamedNode) else None for end in (subject, value))
        pattern = Pattern(one, path.predicates[0], other, graph)
        if self._where == _MUST and isinstance(subject, Variable):
            self._must.append((subject, pattern, value))
            self._bound.add(subject)
        elif self._where == _MAY and isinstance(subject, Variable) and subject in self._bound:
            self._may.append((subject, pattern))
        else:
            self._found.add(pattern)
        return True

    def _stay(self, *ends: Term) -> None:
        """A path of no step: it leads from a node to itself, so it matters what nodes there are."""
        if "a literal" in ends or not any(isinstance(end, NamedNode) for end in ends):
            raise UnreadError("every node is joined with itself")
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
            raise UnreadError(self._peek())
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
            raise UnreadError(text)
        if kind == "literal":
            if self._took("^^"):
                self._named()
            elif self._peek()[0] == "language":
                self._next()
            return "a literal"
        if kind == "variable":
            return Variable(text[1:])
        if kind == "blank":
            return None
        return self._iri(kind, text)

    def _iri(self, kind: str, text: str) -> NamedNode | None:
        """The IRI; None for one that is relative to what is not known here."""
        if kind == "name":
            prefix, _, local = text.partition(":")
            if prefix not in self._prefixes:
                raise UnreadError(text)
            iri = self._prefixes[prefix] + local
        elif kind == "iri":
            iri = text[1:-1]
        else:
            raise UnreadError(text)
        if self._base and self._base.endswith("/") and _PLAIN.fullmatch(iri):
            iri = self._base + iri
        if not _ABSOLUTE.match(iri):
            return None
        if "/." in iri:  # the engine may leave such steps out
            raise UnreadError(iri)
        return NamedNode(iri)

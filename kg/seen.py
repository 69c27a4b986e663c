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

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import lru_cache
from typing import Final

from pyoxigraph import NamedNode, Variable

from kg import vocabulary as v
from kg.patterns import EVERYTHING, Among, Narrow, Pattern, Seen
from kg.query_paths import Path, verb
from kg.query_terms import END, Term, Words
from kg.query_words import UnreadError

_ALL: Final = Seen(frozenset((EVERYTHING,)))
_MOST = 200_000  # characters; a longer text sees everything
_BACKGROUND: Final = (NamedNode(v.ONTOLOGY_GRAPH), NamedNode(v.COMMONSENSE_GRAPH))
_FREE, _MUST, _MAY = range(3)  # where a pattern stands: anywhere, in every solution, in an OPTIONAL
_RDF = v.RDF_TYPE.removesuffix("type")
_OPERANDS = frozenset(  # after these words, and perhaps after a less-than, comes no IRI
    ("iri", "name", "literal", "variable", "number", "language", "word", ")", "<")
)


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
        return _Reader(Words(sparql, dict(prefixes), base)).query()
    except (UnreadError, ValueError, RecursionError):
        return _ALL


class _Reader:
    """Reads one query; each method takes what the grammar calls so."""

    def __init__(self, words: Words) -> None:
        self._words = words
        self._found: set[Pattern] = set()
        self._where = _FREE
        self._any_graph = False  # what is read stands in a GRAPH of a variable
        self._bound: set[Variable] = set()  # by what stands before in this group
        self._must: list[tuple[Variable, Pattern, Term]] = []  # subject, pattern, object
        self._may: list[tuple[Variable, Pattern]] = []
        self._given: dict[Variable, frozenset[NamedNode]] = {}  # by VALUES

    def query(self) -> Seen:
        self._words.prologue()
        form = self._words.next()
        if form == ("word", "select"):
            self._projection()
        elif form == ("word", "construct"):
            if self._words.peek() == ("mark", "{"):
                self._words.data()
        elif form != ("word", "ask"):  # DESCRIBE: what it tells is the engine's to decide
            raise UnreadError(form)
        while self._words.took("from"):
            self._words.took("named")
            self._words.term()
        self._words.took("where")
        with self._at(_MUST):
            self._group(None)
        self._tail(None)
        if self._words.peek() != END:
            raise UnreadError(self._words.peek())
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

    def _projection(self) -> None:
        self._words.took("distinct", "reduced")
        while (word := self._words.peek())[0] == "variable" or word[1] in ("*", "("):
            if word[1] == "(":
                self._expression(None)
            else:
                self._words.next()

    def _tail(self, graph: NamedNode | None) -> None:
        """What comes after the pattern of a query or of a subquery."""
        while (token := self._words.peek()) not in (END, ("mark", "}")):
            if self._words.took("values"):
                self._values()
            elif token == ("mark", "("):
                self._expression(graph)
            elif token[0] in ("word", "variable", "number", "iri", "name"):
                self._words.next()  # GROUP BY, HAVING, ORDER BY, LIMIT, OFFSET and what they name
            else:
                raise UnreadError(token)

    def _group(self, graph: NamedNode | None) -> bool:
        """A group in braces; whether it has no solution where the graph holds no fact."""
        self._words.expect("{")
        if self._words.took("select"):
            with self._at(_FREE):
                self._projection()
                self._words.took("where")
                self._apart(graph)
                self._tail(graph)
            self._words.expect("}")
            return False  # a count of nothing is a solution
        certain = False
        while not self._words.took("}"):
            if not self._words.took("."):
                certain |= self._element(graph)
        return certain

    def _element(self, graph: NamedNode | None) -> bool:
        if self._words.peek() == ("mark", "{"):
            with self._at(_FREE):
                return self._union(graph)
        if self._words.took("optional"):
            with self._at(_MAY if self._where == _MUST else _FREE):
                self._group(graph)
        elif self._words.took("minus"):
            with self._at(_FREE):
                self._group(graph)
        elif self._words.took("graph"):
            self._graph()
        elif self._words.took("filter"):
            self._filter(graph)
        elif self._words.took("bind"):
            self._expression(graph)
        elif self._words.took("values"):
            self._values(binding=self._where == _MUST)
        else:
            return self._triples(graph)
        return False

    def _union(self, graph: NamedNode | None) -> bool:
        certain = self._group(graph)
        while self._words.took("union"):
            certain &= self._group(graph)
        return certain

    def _graph(self) -> None:
        name = self._words.term()
        before = self._bound
        if self._where == _MUST:
            self._bound = set()  # an OPTIONAL in it adds to what stands in it alone
        # else it matters which graphs there are
        graph = name if isinstance(name, NamedNode) else None
        around, self._any_graph = self._any_graph, graph is None
        if not self._group(graph):
            raise UnreadError("graph")
        self._any_graph = around
        self._bound |= before

    def _apart(self, graph: NamedNode | None) -> None:
        """A group of a subquery or EXISTS: which graph is meant around it is not known to it."""
        with self._at(_FREE):
            if not self._group(graph) and self._any_graph:
                raise UnreadError("graph")  # it has a solution in each graph there is

    def _filter(self, graph: NamedNode | None) -> None:
        self._words.took("not")
        if self._words.took("exists"):
            self._apart(graph)
            return
        if self._words.peek()[0] in ("word", "iri", "name"):  # a function
            self._words.next()
        self._expression(graph)

    def _expression(self, graph: NamedNode | None) -> None:
        """All from a bracket to its end: only what EXISTS asks sees facts."""
        self._words.expect("(")
        depth, before = 1, ""
        while depth:
            if self._words.took("exists"):
                self._apart(graph)
                before = "word"
                continue
            kind, text = self._words.next()
            if text in ("{", "}", "[", "]", "") or (kind == "iri" and before in _OPERANDS):
                raise UnreadError(text)  # what looks like an IRI may be a less-than
            if before == text == "<":  # a triple term
                raise UnreadError(text)
            depth += (text == "(") - (text == ")")
            before = text if text in (")", "<") else kind

    def _values(self, *, binding: bool = False) -> None:
        if self._words.took("("):
            while not self._words.took(")"):
                self._words.variable()
            self._words.data()
            return
        variable, given = self._words.variable(), self._words.data()
        if binding and all(kind in ("iri", "name") for kind, _ in given):
            names = [self._words.iri(*word) for word in given]
            if all(names):
                self._given[variable] = frozenset(name for name in names if name)

    def _triples(self, graph: NamedNode | None) -> bool:
        whole = self._words.peek() in (("mark", "["), ("mark", "("))  # may stand by itself
        subject = self._node(graph)
        if whole and self._words.peek()[1] in (".", "}"):
            return False
        return self._properties(subject, graph)

    def _properties(self, subject: Term, graph: NamedNode | None) -> bool:
        """What is asked of a subject; whether at least one fact is."""
        certain = False
        while True:
            path = verb(self._words)
            while True:
                certain |= self._ask(subject, path, self._node(graph), graph)
                if not self._words.took(","):
                    break
            if not self._words.took(";"):
                return certain
            while self._words.took(";"):
                pass
            if self._words.peek()[1] in (".", "}", "]"):
                return certain

    def _ask(self, subject: Term, path: Path, value: Term, graph: NamedNode | None) -> bool:
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

    def _node(self, graph: NamedNode | None) -> Term:
        """A term where a subject or an object may be, and what is asked within it."""
        if self._words.took("["):
            if not self._words.took("]"):
                self._properties(None, graph)
                self._words.expect("]")
            return None
        if self._words.took("("):
            return self._collection(graph)
        return self._words.term()

    def _collection(self, graph: NamedNode | None) -> Term:
        if self._words.took(")"):
            return NamedNode(_RDF + "nil")
        for predicate in ("first", "rest"):
            self._found.add(Pattern(None, NamedNode(_RDF + predicate), None, graph))
        while not self._words.took(")"):
            self._node(graph)
        return None

"""The terms of a SPARQL query, for a parser: names and literals, taken word by word."""

from __future__ import annotations

import re
from typing import Final, Literal

from pyoxigraph import NamedNode, Variable

from kg.query_words import UnreadError, words_of

END: Final = ("end", "")
_ABSOLUTE = re.compile(r"[A-Za-z][A-Za-z0-9+.-]*:")
_PLAIN = re.compile(r"\w+(?:/\w+)*", re.ASCII)  # relative, and resolved by appending
_FOLDER = re.compile(r"[^?#]*/")  # as a base, one that is appended to

Word = tuple[str, str]  # kind and text
Term = NamedNode | Variable | Literal["a literal"] | None  # None for a blank node, and the like


class Words:
    """Goes through the words of one query; raises UnreadError where what is next is another."""

    def __init__(self, sparql: str, prefixes: dict[str, str], base: str | None) -> None:
        self._words = [*words_of(sparql)]
        self._at = 0
        self._prefixes = prefixes  # those that the query declares are added
        self._base = base if base and _FOLDER.fullmatch(base) else None

    def peek(self) -> Word:
        """The next one."""
        return self._words[self._at] if self._at < len(self._words) else END

    def next(self) -> Word:
        """The next one, which is now taken."""
        word = self.peek()
        self._at += 1
        return word

    def took(self, *texts: str) -> bool:
        """Whether one of these keywords or marks was next, and is now taken."""
        kind, text = self.peek()
        if kind in ("word", "mark") and text in texts:
            self._at += 1
            return True
        return False

    def expect(self, text: str) -> None:
        """Take this keyword or mark."""
        if not self.took(text):
            raise UnreadError(text)

    def prologue(self) -> None:
        """Take what is declared of names."""
        while True:
            if self.took("base"):
                self.next()
                self._base = None
            elif self.took("prefix"):
                self._declare(self.next(), self.next())
            else:
                return

    def _declare(self, name: Word, iri: Word) -> None:
        if name[0] != "name" or iri[0] != "iri" or not name[1].endswith(":"):
            raise UnreadError(name)
        if not _ABSOLUTE.match(iri[1][1:]):  # with a colon in a local name it would look so
            raise UnreadError(iri)
        self._prefixes[name[1][:-1]] = iri[1][1:-1]

    def variable(self) -> Variable:
        """Take a variable."""
        kind, text = self.next()
        if kind != "variable":
            raise UnreadError(text)
        return Variable(text[1:])

    def data(self) -> list[Word]:
        """Take braces with nothing that is matched; what stands within."""
        self.expect("{")
        start = self._at
        while not self.took("}"):
            kind, text = self.next()
            if kind == "end" or text in ("{", "<"):  # << begins a triple term
                raise UnreadError(text)
        return self._words[start : self._at - 1]

    def term(self) -> Term:
        """Take a term that is written as such."""
        signed = self.took("+", "-")
        kind, text = self.next()
        if kind == "number" or (kind == "word" and text in ("true", "false") and not signed):
            return "a literal"
        if signed:
            raise UnreadError(text)
        if kind == "literal":
            if self.took("^^"):
                self.named()
            elif self.peek()[0] == "language":
                self.next()
            return "a literal"
        if kind == "variable":
            return Variable(text[1:])
        if kind == "blank":
            return None
        return self.iri(kind, text)

    def iri(self, kind: str, text: str) -> NamedNode | None:
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
        if self._base and _PLAIN.fullmatch(iri):
            iri = self._base + iri
        if not _ABSOLUTE.match(iri):
            return None
        if "/." in iri:  # the engine may leave such steps out
            raise UnreadError(iri)
        return NamedNode(iri)

    def named(self) -> NamedNode | None:
        """Take an IRI, or a name of one."""
        if self.peek()[0] not in ("iri", "name"):
            raise UnreadError(self.peek())
        name = self.term()
        return name if isinstance(name, NamedNode) else None

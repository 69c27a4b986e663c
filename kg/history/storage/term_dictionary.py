"""Numbers for the IRIs and blank nodes that recur, in the log's own tables."""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Iterable
from typing import NoReturn

from pyoxigraph import BlankNode, NamedNode, Quad

from kg import vocabulary as v
from kg.errors import HistoryError
from kg.history.storage.row_codec import INTERNED, Coded, Term, code_literal, decode_literal

_NAMED = (NamedNode, BlankNode)
_REMEMBERED = 50_000  # terms held in memory before starting afresh
# the predicates of every frame come first: their numbers then take one byte
_FIRST = (
    *(v.X, v.Y, v.Z, v.CONFIDENCE, v.EXISTENCE, v.OBSERVATION_COUNT, v.LAST_SEEN, v.IN_CELL),
    *(v.IN_PLACE, v.SCORE, v.BOX, v.FRAME, v.SOSA_RESULT_TIME, v.RDF_TYPE, v.RDFS_LABEL),
    *(v.FIRST_SEEN, v.EXPLAINED_BY, v.HEADING, v.FRAMES_APPLIED, v.LAST_FRAME, v.BELIEF),
    *(v.VIEW_COUNT, v.HAS_BELIEF, v.OF_CATEGORY, v.MODEL, v.FROM_RECORDING, v.SOSA_FEATURE),
    *(v.NEXT_OBJECT, v.X_MIN, v.X_MAX, v.Y_MIN),
)

KEPT = len(_FIRST)  # terms up to this number stay, used or not


class TermDictionary:
    """Interns terms, and (graph, subject) pairs as nodes; not safe for several threads."""

    def __init__(self, connection: sqlite3.Connection, base: str) -> None:
        self._db = connection
        self._base = base
        self._numbers: dict[Term, int] = {}
        self._terms: dict[int, Term] = {}
        self._nodes: dict[tuple[Term, Term], int] = {}

    def begin(self) -> None:
        """Give the vocabulary's own predicates the smallest numbers."""
        for iri in _FIRST:
            self.number(NamedNode(iri))

    def forget(self) -> None:
        """Drop what is held in memory: after a rollback it may not be so."""
        self._numbers.clear()
        self._terms.clear()
        self._nodes.clear()

    def number(self, term: Term) -> int:
        """The number of an IRI or blank node, given out where it has none."""
        known = self._numbers.get(term)
        if known is None:
            known = self.find(term)
            if known is None:
                insert = "INSERT INTO term (text) VALUES (?)"
                known = int(self._db.execute(insert, (self._text(term),)).lastrowid or 0)
            self._remember(term, known)
        return known

    def find(self, term: Term) -> int | None:
        """The number of an IRI or blank node, if it has one."""
        row = self._db.execute("SELECT id FROM term WHERE text = ?", (self._text(term),)).fetchone()
        return row[0] if row else None

    def term(self, number: int) -> Term:
        """The IRI or blank node of a number; HistoryError where it is dropped meanwhile."""
        known = self._terms.get(number)
        if known is None:
            row = self._db.execute("SELECT text FROM term WHERE id = ?", (number,)).fetchone()
            (text,) = row or _refuse_forgotten()
            known = BlankNode(text[2:]) if text.startswith("_:") else NamedNode(self._whole(text))
            self._remember(known, number)
        return known

    def written(self, numbers: Iterable[int]) -> dict[int, str]:
        """Many IRIs and blank nodes by number, as N-Triples has them; raises as `term`."""
        wanted = set(numbers)
        select = "SELECT id, text FROM term WHERE id IN (SELECT value FROM json_each(?))"
        found = {
            number: text if text.startswith("_:") else f"<{self._whole(text)}>"
            for number, text in self._db.execute(select, (json.dumps([*wanted]),))
        }
        return found if len(found) == len(wanted) else _refuse_forgotten()

    def node(self, graph: Term, subject: Term) -> int:
        """The number of a subject in a graph, given out where it has none."""
        known = self._nodes.get((graph, subject))
        if known is None:
            pair = self.number(subject), self.number(graph)
            select = "SELECT id FROM node WHERE subject = ? AND graph = ?"
            row = self._db.execute(select, pair).fetchone()
            if row is None:
                insert = "INSERT INTO node (subject, graph) VALUES (?, ?)"
                row = (int(self._db.execute(insert, pair).lastrowid or 0),)
            known = int(row[0])
            if len(self._nodes) > _REMEMBERED:
                self._nodes.clear()
            self._nodes[graph, subject] = known
        return known

    def pair(self, node: int) -> tuple[Term, Term]:
        """Graph and subject of a node; HistoryError where it is dropped meanwhile."""
        select = "SELECT graph, subject FROM node WHERE id = ?"
        graph, subject = self._db.execute(select, (node,)).fetchone() or _refuse_forgotten()
        return self.term(graph), self.term(subject)

    def nodes_of(self, subject: Term) -> list[int]:
        """The nodes of a subject, one for each graph that ever had facts about it."""
        number = self.find(subject)
        select = "SELECT id FROM node WHERE subject = ? ORDER BY id"
        return [] if number is None else [row[0] for row in self._db.execute(select, (number,))]

    def nodes_under(self, prefix: str) -> list[int]:
        """The nodes of all subjects whose IRI begins with `prefix`."""
        text = self._text(NamedNode(prefix))
        select = (
            "SELECT node.id FROM node JOIN term ON term.id = node.subject "
            "WHERE term.text >= ? AND term.text < ? ORDER BY term.text"
        )
        return [row[0] for row in self._db.execute(select, (text, text + "\U0010ffff"))]

    def code(self, predicate: Term, value: Term) -> Coded:
        """Predicate and object of a quad, coded."""
        number = self._numbers.get(predicate) or self.number(predicate)
        if isinstance(value, _NAMED):
            return Coded(number, INTERNED, self.number(value))
        return Coded(number, *code_literal(value))

    def find_code(self, predicate: Term, value: Term) -> Coded | None:
        """As `code`, but None where the log lacks one of them."""
        number = self.find(predicate)
        if not isinstance(value, _NAMED):
            return None if number is None else Coded(number, *code_literal(value))
        other = self.find(value)
        return None if number is None or other is None else Coded(number, INTERNED, other)

    def quads(self, node: int, facts: Iterable[Coded]) -> list[Quad]:
        """The quads of a node's `facts`."""
        graph, subject = self.pair(node)
        return [
            Quad(subject, self.term(coded.predicate), self.value(coded), graph)  # type: ignore[arg-type]
            for coded in facts
        ]

    def value(self, coded: Coded) -> Term:
        """The object of a coded fact."""
        _, kind, value = coded
        return self.term(int(value)) if kind == INTERNED else decode_literal(kind, value)

    def _whole(self, text: str) -> str:
        return self._base + text[1:] if text.startswith("~") else text

    def _text(self, term: Term) -> str:
        if isinstance(term, NamedNode):
            text = term.value
            own = text.startswith(self._base)
            return "~" + text[len(self._base) :] if own else text
        return str(term)

    def _remember(self, term: Term, number: int) -> None:
        if len(self._terms) > _REMEMBERED:
            self._terms.clear()
            self._numbers.clear()
        self._numbers[term] = number
        self._terms[number] = term


def _refuse_forgotten() -> NoReturn:
    raise HistoryError("the past state is no longer kept: it was dropped while it was read")

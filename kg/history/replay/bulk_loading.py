"""Bulk loading of facts in columns: as N-Triples, in half the time of a quad at a time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from pyoxigraph import NamedNode, Quad, RdfFormat, Store

from kg import vocabulary as v
from kg.history.replay.column_decoding import Ints
from kg.history.storage.log import HistoryLog
from kg.history.storage.row_codec import HUNDREDTHS, INTERNED, STRING, Coded, decode_literal
from kg.history.storage.term_dictionary import TermDictionary

_DOUBLE = f"^^<{v.XSD_DOUBLE}>"
_EXACT = 10**15  # hundredths below it are written by a double as by hand


class Columns(NamedTuple):
    """Facts, in columns of one length; subject, predicate and graph are interned."""

    subject: Ints
    predicate: Ints
    kind: Ints  # as `kg.history.storage.row_codec` has them, and `value` too; of text its place
    value: Ints
    graph: Ints


def load_facts(store: Store, facts: Columns, texts: Sequence[str], log: HistoryLog) -> None:
    """Add facts to a store; raises HistoryError where a name of theirs is dropped meanwhile."""
    named = facts.value[facts.kind == INTERNED]
    known = np.unique(np.concatenate((facts.subject, facts.predicate, facts.graph, named)))
    with log.lock:
        names = log.terms.written(known.tolist())
        nameless = [number for number, text in names.items() if text.startswith("_:")]
        if nameless:  # reading N-Triples would give them other names
            some = np.isin(facts.subject, nameless)
            some |= (facts.kind == INTERNED) & np.isin(facts.value, nameless)
            _add_singly(store, Columns(*(column[some] for column in facts)), texts, log.terms)
            facts = Columns(*(column[~some] for column in facts))
    for graph in np.unique(facts.graph).tolist():
        about = Columns(*(column[facts.graph == graph] for column in facts))
        text = _n_triples(about, texts, names)
        name = NamedNode(names[graph][1:-1])
        store.bulk_load(text.encode(), RdfFormat.N_TRIPLES, to_graph=name, lenient=True)


def _n_triples(facts: Columns, texts: Sequence[str], names: Mapping[int, str]) -> str:
    values = _values(facts, texts, names)
    each = zip(facts.subject.tolist(), facts.predicate.tolist(), values, strict=True)
    return "".join([f"{names[s]} {names[p]} {value} .\n" for s, p, value in each])


def _values(facts: Columns, texts: Sequence[str], names: Mapping[int, str]) -> list[str]:
    """The objects as N-Triples has them; each is written once."""
    values = np.empty(len(facts.kind), object)
    for kind in np.unique(facts.kind).tolist():
        some = facts.kind == kind
        numbers = facts.value[some].tolist()
        if kind == INTERNED:
            written = names
        elif kind == HUNDREDTHS:
            written = {number: hundredths(number) for number in set(numbers)}
        else:
            given = {number: texts[number] if kind >= STRING else number for number in set(numbers)}
            written = {number: str(decode_literal(kind, value)) for number, value in given.items()}
        values[some] = [written[number] for number in numbers]
    return list(values)


def hundredths(number: int) -> str:
    """A double of so many hundredths, as `str` writes the literal that `decode_literal` makes."""
    if abs(number) >= _EXACT:
        return str(decode_literal(HUNDREDTHS, number))
    whole, part = divmod(abs(number), 100)
    point = f".{part:02d}".rstrip("0") if part else ""
    return f'"{"-" * (number < 0)}{whole}{point}"{_DOUBLE}'


def _add_singly(store: Store, facts: Columns, texts: Sequence[str], terms: TermDictionary) -> None:
    for subject, predicate, kind, value, graph in zip(*(c.tolist() for c in facts), strict=True):
        coded = Coded(predicate, kind, texts[value] if kind >= STRING else value)
        store.add(
            Quad(
                terms.term(subject),  # type: ignore[arg-type]
                terms.term(predicate),  # type: ignore[arg-type]
                terms.value(coded),  # type: ignore[arg-type]
                terms.term(graph),  # type: ignore[arg-type]
            )
        )

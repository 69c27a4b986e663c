"""Point-in-time queries on the log: one thing at a moment, and the difference of two moments."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from pyoxigraph import NamedNode, Quad

from kg.history.curies import short, word
from kg.history.storage.change_lines import net, quads_of
from kg.history.storage.log import HistoryLog
from kg.model.errors import HistoryError

NEAR: Final = 200  # transactions between two moments that are read one by one


@dataclass(frozen=True, slots=True)
class Difference:
    """The quads that hold at one moment and not at another."""

    before: int  # sequence numbers
    after: int
    added: tuple[Quad, ...]
    removed: tuple[Quad, ...]

    def __len__(self) -> int:
        return len(self.added) + len(self.removed)

    def rows(self, base: str) -> list[tuple[str, str, str, str, str]]:
        """``+``, ``-`` or ``~``, thing, what of it, before and after; in words, by thing."""
        sides: dict[tuple[str, str], tuple[list[str], list[str]]] = {}
        for side, quads in enumerate((self.removed, self.added)):
            for quad in quads:
                key = short(quad.subject, base), word(quad.predicate)
                sides.setdefault(key, ([], []))[side].append(short(quad.object, base))
        rows = []
        for (subject, what), (before, after) in sides.items():
            sign = "~" if before and after else "+" if after else "-"
            rows.append((sign, subject, what, _listed(before), _listed(after)))
        return sorted(rows, key=lambda row: (_natural(row[1]), row[2]))


def state_of(log: HistoryLog, iri: str, sequence: int) -> tuple[Quad, ...]:
    """All quads about `iri` after `sequence`, but for ontology and common sense."""
    return tuple(sorted(quads_of(log.facts(sequence, subject_line(iri))), key=str))


def difference(log: HistoryLog, before: int, after: int) -> Difference:
    """The net change between two transactions; facts that went and came back do not count."""
    if before > after:
        turned = difference(log, after, before)
        return Difference(before, after, turned.removed, turned.added)
    background = net(log.change_lines(before, after, background=True))
    if after - before <= NEAR:
        removed, added = net(log.change_lines(before, after))
    else:
        old, new = log.facts(before), log.facts(after)
        removed, added = sorted(old - new), sorted(new - old)
    log.check_kept(before)
    return Difference(
        before,
        after,
        tuple(quads_of(background.added + added)),
        tuple(quads_of(background.removed + removed)),
    )


def _listed(values: list[str]) -> str:
    return ", ".join(sorted(values))


def _natural(text: str) -> tuple[str, int, str]:
    head, _, number = text.rpartition("/")
    return (head, int(number), "") if number.isascii() and number.isdigit() else (text, 0, text)


def subject_line(iri: str) -> bytes:
    """The IRI as N-Quads writes it; HistoryError for what is no absolute IRI."""
    try:
        return str(NamedNode(iri)).encode()
    except ValueError:
        raise HistoryError(f"needs an absolute IRI, got {iri!r}") from None

"""Point-in-time queries: states and versions of one thing, and differences of two moments."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from pyoxigraph import NamedNode, Quad

from kg.history.curies import brief, short, word
from kg.history.storage.change_lines import net, quads_of
from kg.history.storage.log import HistoryLog
from kg.model.errors import HistoryError
from kg.model.iris import whole_number

MAX_STEPS: Final = 200  # transactions read one by one; with more, two states are compared


@dataclass(frozen=True, slots=True)
class Difference:
    """The difference between the states after two transactions."""

    before: int  # sequence numbers
    after: int
    added: tuple[Quad, ...]
    removed: tuple[Quad, ...]

    def __len__(self) -> int:
        return len(self.added) + len(self.removed)

    def rows(self, base: str) -> list[tuple[str, str, str, str, str]]:
        """Rows of (``+``, ``-`` or ``~``, thing, property, before, after) in words, by thing."""
        sides: dict[tuple[str, str], tuple[list[str], list[str]]] = {}
        for side, quads in enumerate((self.removed, self.added)):
            for quad in quads:
                key = short(quad.subject, base), word(quad.predicate)
                sides.setdefault(key, ([], []))[side].append(brief(quad.object, base))
        rows = []
        for (subject, what), (before, after) in sides.items():
            sign = "~" if before and after else "+" if after else "-"
            rows.append((sign, subject, what, ", ".join(sorted(before)), ", ".join(sorted(after))))
        return sorted(rows, key=lambda row: (_natural(row[1]), row[2]))


def state_of(log: HistoryLog, iri: str, sequence: int) -> tuple[Quad, ...]:
    """All quads about `iri` after `sequence`, without ontology and common sense."""
    return tuple(sorted(quads_of(log.facts(sequence, subject_line(iri))), key=str))


def difference(log: HistoryLog, before: int, after: int) -> Difference:
    """The net change between two transactions."""
    if before > after:
        turned = difference(log, after, before)
        return Difference(before, after, turned.removed, turned.added)
    background = net(log.change_lines(before, after, background=True))
    if after - before <= MAX_STEPS:
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


def _natural(text: str) -> tuple[str, int, str]:
    head, _, number = text.rpartition("/")
    found = whole_number(number)
    return (text, 0, text) if found is None else (head, found, "")


def subject_line(iri: str) -> bytes:
    """The IRI as in N-Quads; raises HistoryError if it is not absolute."""
    try:
        return str(NamedNode(iri)).encode()
    except ValueError:
        raise HistoryError(f"needs an absolute IRI, got {iri!r}") from None


@dataclass(frozen=True, slots=True)
class Version:
    """A version of a thing: its facts from one transaction that changed them until the next."""

    sequence: int
    time: float  # [s] since 1970-01-01 UTC
    empty: bool = False  # without facts: the thing had been removed


def versions(
    log: HistoryLog, iri: str, *, until: int | None = None, max_count: int = 1000
) -> list[Version]:
    """The last `max_count` versions (-1: all) up to the transaction `until`, the latest first.

    Ontology and common sense have no versions, since the log does not keep their first state.
    Raises HistoryError if `iri` is no absolute IRI.
    """
    subject, found = subject_line(iri), list[Version]()
    with log.lock:
        changes = log.history(subject, until, max_count)
        facts = log.facts(changes[0][0] - 1 if changes else log.floor, subject)
        if facts and len(changes) != max_count:
            found.append(Version(log.floor, log.floor_time))
        for sequence, change in changes:
            commit = log.commit(sequence)
            facts.difference_update(change.removed)
            facts.update(change.added)
            if commit is not None:
                found.append(Version(sequence, commit.time, not facts))
    return found[::-1]


def version_at(log: HistoryLog, iri: str, sequence: int) -> Version | None:
    """The version right after a transaction; None if the log has no version until then."""
    return next(iter(versions(log, iri, until=sequence, max_count=1)), None)


def first_version(log: HistoryLog, iri: str) -> Version | None:
    """The oldest version that is kept and has facts."""
    found = [version for version in versions(log, iri, max_count=-1) if not version.empty]
    return found[-1] if found else None

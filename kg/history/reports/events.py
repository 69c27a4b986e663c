"""The history of one thing in words: its changes in each transaction, with the cause."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from typing import Final

from pyoxigraph import Literal, NamedNode, Quad

from kg.history.point_in_time import Difference, subject_line
from kg.history.reports.comparison import Comparison
from kg.history.reports.explanation import Explanation
from kg.history.reports.report_names import Names
from kg.history.storage.log import HistoryLog
from kg.history.storage.log_reader import ChangeLines, quads_of
from kg.history.timestamps import iso, moment, short, spoken, word
from kg.model import vocabulary as v
from kg.model.errors import QueryParameterError
from kg.model.iris import observation_iri
from kg.model.place_names import indefinite
from kg.model.shares import chance
from kg.model.transactions import Cause
from kg.rdf.quad_store import QuadStore, Term

_Sides = tuple[list[Quad], list[Quad]]  # removed, added

_DEPARTED = NamedNode(v.DEPARTED_OBJECT)
_FARTHER: Final = 0.1  # [m] from its position in the summary, below which a thing has not moved
_SURER: Final = 0.2  # change of existence that belongs into the summary
_NUMBERS: Final = (v.X, v.Y, v.EXISTENCE, v.DEVIATION)
_STATED: Final = {
    v.IN_PLACE: "in",
    v.ON: "on",
    v.INSIDE: "inside",
    v.RDFS_LABEL: "called",
    v.SEARCH_STATE: "",
    v.BOT_INTERFACE_OF: "leading to",
}


@dataclass(frozen=True, slots=True)
class HistoryEvent:
    """The changes of one thing in one transaction."""

    sequence: int
    time: float  # [s] since 1970-01-01 UTC
    cause: Cause
    changes: tuple[str, ...]  # in words, e.g. "x 1.20 -> 1.23"
    #: the changes in a summary; () where they are counters, and corrections within the uncertainty
    told: tuple[str, ...] = ()
    cause_words: str = ""  # kind and note of the cause, with names in place of IRIs

    @property
    def words(self) -> str:
        """All changes in one line."""
        return ", ".join(self.changes)


def history_events(
    log: HistoryLog, engine: QuadStore, iri: NamedNode, base: str
) -> Iterator[HistoryEvent]:
    """The transactions that changed `iri`, its observation, beliefs or relations; oldest first.

    Other things have the names that they have in `engine`.

    Raises QueryParameterError if the history does not contain the IRI.
    """
    subjects = [
        *(subject_line(one) for one in (iri.value, observation_iri(base, iri.value))),
        *log.subjects_under(iri.value + "/belief/"),
        *log.subjects_under(iri.value + "/relation/"),
    ]
    found: dict[int, list[ChangeLines]] = {}
    for subject in subjects:
        for sequence, change in log.whole_history(subject):
            found.setdefault(sequence, []).append(change)
    if not found and not log.facts(log.floor, subjects[0]):
        raise QueryParameterError(
            f"the history knows nothing of {short(iri, base)}; "
            "`hereabouts ask MAP objects` lists what there is"
        )
    names = Names(engine, base)
    summary = _Summary(iri, names)
    for sequence, lines_of in sorted(found.items()):
        commit = log.commit(sequence)
        if commit is not None:
            changes = [(quads_of(removed), quads_of(added)) for removed, added in lines_of]
            lines = tuple(text for change in changes for text in _words(change, base, names))
            told = tuple(text for change in changes for text in summary.of(change))
            cause = commit.cause
            words = " ".join(filter(None, (cause.kind, names.text(cause.note))))
            yield HistoryEvent(sequence, commit.time, cause, lines, told, words)


class _Summary:
    """Summary of the changes of one thing: those that differ from the summary so far."""

    def __init__(self, iri: NamedNode, names: Names) -> None:
        self._iri, self._names = iri, names
        self._at: tuple[float, ...] = ()  # [m] position in the summary
        self._existence = math.nan  # in the summary
        self._numbers: dict[str, float] = {}  # present values

    def of(self, change: _Sides) -> Iterator[str]:
        """The part of a change that belongs into the summary, in words."""
        sides = [[quad for quad in side if quad.graph_name == v.MAP_GRAPH] for side in change]
        if not any(sides) or (sides[0] + sides[1])[0].subject != self._iri:
            return
        removed, added = (_by_predicate(side) for side in sides)
        if v.RDF_TYPE in removed and (went := _left(added)):
            self._at, self._existence, self._numbers = (), math.nan, {}
            yield went
            return
        self._numbers |= {
            predicate.value: number
            for predicate, values in added.items()
            if isinstance(predicate, NamedNode) and predicate.value in _NUMBERS
            for number in _floats(values)
        }
        yield from self._kind(removed, added)
        yield from self._numbers_told()
        for predicate, words in _STATED.items():
            now = added.get(NamedNode(predicate), [])
            gone = removed.get(NamedNode(predicate), []) if not now else []
            yield from (f"{words} {self._names(value)}".strip() for value in now)
            yield from (f"no longer {words} {self._names(value)}" for value in gone)

    def _kind(
        self, removed: dict[Term, list[Term]], added: dict[Term, list[Term]]
    ) -> Iterator[str]:
        if _DEPARTED in removed.get(v.RDF_TYPE, ()):
            yield "came back"
            return
        known = v.RDF_TYPE in removed or bool(self._at)
        for kind in added.get(v.RDF_TYPE, ()):
            if kind != NamedNode(v.BOT_SPACE):  # each place is one
                kind_name = self._names(kind)
                yield f"{indefinite(kind_name)} now" if known else f"new: {kind_name}"

    def _numbers_told(self) -> Iterator[str]:
        x, y, existence = (self._numbers.get(name, math.nan) for name in (v.X, v.Y, v.EXISTENCE))
        reach = max(_FARTHER, self._numbers.get(v.DEVIATION, 0.0))
        if math.isfinite(x + y) and not (self._at and math.dist(self._at, (x, y)) <= reach):
            moved = f"moved {math.dist(self._at, (x, y)):.2f} m, " if self._at else ""
            self._at = (x, y)
            yield f"{moved}at ({x:.2f}, {y:.2f}) m"
        if math.isfinite(existence) and not self._is_as_told(existence):
            self._existence = existence
            yield f"there with {chance(existence)}"

    def _is_as_told(self, existence: float) -> bool:
        """Whether an existence is near that of the summary; less near across an even chance."""
        same_side = (existence >= 0.5) == (self._existence >= 0.5)
        return abs(existence - self._existence) < (_SURER if same_side else _SURER / 2)


def _left(added: dict[Term, list[Term]]) -> str:
    """A thing that loses its kind leaves or is removed: the verb; "" where it stays."""
    if _DEPARTED in added.get(v.RDF_TYPE, ()):
        return "left where it stood"
    return "" if v.RDF_TYPE in added else "removed"


def _floats(values: Iterable[Term]) -> Iterator[float]:
    """The first of the values, if it is a number."""
    for value in values:
        if isinstance(value, Literal):
            with suppress(ValueError):
                yield float(value.value)
            return


def _words(change: _Sides, base: str, names: Names) -> Iterator[str]:
    removed_quads, added_quads = change
    about = _about((removed_quads + added_quads)[0].subject, base)
    removed, added = _by_predicate(removed_quads), _by_predicate(added_quads)
    if v.RDF_TYPE in removed and v.RDF_TYPE not in added:
        yield f"{about}: removed" if about else "removed"
        return
    if v.RDF_TYPE in removed and _DEPARTED in added.get(v.RDF_TYPE, ()):
        yield "left where it stood"
        return
    lines = _steps(removed, added, names)
    if about:
        yield f"{about}: {'; '.join(lines)}"
    else:
        yield from lines


def _steps(
    removed: dict[Term, list[Term]], added: dict[Term, list[Term]], names: Names
) -> Iterator[str]:
    new = v.RDF_TYPE in added and v.RDF_TYPE not in removed
    if new:
        yield "new " + ", ".join(names(kind) for kind in added[v.RDF_TYPE])
    for predicate in sorted({*removed, *added}, key=word):
        if predicate != v.RDF_TYPE or not new:
            old, now = (
                ", ".join(names(value) for value in side.get(predicate, ()))
                for side in (removed, added)
            )
            yield f"{word(predicate)} {_step(old, now)}"


def _step(old: str, new: str) -> str:
    if old and new:
        return f"{old} -> {new}"
    return new or f"{old} no more"


def _about(subject: Term, base: str) -> str:
    text = short(subject, base)
    if "/belief/" in text:
        return f"belief in {text.rpartition('/')[2]}"
    if "/relation/" in text:
        return f"relation {' '.join(text.partition('/relation/')[2].split('/'))}"
    return "best observation" if "observation" in text else ""


def _by_predicate(quads: Iterable[Quad]) -> dict[Term, list[Term]]:
    found: dict[Term, list[Term]] = {}
    for quad in quads:
        found.setdefault(quad.predicate, []).append(quad.object)
    return found


#: Labels of the kinds of steps; the other labels are the kinds themselves.
_LABELS: Final = {
    **dict.fromkeys(("thing", "fact", "was"), ""),
    "observation": "evidence",
    "commit": "written",
    "change": "last change",
    "person": "by",
    "view": "views",
}
_OF_MACHINES: Final = frozenset(("rule", "model", "pose", "commit", "change"))
_MAX_SENTENCES: Final = 8
_BRIEF: Final = re.compile(r"[:;,]| \(")  # the end of a rule's first words
_MOMENT: Final = re.compile(r"(?: at)? (\d{4}-\d\d-\d\dT[\d:.]+Z)")
#: what of steps only machines use: the box of an observation, the frames of views
_BOX: Final = re.compile(r": box [^;]*|, last [^;]*/[^;]*")


def log_text(entries: Iterable[HistoryEvent]) -> str:
    """A line for each transaction."""
    return _lines(
        f"#{entry.sequence} {iso(entry.time)} {_cause(entry)}: {entry.words}" for entry in entries
    )


def difference_text(found: Difference, base: str) -> str:
    """A line for each differing property of a thing."""
    return _lines(
        f"{sign} {subject} {what}: {_words_of(before, after)}"
        for sign, subject, what, before, after in found.rows(base)
    )


def comparison_text(found: Comparison) -> str:
    """A line for each change of an object or a room, and one for floor and surface."""
    changes = (
        f"{one.kind} {one.name or one.category}: {_words_of(*one.sides)}" for one in found.changes
    )
    rooms = (f"{one.kind} {one.title}: {_words_of(one.before, one.after)}" for one in found.rooms)
    return _lines((*changes, *rooms, found.area_words))


def reasons_text(reasons: Iterable[Explanation]) -> str:
    """A line for each step, indented by its depth."""
    return _lines(
        f"{'  ' * depth}{_label_of(step)}{step.text}"
        for reason in reasons
        for depth, step in reason.walk()
    )


def _label_of(step: Explanation) -> str:
    """Relation of a step to the one before it, as ``evidence: ``; empty for things and facts."""
    label = _LABELS.get(step.kind, step.kind)
    return f"{label}: " if label else ""


def reason_sentences(reasons: Iterable[Explanation]) -> list[str]:
    """Short sentences on what stands behind facts: views, beliefs, people; fewer than ten.

    Without the rules, networks, poses and transactions, which `reasons_text` has.
    """
    lines = list[str]()
    for reason in reasons:
        lines += [reason.text] if reason.kind == "thing" else []
        steps = reason.because if reason.kind == "thing" else (reason,)
        lines += [_sentence(step) for step in steps if step.kind not in _OF_MACHINES]
    rest = len(lines) - _MAX_SENTENCES
    return [*lines[:_MAX_SENTENCES], *([f"and {rest} more"] if rest > 0 else [])]


def _sentence(step: Explanation) -> str:
    """A step with what is behind it: ``Cup 9 is a cup: seen best in frame-000259 of tour``."""
    rules = [_BRIEF.split(one.text)[0] for one in step.because if one.kind == "rule"]
    behind = [*(rule for rule in rules if rule.startswith("the size ")), *_behind(step)]
    commits = [one for one in step.because if one.kind == "commit" and one.time is not None]
    for one in commits:
        said = [person.text for person in one.because if not person.text.startswith("search/")]
        behind += [f"{who} said so {spoken(one.time or 0.0)}" for who in said]
    if not behind:
        behind = [*rules[-1:], *(f"since {spoken(one.time or 0.0)}" for one in commits)]
    text = step.text
    if behind:
        stated = step.because[:1] and step.because[0].kind == "person"
        text += f"{'' if stated else ':'} {'; '.join(behind)}"
    text = _MOMENT.sub(lambda found: f" {spoken(moment(found[1]))}", _BOX.sub("", text))
    return text[:1].upper() + text[1:]


def _behind(step: Explanation) -> Iterator[str]:
    things = [one for one in step.because if one.kind == "thing"]
    for one in step.because:
        if one.kind not in _OF_MACHINES and one not in things:
            yield f"by {one.text}" if one.kind == "person" else one.text
            yield from _behind(one)
    if things:
        yield f"{len(things)} thing{'s' * (len(things) > 1)} in it"


def _cause(entry: HistoryEvent) -> str:
    by = entry.cause.by
    return f"{entry.cause_words} by {by}" if by else entry.cause_words


def _words_of(before: str, after: str) -> str:
    return f"{before} -> {after}" if before and after else after or before


def _lines(lines: Iterable[str]) -> str:
    return "".join(f"{line}\n" for line in lines)

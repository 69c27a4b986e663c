"""Plain questions and their answers: what is asked, read by the sentences of each language.

A question that has no sentence, or has words which change its sense (not, nearest, more), is not
understood: no answer is better than a wrong one.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, Literal, cast

from kg.maps.query.parameter_resolution import preferred_languages
from planner.questions.clues import has_clue, read_clues
from planner.questions.sentences import Gaps, Language, languages

Kind = (
    Literal["where", "in place", "changed", "status", "count", "near", "around", "on", "last seen"]
    | Literal["places", "objects", "robot", "departed", "distance", "size", "compare", "most"]
    | Literal["under", "help", "recent", "largest", "route", "between", "certainty", "unseen"]
    | Literal["why", "alike"]
)

Known = Callable[[str], bool]

MAX_LENGTH: Final = 300  # characters of a question
ROBOT: Final = "robot"  # in place of a thing, the last pose of the robot
#: kinds of changes that a word of a question means; none: all
EVENTS: Final[dict[str, tuple[str, ...]]] = {
    "move": ("moved",),
    "new": ("appeared",),
    "gone": ("gone",),
}
_NEED: Final = re.compile(r"(?:some|any)(?:thing|where) (?:i|we|one) can\b")
_NUMBERED: Final = re.compile(
    r"(?:object|thing|item|number|objekt|ding|gegenstand)(?: number| no\.?| nummer| nr\.?)? #?(\d+)"
)
_OF_SEVERAL: Final = ("where", "status", "count", "last seen")  # kinds that ask for A and B, too
_NAMED: Final = ("what", "where", "other", "start")  # gaps of names
_TIMELESS: Final = ("changed", "last seen", "departed", "recent", "why", "certainty")
_MAX_NAME: Final = 2  # words of a name that stands alone, unless it is known or has a number


@dataclass(frozen=True, slots=True)
class Question:
    """A question that a sentence has: its kind and the words in its gaps."""

    kind: Kind
    what: str = ""
    where: str = ""
    other: str = ""
    when: str = ""
    event: str = ""
    qualities: tuple[str, ...] = ()
    also: tuple[str, ...] = ()  # further things that the same is asked about
    at: str = ""  # the moment in words that is asked about; "" for now
    start: str = ""  # of a way; "" for the robot
    number: int = 0  # whether there are so many; 0: how many there are
    of_person: bool = False  # asks where the person is
    of_all: bool = False  # asks for each such thing, not for one
    read_as: str = ""  # the text with its small words corrected

    def whether(self, sure: int, known: int) -> str:
        """``Yes: `` or ``No: ``: whether there are so many as is asked; "" where that is not."""
        if not self.number:
            return ""
        if sure >= self.number:
            return "Yes: "
        return "Perhaps: " if known >= self.number else "No: "

    @property
    def notes(self) -> list[str]:
        """Sentences on what the answer leaves out of the text, or corrects in it."""
        notes = [f"This is read as '{self.read_as}'"] if self.read_as else []
        notes += ["The map knows where the robot is, not where you are"] * self.of_person
        if self.qualities and self.kind != "alike":
            named = " and ".join(self.qualities)
            notes.append(f"The map does not keep what is {named}, so this is about all of them")
        return notes


@dataclass(frozen=True, slots=True)
class PlainAnswer:
    """The answer to a plain question, and how the question was understood."""

    kind: Kind
    query: str  # shipped query that has the facts
    parameters: Mapping[str, str]  # of the query
    lines: tuple[str, ...]  # the answer in sentences
    columns: tuple[str, ...] = ()
    rows: tuple[tuple[object, ...], ...] = ()
    things: tuple[str, ...] = ()  # IRIs of what was counted, beside those of the rows

    @property
    def command(self) -> str:
        """The same facts by `hereabouts ask`; "" where no query has them."""
        if not self.query:
            return ""
        given = "".join(f" -p {name}='{value}'" for name, value in self.parameters.items())
        return f"hereabouts ask MAP {self.query}{given}"

    def to_json(self) -> dict[str, object]:
        """Plain values for JSON."""
        return {
            "kind": self.kind,
            "query": self.query,
            "parameters": dict(self.parameters),
            "answer": list(self.lines),
        }


def parsed(text: str, known: Known = lambda name: False, language: str = "") -> Question | None:
    """The question in a text; None if it is not understood, or an order.

    `known` tells whether a category, or a thing, has that name; such names keep all their words.
    `language` limits the languages that the text is read in, such as ``de`` or ``de, en``.
    Raises QueryParameterError where it has another form.
    """
    spoken, gaps = _read(text, known, language)
    if not gaps or gaps["kind"] == "order":
        return None
    return None if _is_timeless(gaps) else _question(spoken, gaps, known)


def ordered(text: str) -> str:
    """The thing that an order is about, such as to bring it; "" for other texts."""
    _, gaps = _read(text, lambda name: False)
    return gaps["what"] if gaps.get("kind") == "order" else ""


def _read(text: str, known: Known, wanted: str = "") -> tuple[Language, Gaps]:
    """The language of a text, and the gaps of its sentence; none if it is not understood."""
    names = {one.partition("-")[0] for one in preferred_languages(wanted)}
    *_, last = spoken = [one for one in languages() if one.name in names] or languages()
    if len(text) > MAX_LENGTH or not text.strip():
        return last, {}
    plain = [(language, language.plain(text)) for language in spoken]
    plain = [(language, w) for language, w in plain if re.fullmatch(r"[\w '#:.,/-]*", w)]
    if any(not words for _, words in plain):  # politeness alone
        return last, {"kind": "help"}
    if (read := _by_sentence_or_clues(plain, known)) is not None:
        return read
    for language, words in plain:
        again = language.respelt(words, known)
        if again != words and (gaps := language.read(again)):
            return language, {**gaps, "read_as": again}
    simpler = [(language, language.simpler(words)) for language, words in plain]
    if simpler != plain and (read := _by_sentence_or_clues(simpler, known)) is not None:
        return read
    for language, words in plain[-1:]:
        name, _ = _Names(language, known).without(words)
        short = len(name.split()) <= _MAX_NAME or name.split()[-1].isdigit()
        if known(name) or (short and not has_clue(language, [name])):
            return language, {"kind": "where", "what": words}
    return last, {}


def _by_sentence_or_clues(
    plain: Sequence[tuple[Language, str]], known: Known
) -> tuple[Language, Gaps] | None:
    """The reading of a sentence; clues go first where one of its names has other words in it."""
    read = [(one, w, one.read(w) or {}) for one, w in plain]
    for language, _, gaps in read:
        here = language.one_of("here").fullmatch(gaps.get("other", ""))
        given = [gaps.get(gap, "") for gap in _NAMED if gap != "other" or not here]
        names = [_Names(language, known).without(name)[0] for name in given]
        unknown = [name for name in names if not known(name)]
        if gaps and not _is_timeless(gaps) and not has_clue(language, unknown):
            return language, gaps
    for language, words, gaps in read:
        clues = read_clues(language, words) or {}
        given = [clues.get(gap, "") for gap in _NAMED]
        if any(has_clue(one, given) for one in languages() if one is not language):
            clues = {}  # words of another language are no name
        if clues or gaps:
            return language, clues or gaps
    return None


def _is_timeless(gaps: Gaps) -> bool:
    """Whether a moment is asked for where no answer has one."""
    return bool(gaps.get("at")) and gaps["kind"] in _TIMELESS


def _question(language: Language, gaps: Gaps, known: Known) -> Question | None:
    """The question of a sentence; None if a word in a gap changes its sense."""
    kind, names = cast(Kind, gaps["kind"]), _Names(language, known)
    thing = gaps.get("what", "")
    is_list, joins = kind in _OF_SEVERAL and not known(thing), "|".join(language.words("joins"))
    parts = re.split(rf",? (?:{joins}) |, ", thing) if is_list else [thing]
    found = [names.read(words) for words in (*parts, *(gaps.get(g, "") for g in _NAMED[1:]))]
    if None in found:
        return None
    *things, (where, _), (other, more), (start, _) = cast(list[tuple[str, tuple[str, ...]]], found)
    what, *also = (name for name, _ in things)
    if also and "number" in gaps:  # whether it is the number of one or of all is not said
        return None
    amounts = [language.one_of("amounts").match(name) for name, _ in things if " " in name]
    if kind in ("status", "near", "count") and any(amounts):  # "several cups" is none for a cup
        return None
    if kind in ("near", "distance") and not other:
        other = ROBOT
    if kind == "distance" and what == ROBOT:
        what, other = other, what
    return Question(
        kind,
        gaps.get("need", what),
        where,
        other,
        gaps.get("when", ""),
        gaps.get("event", ""),
        (*(quality for _, some in things for quality in some), *more),
        tuple(also),
        gaps.get("at", ""),
        start,
        int(gaps.get("number", 0)),
        "of_person" in gaps,
        "of_all" in gaps,
        gaps.get("read_as", ""),
    )


@dataclass(frozen=True, slots=True)
class _Names:
    """Names of things and places in the gaps of a sentence."""

    language: Language
    known: Known

    def read(self, words: str) -> tuple[str, tuple[str, ...]] | None:
        """A name and its qualities, as `without`; None if it is no name, or more than one."""
        if self.language.one_of("here").fullmatch(words):
            return ROBOT, ()
        need = _NEED.sub("something", words)  # the words of a need are looked up as a whole
        if not self.known(words) and self.language.one_of("refused").search(need):
            return None
        name, qualities = self.without(words)
        # an article within, as in "water the plants", begins the name of something else
        inside = any(language.one_of("articles").search(name) for language in languages())
        return None if inside and not self.known(name) else (name, qualities)

    def without(self, words: str) -> tuple[str, tuple[str, ...]]:
        """A name without leading articles and qualities, and these qualities."""
        parts, qualities = words.split(), list[str]()
        determiner, quality = (self.language.one_of(key) for key in ("determiners", "qualities"))
        while len(parts) > 1 and not self.known(" ".join(parts)):
            is_quality = quality.fullmatch(parts[0])
            if not is_quality and (qualities or not determiner.fullmatch(parts[0])):
                break
            qualities += [parts[0]] if is_quality else []
            parts.pop(0)
        name = " ".join(parts)
        number = self.language.lists["number"].get(parts[-1]) if len(parts) > 1 else None
        if number and not self.known(name):  # chair three
            name = " ".join([*parts[:-1], number])
        return _NUMBERED.sub(r"object \1", name), tuple(qualities)

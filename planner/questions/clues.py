"""Questions that no sentence has, read by their clues.

A text is split into clues, such as ``where`` or ``how many``, and names, which are all other words,
each with the preposition before it. A reading has the clues and names of one kind of
question. Their order does not matter, but each must be used: a text is refused if a clue
or a name is left over, or if readings of two kinds fit.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any, Final

from planner.questions.sentences import Gaps, Language

READINGS: Final = Path(__file__).with_name("readings.toml")
_VOID: Final = "void"  # the clue of words that say nothing
_HANGING: Final = "hanging"  # the clue of a preposition without a name: "which room is it in"
_TWICE: Final = "twice"  # the clue of two texts for one gap: "at 9:30 yesterday"
_OF: Final = "of"  # may stand before a clue: "the time of the latest sighting"
_OR: Final = "or"  # "in the hall or in the kitchen"
_JOIN: Final = "and"  # the preposition of a further name in a list
_FROM_HERE: Final = ("near", "to", "from", "between", "and")  # prepositions of "me", and of "here"
_SPANS: Final = ("changed", "last seen")  # kinds that ask for a span, not for a moment of it
_WORD: Final = re.compile(r"[^ ,]+ \d+(?![\w:.])|[^ ,]+|,")  # ``place 4`` is one
Name = tuple[str, str]  # preposition, or "", and words


@dataclass(slots=True)
class _Split:
    """The clues of a text with the texts of their gaps, and its names in order."""

    language: Language
    clues: set[str] = field(default_factory=set)
    gaps: Gaps = field(default_factory=dict)
    names: list[Name] = field(default_factory=list)
    before: str = ""  # the preposition of the next name
    name: list[str] = field(default_factory=list)  # words of one that has no end yet

    def add(self, table: str, clue: str, found: re.Match[str]) -> None:
        """Adds a clue or a preposition of the file, or a word that is neither."""
        text = found[0].strip(" ,")
        if table == "clues" and self._is_in_name(clue, text):
            table = ""
        if table or not text or self.language.one_of("determiners").fullmatch(text):
            self.end_name()
        if table == "prepositions":
            self.clues.update({_HANGING} if self.before not in ("", _OF, _OR) else ())
            self.before = self.before if self.before == _OR else clue
        elif self.before in _FROM_HERE and self.language.one_of("here").fullmatch(text):
            self.name.append(text)
            self.end_name()
        elif table:
            if self.before and clue not in _file()["soft"]:  # "in which room"
                self.clues.update({_HANGING} if self.before not in (_OF, _OR) else ())
                self.before = self.before if self.before == _OR else ""
            self.clues.add(clue)
            for gap, one in self.language.gaps(found).items():
                self.clues.update({_TWICE} if self.gaps.setdefault(gap, one) != one else ())
        elif text:
            self.name.append(text)

    def _is_in_name(self, clue: str, text: str) -> bool:
        """Whether a clue is part of a name: a soft one after an article, a noun after a word."""
        if not self.name or self.language.one_of("articles").fullmatch(self.name[-1]):
            return bool(self.name) and clue != _VOID and clue in _file()["soft"]
        return bool(self.language.one_of("nouns").fullmatch(text))

    def end_name(self) -> None:
        """Ends a name; determiners alone are none."""
        if any(not self.language.one_of("determiners").fullmatch(word) for word in self.name):
            self.names.append((self.before, " ".join(self.name)))
            self.before = ""
        self.name.clear()

    def end(self) -> None:
        """Ends the text; its last preposition may belong to its first name."""
        self.end_name()
        if self.before and "what" in self.clues and self.names and not self.names[0][0]:
            self.names[0] = (self.before, self.names[0][1])  # the kitchen, what is in it
        elif self.before:
            self.clues.add(_HANGING)


@dataclass(frozen=True, slots=True)
class _Reading:
    """One way to ask a kind of question: ``a|b`` is one of two clues, ``[a]`` may be missing."""

    kind: str
    clues: tuple[frozenset[str], ...]  # of each, one must be there
    further: frozenset[str]  # clues that may be there
    names: tuple[tuple[frozenset[str], str, bool], ...]  # prepositions, gap, whether it is needed

    @classmethod
    def of(cls, kind: str, text: str, soft: Sequence[str]) -> _Reading:
        """The reading of a line of the file; `soft` clues may be there, too."""
        clues, _, names = text.partition("/")
        gaps = [(*one.strip("[]").rpartition(":")[::2], one[0] != "[") for one in names.split()]
        return cls(
            kind,
            tuple(frozenset(one.split("|")) for one in clues.split() if one[0] != "["),
            frozenset((*soft, *(one.strip("[]") for one in clues.split() if one[0] == "["))),
            tuple((frozenset(before.split("|")), gap, needed) for before, gap, needed in gaps),
        )

    def fit(self, split: _Split, join: str) -> Gaps | None:
        """The gaps of a text; None if a clue or a name is missing, or left over."""
        clues, gaps = split.clues, Gaps({"kind": self.kind, "at": "", **split.gaps})
        if clues.difference(self.further, *self.clues) or not all(
            map(clues.intersection, self.clues)
        ):
            return None
        names = self._listed(split.names, join)
        for before, gap, needed in self.names:
            at = next((n for n, name in enumerate(names) if name[0] in before), None)
            if at is not None:
                gaps[gap] = names.pop(at)[1]
            elif needed:
                return None
        if "time" in gaps:
            gaps["when" if self.kind in _SPANS else "at"] = gaps.pop("time")
        return None if names else gaps

    def _listed(self, names: list[Name], join: str) -> list[Name]:
        """The names; those of a list are one, unless the second has a gap of its own."""
        if any(_JOIN in before for before, _, _ in self.names):
            return list(names)
        found = list[Name]()
        for before, words in names:
            if before == _JOIN and found:
                found[-1] = (found[-1][0], f"{found[-1][1]} {join} {words}")
            else:
                found.append((before, words))
        return found


def has_clue(language: Language, names: Iterable[str]) -> bool:
    """Whether a name that a sentence has found has a clue or a preposition in it."""
    return any(table for name in names for table, _, _ in _tokens(language, name))


def read_clues(language: Language, words: str) -> Gaps | None:
    """The gaps of plain words, or of their other form; None if no reading uses all of them.

    None, too, if readings of several kinds do.
    """
    form, at = language.formed(words)
    found = _read(language, words)
    if found is None and form != words and (found := _read(language, form)) is not None:
        found["at"] = found["at"] or at
    return found


def _read(language: Language, words: str) -> Gaps | None:
    split, join = _Split(language), language.words("joins")[0]
    for token in _tokens(language, words):
        split.add(*token)
    split.end()
    fits = [gaps for one in readings() if (gaps := one.fit(split, join)) is not None]
    return fits[0] if len({one["kind"] for one in fits}) == 1 else None


@cache
def _file() -> dict[str, Any]:
    return tomllib.loads(READINGS.read_text(encoding="utf-8"))


@cache
def readings() -> tuple[_Reading, ...]:
    """The ways to ask, of all languages."""
    file = _file()
    lines = ((kind, line) for kind, several in file["readings"].items() for line in several)
    return tuple(_Reading.of(kind, line, file["soft"]) for kind, line in lines)


@cache
def _patterns(language: Language) -> list[tuple[str, str, re.Pattern[str]]]:
    """Tables of a language's file, names of clues or prepositions in them, and expressions."""
    return [
        (table, name, re.compile(rf"{language.pattern(f'({template})').pattern}(?![\w'])"))
        for table in ("clues", "prepositions")
        for name, template in language.table(table).items()
    ]


def _tokens(language: Language, words: str) -> Iterator[tuple[str, str, re.Match[str]]]:
    """The longest clue or preposition at each word, with its table and name; else the word."""
    at = 0
    while at < len(words):
        every = ((table, name, p.match(words, at)) for table, name, p in _patterns(language))
        found = [(table, name, match) for table, name, match in every if match]
        word = _WORD.match(words, at)
        found += [("", "", word)] if word and (not found or " " in word[0]) else []
        table, name, match = max(found, key=lambda one: len(one[2][0].rstrip(" ,") or ","))
        yield table, name, match
        at += len(match[0].rstrip(" ,") or match[0])
        at += len(words[at:]) - len(words[at:].lstrip(" "))

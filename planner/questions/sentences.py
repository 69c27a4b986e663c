"""Sentences of questions: templates from a file for each language, and what a text says by them.

A template has words, `[optional words]`, `(one|or another)`, `<rules>` and `{gaps}`, as sentences
of Home Assistant have them. `{shape:gap}` takes only the texts of a list, or of a shape.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path
from typing import Final

FOLDER: Final = Path(__file__).with_name("sentences")
ENGLISH: Final = "en"  # is tried last, since its sentences take names alone, too
_TOKEN: Final = re.compile(r"\{(?:(\w+):)?(\w+)\}|([\[\]()|])|\s+|([^\s{}\[\]()|]+)")
_WORD: Final = re.compile(r"(?<![{:\w])[^\s{}\[\]()|]+")
_PAUSES: Final = re.compile(r" - |[ ,;:?!.]*[,;:?!.](?= )[ ,;:]*")
_MARKS: Final = {"[": "(?:", "]": ")?", "(": "(?:", ")": ")", "|": "|"}
_UMLAUTS: Final = {"ä": "(?:ä|ae)", "ö": "(?:ö|oe)", "ü": "(?:ü|ue)", "ß": "(?:ß|ss)"}
_IN_ASCII: Final = str.maketrans({"ä": "ae", "ö": "oe", "ü": "ue", "ß": "ss"})
_MIN_MISSPELT: Final = 4  # letters of a word that lacks a letter, or has one too many

Gaps = dict[str, str]


@dataclass(frozen=True, eq=False)
class Sentence:
    """A template with the fields of the question that it asks, or the form that it is put into."""

    language: Language
    template: str  # without rules
    fields: Mapping[str, str]

    def match(self, words: str) -> Gaps | None:
        """The texts in the gaps, and the fields; None for words that it does not have."""
        if not self._may_begin(words.split(" ", 1)[0]):
            return None
        found = self._pattern.fullmatch(words)
        if found is None:
            return None
        return {**self.fields, **self.language.gaps(found)}

    def _may_begin(self, first: str) -> bool:
        """Whether a word may be the first one: saves most of the templates from being compiled."""
        return self.template.startswith("{") or first.translate(_IN_ASCII) in self._words

    @cached_property
    def _words(self) -> frozenset[str]:
        return frozenset(word.translate(_IN_ASCII) for word in _WORD.findall(self.template))

    @cached_property
    def _pattern(self) -> re.Pattern[str]:
        return self.language.pattern(self.template)


@dataclass(frozen=True, eq=False)
class Language:
    """The sentences, and the words around them, of one language."""

    name: str  # of its file
    file: Mapping[str, object]

    def pattern(self, template: str) -> re.Pattern[str]:
        """The regular expression of a template; a gap's group is ``shape__gap`` with a number."""
        return re.compile("".join(self._parts(self._expanded(template))))

    def _parts(self, template: str) -> Iterator[str]:
        for n, token in enumerate(_TOKEN.finditer(template)):
            shape, gap, mark, word = token.groups()
            if gap:
                yield f"(?P<{shape or gap}__{gap}__{n}>{self._shape(shape or gap)})"
            elif word:
                yield rf"\b{_spelt(re.escape(word))}\b"
            else:
                yield _MARKS[mark] if mark else "[ ,]*"

    def _shape(self, name: str) -> str:
        if values := self.lists.get(name):
            longest_first = sorted(values, key=len, reverse=True)
            return rf"\b(?:{'|'.join(map(_spelt, longest_first))})\b"
        return self.table("shapes").get(name, r"[^\s,].*?")

    def gaps(self, found: re.Match[str]) -> Gaps:
        """The texts in the gaps of a template's pattern; those of lists by what they mean."""
        gaps = Gaps()
        for group, text in found.groupdict().items():
            if text is not None:
                shape, _, gap = group.partition("__")
                values = self.lists.get(shape, {}).items()
                meant = (v for key, v in values if re.fullmatch(_spelt(key), text.strip()))
                gaps[gap.rstrip("0123456789_")] = next(meant, text.strip())
        return gaps

    def _expanded(self, template: str) -> str:
        while "<" in template:
            template = re.sub(r"<(\w+)>", lambda m: f"({self.table('rules')[m[1]]})", template)
        return template

    @cached_property
    def lists(self) -> Mapping[str, Mapping[str, str]]:
        """Texts that a gap may have, and what each means."""
        return self.file["lists"]  # type: ignore[return-value]

    def table(self, key: str) -> Mapping[str, str]:
        """Texts by name, such as the rules; empty where the file has none."""
        return self.file.get(key, {})  # type: ignore[return-value]

    def words(self, key: str) -> Sequence[str]:
        """A list of words, which may be regular expressions."""
        return self.file[key]  # type: ignore[return-value]

    def one_of(self, key: str) -> re.Pattern[str]:
        """The words of a list as one expression, from the beginning of a word to its end."""
        return _one_of(tuple(self.words(key)))

    @cached_property
    def questions(self) -> tuple[Sentence, ...]:
        """All sentences, in the order in which they are tried."""
        return tuple(self._sentences("question", "sentences"))

    @cached_property
    def _forms(self) -> tuple[Sentence, ...]:
        return tuple(self._sentences("form", "read"))

    def _sentences(self, key: str, texts: str) -> Iterator[Sentence]:
        for block in self.file.get(key, ()):  # type: ignore[attr-defined]
            fields = {name: value for name, value in block.items() if name != texts}
            for template in block[texts]:
                yield Sentence(self, self._expanded(template), fields)

    def plain(self, text: str) -> str:
        """Lower case, single spaces, full forms; without marks at the end and politeness."""
        words = " ".join(text.replace("\u2019", "'").casefold().split()).strip(" ?!.,;:'\"")
        words = _PAUSES.sub(", ", words)
        for form, read in self.table("spelt").items():
            words = re.sub(rf"(?<![\w'])(?:{form})(?!\w)", read, words)
        before, after = (self._around(key) for key in ("before", "after"))
        while (match := before.match(words)) and match.end():
            words = words[match.end() :]
        while (match := after.search(words)) and match.start():
            words = words[: match.start()]
        return words

    @cache  # noqa: B019 (languages live as long as the process)
    def _around(self, key: str) -> re.Pattern[str]:
        pattern = self.pattern(str(self.file[key])).pattern
        return re.compile(
            rf"(?:{pattern})(?: |[,!.]+ ?|$)" if key == "before" else f",? (?:{pattern})$"
        )

    def formed(self, words: str) -> tuple[str, str]:
        """Plain words in the form that has a sentence, and the moment of the past in them."""
        at = ""
        for form in self._forms:
            if (gaps := form.match(words)) is not None:
                words = " ".join(gaps["as"].format(**gaps).split())
                at = gaps.get("at", at)
        return words, at

    def read(self, words: str) -> Gaps | None:
        """The gaps of the first sentence that plain words are; None if they are none."""
        words, at = self.formed(words)
        found = (sentence.match(words) for sentence in self.questions)
        gaps = next((one for one in found if one is not None), None)
        return gaps and {**gaps, "at": at}

    def simpler(self, words: str) -> str:
        """Plain words without what a person tells first: ``i am thirsty, where is a cup``."""
        *told, asked = words.split(", ")
        is_told = bool(told) and all(map(self.one_of("first_person").match, told))
        return self.plain(asked) if is_told else words

    def respelt(self, words: str, known: Callable[[str], bool]) -> str:
        """Words with the small ones as they are most probably meant: ``wher`` is ``where``.

        A word that is known stays as it is.
        """
        small = sorted(self.words("small_words"))
        return " ".join(
            typed
            if typed in small or known(typed)
            else next((word for word in small if _misspelt(typed, word)), typed)
            for typed in words.split()
        )


@cache
def _one_of(words: tuple[str, ...]) -> re.Pattern[str]:
    longest_first = sorted(map(_spelt, words), key=len, reverse=True)
    return re.compile(rf"\b(?:{'|'.join(longest_first)})(?!\w)")


def _spelt(word: str) -> str:
    """A word with umlauts in both spellings."""
    return re.sub("[äöüß]", lambda letter: _UMLAUTS[letter[0]], word)


def _misspelt(typed: str, word: str) -> bool:
    """Whether letters are in another order, or one is missing, or one is too many."""
    if sorted(typed) == sorted(word) or len(typed) < _MIN_MISSPELT:
        return sorted(typed) == sorted(word)
    return typed in _without_a_letter(word) or word in _without_a_letter(typed)


def _without_a_letter(word: str) -> Iterator[str]:
    return (word[:n] + word[n + 1 :] for n in range(len(word)))


@cache
def languages() -> tuple[Language, ...]:
    """The language of each file, English last."""
    files = sorted(FOLDER.glob("*.toml"), key=lambda path: (path.stem == ENGLISH, path.stem))
    return tuple(
        Language(path.stem, tomllib.loads(path.read_text(encoding="utf-8"))) for path in files
    )

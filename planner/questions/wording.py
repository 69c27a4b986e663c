"""Wording of questions: politeness, equal forms, the past, and misspelt small words."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Final

MAX_LENGTH: Final = 300  # characters of a question

_POLITE: Final = re.compile(
    r"^(?:(?:(?:hey|hi|hello)(?: there)?|ok|okay|please|robot|so|and|well|excuse me|"
    r"thanks?(?: you)?(?: very much| a lot)?|cheers|(?:good)?bye|"
    r"good (?:morning|day|afternoon|evening))\b[ ,!.]*)*"
    r"(?:(?:can|could|would|will) you (?:please )?(?:tell me|show me|say|find out|find)? ?"
    r"|do you (?:know|remember) |(?:do you have )?any idea |(?:please )?(?:tell|show) me "
    r"|i (?:want|would like|need) to know )?"
)
_TRAILING: Final = re.compile(
    r"(?:,? (?:please|for me|anywhere|around here|right now|now|at the moment))+$"
)
#: forms of questions, and those with the same meaning that the patterns have
_FORMS: Final = tuple(
    (re.compile(pattern), form)
    for pattern, form in (
        (
            r"^(?:are you (?:sure|certain)|do you think|is it true)(?: that)? (?=there|the |my )",
            "is ",
        ),
        (r"^(?:what |how )?about (?=.)|^describe ", "where is "),
        (r"^(how many .+?) (?:can|could|did|have) you (?:see|seen|count)\b(?: there)?", r"\1"),
        (r"^(where is .+) gone$", r"\1"),
        (r"^(.+) that (?:is|are) (in|on) ", r"\1 \2 "),
        (r"^is there (is|are) ", r"\1 there "),
        (r"^is ((?:the|my) .+?) (is|are) (in|on) ", r"\2 \1 \3 "),
        (r"^(is|are|do|have)n't (?=there|we|you|i)", r"\1 "),
        (r"^(where) (.+) (is|are|am)$", r"\1 \3 \2"),
        (r"^(how many .+?) (?:there )?(?:are )(in .+)$", r"\1 \2"),
        (r" (to|from|near|next to|close to|around) (?:me|us|you|here)$", r" \1 the robot"),
    )
)
_PAST: Final = re.compile(
    r"(?P<asked>|(?:where|what|which .+?|how many .+?) )(?P<be>was|were) (?P<rest>.+?) (?P<when>"
    r"(?:on |last )?\w*day|last (?:week|month)|this morning|last night|"
    r"(?:(?:\w+ )?(?:couple of|few)|\w+) \w+ ago)"
)
_SMALL_WORDS: Final = frozenset(
    (
        *("where", "what", "which", "when", "how", "many", "there", "the", "have", "are", "find"),
        *("room", "rooms", "things", "who", "three"),  # who is no misspelt how
    )
)
_MIN_MISSPELT: Final = 4  # letters of a word that lacks a letter, or has one too many


def normalised(text: str) -> str:
    """Lower case, single spaces, straight apostrophes, without marks at the end and politeness."""
    words = " ".join(text.replace("\u2019", "'").casefold().split())
    words = re.sub(r"\b(?:(where|what|who|that|there|it)'s|(what)s)\b", r"\1\2 is", words).strip(
        " ?!.,;:'\""
    )
    words = _TRAILING.sub("", _POLITE.sub("", words[:MAX_LENGTH], count=1))
    return _in_one_form(words)


def _in_one_form(words: str) -> str:
    for pattern, form in _FORMS:
        words = pattern.sub(form, words)
    return words


def in_present(words: str) -> tuple[str, str]:
    """A question about the past as one about the present, and its moment in words, or ""."""
    match = _PAST.fullmatch(words)
    if match is None:
        return words, ""
    be = {"was": "is", "were": "are"}[match["be"]]
    present = _in_one_form(f"{match['asked']}{be} {match['rest']}")
    return present, match["when"].removeprefix("on ")


def respelt(words: str) -> str:
    """A question with its small words as they are most probably meant: ``wher`` is ``where``."""
    return " ".join(_small_word(word) for word in words.split())


def _small_word(typed: str) -> str:
    if typed in _SMALL_WORDS:
        return typed
    return next((w for w in sorted(_SMALL_WORDS) if _is_misspelt(typed, w)), typed)


def _is_misspelt(typed: str, word: str) -> bool:
    """Whether letters are in another order, or one is missing, or one is too many."""
    if sorted(typed) == sorted(word) or len(typed) < _MIN_MISSPELT:
        return sorted(typed) == sorted(word)
    return typed in _without_a_letter(word) or word in _without_a_letter(typed)


def _without_a_letter(word: str) -> Iterator[str]:
    return (word[:n] + word[n + 1 :] for n in range(len(word)))

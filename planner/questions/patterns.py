"""Patterns of plain questions: a table of regular expressions over normalised words.

A question that no pattern matches, or that has words which change its sense (not, when, nearest),
is not understood: no answer is better than a wrong one.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, Literal

from planner.questions.german import in_english

Kind = Literal[
    "where",
    "in place",
    "changed",
    "status",
    "count",
    "near",
    "around",
    "on",
    "last seen",
    "places",
    "objects",
    "robot",
    "departed",
]

Known = Callable[[str], bool]

MAX_LENGTH: Final = 300  # characters of a question

_POLITE: Final = re.compile(
    r"^(?:(?:hey|hi|hello|ok|okay|please|robot|so|and|well|excuse me)\b[ ,]*)*"
    r"(?:(?:can|could|would|will) you (?:please )?(?:tell me|show me|say|find out|find)? ?"
    r"|do you (?:know|remember) |(?:do you have )?any idea |(?:please )?(?:tell|show) me "
    r"|i (?:want|would like|need) to know )?"
)
_BE: Final = "(?:is|are|'s|was|were)"
_ARE: Final = "(?:is|are|'s)"
_TRAILING: Final = re.compile(r"(?:,? (?:please|for me|anywhere|around here|now|at the moment))+$")
_SEE: Final = "(?:you (?:see|know|have|find)|we have|i have|there (?:is|are)|are there|is there)"
_IN: Final = "(?:in|inside|of|at|within)"
_CLOSE: Final = "(?:near|beside|next to|close to|by|around|next)(?: to)?"
_WHAT: Final = r"(?P<what>.+?)"
_WHERE: Final = f"(?: {_IN} (?P<where>.+?))?"
_THINGS: Final = "(?:what|(?:which |what |all )?(?:things|objects|items)|everything)"
_LIST: Final = "(?:list|show|name|give me) (?:me )?"
_EVENT: Final = "(?P<event>change|move|appear|disappear|gone|new|different|happen)(?:d|ed)?"
_SPAN: Final = "(?:since|in the|during the|over the|within the|after) .+"
_SINCE: Final = f"(?: (?P<when>{_SPAN}|today|lately|recently|yesterday))?"
_ANYTHING: Final = "(?P<what>(?:some|any)thing to .+?)"
_OWN: Final = r"(?P<what>(?:the|my|our|your|his|her|their|[a-z ]+ \d+).*?)"
_SEARCHED: Final = (
    "(?:find|locate|look for|search for|i (?:am|'m) (?:looking|searching) for|"
    "i (?:need|want)|have you seen|did you see|go to)"
)
_ASKED_WHERE: Final = (
    f"(?:where {_ARE}|where (?:can|do|could|should|did) (?:i|we|you) "
    "(?:find|look for|search for|see|put|leave)|where (?:have|has) (?:i|we|you) (?:put|left|seen)|"
    f"where to (?:find|look for)|wheres|what {_ARE} the (?:location|position|place) of)"
)
_ROOM: Final = "(?:in |on )?(?:which|what) (?:room|place)s? (?:is|are|has|have|holds?|contains?)"

#: kind and pattern of the whole normalised question, in the order in which they are tried
_TABLE: Final[tuple[tuple[Kind, str], ...]] = (
    ("robot", f"where {_ARE} (?:you|the robot)(?: now)?|where am i"),
    ("places", f"(?:which|what) (?:rooms|places) (?:{_ARE} there|do {_SEE})"),
    ("places", f"(?:{_LIST})?(?:all |the )*(?:rooms|places)(?: {_ARE} there)?"),
    ("places", f"how many (?:rooms|places)(?: {_ARE} there| do {_SEE})?"),
    ("objects", f"{_LIST}(?:all |the |every)*(?:objects|things?)(?: you (?:know|see))?"),
    (
        "objects",
        "what (?:can|do) you (?:see|know)|what is (?:there|here|in (?:the|this) map)",
    ),
    ("departed", f"{_THINGS} (?:{_ARE}|has|have)(?: gone)? (?:missing|gone|lost)"),
    (
        "changed",
        f"(?:{_THINGS}|anything)(?: has| have| is| are)?(?: been)? {_EVENT}{_SINCE}",
    ),
    ("changed", f"(?:has|did) (?:anything|something) {_EVENT}{_SINCE}"),
    (
        "last seen",
        f"when (?:did|have|was|were|had) (?:you |we )?(?:last )?(?:see |seen )?{_WHAT}(?: "
        "last)?(?: seen)?(?: last| the last time)?",
    ),
    (
        "count",
        f"(?:how many|what is the number of|count) {_WHAT}(?: (?:do )?{_SEE})?{_WHERE}(?: {_SEE})?",
    ),
    ("near", f"{_ARE} there {_WHAT} {_CLOSE} (?P<other>.+)"),
    (
        "near",
        f"(?:where (?:{_ARE}|can i find) |find |is there )?{_ANYTHING} {_CLOSE} (?P<other>.+)",
    ),
    ("near", f"(?:where {_ARE}|find|show) {_WHAT} {_CLOSE} (?P<other>.+)"),
    ("around", f"{_THINGS} ?{_ARE}? {_CLOSE} (?P<other>.+)"),
    (
        "on",
        f"{_THINGS} ?(?:{_ARE}|lies|stands)? (?:lying |standing )?on(?: top of)? (?P<other>.+)",
    ),
    (
        "in place",
        f"(?:{_LIST})?{_THINGS} ?(?:{_ARE}|can|do)? ?(?:{_SEE} |there )?in(?:side)? (?P<where>.+)",
    ),
    ("where", f"{_ROOM} {_WHAT}(?: in)?"),
    (
        "status",
        f"{_ARE} there (?:still )?(?:any )?{_WHAT}(?: left)?(?: (?:in|inside|at) (?P<where"
        ">.+?))?(?: left)?",
    ),
    (
        "status",
        f"(?:do|does) (?:we|you|i|the map) (?:still )?(?:have|know|see|contain) {_WHAT}{_WHERE}",
    ),
    ("status", f"{_ARE} {_OWN} (?:still )?(?:in|inside|at) (?P<where>.+)"),
    ("status", f"{_ARE} (?P<where>place \\d+) an? {_WHAT}"),
    ("where", r"what (?:kind |sort )?(?:of )?(?:room |place )?is (?P<what>place \d+)"),
    ("where", f"{_ASKED_WHERE} {_WHAT}(?: now)?"),
    ("where", f"{_SEARCHED} {_WHAT}"),
    ("where", _ANYTHING.replace("+?", "+")),
    (
        "where",
        "what can (?:i|we|one) (?P<need>(?:sit|eat|drink|cut|sleep|write|cook|read|lie) ?.*)",
    ),
    ("where", f"{_LIST}{_WHAT}"),
    (
        "status",
        "(?:any|(?:have (?:we|you|i) )?got (?:any|some|a|an)|have (?:we|you|i) any) "
        f"{_WHAT}(?: left)?{_WHERE}",
    ),
    ("status", f"(?:does|has) (?P<where>.+? room|the .+?|place \\d+) (?:have|got|contain) {_WHAT}"),
    ("near", f"{_WHAT} {_CLOSE} (?P<other>.+)"),
    ("status", f"{_WHAT} in(?:side)? (?P<where>.+)"),
)
PATTERNS: Final = tuple((kind, re.compile(pattern)) for kind, pattern in _TABLE)
#: kinds of changes that a word of a question means; none: all
EVENTS: Final[dict[str, tuple[str, ...]]] = {
    "move": ("moved",),
    "appear": ("appeared",),
    "new": ("appeared",),
    "gone": ("gone",),
    "disappear": ("gone",),
}
#: words that change the sense of a question in a way that no query has
_REFUSED: Final = re.compile(
    r"\b(?:not|no|never|nothing|none|nobody|except|without|but|or|if|while|who|whose|why|how|which|"
    r"nearest|closest|farthest|biggest|largest|smallest|oldest|newest|most|least|best|other|else|"
    r"left|right|behind|under|above|below|between|tomorrow|yesterday|before|ago|will|should|and|"
    r"than|as|more|fewer|less|another|"
    r"was|were|had|has|have|does|do|is|are|what|where|can|i|me|you|he|she|they|we|it)\b"
)
#: needs that are met by a kind of thing, not by a tool for them
_MEALS: Final = {"to eat": "food", "to drink": "drink"}
#: an amount: "are there two cups" is no question for a cup
_AMOUNT: Final = re.compile(
    r"^\d+ |\b(?:two|three|four|five|six|seven|eight|nine|ten|eleven|twelve|twenty|thirty|hundred|"
    r"dozens?|couple|several|few|plenty|enough|many|exactly|only|just|second|third) "
)
#: qualities that maps do not keep; things are found without them, and the answer says so
_QUALITIES: Final = frozenset(
    (
        *("red", "green", "blue", "yellow", "black", "white", "grey", "gray", "brown", "orange"),
        *("pink", "purple", "violet", "silver", "golden", "big", "small", "large", "little"),
        *("tall", "short", "long", "old", "new", "clean", "dirty", "empty", "full", "broken"),
        *("wooden", "free", "available", "spare", "used", "warm", "cold", "fresh", "ripe", "nice"),
        *("good", "favourite", "round", "square", "heavy", "open", "closed", "favorite"),
    )
)
_LEADING: Final = frozenset(
    (
        *("a", "an", "the", "my", "our", "your", "his", "her", "their", "some", "any", "this"),
        *("that", "these", "all"),
    )
)


@dataclass(frozen=True, slots=True)
class Question:
    """A question that a pattern matched: its kind and the words in its gaps."""

    kind: Kind
    what: str = ""
    where: str = ""
    other: str = ""
    when: str = ""
    event: str = ""
    qualities: tuple[str, ...] = ()

    @property
    def notes(self) -> list[str]:
        """A sentence on qualities that are not in the map."""
        if not self.qualities:
            return []
        named = " and ".join(self.qualities)
        return [f"The map does not keep what is {named}, so this is about all of them"]


def normalised(text: str) -> str:
    """Lower case, single spaces, straight apostrophes, without marks at the end and politeness."""
    words = " ".join(text.replace("\u2019", "'").casefold().split())
    words = re.sub(r"\b(where|what|who|there|it)'s\b", r"\1 is", words).strip(" ?!.,;:'\"")
    stripped = _POLITE.sub("", words[:MAX_LENGTH], count=1)
    stripped = _TRAILING.sub("", stripped)
    asked = re.sub(r"^(where) (.+) (is|are)$", r"\1 \3 \2", stripped)
    return re.sub(r"^(how many .+?) (?:there )?(?:are )(in .+)$", r"\1 \2", asked)


def parsed(text: str, known: Known = lambda name: False) -> Question | None:
    """The question in a text by the first pattern that matches; None if it is not understood.

    `known` tells whether a category has that name; such names keep all their words.
    """
    words = normalised(in_english(text[: MAX_LENGTH + 1]))
    if len(text) > MAX_LENGTH or not re.fullmatch(r"[\w '#:.,-]+", words):
        return None
    for kind, pattern in PATTERNS:
        if match := pattern.fullmatch(words):
            return _question(kind, match.groupdict(""), known)
    bare = _without(words, known)[0]
    return _question("where", {"what": words}, known) if 0 < len(bare.split()) <= 3 else None


def _question(kind: Kind, gaps: dict[str, str], known: Known) -> Question | None:
    names = {gap: gaps.get(gap, "") for gap in ("what", "where", "other")}
    if any(_REFUSED.search(_needless(words)) for words in names.values()):
        return None
    what, qualities = _without(names["what"], known)
    where, _ = _without(names["where"], known)
    other, more = _without(names["other"], known)
    if kind in ("status", "near", "count") and _AMOUNT.search(f"{what} "):
        return None
    if re.search(r"\b(?:a|an|the)\b", f"{what} {where} {other}"):
        return None
    what = f"something to {gaps['need']}" if gaps.get("need") else what
    what = _MEALS.get(what.partition("thing ")[2], what)
    event, when = gaps.get("event", ""), gaps.get("when", "")
    return Question(kind, what, where, other, when, event, (*qualities, *more))


def _needless(words: str) -> str:
    """Without the words of a need, which are looked up as a whole."""
    return re.sub(r"^(?:some|any)thing (?:i|we|one) can\b", "something", words)


def _without(words: str, known: Known) -> tuple[str, tuple[str, ...]]:
    """A name without leading articles and qualities, and these qualities."""
    parts, qualities = words.split(), list[str]()
    while len(parts) > 1 and parts[0] in _LEADING | _QUALITIES and not known(" ".join(parts)):
        first = parts.pop(0)
        qualities += [first] if first in _QUALITIES else []
    return " ".join(parts), tuple(qualities)

"""Patterns of plain questions: a table of regular expressions over normalised words.

A question that no pattern matches, or that has words which change its sense (not, when, nearest),
is not understood: no answer is better than a wrong one.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final, Literal

from planner.questions.german import in_english
from planner.questions.wording import MAX_LENGTH, in_present, normalised, respelt

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
    "distance",
    "size",
    "compare",
    "most",
    "under",
    "help",
]

Known = Callable[[str], bool]

_ARE: Final = "(?:is|are|'s)"
_SEE: Final = "(?:(?:you|we|i) (?:see|know|have|own|find)|there (?:is|are)|are there|is there)"
_IN: Final = "(?:in|inside|of|at|within)"
_CLOSE: Final = "(?:near|beside|next to|close to|by|around|next)(?: to)?"
_WHAT: Final = r"(?P<what>.+?)"
_WHERE: Final = f"(?: {_IN} (?P<where>.+?))?"
_INSIDE: Final = "(?: (?:in|inside|at|from|within) (?P<where>.+?))?"
_THINGS: Final = "(?:what|(?:which |what |all |the )*(?:things|objects|items)|everything)"
_LIST: Final = "(?:list|show|name|give me) (?:me )?"
_EVENT: Final = "(?P<event>change|move|appear|disappear|gone|new|different|happen)(?:d|ed)?"
_SPAN: Final = "(?:since|in the|during the|over the|within the|after) .+"
_SINCE: Final = f"(?: (?P<when>{_SPAN}|today|lately|recently|yesterday))?"
_SOMETHING: Final = "(?:any|some)(?:thing| things?| objects?)"
_SOMEBODY: Final = "(?:any|some)(?:one|body)"
_MOVED: Final = "(?:moved?|taken?|took|stolen?|steal|shift(?:ed)?)"
_ANYTHING: Final = "(?P<what>(?:some|any)(?:thing|where) (?:to|(?:i|we|one) can) .+?)"
_OWN: Final = r"(?P<what>(?:the|my|our|your|his|her|their|[a-z ]+ \d+).*?)"
_SEARCHED: Final = (
    "(?:find(?: me)?|locate|look for|search for|i (?:am|'m) (?:looking|searching) for|"
    "i (?:need|want|can(?:not| not|'?t) find)|have you seen|did you see)"
)
_ASKED_WHERE: Final = (
    f"(?:where {_ARE}|where (?:can|do|could|should|did|would|might) (?:i|we|you) "
    "(?:find|look for|search for|see)|where do (?:i|we) (?:keep|store)|"
    "where did (?:i|we|you) (?:put|leave)|"
    "where (?:have|has) (?:i|we|you) (?:put|left|seen)|"
    f"where to (?:find|look for)|wheres|what {_ARE} the (?:location|position|place) of)"
)
_ORDER: Final = "(?P<order>bring(?: me)?|fetch(?: me)?|get(?: me)?|(?:hand|give) me|go to|pick up)"
_HOW_LARGE: Final = "how (?:big|large|tall|high|wide|broad|long|deep)"
_LARGER: Final = "(?P<event>bigger|larger|smaller|taller|higher)"
_HAS: Final = "(?:has|have|holds?|contains?)"
_ROOM: Final = f"(?:in |on )?(?:which|what) (?:room|place)s? (?:is|are|{_HAS})"
_NUMBER: Final = "(?:how many|(?:what is )?(?:the )?(?:total )?(?:number|count) of|count)"
_LIES: Final = "(?:(?:is|are|'s|lies|stands) )?(?:lying |standing )?"
_UNDER: Final = "(?:under(?:neath)?|beneath|below)"

#: kind and pattern of the whole normalised question, in the order in which they are tried
_TABLE: Final[tuple[tuple[Kind, str], ...]] = (
    ("help", "|help(?: me)?|what can (?:you (?:do|answer)|i (?:ask|say)(?: you)?)"),
    ("robot", f"where (?:{_ARE} (?:you|the robot)|(?P<person>am i|are we))(?: now)?"),
    (
        "robot",
        "(?:in )?(?:which|what) (?:room|place) (?:are you|is the robot|(?P<person>am i|are we))"
        "(?: in)?",
    ),
    ("places", f"(?:which|what) (?:rooms|places) (?:{_ARE} there|do {_SEE})"),
    ("places", f"(?:{_LIST})?(?:all |the )*(?:rooms|places)(?: {_ARE} there)?"),
    ("places", f"how many (?:rooms|places)(?: {_ARE} there| do {_SEE})?"),
    ("objects", f"{_LIST}(?:all |the |every)*(?:objects|things?)(?: you (?:know|see))?"),
    ("objects", f"how many (?:objects|things)(?: {_ARE} there| do {_SEE})?|where is everything"),
    ("in place", f"how many (?:objects|things) ?(?:{_ARE}|do)? ?(?:{_SEE} )?{_IN} (?P<where>.+)"),
    ("on", f"how many (?:objects|things) {_LIES}on(?: top of)? (?P<other>.+)"),
    (
        "objects",
        "what (?:can|do) you (?:see|know)|what is (?:there|here|in (?:the|this) map)",
    ),
    (
        "departed",
        f"(?:{_THINGS} (?:{_ARE}|has|have)|(?:{_ARE}|has) {_SOMETHING})(?: gone)? "
        "(?:missing|gone|lost)",
    ),
    (
        "changed",
        f"(?:{_THINGS}|anything)(?: has| have| is| are)?(?: been)? {_EVENT}{_SINCE}",
    ),
    ("changed", f"(?:has|did) (?:anything|something) {_EVENT}{_SINCE}"),
    ("changed", f"(?:has|have|did) {_SOMEBODY} {_MOVED} {_WHAT}{_SINCE}"),
    (
        "changed",
        f"(?:has|have|was|were|is|are) {_OWN} (?:been |gone )?"
        f"(?:{_MOVED}|gone|missing|lost){_SINCE}",
    ),
    ("last seen", f"when was the last time (?:you|we|i|anybody|anyone|somebody) saw {_WHAT}"),
    (
        "last seen",
        f"when (?:did|have|was|were|had) (?:you |we )?(?:last )?(?:see |seen )?{_WHAT}(?: "
        "last)?(?: seen)?(?: last| the last time)?",
    ),
    (
        "last seen",
        "(?:was|were|have|has|did) (?:there|you|we|the robot|anybody|anyone) ever "
        f"(?:been |seen? )?{_WHAT}",
    ),
    ("distance", f"how far(?: apart)? {_ARE} {_WHAT} and (?P<other>.+?)(?: apart)?"),
    (
        "distance",
        f"(?:how far is it|(?:what is )?(?:the )?distance) (?:between|from) {_WHAT} (?:and|to) "
        "(?P<other>.+)",
    ),
    ("distance", f"how far (?:away )?{_ARE} {_WHAT}(?: away)?(?: from (?P<other>.+))?"),
    ("compare", f"(?:which|what)(?: one)? is {_LARGER}[,:]? {_WHAT},? or (?P<other>.+)"),
    ("compare", f"{_ARE} {_OWN} {_LARGER} than (?P<other>.+)"),
    (
        "size",
        f"(?:{_HOW_LARGE}|what size) {_ARE} {_WHAT}(?: (?:above|from) the (?:floor|ground))?|"
        f"what {_ARE} the (?:size|height|width|length|depth|dimensions) of (?P<sized>.+)",
    ),
    ("count", f"{_NUMBER} {_WHAT} (?:{_ARE} )?(?:{_SEE} )?on(?: top of)? (?P<other>.+)"),
    ("count", f"{_NUMBER} {_WHAT} do(?:es)? (?P<where>(?:the|this|our|my) .+?) have"),
    ("count", f"{_NUMBER} {_WHAT}(?: (?:do )?{_SEE})?{_WHERE}(?: {_SEE})?"),
    ("most", f"(?:in )?(?:which|what) (?:room|place) (?:{_HAS}|are) (?:the )?most {_WHAT}"),
    ("around", f"{_THINGS} {_ARE} (?:the )?(?:nearest|closest)(?: thing)? to (?P<other>.+)"),
    (
        "near",
        f"(?:(?:which|what|where|find|show)(?: {_ARE}| me)? )?(?:the )?(?:nearest|closest) {_WHAT}"
        "(?: to (?P<other>.+))?",
    ),
    ("near", f"(?:which|what) {_WHAT} {_ARE} (?:the )?(?:nearest|closest)(?: to)? (?P<other>.+)"),
    ("near", f"{_ARE} there {_WHAT} {_CLOSE} (?P<other>.+)"),
    (
        "near",
        f"(?:where (?:{_ARE}|can i find) |find |is there )?{_ANYTHING} {_CLOSE} (?P<other>.+)",
    ),
    ("near", f"(?:where {_ARE}|find|show) {_WHAT} {_CLOSE} (?P<other>.+)"),
    ("near", f"{_ARE} {_OWN} {_CLOSE} (?P<other>.+)"),
    ("near", f"(?:which|what) (?P<what>rooms?|places?) {_ARE} {_CLOSE} (?P<other>.+)"),
    ("around", f"{_THINGS} ?{_ARE}? {_CLOSE} (?P<other>.+)"),
    ("under", f"(?:{_THINGS}|{_ARE} (?:there )?{_SOMETHING}) {_LIES}{_UNDER} (?P<other>.+)"),
    ("on", f"(?:{_THINGS}|(?:{_ARE} there )?{_SOMETHING}) {_LIES}on(?: top of)? (?P<other>.+)"),
    (
        "in place",
        f"(?:{_LIST})?{_THINGS} ?(?:{_ARE}|can|do)? ?(?:{_SEE} |there )?in(?:side)? (?P<where>.+)",
    ),
    ("where", f"{_ROOM} {_WHAT}(?: in)?"),
    (
        "where",
        "(?:where|in (?:which|what) (?:room|place)) (?:did|have|do|can) (?:i|we|you) (?:last )?"
        f"(?:see|seen|find) {_WHAT}(?: last)?",
    ),
    (
        "where",
        f"(?:what|which) (?:(?:kinds?|sorts?|types?) of )?{_WHAT} (?:do )?(?:{_SEE}|{_ARE} there)"
        f"{_INSIDE}",
    ),
    ("where", f"(?:what|which) {_WHAT} {_ARE} (?:in|inside) (?P<where>.+)"),
    (
        "status",
        f"{_ARE} (?:there (?:still )?(?:any )?(?P<any>.+?)|{_OWN}) (?:still )?on(?: top of)? "
        "(?P<other>(?!in ).+)",
    ),
    (
        "status",
        f"{_ARE} there (?:still )?(?:any )?{_WHAT}(?: left)?(?: (?:in|inside|at) (?P<where"
        ">.+?))?(?: left)?",
    ),
    (
        "status",
        "(?:do|does) (?:we|you|i|the map) (?:still )?(?:have|own|know|see|contain) "
        f"{_WHAT}{_WHERE}",
    ),
    ("status", f"{_ARE} {_OWN} (?:still )?(?:(?:in|inside|at) (?P<where>.+)|there)"),
    ("status", f"{_ARE} (?P<where>place \\d+) an? {_WHAT}"),
    ("where", r"what (?:kind |sort )?(?:of )?(?:room |place )?is (?P<what>place \d+)"),
    ("where", f"where in(?:side)? (?P<where>.+?) {_ARE} {_WHAT}"),
    ("where", f"(?:{_ASKED_WHERE}|{_SEARCHED}|{_ORDER}) {_WHAT}{_INSIDE}(?: now)?"),
    ("where", f"{_ANYTHING}{_INSIDE}"),
    ("where", f"where can (?:i|we|one) (?P<need>(?:sit|sleep|write|cook|read|lie).*?){_INSIDE}"),
    (
        "where",
        "what can (?:i|we|one) (?P<need>(?:sit|eat|drink|cut|sleep|write|cook|read|lie).*?)"
        f"{_INSIDE}",
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
    r"second|third|nearest|closest|farthest|biggest|largest|smallest|oldest|newest|most|least|best|fewest|other|else|"
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
_ARTICLE: Final = re.compile(r"\b(?:a|an|the|my|our|your|his|her|their)\b")
_OF_SEVERAL: Final = ("where", "status", "count", "last seen")  # kinds that ask for A and B, too
_TIMELESS: Final = ("changed", "last seen", "departed")  # kinds that the past has no answer to
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
    also: tuple[str, ...] = ()  # further things that the same is asked about
    at: str = ""  # the moment in words that is asked about; "" for now
    is_order: bool = False
    of_person: bool = False  # asks where the person is
    read_as: str = ""  # the text with its small words corrected

    @property
    def notes(self) -> list[str]:
        """Sentences on what the answer leaves out of the text, or corrects in it."""
        notes = [f"This is read as '{self.read_as}'"] if self.read_as else []
        notes += ["This answers questions and moves no robot"] * self.is_order
        notes += ["The map knows where the robot is, not where you are"] * self.of_person
        if self.qualities:
            named = " and ".join(self.qualities)
            notes.append(f"The map does not keep what is {named}, so this is about all of them")
        return notes


def parsed(text: str, known: Known = lambda name: False) -> Question | None:
    """The question in a text by the first pattern that matches; None if it is not understood.

    `known` tells whether a category, or a thing, has that name; such names keep all their words.
    """
    words, at = in_present(normalised(in_english(text[: MAX_LENGTH + 1])))
    if len(text) > MAX_LENGTH or not re.fullmatch(r"[\w '#:.,/-]*", words) or not text.strip():
        return None
    found, read_as = _match(words), ""
    if found is None and (again := respelt(words)) != words:
        present, then = in_present(again)
        if (found := _match(present)) is not None:
            read_as, at = again, at or then
    if found is None and 0 < len(_without(words, known)[0].split()) <= 3:
        found = "where", {"what": words}
    question = found and _question(*found, known)
    if question is None or (at and question.kind in _TIMELESS):
        return None
    return replace(question, at=at, read_as=read_as)


def _match(words: str) -> tuple[Kind, dict[str, str]] | None:
    """Kind and gaps of the first pattern that matches, or None."""
    for kind, pattern in PATTERNS:
        if match := pattern.fullmatch(words):
            return kind, match.groupdict("")
    return None


def _question(kind: Kind, gaps: dict[str, str], known: Known) -> Question | None:
    thing = gaps.get("what") or gaps.get("any") or gaps.get("sized") or ""
    parts = re.split(r",? and |, ", thing) if kind in _OF_SEVERAL and not known(thing) else [thing]
    names = [*parts, gaps.get("where", ""), gaps.get("other", "")]
    if any(_REFUSED.search(_needless(words)) for words in names):
        return None
    *things, (where, _), (other, more) = (_without(words, known) for words in names)
    what, *also = (name for name, _ in things)
    if kind in ("status", "near", "count") and any(_AMOUNT.search(f"{n} ") for n, _ in things):
        return None
    if any(_ARTICLE.search(name) and not known(name) for name in (what, *also, where, other)):
        return None
    if kind in ("near", "distance") and not other:
        other = "robot"
    what = f"something to {gaps['need']}" if gaps.get("need") else what
    what = _MEALS.get(what.partition("thing ")[2], what)
    return Question(
        kind,
        what,
        where,
        other,
        gaps.get("when", ""),
        gaps.get("event", ""),
        (*(quality for _, some in things for quality in some), *more),
        tuple(also),
        is_order=bool(gaps.get("order")),
        of_person=bool(gaps.get("person")),
    )


def _needless(words: str) -> str:
    """Without the words of a need, which are looked up as a whole."""
    return re.sub(r"^(?:some|any)(?:thing|where) (?:i|we|one) can\b", "something", words)


def _without(words: str, known: Known) -> tuple[str, tuple[str, ...]]:
    """A name without leading articles and qualities, and these qualities."""
    parts, qualities = words.split(), list[str]()
    while len(parts) > 1 and not known(" ".join(parts)):
        if parts[0] not in (_QUALITIES if qualities else _LEADING | _QUALITIES):
            break
        first = parts.pop(0)
        qualities += [first] if first in _QUALITIES else []
    return " ".join(parts), tuple(qualities)

"""German questions: the common forms, put into the English that the patterns read.

Names of things stay German, since words and rooms are known by German names, too.
"""

from __future__ import annotations

import re
from typing import Final

_A: Final = "(?:(?:der|die|das|dem|den|(?:ein|mein|unser|euer|dein)(?:e|en|em|er|es)?) )?"
_WHAT: Final = rf"{_A}(?P<what>.+?)"
_IN: Final = rf"(?:in|im) {_A}(?P<where>.+?)"
_IS: Final = "(?:ist|sind|liegt|liegen|steht|stehen|befindet sich|befinden sich|gibt es)"
_SO: Final = "(?: (?:jetzt|gerade|denn|noch|alles|hier|da))*"
_NEAR: Final = "(?:neben|bei|beim|nahe|in der n\u00e4he von)"
_ROOMS: Final = "(?:r\u00e4ume|raeume|zimmer|orte)"
_THINGS: Final = "(?:dinge|gegenst\u00e4nde|gegenstaende|objekte|sachen)"
_CHANGED: Final = "(?:ver|ge)(?:\u00e4|ae)ndert"
_SINCE: Final = "(?: seit (?P<when>gestern|heute))?"

#: a German form and its English one, in the order in which they are tried
_TABLE: Final = (
    (rf"wo bist du{_SO}", "where are you"),
    (rf"wo ist der roboter{_SO}", "where is the robot"),
    (r"hilfe|was kannst du|danke|vielen dank|guten (?:tag|morgen|abend)|", "help"),
    (
        r"wo ist (?:der|die|das) n\u00e4chste (?P<what>.+)",
        "where is the nearest {what}",
    ),
    (r"wo kann (?:ich|man) (?:mich )?(?:hin)?(?:sitzen|setzen)", "where can i sit"),
    (rf"wie (?:gro(?:\u00df|ss)|breit|lang|tief) {_IS} {_WHAT}", "how big is the {what}"),
    (rf"wie hoch {_IS} {_WHAT}", "how high is the {what}"),
    (
        rf"wie weit {_IS} {_WHAT} (?:von|vom) {_A}(?P<where>.+?)(?: entfernt| weg)?",
        "how far is the {what} from the {where}",
    ),
    (rf"{_IS} {_WHAT}(?: noch| jetzt)* (?:da|hier)", "is the {what} still there"),
    (rf"was {_IS}{_SO} unter {_WHAT}", "what is under {what}"),
    (
        rf"wo (?:ist|sind|liegt|liegen|steht|stehen|finde ich){_SO} {_WHAT} {_IN}",
        "where is {what} in {where}",
    ),
    (rf"wo (?:ist|sind|liegt|liegen|steht|stehen|finde ich){_SO} {_WHAT}{_SO}", "where is {what}"),
    (rf"wo (?:habe ich|hast du|haben wir) {_WHAT} (?:hin)?ge\w+", "where is {what}"),
    (rf"(?:such|suche|finde)(?: mir)?(?: bitte)? {_WHAT}", "find {what}"),
    (rf"was (?:fehlt|ist (?:weg|verschwunden)){_SO}", "what is missing"),
    (rf"was hat sich{_SINCE} {_CHANGED}", "what changed{when}"),
    (rf"was hat sich {_CHANGED}{_SINCE}", "what changed{when}"),
    (rf"was {_IS}{_SO} {_IN}", "what is in {where}"),
    (rf"was {_IS}{_SO} auf {_WHAT}", "what is on {what}"),
    (rf"was {_IS}{_SO} {_NEAR} {_WHAT}", "what is next to {what}"),
    (rf"(?:welche|wie viele) {_ROOMS} (?:gibt es|haben wir){_SO}", "which rooms are there"),
    (rf"welche {_THINGS} (?:gibt es|kennst du){_SO}", "list all objects"),
    (
        rf"wie viele (?P<what>.+?) (?:gibt es|sind|stehen|liegen|haben wir){_SO} {_IN}",
        "how many {what} are in {where}",
    ),
    (rf"wie viele (?P<what>.+?) hat {_A}(?P<where>.+?)", "how many {what} are in {where}"),
    (rf"wie viele (?P<what>.+?) (?:gibt es|sind (?:da|hier)|haben wir){_SO}", "how many {what}"),
    (
        rf"(?:gibt es|haben wir|ist|sind|liegt|liegen|steht|stehen){_SO} (?:in|im) {_A}"
        rf"(?P<where>\w+) {_WHAT}{_SO}",
        "is there a {what} in {where}",
    ),
    (rf"welche (?P<what>.+?) (?:gibt es|haben wir){_SO}", "which {what} are there"),
    (rf"(?:gibt es|haben wir){_SO} {_WHAT} {_IN}", "is there a {what} in {where}"),
    (rf"(?:gibt es|haben wir){_SO} {_WHAT}{_SO}", "is there a {what}"),
    (rf"(?:ist|sind|liegt|steht) {_WHAT}{_SO} {_IN}", "is the {what} in {where}"),
    (
        rf"wann (?:hast du|wurde) {_WHAT} (?:zuletzt|das letzte mal) gesehen",
        "when did you last see {what}",
    ),
)
_PATTERNS: Final = tuple((re.compile(german), english) for german, english in _TABLE)
_MOMENTS: Final = {"gestern": " since yesterday", "heute": " since today"}
#: words that change the sense of a question in a way that no query has
_REFUSED: Final = re.compile(
    r"\b(?:nicht|nichts|kein\w*|nie|ohne|au\u00dfer|mehr|weniger|als|und|oder|aber|wenn|zwei|drei|"
    r"vier|f\u00fcnf|sechs|sieben|acht|neun|zehn|zw\u00f6lf|zwanzig|einige|mehrere|genug|genau|"
    r"zweite\w*|dritte\w*|andere\w*|n\u00e4chste\w*|gr\u00f6\u00dfte\w*|kleinste\w*|hinter|unter|"
    r"\u00fcber|zwischen|links|rechts|wer|warum|wie)\b"
)


def in_english(text: str) -> str:
    """The English form of a German question; any other text as it is."""
    words = " ".join(text.casefold().split()).strip(" ?!.,;:'\"")
    words = re.sub(r"^(?:bitte|hallo|hey|und|also)\b[ ,]*|,? bitte$", "", words)
    words = re.sub(r"^wieviele?\b", "wie viele", words)
    for german, english in _PATTERNS:
        if match := german.fullmatch(words):
            gaps = match.groupdict("")
            if any(_REFUSED.search(gap) for gap in gaps.values()):
                return text
            gaps["when"] = _MOMENTS.get(gaps.get("when", ""), "")
            return english.format(**gaps)
    return text

"""Tables of words: senses of everyday nouns, and names of them in other languages.

`data/words.csv` has a row for each sense of WordNet 3.0 (or of ours) that a home may hold, with
its relation to categories of the shipped ontology. `data/names_de.csv` has German names. A user's
own names come from the CSV file that `HEREABOUTS_WORDS` names (docs/how-to/labels.md).
"""

from __future__ import annotations

import csv
import os
import unicodedata
from collections.abc import Callable, Hashable, Iterable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Final, Literal, cast

from kg.knowledge.ontology.catalogue import name_key
from kg.model.errors import OntologyError
from kg.model.regular_files import read_text
from kg.model.resources import table_rows

DATA: Final = Path(__file__).with_name("data")
#: Environment variable with the path of a CSV file of more names: `name,means`.
NAMES_VARIABLE: Final = "HEREABOUTS_WORDS"

_MIN_BARE: Final = 7  # letters of a name that is known without its umlauts; tur may be anything

#: A sense is one of its categories, a kind of one, perhaps a kind of one, several kinds that
#: include them, a part of one, or none of these.
Relation = Literal["same", "narrower", "may", "broader", "part", "none"]


@dataclass(frozen=True, slots=True)
class Sense:
    """A sense of one or more words."""

    synset: str  # WordNet 3.0's name, as cup.n.01; ".x." for one of ours
    relation: Relation
    categories: tuple[str, ...]  # labels in the shipped ontology; () for relation "none"
    words: tuple[str, ...]  # the usual one first
    gloss: str  # may be ""


@dataclass(frozen=True, slots=True)
class WordTable:
    """Senses by normalised word (`name_key`), and words that are names of others."""

    senses: Mapping[str, Sense]
    names: Mapping[str, str]  # a name in another language -> the word that it means
    words: Mapping[str, str]  # normalised -> as written, of both


def word_table() -> WordTable:
    """The shipped words and those of the user's file, read once in a process.

    Raises OntologyError if the user's file cannot be read.
    """
    return _table(os.environ.get(NAMES_VARIABLE) or None)


@lru_cache(maxsize=2)
def _table(own: str | None) -> WordTable:
    senses: dict[str, Sense] = {}
    others: dict[str, Sense] = {}
    words: dict[str, str] = {}
    for row in table_rows(DATA / "words.csv"):
        given = row["words"].split("|")
        plain = tuple(word.lstrip("~") for word in given)
        kinds = tuple(row["categories"].split("|")) if row["categories"] else ()
        relation = cast(Relation, row["relation"])
        sense = Sense(row["synset"], relation, kinds, plain, row["gloss"])
        for word, name in zip(given, plain, strict=True):
            words.setdefault(name_key(name), name)
            (others if word.startswith("~") else senses).setdefault(name_key(name), sense)
    names: dict[str, str] = {}
    for path in (*([Path(own)] if own else []), DATA / "names_de.csv"):
        for row in _names(path):
            names.setdefault(name_key(row["name"]), row["means"])
            words.setdefault(name_key(row["name"]), row["name"])
    for name in list(names):
        for typed in _typed_plainly(name):
            names.setdefault(typed, names[name])
    return WordTable(others | senses, names, words)


def _typed_plainly(key: str) -> set[str]:
    """Keys of a name as people type it without umlauts: kuehlschrank, and kuhlschrank if long."""
    if key.isascii():
        return set()
    written_out = key.translate({ord("ä"): "ae", ord("ö"): "oe", ord("ü"): "ue", ord("ß"): "ss"})
    parts = unicodedata.normalize("NFD", key)
    bare = "".join(part for part in parts if unicodedata.category(part) != "Mn")
    return {written_out, *([bare] if len(bare) >= _MIN_BARE else [])}


def _names(path: Path) -> Iterable[dict[str, str]]:
    try:
        text = read_text(path, "utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "it is no text in UTF-8"
        raise OntologyError(f"cannot read the names of {path}: {reason}") from error
    reader = csv.DictReader(text.splitlines())
    if reader.fieldnames != ["name", "means"]:
        raise OntologyError(f"{path} needs a first line name,means, then lines such as Tasse,cup")
    for row in reader:
        if not row["name"] or not row["means"]:
            raise OntologyError(f"{path}, line {reader.line_num}: expected name,means")
        yield row


_MIN_LENGTH: Final = 5  # letters of a word that is corrected; shorter ones are too alike
_LONG: Final = 9  # letters from which two errors are accepted
_DOUBLED: Final = 0.5  # cost of a letter written twice, or once instead of twice
_SUGGESTED: Final = 2.0  # largest distance of a suggestion


def corrected(key: str, known: Iterable[str], sense: Callable[[str], Hashable]) -> str | None:
    """The nearest of the known words, or None where none is near or senses compete.

    One error is accepted in words of 5 letters, two from 9 letters on. Two words at the same
    distance that differ in `sense` leave the word undecided: a spelling alone does not tell which
    of them a person means.
    """
    if len(key) < _MIN_LENGTH:
        return None
    limit = 2.0 if len(key) >= _LONG else 1.0
    near = _near(key, known, limit)
    if not near or len({sense(word) for distance, word in near if distance == near[0][0]}) > 1:
        return None
    return near[0][1]


def suggestions(key: str, known: Iterable[str]) -> list[str]:
    """Up to three known words of a similar spelling, the nearest first."""
    limit = min(_SUGGESTED, len(key) / 3)
    return [word for _, word in _near(key, known, limit)[:3]]


def _near(key: str, known: Iterable[str], limit: float) -> list[tuple[float, str]]:
    letters = set(key)
    found = []
    for word in known:
        if abs(len(word) - len(key)) > limit or len(letters.difference(word)) > limit:
            continue
        distance = _distance(key, word, limit)
        if distance <= limit:
            found.append((distance, word))
    return sorted(found)


def _distance(one: str, other: str, limit: float) -> float:
    """Edit distance with transpositions; a doubled letter costs half; above `limit` inexact."""
    before: list[float] = []
    last = [0.0]
    for j, letter in enumerate(other):
        last.append(last[j] + (_DOUBLED if j and other[j - 1] == letter else 1.0))
    for i, letter in enumerate(one):
        removal = _DOUBLED if i and one[i - 1] == letter else 1.0
        row = [last[0] + removal]
        for j, wanted in enumerate(other):
            insertion = _DOUBLED if j and other[j - 1] == wanted else 1.0
            cost = min(last[j] + (letter != wanted), last[j + 1] + removal, row[j] + insertion)
            if i and j and letter == other[j - 1] and one[i - 1] == wanted:
                cost = min(cost, before[j - 1] + _DOUBLED)
            row.append(cost)
        if min(row) > limit:
            return min(row)
        before, last = last, row
    return last[-1]

"""Score the resolver of words on four lists of everyday words (benchmarks/words.csv).

python -m benchmarks.words [--all]

The first list was written by hand before the table of words was read; the second has names of
things from the truth of data sets (Housekeep, HM3D), labelled by hand; two of its errors led to a
rule each (heads of broad words, errors in modifiers). The third was written after that, and the
fourth after a rule for errors in compounds; both were used for no decision. A line has the
categories that are right, joined by "|"; none for things outside every category, and an empty one
beside others where both answers are right. Typing errors are one random letter inside each name of
a category, swapped with the next, left out, put in or replaced.

right: a category that is right, or for a thing outside, none. wrong: only categories that are not
right. unknown: refused as no known word. The baseline has the ontology's names alone, and takes
its first suggestion of a similar spelling as its answer.
"""

from __future__ import annotations

import csv
import difflib
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from random import Random
from typing import Literal

from kg.knowledge.ontology.catalogue import Catalogue, shipped_ontology
from kg.knowledge.words.meaning import understand
from kg.knowledge.words.usual_places import usual_places
from kg.model.errors import UnknownCategoryError
from lab.command_line import parser_of

_TYPED = 5  # letters of a name that typing errors are tried on

LISTS = Path(__file__).with_suffix(".csv")

Verdict = Literal["right", "wrong", "unknown"]
#: labels of the categories of a name, or None for no known word
Resolver = Callable[[str], "set[str] | None"]


@dataclass(frozen=True, slots=True)
class Word:
    """A word of a list with the labels that are right."""

    of: str
    text: str
    right: frozenset[str]  # "" where no category is right, too

    @property
    def inside(self) -> bool:
        """Whether a category must be found."""
        return "" not in self.right

    def verdict(self, found: set[str] | None) -> Verdict:
        """Whether the found categories are right."""
        if found is None:
            return "unknown"
        if found & self.right or (not found and "" in self.right):
            return "right"
        return "wrong" if found else "unknown"


def words() -> Iterator[Word]:
    """The words of all lists."""
    with LISTS.open(encoding="utf-8", newline="") as file:
        for row in csv.DictReader(file):
            yield Word(row["list"], row["word"], frozenset(row["category"].split("|")))


def by_words(catalogue: Catalogue) -> Resolver:
    """The resolver of `find`."""

    def resolve(text: str) -> set[str] | None:
        try:
            return {one.label for one in understand(catalogue, text).categories}
        except UnknownCategoryError:
            return None

    return resolve


def by_names(catalogue: Catalogue) -> Resolver:
    """The baseline."""
    names = {
        n: c for c in catalogue.categories if c.kind == "object" for n in (c.label, *c.synonyms)
    }

    def resolve(text: str) -> set[str] | None:
        found = catalogue.get(text)
        if found is None:
            close = difflib.get_close_matches(text.lower(), list(names), n=1, cutoff=0.6)
            found = names[close[0]] if close else None
        return None if found is None else {found.label}

    return resolve


def typing_errors(catalogue: Catalogue, seed: int = 1) -> dict[str, Counter[Verdict]]:
    """Verdicts of the names of categories, each with one random error inside, by kind of error."""
    random, resolve = Random(seed), by_words(catalogue)
    names = {n for c in catalogue.categories if c.kind == "object" for n in (c.label, *c.synonyms)}
    counts: dict[str, Counter[Verdict]] = {}
    for error in ("swapped", "left out", "put in", "replaced"):
        counts[error] = Counter()
        for name in sorted(name for name in names if len(name) >= _TYPED and name.isascii()):
            at, letter = random.randrange(1, len(name) - 1), random.choice("etaoinshr")
            new, rest = {
                "swapped": (name[at + 1] + name[at], name[at + 2 :]),
                "left out": ("", name[at + 1 :]),
                "put in": (letter, name[at:]),
                "replaced": (letter, name[at + 1 :]),
            }[error]
            right = frozenset(resolve(name) or ())
            if (typed := name[:at] + new + rest) != name:
                found = resolve(typed)
                wrong = found is not None and found != right
                counts[error]["wrong" if wrong else Word("", typed, right).verdict(found)] += 1
    return counts


def main() -> None:
    """Print the counts, and with --all every word that is not right."""
    parser = parser_of("benchmarks.words", __doc__)
    parser.add_argument("--all", action="store_true", help="list the words that are not right")
    every = parser.parse_args().all
    catalogue = shipped_ontology().catalogue
    for name, resolve in (("names", by_names(catalogue)), ("words", by_words(catalogue))):
        counts: Counter[tuple[str, bool, Verdict]] = Counter()
        for word in words():
            found = resolve(word.text)
            verdict = word.verdict(found)
            counts[word.of, word.inside, verdict] += 1
            if every and name == "words" and verdict != "right":
                print(f"  {verdict}: {word.of} {word.text!r}: {found}, not {set(word.right)}")  # noqa: T201
        for of in ("first", "second", "third", "fourth"):
            for inside in (True, False):
                parts = ", ".join(
                    f"{verdict} {counts[of, inside, verdict]}"
                    for verdict in ("right", "wrong", "unknown")
                )
                where = "inside" if inside else "outside"
                print(f"{name}, {of} list, {where}: {parts}")  # noqa: T201
    for error, counted in typing_errors(catalogue).items():
        told = ", ".join(
            f"{verdict} {counted[verdict]}" for verdict in ("right", "wrong", "unknown")
        )
        print(f"typing errors, {error}: {told}")  # noqa: T201
    outside = [word for word in words() if not word.inside]
    placed = 0
    for word in outside:
        try:
            placed += usual_places(understand(catalogue, word.text).synset) is not None
        except UnknownCategoryError:
            continue
    print(f"usual places are known of {placed} of {len(outside)} things outside")  # noqa: T201


if __name__ == "__main__":
    main()

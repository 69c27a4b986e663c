"""Make the word tables of the package from their source tables.

python bundles/words/make.py SOURCE    SOURCE has words.csv, places.csv and support.csv

`trim.txt` says which words and senses are left out; `ours.csv` corrects or adds some. Both were
written by hand. The output is kg/knowledge/words/data/words.csv, places.csv and supports.csv.
"""

from __future__ import annotations

import csv
import re
import sys
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

HERE = Path(__file__).parent
DATA = HERE.parents[1] / "kg" / "knowledge" / "words" / "data"
SENSE = re.compile(r".+\.[a-z]\.\d+")
#: supports of shops and of untidy starts, where nobody looks for a thing of a home
NOT_AT_HOME = {
    *("checkout.n.03", "grocery_shelf.n.01", "carton.n.02", "packing_box.n.02", "sack.n.01"),
    *("shopping_cart.n.01", "shopping_basket.n.01", "driveway.n.01", "lawn.n.01", "bag.n.06"),
    *("floor.n.01", "car.n.01", "pickup.n.01", "carryall.n.01", "plate.n.04", "bowl.n.01"),
}
#: everyday names of supports
PLAIN = {
    "ashcan": "trash can",
    "washer": "washing machine",
    "electric refrigerator": "refrigerator",
    "wicker basket": "basket",
    "sofa": "couch",
    "chopping board": "cutting board",
    "wall nail": "hook",
    "clothes dryer": "dryer",
    "breakfast table": "table",
}
#: tables that a detector may well not call a dining table
MAY_BE = {"dining table": re.compile(r"breakfast|dining|dinner|kitchen|refectory|trestle|pedestal")}
LOOSE = {"stool", "bar stool", "freezer", "brochure", "pamphlet", "booklet", "catalog", "album"}


def main() -> None:
    """Write the three tables."""
    source = Path(sys.argv[1])
    words = kept_words(rows(source / "words.csv"))
    write("words.csv", ("synset", "relation", "categories", "words", "gloss"), words)
    synsets = {row[0] for row in words}
    write("places.csv", ("synset", "source", "place", "with"), places(source, synsets))
    write("supports.csv", ("synset", "relation", "support", "count"), supports(source, synsets))


def rows(path: Path) -> list[dict[str, str]]:
    """The rows of a table, without comments."""
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def kept_words(given: Sequence[dict[str, str]]) -> list[tuple[str, ...]]:
    """A row for each sense that is left: synset, relation, categories, words, gloss.

    A word whose sense is not its usual one in a home has "~" before it.
    """
    trimmed = {
        line
        for line in (HERE / "trim.txt").read_text(encoding="utf-8").splitlines()
        if line and not line.startswith("#")
    }
    ours = rows(HERE / "ours.csv")
    own = {row["word"] for row in ours}
    senses: dict[str, dict[str, str]] = {}
    words: dict[str, list[str]] = defaultdict(list)
    for row in ours:
        senses.setdefault(row["synset"], row)
        words[row["synset"]].append(row["word"])
    for row in given:
        if row["lemma"] in trimmed or row["synset"] in trimmed:
            continue
        if row["synset"] not in senses or "gloss" not in senses[row["synset"]]:
            senses[row["synset"]] = row | senses.get(row["synset"], {})
        rank = "" if row["sense_rank"] == "1" and row["lemma"] not in own else "~"
        if rank + row["lemma"] not in words[row["synset"]] and not (
            row["lemma"] in own and row["lemma"] in words[row["synset"]]
        ):
            words[row["synset"]].append(rank + row["lemma"])
    common = {row["lemma"] for row in given if row["source"] == "ours"} | own
    return sorted(
        (
            synset,
            relation(row, words[synset]),
            row["category"],
            "|".join(ordered(words[synset], synset, common)),
            gloss(row),
        )
        for synset, row in senses.items()
    )


def ordered(words: Sequence[str], synset: str, common: set[str]) -> list[str]:
    """The words of a sense, the usual one first: a common one, the one that names the sense."""
    name = synset.split(".")[0].replace("_", " ")
    return sorted(words, key=lambda word: (word[:1] == "~", word not in common, word != name))


def relation(row: dict[str, str], words: Sequence[str]) -> str:
    """The relation of a sense to its categories; "may" where a detector may well differ."""
    given = row["relation"]
    strict = MAY_BE.get(row["category"])
    if given == "narrower" and strict and not any(strict.search(word) for word in words):
        return "may"
    return "may" if given == "narrower" and LOOSE.intersection(words) else given


def gloss(row: dict[str, str]) -> str:
    """The gloss in at most 60 characters, cut after a word."""
    text = row.get("gloss", "").rstrip(".").strip()
    return text if len(text) <= 60 else text[:57].rpartition(" ")[0] + "..."


def places(source: Path, synsets: set[str]) -> Iterator[tuple[str, ...]]:
    """Counts above zero of the words that are left, and the totals of every place ("*")."""
    short = {"BEHAVIOR-1K homes": "homes"}
    totals: dict[tuple[str, str, str], int] = Counter()
    for row in rows(source / "places.csv"):
        if row["object"] == "*" or row["object"] in synsets:
            kind = short.get(row["source"], "activities")
            if row["object"] == "*" and row["source"].endswith("goal"):
                continue  # the same activities
            totals[row["object"], kind, row["place"]] += int(row["with"])
    for (synset, kind, place), count in sorted(totals.items()):
        if count:
            yield synset, kind, place, str(count)


def supports(source: Path, synsets: set[str]) -> Iterator[tuple[str, ...]]:
    """Counts of what a thing stands on or in, without shops and untidy starts."""
    counts: Counter[tuple[str, str, str]] = Counter()
    for row in rows(source / "support.csv"):
        relation = {"ontop": "on", "inside": "in", "attached": "on"}.get(row["relation"])
        if relation and row["object"] in synsets and row["support"] not in NOT_AT_HOME:
            support = row["support"].split(".")[0].replace("_", " ")
            counts[row["object"], relation, PLAIN.get(support, support)] += int(row["count"])
    for (synset, how, support), count in sorted(counts.items()):
        yield synset, how, support, str(count)


def write(name: str, header: Sequence[str], table: Iterable[Sequence[str]]) -> None:
    """Write one table."""
    with (DATA / name).open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(header)
        writer.writerows(table)


if __name__ == "__main__":
    main()

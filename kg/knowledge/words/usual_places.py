"""Usual places of things that no category includes, and what such things stand on or lie in.

Three sources, the first that knows the word well: rooms of homes that hold one
(`data/places.csv`, source "homes"), rooms of everyday activities with one (source "activities"),
and places that we state without counts (`data/stated_places.csv`). Activities come before homes
where they count much more of the thing. A place that is named was counted twice or more, and is a
room of a home. Where nothing is left and nothing is stated, few counts are better than none. Both
counts are of BEHAVIOR-1K (bddl 3.6.0, MIT).
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Final, Literal

from kg.knowledge.ontology.catalogue import name_key
from kg.knowledge.placement.belief_model import FITTED
from kg.knowledge.words.tables import DATA, word_table
from kg.model.resources import table_rows

Source = Literal["homes", "activities", "stated"]

_MIN_PROBABILITY: Final = 0.1  # of a place that an answer names
_FEW: Final = int(FITTED.kappa)  # counts below which a stated place is preferred
_MIN_COUNT: Final = 2  # count of a place that is named, unless there are few counts
_MIN_COUNT_OUTSIDE: Final = 3  # count of a place outside of homes that is named
_MUCH_MORE: Final = 2  # times as many counts of activities as of homes, which then come later
#: Places that are named only where no room of a home is.
_NOT_INSIDE: Final = frozenset(("yard", "supermarket", "classroom", "conference room", "bar"))
_PLACES: Final = 3  # named at most
_SUPPORTS: Final = 2
_MIN_SUPPORT: Final = 3  # count of a support that is named


@dataclass(frozen=True, slots=True)
class UsualPlace:
    """A kind of place where a thing usually is.

    From homes, `probability` is that such a room holds one (`count` of `total` rooms did); from
    activities, that the thing is in such a room (`count` of `total` activities with it). Both are
    smoothed. None, with counts of 0, where nothing was counted.
    """

    label: str  # of a category of places of the shipped ontology
    probability: float | None
    count: int
    total: int


@dataclass(frozen=True, slots=True)
class UsualPlaces:
    """Usual places of a thing, the most probable first, and its supports as ``on a table``."""

    source: Source
    places: tuple[UsualPlace, ...]
    supports: tuple[str, ...]


def usual_places(synset: str) -> UsualPlaces | None:
    """Usual places of things of a sense (`kg.knowledge.words.meaning`); None if not known."""
    for one in filter(None, (synset, _alike().get(synset))):
        labels, stated = _stated().get(one, ((), ()))
        supports = stated or _supports().get(one, ())
        for source, least in _preference(one):
            places = tuple(UsualPlace(label, None, 0, 0) for label in labels)
            if source != "stated":
                places = _counted(one, source, least)
            if places:
                return UsualPlaces(source, places, supports)
    return None


def _preference(synset: str) -> Iterator[tuple[Source, int]]:
    """Sources in the order in which they are asked, with the counts that they need."""
    homes, activities = (
        sum(_counts()[source].get(synset, {}).values()) for source in ("homes", "activities")
    )
    counted: tuple[Source, ...] = ("homes", "activities")
    if activities > _MUCH_MORE * homes:
        counted = ("activities", "homes")
    yield from ((source, _FEW) for source in counted)
    yield "stated", 0
    yield from ((source, 1) for source in counted)


def _counted(synset: str, source: Source, least: int) -> tuple[UsualPlace, ...]:
    """Places by counts, if there are `least`; none otherwise.

    Where there are not few, only rooms of homes that were counted `_MIN_COUNT` times or more; else
    any room, or a place outside of homes with `_MIN_COUNT_OUTSIDE`. Smoothed as if `FITTED.kappa`
    more rooms or activities had the rate of all.
    """
    totals, counts = _counts()[source]["*"], _counts()[source].get(synset, {})
    found, everywhere, kappa = sum(counts.values()), sum(totals.values()), FITTED.kappa
    if found < least:
        return ()
    places = []
    for label, count in counts.items():
        if label in _NOT_INSIDE:
            enough = least == 1 and count >= _MIN_COUNT_OUTSIDE
        else:
            enough = least == 1 or count >= _MIN_COUNT
        if not enough:
            continue
        if source == "homes":
            total, rate = totals[label], found / everywhere
        else:
            total, rate = found, totals[label] / everywhere
        probability = (count + kappa * rate) / (total + kappa)
        places.append(UsualPlace(label, round(probability, 3), count, total))
    places = [one for one in places if (one.probability or 0) >= _MIN_PROBABILITY]
    places = [one for one in places if one.label not in _NOT_INSIDE] or places
    return tuple(sorted(places, key=lambda one: (-(one.probability or 0), one.label))[:_PLACES])


@lru_cache(maxsize=1)
def _counts() -> Mapping[str, Mapping[str, Mapping[str, int]]]:
    """Counts by source, synset ("*": all rooms or activities) and place."""
    counts: dict[str, dict[str, dict[str, int]]] = {"homes": {}, "activities": {}}
    for row in table_rows(DATA / "places.csv"):
        by_place = counts[row["source"]].setdefault(row["synset"], {})
        by_place[row["place"]] = int(row["with"])
    return counts


@lru_cache(maxsize=1)
def _supports() -> Mapping[str, tuple[str, ...]]:
    """The most counted supports by synset."""
    counted: dict[str, list[tuple[int, str]]] = defaultdict(list)
    for row in table_rows(DATA / "supports.csv"):
        if int(row["count"]) < _MIN_SUPPORT:
            continue
        article = "an" if row["support"][0] in "aeiou" else "a"
        phrase = f"{row['relation']} {article} {row['support']}"
        counted[row["synset"]].append((-int(row["count"]), phrase))
    return {s: tuple(text for _, text in sorted(all_)[:_SUPPORTS]) for s, all_ in counted.items()}


@lru_cache(maxsize=1)
def _stated() -> Mapping[str, tuple[tuple[str, ...], tuple[str, ...]]]:
    """Stated places and supports by synset."""
    rows = [row for row in table_rows(DATA / "stated_places.csv") if not row["like"]]
    return {
        _synset(row["word"]): (
            tuple(row["places"].split("|")),
            tuple(filter(None, row["supports"].split("|"))),
        )
        for row in reversed(rows)
    }


@lru_cache(maxsize=1)
def _alike() -> Mapping[str, str]:
    """Synset -> another whose things are in the same places."""
    rows = [row for row in table_rows(DATA / "stated_places.csv") if row["like"]]
    return {_synset(row["word"]): _synset(row["like"]) for row in rows}


def _synset(word: str) -> str:
    sense = word_table().senses.get(name_key(word))
    return "" if sense is None else sense.synset

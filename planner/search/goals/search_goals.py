"""Search goals: where to search for a category, by `queries/goals-*.rq` from the graph alone.

There are three kinds (thesis section 3.4): objects of the category; objects of categories that the
ontology relates to it as near; and explored places of categories where it, or something near it,
is located.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from kg.history.timestamps import spoken
from kg.knowledge.ontology.catalogue import Catalogue, Category
from kg.maps.query.evaluation import Value
from kg.maps.semantic_map import SemanticMap
from kg.model.errors import UnknownCategoryError
from kg.model.place_names import indefinite
from kg.model.shares import chance, percent
from planner.freespace.planning_map import Row, number, time_or_none
from planner.search.goals.place_names import in_words
from planner.search.goals.target_words import meaning_of


@dataclass(frozen=True, slots=True, eq=False)
class Goal:
    """An object or place to search at."""

    iri: str  # of the object or place to go to
    kind: Literal["known", "nearby", "place"]
    label: str
    p_map: NDArray[np.float64]  # (2,) [m] in the map frame; of a place its centre
    probability: float  # to find the target there; not calibrated
    why: str  # one sentence: the facts that make it a goal


def resolve_target(catalogue: Catalogue, target: str) -> Category:
    """The category that `target` names: by label, synonym, word or IRI; objects, supercategories.

    Raises UndetectableError for a thing that no category includes, and UnknownCategoryError for a
    word of several categories, for places, and for anything else; the message names what exists.
    """
    meaning = meaning_of(catalogue, target)
    found = [one for one in meaning.categories if not one.undetected] or meaning.categories
    if len(found) > 1:
        raise UnknownCategoryError(f"{meaning.note}; ask for one of them")
    return found[0]


def derive_goals(semantic_map: SemanticMap, target: str) -> tuple[Goal, ...]:
    """All goals for `target` (label, synonym or IRI), the most probable first, one for each IRI.

    A supercategory searches for all its members at once; each goal's `why` names the member. Where
    several reasons lead to the same object or place, the most probable one is kept. Goals with
    probability 0 are left out. Without goals, `explain_none` gives the reason. A place counts for
    its most believed category, as in the thesis. Raises UnknownCategoryError.
    """
    category = resolve_target(semantic_map.catalogue, target).iri

    def rows(kind: str) -> list[Row]:
        return list(semantic_map.query(f"goals-{kind}", category=category).records())

    goals = [
        *_goals("known", _why_known, rows("known")),
        *_goals("nearby", _why_nearby, rows("nearby")),
        *_place_goals(rows("places")),
    ]
    best: dict[str, Goal] = {}
    for goal in sorted(goals, key=lambda goal: (-goal.probability, goal.iri)):
        if goal.probability > 0:
            best.setdefault(goal.iri, goal)
    return tuple(best.values())


def explain_none(semantic_map: SemanticMap, target: str) -> str:
    """Reason in one sentence why the map and the ontology give no goal for `target`."""
    category = resolve_target(semantic_map.catalogue, target)
    relations = semantic_map.query("goals-relations", category=category.iri).records()
    where = _names(row["target"] for row in relations if row["relation"] == "located at")
    near = _names(row["target"] for row in relations if row["relation"] == "near")
    reason = f"nowhere to search for {category.label}: the map knows none"
    if not where and not near:
        return f"{reason}, and no ontology says where it is found or what it is found near"
    if near:
        reason += f", knows nothing it is found near ({near})"
    places = semantic_map.places()
    explored = sum(place.views > 0 for place in places)
    known = f"{explored} of its {len(places)} places are explored"
    return f"{reason}, and holds no place to search" + (f" ({where}; {known})" if where else "")


def _names(labels: Iterable[Value]) -> str:
    return ", ".join(sorted({str(label) for label in labels}))


def _goals(
    kind: Literal["known", "nearby", "place"], why: Callable[[Row], str], rows: Iterable[Row]
) -> Iterable[Goal]:
    for row in rows:
        yield Goal(
            iri=str(row["iri"]),
            kind=kind,
            label=label_of(row),
            p_map=np.array([row["x"], row["y"]], dtype=np.float64),
            probability=number(row, "probability"),
            why=why(row),
        )


def _place_goals(rows: list[Row]) -> Iterable[Goal]:
    wanted: dict[Value, set[str]] = {}
    for row in rows:
        wanted.setdefault(row["iri"], set()).add(str(row["wanted"]))

    def why(row: Row) -> str:
        others = sorted(wanted[row["iri"]] - {str(row["wanted"])})
        return _why_place(row) + (f"; also for {', '.join(others)}" if others else "")

    return _goals("place", why, rows)


def _why_known(row: Row) -> str:
    return f"{label_of(row)} is in the map ({evidence(row, number(row, 'probability'))})"


def _why_nearby(row: Row) -> str:
    return (
        f"{label_of(row)} is in the map ({evidence(row, number(row, 'existence'))}), "
        f"and {row['wanted']} is found near {row['category']} {sourced(row, 'relationProbability')}"
    )


def _why_place(row: Row) -> str:
    label = row["near"] or row["wanted"]
    reason = (
        f"this is {with_article(str(row['category']))} (belief {number(row, 'belief'):.2f}), where "
        f"{label} is found {sourced(row, 'relationProbability')}"
    )
    if row["near"] is None:
        return reason
    return (
        f"{reason}, and {row['wanted']} is found near {label} ({number(row, 'nearProbability'):g})"
    )


def with_article(noun: str, catalogue: Catalogue | None = None) -> str:
    """A noun with its article: ``an apple``; a name that a person gave stays as it is.

    Names are known to `catalogue`.
    """
    if catalogue is not None and catalogue.is_given_name(noun):
        return noun
    return indefinite(noun)


def label_of(row: Row) -> str:
    """Label of the object of a row, else its category."""
    return str(row["label"] or row["category"])


def sourced(row: Row, column: str) -> str:
    """A probability of a row and its source, in parentheses."""
    source = f", {row['source']}" if row["source"] else ""
    return f"({percent(number(row, column))}{source})"


def evidence(row: Row, existence: float, place: str = "place") -> str:
    """How surely a row's object exists, and its observations as `observed` has them."""
    return f"{chance(existence)} sure{observed(row, place)}"


def observed(row: Row, place: str = "place") -> str:
    """Number, time, frame and place (column `place`) of the observations of a row's object."""
    reason = ""
    if row.get("observations") is not None:
        detected = f" as {row['detectedAs']}" if row.get("detectedAs") else ""
        reason = f", seen {times(number(row, 'observations'))}{detected}"
    if (last := time_or_none(row, "lastSeen")) is not None:
        reason += f", last seen {spoken(last.timestamp())}"
    if row["frame"] is not None:
        reason += f", best in {row['frame']}"
    return reason + (f", in {row[place]}" if row[place] is not None else "")


def times(count: float) -> str:
    """A count in words: once, twice, 3 times."""
    return {1: "once", 2: "twice"}.get(round(count), f"{count:.0f} times")


_PLURALS: Final = {
    "person": "people",
    "man": "men",
    "woman": "women",
    "child": "children",
    "knife": "knives",
    "shelf": "shelves",
    "mouse": "mice",
    "tooth": "teeth",
    "foot": "feet",
    **{one: one for one in ("sheep", "scissors", "skis", "glasses", "trousers", "furniture")},
}


def plural(noun: str) -> str:
    """Several of a noun: ``benches``, ``teddy bears``, ``things to sit on``."""
    head, to, use = noun.partition(" to ")
    if to:
        several = "things" if head.endswith(("thing", "things")) else plural(head)
        return f"{several} to {use}"
    first, _, last = noun.rpartition(" ")
    if last not in _PLURALS:
        if last.endswith("y") and last[-2:-1] not in "aeiou":
            several = f"{last[:-1]}ies"
        else:
            several = last + ("es" if last.endswith(("ss", "us", "x", "z", "ch", "sh")) else "s")
            several = last if re.search("[^su]s$", last) else several  # it names several already
    else:
        several = _PLURALS[last]
    return f"{first} {several}".strip()


_MAX_NAMED: Final = 3  # objects named: an apple in a bowl on a table


def whereabouts(
    semantic_map: SemanticMap, iri: str, spoken: Mapping[str, str] | None = None
) -> str:
    """Relations and place of an object: ``inside bowl 4 on dining table 3 in the kitchen``.

    An object beside it is named where nothing carries it. Its position [m] is given where it has
    neither a relation nor a place. "" for an IRI that is no object of the map. `spoken` has what
    sentences call places (by IRI), by default their labels.
    """
    words, place, at, current = list[str](), "", "", iri
    named = set[str]()
    while len(named) < _MAX_NAMED and current not in named:
        named.add(current)
        rows = semantic_map.query("whereabouts", object=current).records()
        if not rows:
            break
        if current == iri:
            place = in_words(semantic_map.catalogue, str(rows[0]["placeLabel"] or ""))
            place = (spoken or {}).get(str(rows[0]["place"]), place)
            at = f"at ({rows[0]['x']:.1f}, {rows[0]['y']:.1f}) m"
        carriers = [row for row in rows if row["relation"] in ("inside", "on")]
        beside = [row for row in rows if row["relation"] == "beside"] if not words else []
        nearest = (carriers or beside)[:1]
        words += [f"{row['relation']} {row['otherLabel'] or row['other']}" for row in nearest]
        if not carriers:
            break
        current = str(carriers[0]["other"])
    if place:
        words.append(f"in {place}")
    return " ".join(words) or at

"""Search goals: where to look for something, derived by `queries/goals-*.rq` from the graph alone.

There are three kinds (thesis section 3.4): objects of the category in the map, known objects that
the ontology says are near it, and explored places where the ontology puts it or something near it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from datetime import datetime
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from kg.knowledge.ontology.catalogue import Catalogue, Category
from kg.maps.query.evaluation import Value
from kg.maps.semantic_map import SemanticMap
from kg.model.errors import UnknownCategoryError, did_you_mean

Row = Mapping[str, Value]


@dataclass(frozen=True, slots=True, eq=False)
class Goal:
    """Somewhere to look."""

    iri: str  # of the object or place to go to
    kind: Literal["known", "nearby", "place"]
    label: str
    p_map: NDArray[np.float64]  # (2,) [m] in the map frame; of a place its centre
    probability: float  # that what is searched for is found there; not calibrated
    why: str  # one sentence: the facts that make it a goal


def resolve_target(catalogue: Catalogue, target: str) -> Category:
    """The category that `target` names: by label, synonym or IRI; objects and supercategories.

    Raises UnknownCategoryError for anything else, places included; the message names what exists.
    """
    category = catalogue.get(target)
    if category is None:
        raise UnknownCategoryError(_not_a_category(catalogue, target))
    if category.kind == "place":
        other = catalogue.get(target, "object")
        if other is None:
            raise UnknownCategoryError(
                f"'{category.label}' is a kind of place, not something to search for; "
                f"search for an object such as banana, or one of {_supercategories(catalogue)}"
            )
        return other
    return category


def _supercategories(catalogue: Catalogue) -> str:
    return ", ".join(sorted(c.label for c in catalogue.categories if c.kind == "supercategory"))


def _not_a_category(catalogue: Catalogue, target: str) -> str:
    objects = [c for c in catalogue.categories if c.kind != "place"]
    spellings = [name for c in objects for name in (c.label, *c.synonyms)]
    count = sum(c.kind == "object" for c in objects)
    return (
        f"no category '{target}'{did_you_mean(target, spellings) or ';'} there are {count} kinds "
        f"of object, and {_supercategories(catalogue)} for several of them at once"
    )


def derive_goals(
    semantic_map: SemanticMap,
    target: str,
    *,
    min_belief: float = 0.0,
    any_category: bool = False,
) -> tuple[Goal, ...]:
    """All goals for `target` (label, synonym or IRI), the most probable first, one for each IRI.

    A supercategory searches all its members at once; each goal's `why` names which ones. Where
    several reasons lead to the same object or place, the most probable one is kept; what has no
    probability at all is no goal. Empty without any candidate: `explain_none` gives the reason.

    `min_belief` and `any_category` widen or narrow which places count: the text uses the most
    believed category whatever its belief (the defaults), the author's own finder every category
    believed to at least 0.25. Raises UnknownCategoryError.
    """
    category = resolve_target(semantic_map.catalogue, target).iri
    ask = semantic_map.query
    places = ask(
        "goals-places", category=category, minBelief=min_belief, anyCategory=int(any_category)
    )
    return _strongest(
        [
            *_goals("known", _why_known, ask("goals-known", category=category).records()),
            *_goals("nearby", _why_nearby, ask("goals-nearby", category=category).records()),
            *_place_goals(places.records()),
        ]
    )


def explain_none(semantic_map: SemanticMap, target: str) -> str:
    """One sentence for when there is no goal: what the map and the ontology know about `target`."""
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


def _strongest(goals: Iterable[Goal]) -> tuple[Goal, ...]:
    best: dict[str, Goal] = {}
    for goal in goals:
        rival = best.get(goal.iri)
        if goal.probability > (rival.probability if rival else 0.0):
            best[goal.iri] = goal
    return tuple(sorted(best.values(), key=lambda goal: (-goal.probability, goal.iri)))


def _goals(
    kind: Literal["known", "nearby", "place"], why: Callable[[Row], str], rows: Iterable[Row]
) -> Iterable[Goal]:
    for row in rows:
        yield Goal(
            iri=str(row["iri"]),
            kind=kind,
            label=_label(row),
            p_map=np.array([row["x"], row["y"]], dtype=np.float64),
            probability=_number(row, "probability"),
            why=why(row),
        )


def _place_goals(rows: Iterable[Row]) -> Iterable[Goal]:
    wanted: dict[Value, set[str]] = {}
    rows = list(rows)
    for row in rows:
        wanted.setdefault(row["iri"], set()).add(str(row["wanted"]))

    def why(row: Row) -> str:
        others = sorted(wanted[row["iri"]] - {str(row["wanted"])})
        return _why_place(row) + (f"; also for {', '.join(others)}" if others else "")

    return _goals("place", why, rows)


def _why_known(row: Row) -> str:
    return f"{_label(row)} is in the map (existence {_number(row, 'probability'):.2f}{seen(row)})"


def _why_nearby(row: Row) -> str:
    relation = _relation(row, "relationProbability")
    return (
        f"{_label(row)} is in the map (existence {_number(row, 'existence'):.2f}{seen(row)}), "
        f"and {row['wanted']} is found near {row['category']} {relation}"
    )


def _why_place(row: Row) -> str:
    what = row["near"] or row["wanted"]
    reason = (
        f"{row['category']} (belief {_number(row, 'belief'):.2f}) is where to look for {what} "
        f"{_relation(row, 'relationProbability')}"
    )
    if row["near"] is None:
        return reason
    return (
        f"{reason}, and {row['wanted']} is found near {what} ({_number(row, 'nearProbability'):g})"
    )


def _label(row: Row) -> str:
    return str(row["label"] or row["category"])


def _relation(row: Row, column: str) -> str:
    source = f", {row['source']}" if row["source"] else ""
    return f"({_number(row, column):g}{source})"


def seen(row: Row, place: str = "place") -> str:
    """Number, time, frame and place (column `place`) of the observations of a row's object."""
    reason = ""
    if row.get("observations") is not None:
        reason = f", seen {times(_number(row, 'observations'))}"
    if isinstance(row["lastSeen"], datetime):
        reason += f", last {row['lastSeen']:%Y-%m-%d %H:%M:%S}"
    if row["frame"] is not None:
        reason += f", best in {row['frame']}"
    return reason + (f", in {row[place]}" if row[place] is not None else "")


def times(count: float) -> str:
    """A count in words: once, 2 times."""
    return "once" if count == 1 else f"{count:.0f} times"


def _number(row: Row, column: str) -> float:
    value = row[column]
    if not isinstance(value, int | float):
        raise TypeError(f"column {column} must be a number, got {value!r}")
    return float(value)


_MAX_NAMED: Final = 3  # objects named: an apple in a bowl on a table


def whereabouts(semantic_map: SemanticMap, iri: str) -> str:
    """As in ``inside bowl 4 on dining table 3 in the kitchen``.

    What it is beside is named where it is on and inside nothing, its position [m] where it is in no
    place either. "" for what is no object of the map.
    """
    words, place, at, following = list[str](), "", "", iri
    named = set[str]()
    while len(named) < _MAX_NAMED and following not in named:
        named.add(following)
        rows = semantic_map.query("whereabouts", object=following).records()
        if not rows:
            break
        if following == iri:
            place = str(rows[0]["placeLabel"] or "")
            at = f"at ({rows[0]['x']:.1f}, {rows[0]['y']:.1f}) m"
        carriers = [row for row in rows if row["relation"] in ("inside", "on")]
        beside = [row for row in rows if row["relation"] == "beside"] if not words else []
        nearest = (carriers or beside)[:1]
        words += [f"{row['relation']} {row['otherLabel'] or row['other']}" for row in nearest]
        if not carriers:
            break
        following = str(carriers[0]["other"])
    if place:
        words.append(f"in {place}" if _is_name(place) else f"in the {place}")
    return " ".join(words) or at


def _is_name(place: str) -> bool:
    """Whether a place's label takes no article: ``place 3``, ``Ann's room``."""
    return place[-1:].isdigit() or place[:1].isupper() or "'" in place

"""Where an object is, in words: on or inside what, and in which place, as the graph has it."""

from __future__ import annotations

from typing import Final

from kg.maps.semantic_map import SemanticMap

_LONGEST: Final = 3  # objects named: an apple in a bowl on a table


def whereabouts(semantic_map: SemanticMap, iri: str) -> str:
    """As in ``inside bowl 4 on dining table 3 in the kitchen``.

    What it is beside is named where it is on and inside nothing, its position [m] where it is in no
    place either. "" for what is no object of the map.
    """
    words, place, at, following = list[str](), "", "", iri
    named = set[str]()
    while len(named) < _LONGEST and following not in named:
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

"""Questions that a map can answer, for help and refusals."""

from __future__ import annotations

from collections import Counter

from kg.maps.semantic_map import SemanticMap
from kg.model.place_names import plain_place
from planner.search.goals.search_goals import with_article


def example_questions(semantic_map: SemanticMap) -> list[str]:
    """Questions about the surest thing of a map, another one in its place, and the map itself."""
    things, asked = semantic_map.query("objects").records(), list[str]()
    if things:
        kind, place = str(things[0]["category"]), things[0]["place"]
        beside = [str(row["category"]) for row in things if row["place"] == place]
        other = next((one for one in beside if one != kind), kind)
        asked = [f"where is the {kind}?", f"what is next to the {kind}?", f"how big is the {kind}?"]
        asked += [f"when did you last see the {other}?", f"how many {kind}s are there?"]
        if room := _room(semantic_map, place):
            asked += [f"what is in {room}?", f"is there {with_article(other)} in {room}?"]
    if semantic_map.places():
        asked += ["which rooms are there?", "which room is the largest?"]
    asked += ["where are you?"] if semantic_map.query("robot").records() else []
    return [*asked, "what changed since yesterday?", "list all objects"]


def _room(semantic_map: SemanticMap, label: object) -> str:
    """``the kitchen`` for the only place that is believed to be one, else the place's label."""
    rows = semantic_map.query("places").records()
    kinds = Counter(row["category"] for row in rows)
    for row in rows:
        if row["label"] == label:
            alone = row["category"] and kinds[row["category"]] == 1
            return f"the {plain_place(str(row['category']))}" if alone else str(label)
    return ""

"""Rules by which the reference mapper derives facts, a sentence for each predicate.

Equations and sections are those of the thesis the reference mapper follows; its numbers are in
`mapping.reference.settings`.
"""

from __future__ import annotations

from typing import Final

from kg.model import vocabulary as v

_POSITION: Final = (
    "mean over all sightings of the position in the map; each is the fullest bin of the "
    "depths within the box, taken through the camera's pose (section 3.3.1)"
)
_EXTENT: Final = "the box of the points that its latest sightings showed, outliers apart"
_RELATION: Final = (
    "computed from the boxes of both objects and their uncertainty, as the more probable of what "
    "is mapped nearby (docs/explanation/relations.md)"
)
_LABELS: Final = (
    "computed as the existence, for every other category that the thing was ever detected as; the "
    "three most probable ones from 0.05 on"
)
_RECTANGLE: Final = "the extent given by the layout, or of all points seen in the recording"

_BELIEF: Final = "mean over all views of the scene model's probability of the category (eq. 3.5)"
_CAMERA: Final = "the camera's pose in the latest frame"

_FLOOR: Final = "the mapped floor, split into rooms at its doors (docs/explanation/mapping.md)"
REMOVAL: Final = (
    "an object leaves the map when too many frames should have shown it and did not: its existence "
    "is below 0.02, or three distinct views went through its volume; in reference mode when its "
    "confidence is no longer positive (eq. 3.4)"
)
RULES: Final[dict[str, str]] = {
    v.RDF_TYPE.value: "the detector's label, found among the labels of the ontology",
    v.RDFS_LABEL: "the category's label and the object's number, when it was new",
    v.X: _POSITION,
    v.Y: _POSITION,
    v.Z: _POSITION,
    v.IN_CELL: "the square of 5 m by 5 m that the position lies in",
    v.IN_PLACE: "the first place whose area holds the position, the recording's own before others",
    v.CONFIDENCE: "in reference mode raised with the score of each sighting, up to nu (eq. 3.1), "
    "and lowered by xi for each frame that should have shown it and did not (eq. 3.2 to 3.4); else "
    "nu times the existence",
    v.EXISTENCE: "the probability of its category by all views that showed it or should have, and "
    "by its size; in reference mode confidence divided by nu",
    v.HAS_LABEL_BELIEF: _LABELS,
    v.LABEL_PROBABILITY: _LABELS,
    v.OBSERVATION_COUNT: "one more for each frame with a detection that was associated with it",
    v.EXTENT_X: _EXTENT,
    v.EXTENT_Y: _EXTENT,
    v.EXTENT_Z: _EXTENT,
    v.DEVIATION: "grows with the size of the thing, which is seen from one side at a time",
    **dict.fromkeys((v.ON, v.INSIDE, v.BESIDE, v.HAS_RELATION), _RELATION),
    v.RELATION_PROBABILITY: _RELATION,
    v.FIRST_SEEN: "the time of the frame that registered it",
    v.LAST_SEEN: "the time of the latest frame it was seen in",
    v.EXPLAINED_BY: "the sighting with the highest score so far",
    v.SCORE: "the highest score of all its sightings",
    v.BOX: "the box of the sighting with the highest score",
    v.FRAME: "the frame of the sighting with the highest score",
    v.HAS_BELIEF: "one for each category of place that the views leave any belief in",
    v.BELIEF: _BELIEF,
    v.SCENE_BELIEF: _BELIEF,
    v.TOLD_BY: "objects of known kinds that lie in the place",
    v.VIEW_COUNT: "views that showed enough of the place to speak for it (section 3.3.2)",
    v.X_MIN: _RECTANGLE,
    v.X_MAX: _RECTANGLE,
    v.Y_MIN: _RECTANGLE,
    v.Y_MAX: _RECTANGLE,
    v.OUTLINE: _RECTANGLE,
    v.FROM_FLOOR: _FLOOR,
    v.BOT_ADJACENT_ZONE: _FLOOR,
    v.BOT_INTERFACE_OF: _FLOOR,
    v.WIDTH: _FLOOR,
    v.FOUND_GONE: REMOVAL,
    v.HEADING: "the direction of the camera's axis, seen from above",
}

#: Facts of an object that rest on its sightings.
EVIDENT: Final = frozenset(
    (
        *(v.RDF_TYPE.value, v.EXPLAINED_BY, v.X, v.Y, v.Z),
        *(v.CONFIDENCE, v.EXISTENCE, v.OBSERVATION_COUNT, v.LAST_SEEN),
    )
)
_PLACE_TYPE: Final = (
    "the category with the highest belief, once views of the place or objects in it are evidence"
)
BELIEF_OF_PLACE: Final = (
    "the belief from the views, times how well each object in the place fits the category, as far "
    "as it is believed to exist (docs/explanation/placement.md)"
)


def rule_of(predicate: str, kinds: set[str]) -> str | None:
    """The rule by which a thing of types `kinds` comes by a fact with `predicate`."""
    if v.ROBOT in kinds:
        return _CAMERA
    if v.PLACE in kinds and predicate == v.RDF_TYPE.value:
        return _PLACE_TYPE
    if v.PLACE in kinds and predicate in (v.X, v.Y):
        return "the middle of the place, or what of it is nearest to that"
    if predicate == v.RDF_TYPE.value and kinds & {
        v.SOSA_OBSERVATION,
        v.PLACE_BELIEF,
        v.LABEL_BELIEF,
    }:
        return None
    return RULES.get(predicate)

"""Explanation rules: each predicate's rule, the facts of a map and their changes explain a fact.

A rule is a sentence on how the mappers derive a fact. Equations and sections are of the thesis that
the reference mapper implements; its parameters are in `mapping.reference.settings`.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

from pyoxigraph import Literal, NamedNode, Quad

from kg.history.reports.report_names import Names
from kg.history.storage.log import HistoryLog
from kg.history.storage.log_reader import ChangeLines, Commit, lines_of, quads_of
from kg.history.timestamps import short
from kg.model import vocabulary as v
from kg.model.records import SURFACE
from kg.model.shares import percent
from kg.rdf.quad_store import QuadStore, Term

_POSITION: Final = (
    "mean over all sightings of the position in the map; each is the fullest bin of the "
    "depths within the box, taken through the camera's pose (section 3.3.1)"
)
_EXTENT: Final = (
    "the box around its part of the surface that agrees best with the boxes of up to 16 detections "
    "from different viewpoints; without a surface the box of the points in its latest sightings, "
    "without outliers"
)
_RELATION: Final = (
    "computed from the boxes of both objects and their uncertainty; the most probable relation to "
    "an object nearby (docs/explanation/relations.md)"
)
_LABELS: Final = (
    "computed like the existence, for every other detected category of the thing; the three most "
    "probable ones from 0.05 on"
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
    v.IN_CELL: "the square of 5 m by 5 m that contains the position",
    v.IN_PLACE: "the first place whose area contains the position; places of the recording first",
    v.CONFIDENCE: "in reference mode raised with the score of each sighting, up to nu (eq. 3.1), "
    "and lowered by xi for each frame that should have shown it and did not (eq. 3.2 to 3.4); else "
    "nu times the existence",
    v.EXISTENCE: "the probability that an object of its category exists there, by its size and by "
    "all views that showed or should have shown it; in reference mode confidence divided by nu",
    v.HAS_LABEL_BELIEF: _LABELS,
    v.LABEL_PROBABILITY: _LABELS,
    v.OBSERVATION_COUNT: "one more for each frame with a detection that was associated with it",
    v.EXTENT_X: _EXTENT,
    v.EXTENT_Y: _EXTENT,
    v.EXTENT_Z: _EXTENT,
    v.YAW: _EXTENT,
    v.DEVIATION: "grows with the size of the thing, which is seen from one side at a time",
    **dict.fromkeys((v.ON, v.INSIDE, v.BESIDE, v.HAS_RELATION), _RELATION),
    v.RELATION_PROBABILITY: _RELATION,
    v.FIRST_SEEN: "the time of the frame that registered it",
    v.LAST_SEEN: "the time of the latest frame it was seen in",
    v.EXPLAINED_BY: "the sighting with the highest score so far",
    v.SCORE: "the highest score of all its sightings",
    v.BOX: "the box of the sighting with the highest score",
    v.FRAME: "the frame of the sighting with the highest score",
    v.HAS_BELIEF: "one for each category of place with a belief above 0",
    v.BELIEF: _BELIEF,
    v.SCENE_BELIEF: _BELIEF,
    v.TOLD_BY: "objects of known kinds that lie in the place",
    v.VIEW_COUNT: "views that showed enough of the place to count (section 3.3.2)",
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

#: Predicates of facts of an object that derive from its sightings.
EVIDENT: Final = frozenset(
    (
        *(v.RDF_TYPE.value, v.EXPLAINED_BY, v.X, v.Y, v.Z),
        *(v.CONFIDENCE, v.EXISTENCE, v.OBSERVATION_COUNT, v.LAST_SEEN),
    )
)
_SURFACE_BOX: Final = "the box, along the walls, around the thing in the middle of its views"
_SURFACE_FRAMES: Final = "the number of viewpoints from which it was seen whole"
_SURFACE_EXISTENCE: Final = f"n / (n + 3), where n is {_SURFACE_FRAMES}"
_SURFACE_VIEW: Final = "the view in which most of the thing is in the open, and large"
#: Rules for things without a name, where these differ from those for detections.
_SURFACE_RULES: Final[dict[str, str]] = {
    v.RDF_TYPE.value: "found in the depth of several views: it stands out of its surroundings "
    "and on something level, is 8 cm to 1 m long, and lies in no box of an object with a name",
    **dict.fromkeys((v.X, v.Y, v.Z), f"the middle of {_SURFACE_BOX}"),
    **dict.fromkeys((v.EXTENT_X, v.EXTENT_Y, v.EXTENT_Z, v.YAW), _SURFACE_BOX),
    **dict.fromkeys((v.EXISTENCE, v.CONFIDENCE), _SURFACE_EXISTENCE),
    v.OBSERVATION_COUNT: _SURFACE_FRAMES,
    v.FIRST_SEEN: "the time of the frame that shows it best, or of the latest one, if earlier",
    v.LAST_SEEN: "the time of the latest frame that showed it",
    **dict.fromkeys((v.EXPLAINED_BY, v.FRAME), _SURFACE_VIEW),
    v.SCORE: f"the share of its points in the open in {_SURFACE_VIEW}",
    v.BOX: f"the box around its points in {_SURFACE_VIEW}",
}
REMOVAL_OF_UNNAMED: Final = (
    "a thing without a name leaves the map when the surface no longer shows it, when views of its "
    "place do not show it, or when it lies in the box of an object with a name"
)
_PLACE_TYPE: Final = (
    "the category with the highest belief, once views of the place or objects in it are evidence"
)
BELIEF_OF_PLACE: Final = (
    "the belief from the views, times the likelihood ratio of each object in the place, weighted "
    "by its existence (docs/explanation/placement.md)"
)


def rule_of(predicate: str, kinds: set[str], in_surface: bool = False) -> str | None:
    """The rule for facts with `predicate` about a thing of types `kinds`, or None.

    `in_surface` is whether the surface shows the thing, rather than detections.
    """
    if (
        in_surface
        and predicate in _SURFACE_RULES
        and not (v.SOSA_OBSERVATION in kinds and predicate == v.RDF_TYPE.value)
    ):
        return _SURFACE_RULES[predicate]
    if v.ROBOT in kinds:
        return _CAMERA
    if v.PLACE in kinds and predicate == v.RDF_TYPE.value:
        return _PLACE_TYPE
    if v.PLACE in kinds and predicate in (v.X, v.Y):
        return "the middle of the place, or the nearest point in it"
    if v.DOOR in kinds:
        return _FLOOR
    without_rule = {v.SOSA_OBSERVATION, v.PLACE_BELIEF, v.LABEL_BELIEF, v.SEARCH, v.LOOK}
    if predicate == v.RDF_TYPE.value and kinds & without_rule:
        return None
    return RULES.get(predicate)


class FactReader:
    """Reads the stated facts of a store, as terms and in words."""

    def __init__(self, engine: QuadStore, base: str) -> None:
        self._engine, self._base = engine, base
        self._names = Names(engine, base)

    def _quads(self, iri: NamedNode, predicate: str | None = None) -> list[Quad]:
        """The stated facts about a thing, sorted."""
        node = None if predicate is None else NamedNode(predicate)
        found = self._engine.quads_for_pattern(iri, node, None, None)
        return sorted((quad for quad in found if quad.graph_name != v.INFERRED_GRAPH), key=str)

    def _values(self, iri: NamedNode, predicate: str) -> list[Term]:
        return [q.object for q in self._quads(iri, predicate)]

    def _text(self, iri: NamedNode, predicate: str) -> str:
        return ", ".join(short(value, self._base) for value in self._values(iri, predicate)) or "?"

    def _share(self, iri: NamedNode, predicate: str) -> str:
        """A probability in per cent; 0 where none is stated."""
        shares = (value for value in self._values(iri, predicate) if isinstance(value, Literal))
        return ", ".join(percent(float(share.value)) for share in shares) or percent(0)

    def _called(self, iri: NamedNode, predicate: str) -> str:
        """The values of a predicate by their names."""
        return ", ".join(map(self._names, self._values(iri, predicate))) or "?"

    def _texts(self, quads: Iterable[Quad]) -> dict[str, str]:
        return {q.predicate.value: short(q.object, self._base) for q in quads}

    def _assertion(self, thing: NamedNode, prop: str) -> NamedNode | None:
        """The assertion of a property of a thing."""
        about = NamedNode(v.ASSERTED_OF)
        for quad in self._engine.quads_for_pattern(None, about, thing, v.ASSERTIONS_GRAPH):
            node = quad.subject
            if isinstance(node, NamedNode) and Literal(prop) in self._values(
                node, v.ASSERTED_PROPERTY
            ):
                return node
        return None

    def _in_surface(self, subject: NamedNode, kinds: set[str]) -> bool:
        """Whether the surface, rather than a detector, shows a thing, or the thing of a view."""
        views = [n for n in self._values(subject, v.EXPLAINED_BY) if isinstance(n, NamedNode)]
        by_surface = [self._text(view, v.MODEL) == SURFACE for view in (subject, *views)]
        return v.UNNAMED_THING in kinds or any(by_surface)

    def _name(self, iri: NamedNode, facts: list[Quad]) -> str:
        """A thing with its name, position, and what it is on or inside of."""
        texts = self._texts(facts)
        where = f" at ({texts[v.X]}, {texts[v.Y]}) m" if v.X in texts and v.Y in texts else ""
        place, *related = (
            "".join(
                f"{word} {self._names(quad.object)}"
                for quad in facts
                if quad.predicate.value == predicate
            )
            for predicate, word in ((v.IN_PLACE, " in"), (v.INSIDE, ", inside"), (v.ON, ", on"))
        )
        return f"{self._names(iri)}{place}{where}{''.join(related)}"


class FactChanges:
    """The changes of facts; the history of each subject is read once."""

    def __init__(self, log: HistoryLog) -> None:
        self._log = log
        self._read: dict[Term, list[tuple[int, ChangeLines]]] = {}

    def sequence_of(self, quad: Quad) -> int:
        """The number of the transaction that added `quad`, or else the floor."""
        (line,) = lines_of([quad])
        changes = reversed(self._history(quad.subject))
        sequences = (sequence for sequence, change in changes if line in change.added)
        return next(sequences, self._log.floor)

    def changes_of(
        self,
        subject: NamedNode,
        predicate: str,
        *,
        removed: bool = False,
        value: Term | None = None,
    ) -> list[Commit]:
        """The transactions that added (or `removed`) such a fact, oldest first.

        Without a `value`, facts with any object count.
        """
        start = f"{subject} <{predicate}> ".encode()
        sequences: dict[int, None] = {}
        for sequence, change in self._history(subject):
            lines = change.removed if removed else change.added
            quads = quads_of(line for line in lines if line.startswith(start))
            if any(value is None or same(quad.object, value) for quad in quads):
                sequences[sequence] = None
        commits = map(self._log.commit, sequences)
        return [commit for commit in commits if commit is not None]

    def _history(self, subject: Term) -> list[tuple[int, ChangeLines]]:
        if subject not in self._read:
            self._read[subject] = self._log.whole_history(str(subject).encode())
        return self._read[subject]


def same(one: Term, other: Term) -> bool:
    """Whether two terms are equal, numbers by their value."""
    if one == other:
        return True
    if not (isinstance(one, Literal) and isinstance(other, Literal)):
        return False
    try:
        return float(one.value) == float(other.value)
    except ValueError:
        return one.value == other.value

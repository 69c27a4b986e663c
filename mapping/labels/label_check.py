"""Labels of a network before it maps: the category that each will have, and what it cannot see."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Literal

from kg.knowledge.ontology.catalogue import Catalogue
from kg.knowledge.words.classes import sense_of_label

Way = Literal["category", "name of a category", "new class", "provisional class"]


_WAYS: Final[dict[str, Way]] = {"same": "name of a category"}


@dataclass(frozen=True, slots=True)
class LabelMeaning:
    """Meaning that a label of a detector gets in a new map."""

    label: str
    way: Way
    category: str  # label of the category, or of the one above; "" for here:Object itself


@dataclass(frozen=True, slots=True)
class LabelCheck:
    """Meanings of all labels of a detector."""

    labels: tuple[LabelMeaning, ...]
    unseen: tuple[str, ...]  # categories of the ontology without a label, sorted


def check_labels(labels: Sequence[str], catalogue: Catalogue) -> LabelCheck:
    """Meanings of the labels of a detector, as `LabelResolver` makes them in a new map."""
    found = tuple(_meaning(label, catalogue) for label in dict.fromkeys(labels))
    seen = {one.category for one in found}
    objects = {one.label for one in catalogue.categories if one.kind == "object"}
    return LabelCheck(found, tuple(sorted(objects - seen)))


def _meaning(label: str, catalogue: Catalogue) -> LabelMeaning:
    category = catalogue.for_label(label, "object")
    if category is not None:
        return LabelMeaning(label, "category", category.label)
    sense = sense_of_label(label)
    if sense is None or catalogue.get(label, "supercategory") is not None:
        return LabelMeaning(label, "provisional class", "")
    above = sense.categories[0] if sense.relation in ("same", "narrower") else ""
    return LabelMeaning(label, _WAYS.get(sense.relation, "new class"), above)

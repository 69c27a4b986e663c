"""Label resolution: a network's labels to categories, by a table, the ontology, or a new class."""

from __future__ import annotations

import csv
import io
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, Literal

from kg.knowledge.ontology.catalogue import Catalogue, Category, name_key
from kg.knowledge.words.classes import sense_of_label
from kg.maps.semantic_map import SemanticMap
from kg.model.errors import LabelsError, UnknownCategoryError
from kg.model.regular_files import read_text
from mapping.reference.settings import UnknownLabels

IGNORED: Final = ("", "-")  # categories of labels to be ignored
_HEADER: Final = ["label", "category"]


@dataclass(frozen=True, slots=True)
class LabelTable:
    """Label table, by normalised label: the name of a category, or None to ignore the label."""

    names: Mapping[str, str | None] = field(default_factory=dict)

    def ignores(self, label: str) -> bool:
        """Whether the label is to be ignored."""
        return self.names.get(name_key(label), "") is None

    def category(self, label: str, kind: str, catalogue: Catalogue) -> Category | None:
        """Category of that kind for the label; None where the table has none."""
        name = self.names.get(name_key(label))
        return None if name is None else catalogue.get(name, kind)

    def check_categories(self, catalogue: Catalogue) -> None:
        """Raises LabelsError where the table names an unknown category."""
        for name in filter(None, self.names.values()):
            if not (catalogue.get(name, "object") or catalogue.get(name, "place")):
                try:
                    catalogue.find(name, "object")
                except UnknownCategoryError as error:
                    raise LabelsError(f"the labels map is refused: {error}") from error


def load_label_table(path: Path) -> LabelTable:
    """Read a table: `label,category` a line, category empty or "-" to ignore the label.

    A header line and lines that begin with "#" may be there. Categories are called by label,
    synonym or IRI. Raises LabelsError for anything else, and for a label given twice.
    """
    names: dict[str, str | None] = {}
    for number, row in _rows(path):
        if len(row) != 2 or not row[0]:
            raise LabelsError(
                f"{path}, line {number}: expected label,category, got {','.join(row)!r}"
            )
        key, name = name_key(row[0]), None if row[1] in IGNORED else row[1]
        if names.get(key, name) != name:
            raise LabelsError(f"{path}, line {number}: {row[0]!r} is given two categories")
        names[key] = name
    if not names:
        raise LabelsError(f"{path} maps no label: write lines of label,category")
    return LabelTable(names)


def _rows(path: Path) -> list[tuple[int, list[str]]]:
    """Lines of cells, with their numbers, without header, comments and empty lines."""
    try:
        text = io.StringIO(read_text(path, "utf-8-sig"), newline="")
        reader = csv.reader(text, strict=True)
        rows = [(reader.line_num, [cell.strip() for cell in row]) for row in reader]
    except OSError as error:
        raise LabelsError(f"cannot read the labels map {path}: {error.strerror}") from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise LabelsError(f"the labels map {path} is no CSV in UTF-8: {error}") from error
    rows = [(n, row) for n, row in rows if any(row) and not row[0].startswith("#")]
    return rows[1:] if rows and [c.lower() for c in rows[0][1]] == _HEADER else rows


Way = Literal["category", "name of a category", "new class", "provisional class"]
_WAYS: Final[dict[str, Way]] = {"same": "name of a category"}


class LabelResolver:
    """Resolver of one network's labels in a map's ontology, again whenever that has changed.

    `kind` is "object" or "place". `table` comes first, then the ontology's names; a known word
    becomes a category of its own, any other label a provisional one, or is ignored, by `unknown`.
    `unknown_labels` counts labels without a category; `provisional` has the labels of provisional
    ones. `network` has all labels of the network, () if they are unknown.
    """

    def __init__(
        self,
        semantic_map: SemanticMap,
        kind: str,
        *,
        table: LabelTable | None = None,
        unknown: UnknownLabels = "ignore",
        model: str = "",
    ) -> None:
        self._map, self._kind, self._unknown = semantic_map, kind, unknown
        self._table, self._model = table or LabelTable(), model
        self._catalogue = semantic_map.catalogue
        self._iris: dict[str, str | None] = {}
        self.unknown_labels: Counter[str] = Counter()
        self.provisional: dict[str, None] = {}  # in the order in which they were met
        self.network: tuple[str, ...] = ()
        self._learned: tuple[str, ...] = ()

    def learn(self, labels: Iterable[str]) -> None:
        """Make categories of labels without one, if `unknown` is "provisional".

        With the first labels, those of the network that are known words become categories, so that
        the map tells what the network can see. Others become provisional ones when they are met.
        """
        if self._unknown == "ignore":
            return
        if self._kind == "object" and self._learned != self.network:
            self._learned = self.network
            words = [label for label in self.network if self._known(label) is None]
            labels = [*labels, *(label for label in words if sense_of_label(label) is not None)]
        new = [label for label in dict.fromkeys(labels) if self._known(label) is None]
        new = [label for label in new if not self._table.ignores(label)]
        if new:
            self._map.ontology.learn(new, self._kind, model=self._model)

    def category(self, label: str) -> str | None:
        """IRI of the category of `label`; None, and counted, where there is none."""
        iri = self._known(label)
        if iri is None and not self._table.ignores(label):
            self.unknown_labels[label] += 1
        return iri

    @property
    def detects(self) -> tuple[str, ...]:
        """IRIs of the categories of all labels of the network, sorted."""
        return tuple(sorted({iri for label in self.network if (iri := self._known(label))}))

    def ignores(self, label: str) -> bool:
        """Whether the table says to ignore `label`."""
        return self._table.ignores(label)

    def name(self, label_or_iri: str) -> str:
        """Label of the category that has this label or IRI; the text itself where none has."""
        category = self._catalogue.by_iri(label_or_iri)
        category = category or self._catalogue.by_iri(self._known(label_or_iri) or "")
        return label_or_iri if category is None else category.label

    def _known(self, label: str) -> str | None:
        if self._catalogue is not self._map.catalogue:  # somebody changed the ontology
            self._catalogue = self._map.catalogue
            self._iris.clear()
        if label not in self._iris:
            self._iris[label] = self._find(label)
        return self._iris[label]

    def _find(self, label: str) -> str | None:
        if self._table.ignores(label):
            return None
        given = self._table.category(label, self._kind, self._catalogue)
        category = given or self._catalogue.for_label(label, self._kind)
        if category is None:
            return None
        if category.provisional:
            self.provisional[category.label] = None
        return category.iri


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

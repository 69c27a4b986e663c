"""What a network's labels mean in a map: by a table, by the ontology, or a new category."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable

from kg.semantic_map import SemanticMap
from mapping.labels_map import LabelsMap
from mapping.settings import UnknownLabels


class LabelBook:
    """Labels of one network, looked up in a map's ontology whenever it has changed.

    `kind` is "object" or "place". First counts what `table` says, then what the ontology calls so;
    any other label becomes a provisional category, or is ignored, as `unknown` says.
    `unknown_labels` counts labels that mean nothing; `provisional` has those of provisional ones.
    """

    def __init__(
        self,
        semantic_map: SemanticMap,
        kind: str,
        *,
        table: LabelsMap | None = None,
        unknown: UnknownLabels = "ignore",
        model: str = "",
    ) -> None:
        self._map, self._kind, self._unknown = semantic_map, kind, unknown
        self._table, self._model = table or LabelsMap(), model
        self._catalogue = semantic_map.catalogue
        self._iris: dict[str, str | None] = {}
        self.unknown_labels: Counter[str] = Counter()
        self.provisional: dict[str, None] = {}  # in the order in which they were met

    def learn(self, labels: Iterable[str]) -> None:
        """Make provisional categories of labels that mean nothing yet, where that is wanted."""
        if self._unknown == "ignore":
            return
        new = [label for label in dict.fromkeys(labels) if self._known(label) is None]
        new = [label for label in new if not self._table.ignores(label)]
        if new:
            self._map.learn(new, self._kind, model=self._model)

    def category(self, label: str) -> str | None:
        """IRI of what `label` means; None, and counted, where that is nothing."""
        iri = self._known(label)
        if iri is None and not self._table.ignores(label):
            self.unknown_labels[label] += 1
        return iri

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
        told = self._table.category(label, self._kind, self._catalogue)
        category = told or self._catalogue.for_label(label, self._kind)
        if category is None:
            return None
        if category.provisional:
            self.provisional[category.label] = None
        return category.iri

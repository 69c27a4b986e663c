from __future__ import annotations

from kg.knowledge.ontology.shipped import shipped_ontology
from mapping.labels.label_resolver import LabelMeaning, check_labels


def test_labels_are_told_with_the_category_that_they_get_and_what_is_missing() -> None:
    labels = ["Chair", "coffee mug", "Armchair", "Kettle", "Windsor seat", "Chair"]
    found = check_labels(labels, shipped_ontology().catalogue)
    assert found.labels == (
        LabelMeaning("Chair", "category", "chair"),
        LabelMeaning("coffee mug", "name of a category", "cup"),
        LabelMeaning("Armchair", "new class", "chair"),
        LabelMeaning("Kettle", "new class", ""),
        LabelMeaning("Windsor seat", "provisional class", ""),
    )
    assert "vase" in found.unseen
    assert "cup" not in found.unseen

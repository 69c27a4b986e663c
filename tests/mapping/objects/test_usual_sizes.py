"""Usual sizes of categories, and how likely a size is."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from kg.knowledge.ontology.catalogue import Catalogue
from kg.knowledge.ontology.loading import load_ontologies
from mapping.objects.existence import WORST, UsualSize, size_log_likelihood, usual_sizes
from perception.inference.model_zoo import NETWORKS

size = st.floats(0.01, 20)
CUP = UsualSize(longest=0.1, width=0.08)


def test_every_label_of_the_bundled_detectors_has_a_size_and_is_a_category():
    labels = (NETWORKS / "labels_coco80.txt").read_text(encoding="utf-8").splitlines()
    assert set(labels) <= set(usual_sizes())
    catalogue = Catalogue.from_quads(load_ontologies().quads)
    for label in usual_sizes():
        assert catalogue.for_label(label, "object").label == label


def test_nothing_is_wider_than_long():
    assert [name for name, one in usual_sizes().items() if not 0 < one.width <= one.longest] == []


def test_the_usual_size_is_the_likeliest():
    assert size_log_likelihood(0.1, CUP) == 0
    assert size_log_likelihood(0.2, CUP) < size_log_likelihood(0.12, CUP) < 0
    assert size_log_likelihood(0.05, CUP) > size_log_likelihood(0.2, CUP), "a part is in view"


@given(size)
def test_an_unlikely_size_costs_so_much_and_no_more(size):
    assert WORST <= size_log_likelihood(size, CUP) <= 0


@pytest.mark.parametrize(("measured", "usual"), [(0.3, None), (0.0, CUP)])
def test_what_is_not_known_says_nothing(measured, usual):
    assert size_log_likelihood(measured, usual) == 0

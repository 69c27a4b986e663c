"""Surveys of rooms that ship: their features, and what the model makes of them."""

import numpy as np
import pytest

from kg.knowledge.ontology.catalogue import Catalogue
from kg.knowledge.placement.belief_model import FITTED, posterior_belief
from kg.knowledge.placement.evidence import PlacementEvidence, placement_evidence
from kg.knowledge.placement.statistics import room_type_quads
from kg.knowledge.placement.surveys import room_types, survey_features
from kg.model import vocabulary as v
from tests.shipped_ontology import CATALOGUE as SHIPPED
from tests.shipped_ontology import QUADS

ROOMS = ("garage", "utility room", "toilet")


ADDED = {kind for name in ROOMS for kind in room_types(name, SHIPPED) if kind.below}
ALL = (*QUADS, *room_type_quads(ADDED))


@pytest.fixture(scope="module")
def catalogue() -> Catalogue:
    return Catalogue.from_quads(ALL)


@pytest.fixture(scope="module")
def known(catalogue: Catalogue) -> PlacementEvidence:
    return placement_evidence(ALL, catalogue)


def cell(known: PlacementEvidence, catalogue: Catalogue, thing: str, room: str) -> tuple[int, int]:
    (kind,) = room_types(room, catalogue)
    return known.objects[catalogue.find(thing, "object").iri], known.places[kind.iri]


@pytest.mark.parametrize(
    ("thing", "room", "behavior", "coco", "p"),
    [
        ("toilet", "bathroom", (1, -0.0629, 1, 3.0987), (1, -0.3849, 1, 3.2383), 0.8415),
        ("toilet", "toilet", (1, -0.0629, 1, 3.0987), (1, -0.3849, 1, 3.2383), 0.8415),
        ("chair", "dining room", (1, 1.6134, 1, 1.4085), (1, 1.738, 1, 0.8275), 0.7854),
        ("car", "garage", (1, 0.2885, 1, 1.1927), (1, -1.1354, 0, 0), 0.0624),
        ("sink", "utility room", (1, 0.7997, 1, 1.6717), (1, -0.064, 0, 0), 0.1767),
        ("bed", "hallway", (1, 0.4742, 1, -1.5374), (1, 0.3364, 0, 0), 0.0475),
        ("handbag", "closet", (1, -0.4402, 1, -0.8562), (1, -0.3053, 0, 0), 0.0277),
    ],
)
def test_features_and_probabilities_are_those_that_were_fitted(
    known, catalogue, thing, room, behavior, coco, p
):
    row, column = cell(known, catalogue, thing, room)
    for survey, expected in zip(known.evidence.surveys, (behavior, coco), strict=True):
        features = (survey.covers_object, survey.object_rate, survey.covers_place, survey.lift)
        assert [x[row, column] for x in features] == pytest.approx(expected, abs=1e-4)
    assert posterior_belief(known.evidence, FITTED).prior[row, column] == pytest.approx(p, abs=1e-3)


def test_nothing_is_said_of_a_place_of_unknown_kind(known, catalogue):
    for survey in known.evidence.surveys:
        assert not survey.covers_place[:, known.places[v.PLACE]].any()
        assert not survey.lift[:, known.places[v.PLACE]].any()


def test_a_kind_of_cup_is_as_likely_as_cups(catalogue: Catalogue) -> None:
    cup = catalogue.find("cup", "object").iri
    mug, kitchen = v.HERE + "Mug", catalogue.find("kitchen", "place").iri
    above = {cup: (cup, v.OBJECT), mug: (mug, cup, v.OBJECT), kitchen: (kitchen, v.PLACE)}
    for survey in survey_features((cup, mug), (kitchen,), catalogue, above):
        assert np.array_equal(survey.lift[0], survey.lift[1])
        assert survey.covers_object[1, 0] == 1


def test_what_no_survey_looked_for_has_no_features(catalogue: Catalogue) -> None:
    kitchen, robot = catalogue.find("kitchen", "place").iri, v.HERE + "Robot"
    above = {robot: (robot, v.OBJECT), kitchen: (kitchen, v.PLACE)}
    for survey in survey_features((robot,), (kitchen,), catalogue, above):
        assert survey.log_odds(FITTED.surveys[survey.name]) == pytest.approx(0)

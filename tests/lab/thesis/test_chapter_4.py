from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from lab.maps.truth_matching import MappedObject, Matching, Pair
from lab.thesis.categorisation import FILTERS, PUBLISHED, accuracy, filtered, printed_beliefs
from lab.thesis.localisation import localisation_errors, printed_objects
from lab.thesis.registration import counted, printed

DOCUMENT = Path(__file__).resolve().parents[3] / "lab" / "research" / "chapter_4.md"


def test_the_document_has_what_the_command_prints_of_localisation(prints):
    said = prints("lab.thesis", "4.1")
    assert said.count("| 4.2 |") == 3
    assert said in DOCUMENT.read_text(encoding="utf-8").replace(
        "\nError [m] before the wall, Freedman-Diaconis / Scott / Doane:\n", ""
    )


def test_a_wall_behind_a_wide_box_draws_the_object_to_it_by_each_estimator() -> None:
    chair = [one for one in printed_objects() if (one.scenario, one.name) == (2, "chair")]
    (free,) = localisation_errors(chair, margin=0.3, wall=False)
    (before,) = localisation_errors(chair, margin=0.3, wall=True)
    assert all(error < 0.3 for error in free.errors.values())
    assert all(error == pytest.approx(3.2, abs=0.1) for error in before.errors.values())


def test_printed_counts_of_objects_add_up_to_the_printed_totals() -> None:
    yolo, ssd = printed()
    assert yolo.cells() == "47 | 13 | 13 | 0.783 | 0.783"
    assert ssd.cells() == "35 | 18 | 25 | 0.660 | 0.583"
    assert ssd.cells("backpack") == "0 | 0 | 2 | - | 0.000"


def test_objects_count_as_right_false_or_missed_by_class() -> None:
    mapped = [MappedObject(label, np.zeros(3)) for label in ("cup", "mug", "cup", "sofa")]
    matching = Matching(
        tuple(mapped),
        matched=(Pair(0, 0, 0.1),),
        duplicates=(Pair(2, 0, 0.2),),
        wrong=(),
        ghosts=(Pair(1, 1, 3.0),),
        ignored=(Pair(3, 2, 0.1),),
        missed=(1,),
    )
    found = counted("ours", matching, ["cup", "chair", "couch"])
    assert found.right == Counter(cup=1)
    assert found.false == Counter(cup=1, mug=1)
    assert found.missed == Counter(chair=1)


@pytest.mark.parametrize("name", FILTERS)
def test_the_printed_beliefs_give_the_published_accuracy(name: str) -> None:
    beliefs = printed_beliefs(name)
    assert len(beliefs) == 9
    assert [accuracy(beliefs, first) for first in (1, 5)] == pytest.approx(
        PUBLISHED[name], abs=0.01
    )


def test_filters_agree_on_views_that_are_clear_and_the_prior_knows_no_bathroom() -> None:
    kitchen, shower = (f"https://w3id.org/hereabouts#{kind}" for kind in ("Kitchen", "Shower"))
    views = {kitchen: [{kitchen: 0.7, shower: 0.3}], shower: [{shower: 0.8, kitchen: 0.2}]}
    found = {name: accuracy(places, 1) for name, places in filtered(views, 0).items()}
    assert found == {"bayes": 100, "bayes_prior": 50, "mean": 100, "mean_prior": 50}


def test_table_4_4_without_photographs_is_refused_where_the_folder_holds_none(fails, tmp_path):
    assert "kitchen/*.jpg" in fails("lab.thesis", "4.4", "--photographs", tmp_path)

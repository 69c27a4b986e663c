from __future__ import annotations

import pytest

from kg.knowledge.ontology.catalogue import name_key
from kg.knowledge.words.tables import DATA, all_rows, word_table
from kg.knowledge.words.usual_places import usual_places


def test_counts_are_smoothed_toward_the_rate_of_all_rooms() -> None:
    found = usual_places("dishwasher.n.01")
    assert found is not None
    kitchen = found.places[0]
    assert (found.source, kitchen.label, kitchen.count, kitchen.total) == ("homes", "kitchen", 7, 7)
    rows = all_rows(DATA / "places.csv")
    rooms = sum(int(r["with"]) for r in rows if (r["synset"], r["source"]) == ("*", "homes"))
    assert kitchen.probability == pytest.approx((7 + 5 * 7 / rooms) / (7 + 5), abs=1e-3)


def test_few_counts_give_way_to_a_stated_place() -> None:
    found = usual_places("wallet.n.01")  # three activities have one, each in another room
    assert found is not None
    assert (found.source, found.places[0].label) == ("stated", "corridor")
    assert found.places[0].probability is None


def test_nothing_is_known_of_an_unknown_sense() -> None:
    assert usual_places("") is None
    assert usual_places("unicorn.n.01") is None


def test_every_stated_word_is_known() -> None:
    for row in all_rows(DATA / "stated_places.csv"):
        for word in filter(None, (row["word"], row["like"])):
            assert name_key(word) in word_table().senses, word

from collections import Counter

import pytest

from benchmarks.words import by_names, by_words, typing_errors, words
from kg.knowledge.ontology.catalogue import shipped_ontology

CATALOGUE = shipped_ontology().catalogue


@pytest.mark.parametrize("of", ["first", "second", "third"])
def test_words_inside_are_understood_and_words_outside_are_not_forced_inside(of: str) -> None:
    resolve = by_words(CATALOGUE)
    listed = [word for word in words() if word.of == of]
    counts = Counter((word.inside, word.verdict(resolve(word.text))) for word in listed)
    inside = sum(word.inside for word in listed)
    assert counts[True, "right"] >= 0.75 * inside
    assert counts[True, "wrong"] + counts[False, "wrong"] <= len(listed) / 60


def test_words_are_understood_better_than_by_names_alone() -> None:
    names, resolve = by_names(CATALOGUE), by_words(CATALOGUE)
    listed = [word for word in words() if word.of == "first"]
    before = Counter(word.verdict(names(word.text)) for word in listed)
    after = Counter(word.verdict(resolve(word.text)) for word in listed)
    assert after["right"] > before["right"]
    assert after["wrong"] < before["wrong"]


def test_a_typing_error_is_read_rightly_or_refused() -> None:
    counts = typing_errors(CATALOGUE, seed=2)
    total = sum((Counter(counted) for counted in counts.values()), Counter[str]())
    assert total["right"] >= 0.85 * total.total()
    assert total["wrong"] <= total.total() / 60

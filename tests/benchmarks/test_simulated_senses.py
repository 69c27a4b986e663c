from __future__ import annotations

from benchmarks.simulated_senses import measured


def test_hard_senses_miss_and_err_more_than_mild_ones() -> None:
    tallies = measured([2])
    mild, hard = tallies["demo"], tallies["hard"]
    assert mild.frames == hard.frames > 40

    def recall(found: list[bool]) -> float:
        return sum(found) / len(found)

    assert 0.8 < recall(mild.well) <= 1 and 0.5 < recall(hard.well) < recall(mild.well)
    assert recall(hard.other) < recall(mild.other) < recall(mild.well)
    assert len(hard.false_scores) > 5 * max(len(mild.false_scores), 1)
    assert hard.wrong > mild.wrong
    assert hard.row("hard").count("|") == 10

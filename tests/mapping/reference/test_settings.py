import pytest

from mapping.reference.settings import ReferenceSettings


def test_defaults_are_the_thesis_own():
    s = ReferenceSettings()
    assert (s.kappa, s.phi, s.nu, s.xi) == (0.75, 0.8, 3.0, 0.45)
    assert (s.min_depth, s.max_depth, s.occlusion_window) == (0.8, 4.6, 10)
    assert (s.purity, s.history_length) == (0.75, 50)


@pytest.mark.parametrize(
    "wrong",
    [
        {"kappa": 0},
        {"nu": -1},
        {"phi": float("nan")},
        {"purity": 1.5},
        {"min_depth": 5.0},
        {"stride": 0},
        {"unknown_labels": "guess"},
    ],
)
def test_values_that_cannot_work_are_refused(wrong):
    with pytest.raises(ValueError, match=r"got|empty"):
        ReferenceSettings(**wrong)

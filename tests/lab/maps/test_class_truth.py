import pytest

from kg.model.errors import RecordingError
from lab.maps.truth_matching import load_truth


def test_hand_made_truth_of_the_kitchen_is_read(shared):
    kitchen = load_truth(shared("data/rgbd/redkitchen/objects_gt.json"))
    assert len(kitchen.names) == 14
    assert kitchen.labels.count("chair") == 5
    assert kitchen.p_world.shape == (14, 3)
    assert kitchen.complete_for == ("cup", "tv", "sink", "dining table")


@pytest.mark.parametrize(
    "content",
    [
        "nonsense",
        "[]",
        "{}",
        '{"objects": {"a": {"cls": "cup"}}}',
        '{"objects": {"a": {"cls": "cup", "position": [1, 2]}}}',
        '{"objects": {"a": {"cls": "cup", "position": [1, 2, NaN]}}}',
    ],
)
def test_senseless_truth_is_refused_in_one_line(tmp_path, content):
    path = tmp_path / "truth.json"
    path.write_text(content)
    with pytest.raises(RecordingError) as raised:
        load_truth(path)
    assert "truth.json" in str(raised.value) and "\n" not in str(raised.value)

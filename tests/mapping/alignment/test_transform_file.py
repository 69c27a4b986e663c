import json

import numpy as np
import pytest

from kg.model.errors import LayoutError
from mapping.alignment.recording_fit import load_transform


def test_the_building_of_two_recordings_is_read(shared):
    path = shared("data/rgbd/composite_building.json")
    kitchen = load_transform(path, "redkitchen")
    living = load_transform(path, "icl_livingroom")
    assert kitchen[:3, 3] == pytest.approx([-0.600095, 2.330563, 1.563317])
    assert living[0, 3] == pytest.approx(9.818694)


def test_unknown_sequence_names_the_known(shared):
    with pytest.raises(LayoutError, match=r"there are: icl_livingroom, redkitchen; did you mean"):
        load_transform(shared("data/rgbd/composite_building.json"), "redkitchn")


@pytest.mark.parametrize(
    "content",
    [
        *("nonsense", "[]", "{}", '{"sequences": 3}', '{"sequences": {"a": 3}}'),
        '{"sequences": {"a": {}}}',
    ],
)
def test_senseless_files_are_refused(tmp_path, content):
    path = tmp_path / "transforms.json"
    path.write_text(content)
    with pytest.raises(LayoutError) as raised:
        load_transform(path, "a")
    assert "transforms.json" in str(raised.value) and "\n" not in str(raised.value)


SCALED = np.diag([2.0, 2.0, 2.0, 1.0])
MIRRORED = np.diag([1.0, 1.0, -1.0, 1.0])
PROJECTIVE = np.eye(4) + np.array([[0] * 4, [0] * 4, [0] * 4, [0.1, 0, 0, 0]])
INFINITE = np.eye(4) + np.array([[0, 0, 0, np.inf]] + [[0] * 4] * 3)


@pytest.mark.parametrize(
    "matrix",
    [
        *(T.tolist() for T in (SCALED, MIRRORED, PROJECTIVE, INFINITE, np.eye(3))),
        *("one", [[1, 2], [3]], None),
    ],
)
def test_only_rigid_transforms_pass(tmp_path, matrix):
    path = tmp_path / "transforms.json"
    path.write_text(json.dumps({"sequences": {"a": {"T_map_world": matrix}}}))
    with pytest.raises(LayoutError, match=r"T_map_world of 'a' in .*transforms.json"):
        load_transform(path, "a")


def test_matrix_written_with_six_digits_passes(tmp_path):
    angle = 0.123456789
    c, s = round(np.cos(angle), 6), round(np.sin(angle), 6)
    T = [[c, -s, 0, 1], [s, c, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]]
    path = tmp_path / "transforms.json"
    path.write_text(json.dumps({"sequences": {"a": {"T_map_world": T}}}))
    assert load_transform(path, "a")[:3, 3] == pytest.approx([1, 2, 3])

"""nerfstudio's transforms.json and Polycam's raw export, written from a recording with poses."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from kg.model.errors import RecordingError
from perception.camera.poses import CONVENTIONS
from perception.sources.recording import FolderRecording, open_recording
from perception.sources.recording_options import RecordingOptions, Selection

FEW = 6
OPTIONS = RecordingOptions(T_map_world=np.eye(4), check=False, selection=Selection(limit=FEW))


@pytest.fixture
def truth(shared) -> FolderRecording:
    """The first frames of a synthetic living room."""
    return open_recording(shared("data/rgbd/icl_livingroom"), OPTIONS)


def transforms(truth: FolderRecording, folder: Path) -> dict:
    """The card of the frames, whose images are copied into the folder."""
    (folder / "images").mkdir(parents=True)
    (folder / "depths").mkdir()
    frames = []
    for entry in truth.listing.entries:
        colour, depth = Path(str(entry.colour)), Path(str(entry.depth))
        shutil.copy(colour, folder / "images")
        shutil.copy(depth, folder / "depths")
        frames.append(
            {
                "file_path": f"images/{colour.name}",
                "depth_file_path": f"depths/{depth.name}",
                "transform_matrix": CONVENTIONS["opengl"](entry.T_world_cam).tolist(),
            }
        )
    camera = truth.rectifier.camera
    return {
        "camera_model": "OPENCV",
        "fl_x": camera.fx,
        "fl_y": camera.fy,
        "cx": camera.cx,
        "cy": camera.cy,
        "w": camera.width,
        "h": camera.height,
        "frames": frames,
    }


def test_frames_of_transforms_json_are_read(truth, tmp_path):
    folder = tmp_path / "nerf"
    card = transforms(truth, folder)
    (folder / "transforms.json").write_text(json.dumps(card))
    recording = open_recording(folder, OPTIONS)
    assert (recording.format, len(recording)) == ("nerfstudio", FEW)
    for ours, true in zip(recording.frames(), truth.frames(), strict=True):
        np.testing.assert_allclose(ours.T_map_cam, true.T_map_cam, atol=1e-9)
        np.testing.assert_allclose(ours.K, true.K)
        np.testing.assert_array_equal(ours.depth, true.depth)


def test_poses_are_estimated_where_transforms_json_has_none(truth, tmp_path):
    folder = tmp_path / "nerf"
    card = transforms(truth, folder)
    for frame in card["frames"]:
        del frame["transform_matrix"]
    (folder / "transforms.json").write_text(json.dumps(card))
    assert open_recording(folder, OPTIONS).estimate is not None


def test_transforms_without_depth_are_an_error_with_advice(truth, tmp_path):
    folder = tmp_path / "nerf"
    card = transforms(truth, folder)
    for frame in card["frames"]:
        del frame["depth_file_path"]
    (folder / "transforms.json").write_text(json.dumps(card))
    with pytest.raises(RecordingError, match="has no depth: a depth_file_path"):
        open_recording(folder, OPTIONS)


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"fl_x": "wide"}, "fl_x is no number"),
        ({"frames": {}}, "no list of frames"),
        (
            {"frames": [{"file_path": "a", "depth_file_path": "b", "transform_matrix": [[1]]}]},
            "4x4",
        ),
    ],
)
def test_malformed_transforms_are_errors(truth, tmp_path, change, complaint):
    folder = tmp_path / "nerf"
    (folder / "a").mkdir(parents=True)
    card = transforms(truth, folder / "a") | change
    (folder / "transforms.json").write_text(json.dumps(card))
    with pytest.raises(RecordingError, match=complaint):
        open_recording(folder, OPTIONS)


def test_a_raw_export_of_polycam_is_read_and_turned_upright(truth, tmp_path):
    inner = tmp_path / "scan" / "keyframes"
    for name in ("images", "depth", "cameras"):
        (inner / name).mkdir(parents=True)
    camera = truth.rectifier.camera
    for entry in truth.listing.entries:
        colour, depth = Path(str(entry.colour)), Path(str(entry.depth))
        stamp = f"1234{entry.id}"
        shutil.copy(colour, inner / "images" / f"{stamp}{colour.suffix}")
        shutil.copy(depth, inner / "depth" / f"{stamp}.png")
        rows = CONVENTIONS["opengl"](np.diag([1.0, -1, -1, 1]) @ entry.T_world_cam)
        card = {f"t_{i}{j}": rows[i, j] for i in range(3) for j in range(4)} | {
            "fx": camera.fx,
            "fy": camera.fy,
            "cx": camera.cx,
            "cy": camera.cy,
            "width": camera.width,
            "height": camera.height,
        }
        (inner / "cameras" / f"{stamp}.json").write_text(json.dumps(card))
    recording = open_recording(tmp_path / "scan", OPTIONS)
    assert (recording.format, len(recording)) == ("polycam", FEW)
    up = np.array([0, 1.0, 0])
    for frame in recording.frames():
        assert -(frame.T_map_cam[:3, 1] @ up) > 0.7, "the image's top is up"
    for file in (inner / "cameras").iterdir():
        card = {k: v for k, v in json.loads(file.read_text()).items() if not k.startswith("t_")}
        file.write_text(json.dumps(card))
    with pytest.raises(RecordingError, match=r"has no poses: no t_00 to t_23 in cameras/"):
        open_recording(tmp_path / "scan", RecordingOptions(estimate_poses=False))


def test_frames_whose_images_were_deleted_are_left_out(truth, tmp_path, caplog):
    folder = tmp_path / "nerf"
    card = transforms(truth, folder)
    (folder / "transforms.json").write_text(json.dumps(card))
    (folder / card["frames"][1]["file_path"]).unlink()
    assert len(open_recording(folder, OPTIONS)) == FEW - 1
    assert f"images of 1 of {FEW} frames are missing" in caplog.text


def test_a_lens_that_is_no_pinhole_is_refused(truth, tmp_path):
    folder = tmp_path / "nerf"
    card = transforms(truth, folder) | {"camera_model": "EQUIRECTANGULAR"}
    (folder / "transforms.json").write_text(json.dumps(card))
    with pytest.raises(RecordingError, match="camera_model EQUIRECTANGULAR are not read"):
        open_recording(folder, OPTIONS)

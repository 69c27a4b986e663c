"""Recordings without poses: they are estimated from the images."""

import shutil
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from kg.model.errors import RecordingError
from perception.camera.poses import motion
from perception.sources.folders.image_files import read_colour
from perception.sources.recording import FolderRecording, open_recording
from perception.sources.recording_options import RecordingOptions, Selection

Shared = Callable[[str], Path]
FEW = 12  # frames


@pytest.fixture
def living_room(request: pytest.FixtureRequest, shared: Shared, tmp_path: Path) -> Path:
    """The first images of a synthetic living room, FEW or as given, without its trajectory."""
    source = shared("data/rgbd/icl_livingroom")
    folder = tmp_path / "room"
    for name in ("image", "depth"):
        (folder / name).mkdir(parents=True)
        for path in sorted((source / name).iterdir())[: getattr(request, "param", FEW)]:
            (folder / name / path.name).symlink_to(path)
    shutil.copy(source / "intrinsics.json", folder)
    return folder


def true_poses(shared: Shared, count: int = FEW) -> FolderRecording:
    """The same images with their trajectory."""
    options = RecordingOptions(check=False, selection=Selection(limit=count))
    return open_recording(shared("data/rgbd/icl_livingroom"), options)


def off_truth(recording: FolderRecording, truth: FolderRecording) -> tuple[float, float]:
    """Largest error of the motion from the first frame: [m], [rad]."""
    true = {frame.id: frame.T_map_cam for frame in truth.frames()}
    frames = list(recording.frames())
    first = frames[0]
    errors = [
        motion(
            np.linalg.inv(true[first.id]) @ true[frame.id],
            np.linalg.inv(first.T_map_cam) @ frame.T_map_cam,
        )
        for frame in frames
    ]
    return max(far for far, _ in errors), max(turned for _, turned in errors)


def test_poses_of_a_folder_of_images_are_estimated_and_level(shared, living_room, caplog):
    recording = open_recording(living_room)
    assert recording.format == "images"
    assert len(recording) == FEW
    assert "has no poses" in caplog.text
    assert "estimated from its images" in caplog.text
    truth = true_poses(shared)
    far, turned = off_truth(recording, truth)
    assert far < 0.05
    assert turned < np.deg2rad(2)
    frame, true = recording.frame(0), truth.frame(0)
    np.testing.assert_allclose(frame.T_map_cam[:2, 3], 0, atol=1e-9)
    assert frame.T_map_cam[0, 2] > 0.5, "the camera looks along x"
    assert abs(frame.T_map_cam[2, 3] - true.T_map_cam[2, 3]) < 0.1, "the same height over the floor"
    assert abs(frame.T_map_cam[2, 2] - true.T_map_cam[2, 2]) < 0.05, "the same pitch"


def test_every_frame_is_tracked_where_only_some_are_read(living_room):
    recording = open_recording(living_room, RecordingOptions(selection=Selection(every=4, limit=3)))
    assert [entry.id for entry in recording.listing.entries] == [
        path.stem for path in sorted((living_room / "image").iterdir())[:12:4]
    ]
    assert recording.estimate is not None
    assert recording.estimate.frames == 9


def test_a_trajectory_comes_before_an_estimate(shared, living_room, tmp_path):
    truth = true_poses(shared)
    lines = [
        f"{e.stamp} {' '.join(map(str, e.T_world_cam[:3, 3]))} 0 0 0 1"
        for e in truth.listing.entries
    ]
    (tmp_path / "poses.txt").write_text("\n".join(lines))
    options = RecordingOptions(poses=tmp_path / "poses.txt", check=False, T_map_world=np.eye(4))
    recording = open_recording(living_room, options)
    assert recording.estimate is None
    np.testing.assert_allclose(
        recording.listing.entries[5].T_world_cam[:3, 3], truth.listing.entries[5].T_world_cam[:3, 3]
    )


def test_poses_of_a_recording_that_has_some_are_estimated_when_asked(shared):
    folder = shared("data/rgbd/icl_livingroom")
    truth = true_poses(shared)
    options = RecordingOptions(estimate_poses=True, selection=Selection(limit=FEW))
    recording = open_recording(folder, options)
    assert recording.estimate is not None
    assert off_truth(recording, truth)[0] < 0.05


@pytest.mark.parametrize(
    ("layout", "lost"),
    [("poses.txt", slice(None)), ("poses.txt", slice(3, 9)), ("pose/", slice(None))],
    ids=["all", "some", "all, in files of their own"],
)
def test_poses_that_were_lost_are_estimated_when_asked(shared, living_room, layout, lost, caplog):
    truth = true_poses(shared)
    poses = np.array([entry.T_world_cam for entry in truth.listing.entries[:FEW]])
    poses[lost] = np.nan
    if layout == "poses.txt":
        np.savetxt(living_room / layout, poses.reshape(FEW, 16))
    else:
        (living_room / layout).mkdir()
        for path, T in zip(sorted((living_room / "image").iterdir()), poses, strict=True):
            np.savetxt(living_room / layout / f"{path.stem}.txt", T)
    if lost == slice(None):
        with pytest.raises(RecordingError, match=r"has a.* pose.*--poses estimate"):
            open_recording(living_room)
    recording = open_recording(living_room, RecordingOptions(estimate_poses=True))
    assert len(recording) == FEW
    assert off_truth(recording, truth)[0] < 0.05
    assert "have no pose" not in caplog.text


@pytest.mark.parametrize("living_room", [20], indirect=True)  # a tenth may be missing
def test_frames_whose_images_are_missing_have_no_estimated_pose(shared, living_room, caplog):
    next((living_room / "image").glob("*")).unlink()
    sorted((living_room / "depth").iterdir())[12].unlink()
    recording = open_recording(living_room)
    truth = true_poses(shared, 20)
    assert len(recording) == 18
    assert off_truth(recording, truth)[0] < 0.05
    assert caplog.text.count("the frame is left out") == 2


def test_without_intrinsics_the_error_says_what_would_work(living_room):
    (living_room / "intrinsics.json").unlink()
    with pytest.raises(RecordingError, match=r"no intrinsics: .*\"fx\": 525.*--intrinsics FILE"):
        open_recording(living_room)


def test_images_that_show_nothing_are_an_error_with_advice(living_room):
    for path in (living_room / "image").iterdir():
        black = np.zeros_like(read_colour(path))
        path.unlink()
        cv2.imwrite(str(path), black)
    with pytest.raises(RecordingError, match=r"poses of 0 of 12 frames.*more light"):
        open_recording(living_room)


def test_where_estimates_are_not_wanted_missing_poses_are_an_error(living_room):
    with pytest.raises(RecordingError, match="has no poses"):
        open_recording(living_room, RecordingOptions(estimate_poses=False))


def test_a_camera_that_is_too_high_is_told_with_the_depth_scale_that_fits(shared, tmp_path, caplog):
    options = RecordingOptions(
        depth_scale=300, estimate_poses=True, check=True, selection=Selection(limit=12)
    )
    open_recording(shared("data/rgbd/hololens_lounge"), options)
    assert "m over the floor, by a depth of 300 units a metre; --depth-scale 1000" in caplog.text

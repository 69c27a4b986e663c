"""CameraInfo of ROS 1 and ROS 2 as intrinsics."""

from __future__ import annotations

from types import SimpleNamespace as Message

import numpy as np
import pytest

from kg.model.errors import RecordingError
from perception.sources.ros.image_messages import intrinsics_of
from tests.perception.sources.ros.messages import camera_info


def test_raw_images_follow_k_and_rectified_ones_p() -> None:
    message = camera_info(d=np.array([0.1, -0.2, 0.0, 0.0, 0.3]))
    raw = intrinsics_of(message, "info")
    assert (raw.fx, raw.fy, raw.cx, raw.cy) == (500, 510, 320, 240)
    assert raw.dist == (0.1, -0.2, 0.0, 0.0, 0.3)
    assert raw.size == (640, 480)
    rectified = intrinsics_of(message, "info", rectified=True)
    assert (rectified.fx, rectified.fy, rectified.cx, rectified.cy) == (400, 410, 310, 230)
    assert rectified.dist == ()


def test_ros1_calls_the_fields_by_capitals() -> None:
    fields = vars(camera_info())
    ros1 = Message(**{("DKP"["dkp".index(k)] if k in "dkp" else k): v for k, v in fields.items()})
    assert not hasattr(ros1, "k")
    assert intrinsics_of(ros1, "info").fy == 510


def test_a_region_of_interest_moves_the_principal_point() -> None:
    roi = Message(x_offset=100, y_offset=40, width=200, height=300, do_rectify=False)
    found = intrinsics_of(camera_info(roi=roi), "info")
    assert (found.cx, found.cy) == (220, 200)
    assert found.size == (200, 300)


def test_binned_images_scale_the_camera() -> None:
    found = intrinsics_of(camera_info(), "info").fitted(320, 240)
    assert found.fx == 250


@pytest.mark.parametrize("d", [(0.1, -0.02, 0.0, 0.001), (0.1, -0.02, 0.0, 0.001, 0.0), ()])
def test_fisheye_cameras(d: tuple[float, ...]) -> None:
    found = intrinsics_of(camera_info(distortion_model="equidistant", d=np.array(d)), "info")
    assert found.fisheye
    assert found.distorted, "without coefficients, too, it is no pinhole camera"
    assert found.dist == ((*d[:4],) or (0.0,) * 4)
    rectified = intrinsics_of(camera_info(distortion_model="equidistant"), "info", rectified=True)
    assert not rectified.distorted


def test_cameras_that_cannot_be_used() -> None:
    with pytest.raises(RecordingError, match="info is not calibrated"):
        intrinsics_of(camera_info(k=np.zeros(9)), "info")
    for model, count in (("equidistant", 6), ("omni", 4)):
        other = camera_info(distortion_model=model, d=np.full(count, 0.1))
        with pytest.raises(RecordingError, match=rf"'{model}' with {count} .*image_rect"):
            intrinsics_of(other, "info")
    with pytest.raises(RecordingError, match="with 3 coefficients"):
        intrinsics_of(camera_info(d=np.ones(3)), "info")
    with pytest.raises(RecordingError, match="finite"):
        intrinsics_of(camera_info(k=np.full(9, np.nan)), "info").fitted(640, 480)

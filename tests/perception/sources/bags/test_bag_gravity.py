"""An IMU at rest tells where up is, for poses that are estimated."""

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rosbags")

from perception.sources.bags.bag import read
from perception.sources.listing import Streams
from tests.perception.sources.robot_bags import Bag, View, named, recorded

#: the IMU's x looks along the camera's z, its y to the left, its z up
IMU_IN_CAMERA = np.array([[0.0, -1, 0, 0], [0, 0, -1, 0], [1, 0, 0, 0], [0, 0, 0, 1]])
REST = np.array([2.0, 0.0, 9.6])  # [m/s^2] of a camera that looks down by 12 degrees


def bag(path: Path, *, shake: float = 0.0, linked: bool = True, acceleration=REST) -> Path:
    """Images without poses, and an IMU."""
    random = np.random.default_rng(1)

    def add(made: Bag, view: View) -> None:
        if linked and not view.number:
            made.tf("/tf_static", view.stamp, "lens", "imu", IMU_IN_CAMERA)
        for step in range(10):
            a = named("xyz", acceleration + random.normal(0, 0.02 + shake, 3))
            at, kind = view.stamp + step / 100, "sensor_msgs/msg/Imu"
            made.stamped("/imu", kind, at, "imu", linear_acceleration=a)
        made.images(view)

    return recorded(path, add)


def test_up_is_that_of_the_accelerometer_in_the_camera(tmp_path: Path) -> None:
    listing = read(bag(tmp_path / "rest"), Streams())
    assert listing.no_poses
    wanted = np.array([0.0, -9.6, 2.0])  # the camera's y points down, its z ahead
    np.testing.assert_allclose(
        listing.up_of_first_camera, wanted / np.linalg.norm(wanted), atol=0.01
    )


@pytest.mark.parametrize(
    "options",
    [{"shake": 2.0}, {"linked": False}, {"acceleration": REST / 9.81}],
    ids=["shaken", "not linked to the camera", "in units of gravity"],
)
def test_an_imu_that_tells_nothing_is_not_used(tmp_path: Path, options) -> None:
    assert read(bag(tmp_path / "moving", **options), Streams()).up_of_first_camera is None

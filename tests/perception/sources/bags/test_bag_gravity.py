"""An IMU at rest tells where up is, for poses that are estimated."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rosbags")

from perception.sources.bags.bag import read
from perception.sources.listing import Streams
from tests.perception.sources.test_bags import BEGIN, Bag, views

#: the IMU's x looks along the camera's z, its y to the left, its z up
IMU_IN_CAMERA = np.array([[0.0, -1, 0, 0], [0, 0, -1, 0], [1, 0, 0, 0], [0, 0, 0, 1]])
REST = np.array([2.0, 0.0, 9.6])  # [m/s^2] of a camera that looks down by 12 degrees


def bag(path: Path, *, shake: float = 0.0, linked: bool = True, acceleration=REST) -> Path:
    """Images without poses, and an IMU."""
    made = Bag(path)
    zero = made.make("geometry_msgs/msg/Vector3", x=0.0, y=0.0, z=0.0)
    level = made.make("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=0.0, w=1.0)
    if linked:
        made.tf("/tf_static", BEGIN, "lens", "imu", IMU_IN_CAMERA)
    random = np.random.default_rng(1)
    for _, stamp, _, rgb, millimetres in views():
        for step in range(10):
            x, y, z = acceleration + random.normal(0, 0.02 + shake, 3)
            a = made.make("geometry_msgs/msg/Vector3", x=float(x), y=float(y), z=float(z))
            at = stamp + step / 100
            message = made.make(
                "sensor_msgs/msg/Imu",
                header=made.header(at, "imu"),
                orientation=level,
                orientation_covariance=np.zeros(9),
                angular_velocity=zero,
                angular_velocity_covariance=np.zeros(9),
                linear_acceleration=a,
                linear_acceleration_covariance=np.zeros(9),
            )
            made.write("/imu", "sensor_msgs/msg/Imu", at, message)
        made.camera("/cam/rgb/camera_info", stamp, "lens")
        made.image("/cam/rgb/image_raw", stamp, rgb, "rgb8", "lens")
        made.image("/cam/depth/image_raw", stamp, millimetres, "16UC1", "lens")
    made.bag.close()
    return path


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

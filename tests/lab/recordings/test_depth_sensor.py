import numpy as np

from lab.recordings.simulated_recording import KINECT
from planner.simulation.camera import DepthSensor


def measured(depth, sensor=KINECT, incidence=1.0, returns=True):
    shape = depth.shape
    return sensor.measure(
        depth.astype(np.float32),
        np.full(shape, incidence, np.float32),
        np.full(shape, returns),
        np.random.default_rng(0),
    )


def test_a_kinect_sees_from_half_a_metre_to_less_than_five() -> None:
    for metres, share in ((0.4, 0.0), (1.0, 1.0), (4.0, 1.0), (4.6, 0.5), (5.0, 0.0)):
        seen = np.isfinite(measured(np.full((60, 80), metres))).mean()
        assert abs(seen - share) < 0.05, metres


def test_depth_comes_in_steps_that_grow_with_its_square() -> None:
    def step(metres: float) -> float:
        values = np.unique(measured(np.full((120, 160), metres)))
        return float(np.median(np.diff(values[np.isfinite(values)])))

    assert 0.001 < step(1.0) < 0.005
    assert 7 < step(3.0) / step(1.0) < 11


def test_grazing_surfaces_and_lit_screens_give_no_depth() -> None:
    wall = np.full((20, 20), 2.0)
    assert np.isnan(measured(wall, incidence=0.05)).all()
    assert np.isnan(measured(wall, returns=False)).all()
    assert np.isfinite(measured(wall, DepthSensor(), returns=False)).all()


def test_depth_is_lost_along_edges() -> None:
    step = np.full((100, 40), 2.0)
    step[:, 20:] = 3.0
    lost = np.isnan(measured(step))
    assert 0.4 < lost[:, 19:21].mean() < 0.8
    assert not lost[:, :18].any() and not lost[:, 22:].any()

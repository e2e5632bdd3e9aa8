"""The numbers of readings: whatever a sensor tells them in, the filter reckons with Python's."""

import numpy as np

from txt1.estimation.settings import EstimationConfig
from txt1.estimation.task import ENCODERS, Estimator, Wheels
from txt1.model.odometry import Odometry
from txt1.model.vehicle import Geometry
from txt1.sensors.base import Reading
from txt1.sensors.readings import ImuReading, TrackerReading

SHORT = np.float32


def test_sensors_that_tell_numpys_short_floats_leave_the_estimate_all_its_digits() -> None:
    kinds: dict[str, type] = {"imu": ImuReading, "vicon": TrackerReading}
    estimator = Estimator(EstimationConfig(sensors=(ENCODERS, *kinds)), kinds, Geometry())
    for cycle in range(1, 20):
        now = cycle * 0.02
        turn = SHORT(0.1), SHORT(0.0), SHORT(0.2)
        pose = TrackerReading(SHORT(1.0), SHORT(2.0), SHORT(0.0), (0.0, 0.0, SHORT(0.0), SHORT(1.0)))
        estimator.take("imu", Reading(now, ImuReading((0.0, 0.0, 9.81), turn)))
        estimator.take("vicon", Reading(now, pose._replace(sigma_x=SHORT(0.01))))
        estimate = estimator.step(now, Wheels(Odometry(), now, None, 0.0))
    assert estimator.failure == ""
    assert estimate.located
    assert {type(each) for each in (*estimate[:5], *estimate.covariance, estimate.bias, estimate.slip)} == {float}

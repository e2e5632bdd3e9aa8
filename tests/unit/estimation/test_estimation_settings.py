"""Settings of the filter that contradict one another, or have no effect, are refused in one line each."""

import pytest

from txt1.config import load
from txt1.errors import ConfigError
from txt1.estimation.settings import EstimationConfig


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        (("estimation.preset=gyro", "estimation.sensors=[encoders]"), "contradict one another"),
        (("estimation.sensors=[encoders, imu, imu]",), "'imu' twice"),
        (("estimation.preset=gyro", "estimation.settings={gps: {delay: 0.1}}"), "settings.gps has no effect"),
        (("estimation.preset=vicon", "estimation.settings={vicon: {fields: []}}"), "fields is empty"),
        (("estimation.preset=imu-gps", "estimation.start_sigma=[0.1, 0.1, 0.1]"), "no effect without start"),
        (
            ("estimation.preset=vicon", "estimation.settings={vicon: {fields: [x, y], sigma: {theta: 0.1}}}"),
            "sigma.theta has no effect",
        ),
    ],
)
def test_a_contradiction_is_refused_in_one_line(settings: tuple[str, ...], words: str) -> None:
    with pytest.raises(ConfigError) as caught:
        load(None, settings).config.section(EstimationConfig)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)

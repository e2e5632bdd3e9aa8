"""The pilot as a teacher: its pupil drives to the light by the four raw readings and odometry."""

from argparse import Namespace

import pytest

from benchmarks.teaching import light


@pytest.mark.long
def test_a_pupil_of_the_pilot_finds_the_light_by_noisy_readings() -> None:
    """A network that trusts odometry goes on turning as it turns: such pupils lose it in a tenth of the starts."""
    times = light.case("0.3 3", Namespace(minutes_taught=10.0, starts=60))
    assert max(times["policy"]) < light.LIMIT
    assert sum(times["policy"]) < 1.2 * sum(times["pilot"])

"""A part is judged by the computer that it runs on: what takes longer there may take longer, in proportion."""

import asyncio
from itertools import accumulate, cycle

import pytest

from txt1 import conformance
from txt1.sensors.conformance import COMPUTED, SensorConformance


class Simulated(SensorConformance):
    """A sensor that computes what a device measures."""

    processor = COMPUTED
    interface = SensorConformance


@pytest.mark.parametrize(("call", "kept"), [(0.9, True), (1.0, True), (1.1, False)])
def test_a_call_may_take_as_much_longer_as_a_plain_loop_does(
    call: float, kept: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    # ms of the processor: before and after the call, before and after the loop, which takes 0.2 on a usual computer
    steps = accumulate(cycle((0.0, call, 0.0, 0.7)))
    monkeypatch.setattr(conformance, "processor_ns", lambda: round(1e6 * next(steps)))
    checked = Simulated().expect_prompt("Sensor.read", 0.0, lambda: None)
    if kept:
        asyncio.run(checked)
    else:
        with pytest.raises(AssertionError, match=r"takes less than 1\.05 ms of the processor, but took 1\.10 ms"):
            asyncio.run(checked)

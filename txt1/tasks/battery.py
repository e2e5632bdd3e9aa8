"""The battery task: voltages, state, remaining time. Priority 1, 1 Hz (thesis 3.3.3, 3.6)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from txt1.control.limits import Fault, Gate
from txt1.hal.base import Hal
from txt1.kernel.ticks import Ticks
from txt1.model.battery import remaining_time
from txt1.protocol.messages import BatteryLevels, BoardMessage
from txt1.tasks.fields import Battery, BatteryState
from txt1.tasks.state import State
from txt1.telemetry.topics import Rule, Topic, declare

PRIORITY: Final = 1
PERIOD: Final = 1.0

OLD_WEIGHT: Final = 0.6
"""Weight of the old value in the smoothed voltage (the original firmware)."""
GOOD_V: Final = 9.5
WARNING_V: Final = 9.0
FITTED_V: Final = 1.0
"""A pack that reads less is not fitted."""
BAD_TIME: Final = 5.0
"""Seconds of bad batteries that stop the robot: readings may start low and settle."""

_DISCHARGING: Final = 2
_LIPO: Final = 3
_HEALTH: Final = {BatteryState.GOOD: 1, BatteryState.WARNING: 1, BatteryState.BAD: 3}
"""In ROS's numbers."""


def _topic(number: int) -> Topic[Battery]:
    unknown = float("nan")  # as ROS says it of anything that is not measured

    def numbers(battery: Battery) -> tuple[float, int, bool]:
        voltage = (battery.battery1 if number == 1 else battery.battery2) or 0.0
        return voltage, _HEALTH.get(battery.state, 0) if battery.state else 0, voltage >= FITTED_V

    return declare(Topic(
        f"/battery{number}", Battery, "V", "sensor_msgs/BatteryState", Rule.SECOND, f"battery {number}",
        {
            "temperature": unknown, "current": unknown, "charge": unknown, "capacity": unknown,
            "design_capacity": 6.5, "percentage": unknown, "power_supply_status": _DISCHARGING,
            "power_supply_technology": _LIPO, "location": f"battery{number}",
        },
        ("voltage", "power_supply_health", "present"), numbers,
    ))  # fmt: skip


BATTERIES: Final = (_topic(1), _topic(2))


async def battery(ticks: Ticks, state: State, hal: Hal, gate: Gate, send: Callable[[BoardMessage], None]) -> None:
    """Smooth the voltages, judge them, send them, and stop the robot when they have been bad for too long."""
    smoothed: tuple[float, float] | None = None
    bad_since: float | None = None
    told = False
    time: float | None = None
    async for now in ticks:
        inputs = hal.read(now)
        if inputs.batteries is None or inputs.battery_time == time is not None:
            continue  # nothing new
        time = inputs.battery_time
        one, two = inputs.batteries
        if smoothed is not None and not hal.capabilities.smoothed:
            one = OLD_WEIGHT * smoothed[0] + (1.0 - OLD_WEIGHT) * one
            two = OLD_WEIGHT * smoothed[1] + (1.0 - OLD_WEIGHT) * two
        smoothed = one, two
        judged = judge(one, two)
        remaining = None if judged is BatteryState.EXTERNAL else remaining_time(max(one, two))
        if judged is not BatteryState.BAD:
            bad_since, told = None, False
        elif bad_since is None:
            bad_since = now
        exhausted = bad_since is not None and now - bad_since >= BAD_TIME
        state.battery = Battery(one, two, judged, remaining, now if time is None else time, exhausted)
        send(BatteryLevels(one, two))

        if inputs.cut_off:
            gate.disarm("batteries cut off", Fault.BATTERY)
        if exhausted and not told:
            told = True
            gate.disarm("batteries bad", Fault.BATTERY)
            state.tell(now, "batteries bad: change them, or shut the computer down (Robot.shutdown_host)")


def judge(battery1: float, battery2: float) -> BatteryState:
    """The batteries' state from both voltages in V; without any pack the external supply must be feeding us."""
    best = max(battery1, battery2)
    if best < FITTED_V:
        return BatteryState.EXTERNAL
    if best > GOOD_V:
        return BatteryState.GOOD
    return BatteryState.WARNING if best > WARNING_V else BatteryState.BAD

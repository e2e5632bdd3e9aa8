"""The battery task: voltages, state, remaining time. Priority 1, 1 Hz (thesis 3.3.3, 3.6)."""

from collections.abc import Callable
from math import isfinite
from typing import Final

from txt1.control.limits import Fault, Gate
from txt1.hal.base import Hal
from txt1.kernel.ticks import Ticks
from txt1.model.battery import remaining_time
from txt1.protocol.messages import BatteryLevels, BoardMessage
from txt1.tasks.fields import Battery, BatteryState
from txt1.tasks.state import State
from txt1.telemetry.topics import Rule, Topic, declare

# s
BATTERY_PERIOD: Final = 1.0
# weight of the old value in the smoothed voltage (the original firmware)
OLD_WEIGHT: Final = 0.6
GOOD_V: Final = 9.5
WARNING_V: Final = 9.0
# V; a pack that reads less is not connected
FITTED_V: Final = 1.0
# s for which the batteries have to be bad before the robot stops: first readings may be low, and settle
BAD_TIME: Final = 5.0
# the numbers of ROS
_HEALTH: Final = {BatteryState.GOOD: 1, BatteryState.WARNING: 1, BatteryState.BAD: 3}


def _topic(number: int) -> Topic[Battery]:
    # ROS's value for an unknown quantity
    unknown = float("nan")

    def numbers(battery: Battery) -> tuple[float, int, bool]:
        voltage = (battery.battery1 if number == 1 else battery.battery2) or 0.0
        return voltage, _HEALTH.get(battery.state, 0) if battery.state else 0, voltage >= FITTED_V

    return declare(
        Topic(
            f"/battery{number}",
            Battery,
            "V",
            "sensor_msgs/BatteryState",
            Rule.SECOND,
            f"battery {number}",
            {
                "temperature": unknown,
                "current": unknown,
                "charge": unknown,
                "capacity": unknown,
                "design_capacity": 6.5,
                "percentage": unknown,
                "power_supply_status": 2,
                "power_supply_technology": 3,
                # discharging; lithium polymer
                "location": f"battery{number}",
            },
            ("voltage", "power_supply_health", "present"),
            numbers,
        )
    )


BATTERIES: Final = (_topic(1), _topic(2))
RANGE: Final = declare(
    Topic(
        "/range_left",
        float,
        "m",
        "std_msgs/Float64",
        Rule.SECOND,
        "how far the batteries last at the economical speed",
        paths=("data",),
        make=lambda metres: (metres,),
    )
)


async def battery(ticks: Ticks, state: State, hal: Hal, gate: Gate, send: Callable[[BoardMessage], None]) -> None:
    """Smooth the voltages, judge them, send them, and stop the robot when they have been bad for too long.

    A voltage that is not finite is forgotten: the filter starts again with the next voltage.
    """
    one: float | None = None
    two: float | None = None
    bad_since: float | None = None
    time: float | None = None
    good, bad = gate.limits.battery_good, gate.limits.battery_bad
    weight = 0.0 if hal.capabilities.smoothed else OLD_WEIGHT
    async for now in ticks:
        inputs = hal.read(now)
        if inputs.batteries is None or inputs.battery_time == time is not None:
            # no new reading
            continue
        time = inputs.battery_time
        one, two = smooth(one, inputs.batteries[0], weight), smooth(two, inputs.batteries[1], weight)
        judged = judge(one, two, good, bad)
        best = max((volts for volts in (one, two) if volts is not None), default=0.0)
        unknown = judged in (None, BatteryState.EXTERNAL) or (good, bad) != (GOOD_V, WARNING_V)
        remaining = None if unknown else remaining_time(best)
        if judged is BatteryState.BAD:
            bad_since = now if bad_since is None else bad_since
        elif judged is not None:
            bad_since = None
        exhausted = bad_since is not None and now - bad_since >= BAD_TIME
        newly = exhausted and not state.battery.exhausted
        state.battery = Battery(one, two, judged, remaining, now if time is None else time, exhausted)
        if one is not None and two is not None:
            send(BatteryLevels(one, two))
        else:
            gate.count(Fault.MEASURED)

        if inputs.cut_off:
            gate.disarm("batteries cut off", Fault.BATTERY)
        if newly:
            gate.disarm("batteries bad", Fault.BATTERY)
            state.tell(now, "batteries bad: change them, or shut the computer down (Robot.shutdown_host)")


def smooth(old: float | None, new: float, weight: float) -> float | None:
    """Return the smoothed voltage, V; None if the new voltage is not finite.

    `weight` is the weight of the old voltage.
    """
    if not isfinite(new):
        return None
    return new if old is None else weight * old + (1.0 - weight) * new


def judge(
    battery1: float | None, battery2: float | None, good: float = GOOD_V, bad: float = WARNING_V
) -> BatteryState | None:
    """Return the batteries' state from both voltages in V, None for an unknown voltage; None if the state stays
    unknown.

    If no pack is connected, an external supply feeds the robot.
    """
    known = [volts for volts in (battery1, battery2) if volts is not None]
    best = max(known, default=0.0)
    if best < FITTED_V:
        return BatteryState.EXTERNAL if len(known) == 2 else None
    if best > good:
        return BatteryState.GOOD
    return BatteryState.WARNING if best > bad else BatteryState.BAD

"""Writes the numbers that board and computer share, from their one definition in txt1, as a module and as a C header.

python firmware/make_facts.py           # write it
python firmware/make_facts.py --check   # exit code 1 when it is out of date
"""

from __future__ import annotations

import sys
from pathlib import Path

from txt1.cars.pico.installer import IDENTITY, RELEASE
from txt1.control import limits as gate
from txt1.control.parameters import Limits
from txt1.model import battery as line
from txt1.model.vehicle import PWM_MAX, STEERING_MAX, Geometry
from txt1.protocol import layout
from txt1.protocol.messages import (
    BatteryLevels,
    CombinedOdometry,
    EncoderOdometry,
    PidSet,
    PowerControl,
    PwmCommand,
    PwmTest,
    Velocity,
)
from txt1.protocol.radio_control import RcPermit, RcReport
from txt1.tasks import battery, controller, mode, panel
from txt1.tasks.fields import BatteryState

FILE = Path(__file__).parent / "pico" / "txt1pico" / "facts.py"
HEADER = Path(__file__).parent / "arduino" / "src" / "txt1_facts.h"
HEAD = '''"""The numbers that board and computer share. Made by firmware/make_facts.py: do not edit."""

try:
    from micropython import const
except ImportError:  # under CPython

    def const(value):
        """Return the value."""
        return value


'''


def facts() -> dict[str, object]:
    """Return every constant by its name; lengths in mm, times in ms, voltages in mV, speeds in mm/s."""
    commands = {message: each.command for message, each in layout.LAYOUTS.items()}
    sizes = {
        message: each.struct(each.counts[0]).size
        for message, each in layout.LAYOUTS.items()
        if each.receiver is layout.Role.BOARD and message is not PidSet
    }
    host_frames = tuple(number for message, size in sizes.items() for number in (commands[message], size))
    limits, geometry = Limits(), Geometry()
    return {
        "VELOCITY": commands[Velocity],
        "ENCODER_ODOMETRY": commands[EncoderOdometry],
        "COMBINED_ODOMETRY": commands[CombinedOdometry],
        "BATTERY_LEVELS": commands[BatteryLevels],
        "PWM_TEST": commands[PwmTest],
        "POWER_CONTROL": commands[PowerControl],
        "PWM_COMMAND": commands[PwmCommand],
        "PID_SET": commands[PidSet],
        "RC_REPORT": commands[RcReport],
        "RC_PERMIT": commands[RcPermit],
        "IDENTITY": IDENTITY,
        "RELEASE": RELEASE.decode(),
        "ACCEPTED": layout.ACCEPTED,
        "REJECTED": layout.REJECTED,
        "SETS_MAX": layout.SETS_MAX,
        "HOST_FRAMES": (*host_frames, IDENTITY, 0, IDENTITY, len(RELEASE)),
        "PWM_MAX": PWM_MAX,
        "STEERING_MAX": STEERING_MAX,
        "MOTOR_MAX": limits.motor_max,
        "V_MAX": thousandths(limits.v_max),
        "RADIUS_MIN": thousandths(geometry.radius_min),
        "COMMAND_TIMEOUT": thousandths(limits.command_timeout),
        "COMBINED_TIMEOUT": thousandths(controller.COMBINED_TIMEOUT),
        "VELOCITY_MIN": mode.VELOCITY_MIN,
        "COMBINED_MIN": mode.COMBINED_MIN,
        "MISSED_MAX": limits.missed_ticks_max,
        "LET_GO": 1000,
        "MEASURED_MAX": 3000,
        "RUNAWAY_MOTOR": limits.runaway_motor,
        "RUNAWAY_TIME": thousandths(limits.runaway_time),
        "RUNAWAY_COUNTS": limits.runaway_counts,
        "RUNAWAY_SPEED": thousandths(limits.runaway_speed),
        "PERSISTS": thousandths(gate.PERSISTS),
        "NOISE_COUNTS": gate.NOISE_COUNTS,
        "DISAGREEMENT": thousandths(gate.DISAGREEMENT),
        "CIRCUMFERENCE": round(10000 * geometry.circumference),
        "TRACK_WIDTH": thousandths(geometry.track_width),
        "COUNTS_PER_REV": geometry.counts_per_rev,
        "FITTED": thousandths(battery.FITTED_V),
        "GOOD": thousandths(battery.GOOD_V),
        "WARNING": thousandths(battery.WARNING_V),
        "BAD_TIME": thousandths(battery.BAD_TIME),
        "BEEP_LOW": thousandths(panel.BEEPS[BatteryState.WARNING]),
        "BEEP_EMPTY": thousandths(panel.BEEPS[BatteryState.BAD]),
        "CUT_OFF": thousandths(line.CUT_OFF_V),
        "FULL": thousandths(line.INTERCEPT_V),
        "SLOPE": round(1e6 * line.SLOPE_V_PER_MIN),
        "SAFE_END": round(60.0 * line.SAFE_END_MIN),
    }


def thousandths(value: float) -> int:
    """Return the value in thousandths of its unit."""
    return round(1000.0 * value)


def text() -> str:
    """Return the module."""
    forms = {str: '{} = b"{}"\n', tuple: "{} = {}\n", int: "{} = const({})\n"}
    return HEAD + "".join(forms[type(value)].format(name, value) for name, value in facts().items())


def header() -> str:
    """Return the C header."""
    lines = ["/* The numbers that board and computer share. Made by firmware/make_facts.py: do not edit. */"]
    lines += ["#ifndef TXT1_FACTS_H", "#define TXT1_FACTS_H", ""]
    for name, value in facts().items():
        if isinstance(value, tuple):
            value = f"{{{', '.join(map(str, value))}}}"
        elif isinstance(value, str):
            value = f'"{value}"'
        lines.append(f"#define TXT1_{name} {value}")
    return "\n".join((*lines, "", "#endif", ""))


if __name__ == "__main__":
    made = {FILE: text(), HEADER: header()}
    if "--check" in sys.argv:
        sys.exit(any(file.read_text() != content for file, content in made.items()))
    for file, content in made.items():
        file.write_text(content)

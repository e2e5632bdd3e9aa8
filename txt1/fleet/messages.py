"""Messages of other peers, checked as they arrive: any member of the fleet may send anything.

Each function takes the JSON object of a message and returns its values. It raises ValueError, which says what is wrong.
A stop is the exception: a message on its key is a stop, whatever it contains.
"""

import json
import re
from collections.abc import Mapping
from math import isfinite
from typing import Any, Final, NamedTuple

from txt1.control.hand import DEFAULT_HAND, Hand
from txt1.fleet.body import DEFAULT_BODY, Body

# bytes of the longest message that is read
MESSAGE_SIZE: Final = 1 << 15
# longest name of a robot or a console
MEMBER_NAME: Final = re.compile(r"[a-z][a-z0-9_]{0,63}")
# largest number: m, rad, m/s, rad/s, V
NUMBER_MAX: Final = 1e6
# numbers of a law
DATA_MAX: Final = 16
# largest length and speed of a car: m, m/s, rad/s
CAR_SIZE_MAX: Final = 100.0
# letters of a reason; the rest of a longer reason is cut off
TEXT_MAX: Final = 100
# longest time on a clock, ns
TIME_MAX: Final = 1 << 63
# longest identity of a stop of all
STOP: Final = re.compile(r"[0-9a-f]{32}")


class MemberState(NamedTuple):
    """A robot's message about itself: pose (m, rad), velocities (m/s, rad/s), numbers of its law, and its condition."""

    x: float
    y: float
    theta: float
    v: float
    omega: float
    data: tuple[float, ...]
    armed: bool
    reason: str
    driver: str
    battery: float | None
    silent: str
    body: Body = DEFAULT_BODY
    stuck: str = ""
    hand: Hand = DEFAULT_HAND


class StopAnswer(NamedTuple):
    """A robot's answer to a stop of all, as the robot itself reports.

    It tells whether its gate is closed and whether it was then seen to stand. If not, `why` gives the reason or the
    stop's progress.
    """

    closed: bool
    stands: bool = False
    why: str = ""


def message_of(payload: bytes) -> dict[str, Any] | None:
    """Return the JSON object of a message with a proper sender's name; None for anything else."""
    try:
        message = json.loads(payload) if len(payload) <= MESSAGE_SIZE else None
    except (ValueError, RecursionError):
        return None
    if not isinstance(message, dict) or not is_name(message.get("from")):
        return None
    return message


def is_name(name: object) -> bool:
    """Return whether this may be the name of a peer."""
    return isinstance(name, str) and MEMBER_NAME.fullmatch(name) is not None


def state_of(message: Mapping[str, Any]) -> MemberState:
    """Return the content of a robot's message about itself."""
    data = message.get("data", ())
    if not isinstance(data, list | tuple) or len(data) > DATA_MAX:
        raise ValueError(f"data: give at most {DATA_MAX} numbers")
    x, y, theta, v, omega = (number(message, name) for name in ("x", "y", "theta", "v", "omega"))
    return MemberState(
        x,
        y,
        theta,
        v,
        omega,
        tuple(number({"data": each}, "data") for each in data),
        message.get("armed") is True,
        text(message, "reason"),
        text(message, "driver"),
        None if message.get("battery") is None else number(message, "battery"),
        text(message, "silent"),
        body_of(message.get("body")),
        text(message, "stuck"),
        hand_of(message.get("hand")),
    )


def body_of(told: object) -> Body:
    """Return the body in a robot's message; an older robot sends none and counts as a TXT-1."""
    if not isinstance(told, dict):
        return DEFAULT_BODY
    radius, v_max, reach = (_size(told, name) for name in ("radius", "v_max", "reach"))
    centre, least = number(told, "centre"), number(told, "least")
    if not (abs(centre) <= CAR_SIZE_MAX and 0.0 <= least <= v_max):
        raise ValueError("body: centre or least is out of range")
    return Body(radius, v_max, reach, centre, least, told.get("pivots") is True)


def hand_of(told: object) -> Hand:
    """Return the hand rule of a robot; without one it is the TXT-1's."""
    if not isinstance(told, dict):
        return DEFAULT_HAND
    v_max, omega_max, radius, turn = (_size(told, name) for name in ("v_max", "omega_max", "radius", "turn"))
    return Hand(v_max, omega_max, radius, told.get("pivots") is True, min(turn, 1.0))


def _size(message: Mapping[str, Any], name: str) -> float:
    """Return a length or speed of a car."""
    value = number(message, name)
    if not 0.0 < value <= CAR_SIZE_MAX:
        raise ValueError(f"{name}: it is not between 0 and {CAR_SIZE_MAX:g}")
    return value


def drive_of(message: Mapping[str, Any]) -> tuple[float, float]:
    """Return a velocity for this robot, m/s and rad/s."""
    return number(message, "v"), number(message, "omega")


def stop_of(payload: bytes) -> str:
    """Return the identity of a stop; "" if it has none, and then it is obeyed each time."""
    stop = (message_of(payload) or {}).get("stop")
    return stop if isinstance(stop, str) and STOP.fullmatch(stop) else ""


def answer_of(message: Mapping[str, Any]) -> StopAnswer:
    """Return a robot's answer to a stop; with an open gate it does not count as standing."""
    closed = message.get("closed") is True
    return StopAnswer(closed, closed and message.get("stands") is True, text(message, "why"))


def time_of(message: Mapping[str, Any], name: str) -> int:
    """Return a time of a peer's clock, ns."""
    value = message.get(name)
    if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value < TIME_MAX:
        raise ValueError(f"{name}: it is no time in ns")
    return value


def number(message: Mapping[str, Any], name: str) -> float:
    """Return a field that is a finite number within `NUMBER_MAX`."""
    value = message.get(name)
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError(f"{name}: it is no number")
    if not abs(value) <= NUMBER_MAX or not isfinite(value):
        raise ValueError(f"{name}: it is not finite, or beyond {NUMBER_MAX:g}")
    return float(value)


def text(message: Mapping[str, Any], name: str) -> str:
    """Return a text field as a single line, without control characters of a terminal; "" if it is absent."""
    value = message.get(name)
    if value is None:
        return ""
    if not isinstance(value, str):
        raise ValueError(f"{name}: it is no text")
    return "".join(letter if letter.isprintable() else " " for letter in value[:TEXT_MAX])

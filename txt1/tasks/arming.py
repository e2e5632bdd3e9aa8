"""Decides whether the safety gate may be opened now."""

from typing import Final

from txt1.control.standstill import UNOBEYED
from txt1.hal.base import Hal
from txt1.tasks.standstill import Watch
from txt1.tasks.state import State

# s of the run: the mode task judges the link once a second, so it knows no link before
FIRST: Final = 1.0


def reason_not_to_arm(state: State, hal: Hal, io: Hal, watch: Watch | None, held: bool, now: float) -> str | None:
    """Return why the robot may not be armed at `now`, with the remedy; None when arming is allowed.

    `io` is the hardware layer as the tasks use it. `held`: the velocity loops run here, behind a line, which is not
    allowed.
    """
    # the switch's state after the actions of this instant
    board = None if state.board is None else hal.read(now).link
    if board is not None and not board.ready:
        return f"no link to the board yet: {board.text}"
    if not state.link.alive:
        return (
            f"the link is checked after {FIRST:g} s; try again then"
            if now <= FIRST
            else "no word from the host for a second; is the program that drives it still running?"
        )
    if held:
        return (
            "control: host is experimental: an original board in manual mode keeps its last PWM when this host "
            "dies; with the wheels off the ground, put it into manual mode and set serial.allow_host=true"
        )
    if watch is not None and watch.standstill.stop in UNOBEYED:
        return "it has not stopped yet; wait until it stands"
    if state.power.esc is False and not hal.capabilities.power_known:
        return "the ESC is off: switch it on first (e, or Robot.switch_power)"
    if state.power.atx is False:
        return "the ATX supply is off, so the encoders see nothing: switch it on first"
    if io.read(now).cut_off:
        return "the batteries are cut off: change them first"
    if state.battery.exhausted:
        return "batteries bad: change them first"
    return None


def reason_after_runaway(rolls_until: float, unseen: bool, stands: bool, now: float) -> str | None:
    """Return why a robot that did not obey may not be armed at `now`; None when arming is allowed.

    At `rolls_until` (s of the run) it has certainly come to rest. Before that time its encoders do not count, because
    dead encoders read 0. An `unseen` robot, whose encoders may be dead or which has none, may then be armed.
    """
    if now < rolls_until:
        return f"it did not obey, and may still roll: try again in {rolls_until - now:.1f} s"
    return None if unseen or stands else "it did not obey, and still moves: wait until it stands"

"""Decides whether the safety gate may be opened now."""

from typing import Final

from txt1.control.standstill import UNOBEYED
from txt1.hal.base import Hal
from txt1.tasks.standstill import Watch
from txt1.tasks.state import State

# s of the run: the mode task judges the link once a second, so it knows no link before
LINK_JUDGED_AFTER: Final = 1.0


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
            f"try again in a second: the link is checked after {LINK_JUDGED_AFTER:g} s"
            if now <= LINK_JUDGED_AFTER
            else "look at the program that drives it: it was silent for a second"
        )
    if held:
        return (
            "control: host is experimental: an original board in manual mode keeps its last PWM when this host "
            "dies; with the wheels off the ground, put it into manual mode and set serial.allow_host=true"
        )
    if watch is not None and watch.standstill.stop in UNOBEYED:
        return "wait until it stands: it has not stopped yet"
    if state.power.esc is False and not hal.capabilities.power_known:
        return "switch the ESC on first (e, or Robot.switch_power): it is off"
    if state.power.atx is False:
        return "switch the ATX supply on first: it is off, so the encoders see nothing"
    if io.read(now).cut_off:
        return "change the batteries first: they are cut off"
    if state.battery.exhausted:
        return "change the batteries first: they are bad"
    return None


def reason_after_runaway(rolls_until: float, unseen: bool, stands: bool, now: float) -> str | None:
    """Return why a robot that did not obey may not be armed at `now`; None when arming is allowed.

    At `rolls_until` (s of the run) it has certainly come to rest. Before that time its encoders do not count, because
    dead encoders read 0. An `unseen` robot, whose encoders may be dead or which has none, may then be armed.
    """
    if now < rolls_until:
        return f"try again in {rolls_until - now:.1f} s: it did not obey, and may still roll"
    return None if unseen or stands else "wait until it stands: it did not obey, and still moves"

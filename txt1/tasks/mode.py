"""The mode task: judges the link to the host and selects the odometry. Priority 2, 1 Hz (thesis 3.3.3)."""

from typing import Final, NamedTuple

from txt1.control.limits import Fault, Gate
from txt1.kernel.ticks import Ticks
from txt1.tasks.fields import LinkState, Panel, Power
from txt1.tasks.state import State
from txt1.telemetry.messages import define
from txt1.telemetry.topics import Rule, Topic, declare

# s
MODE_PERIOD: Final = 1.0
# the link is alive if more Velocity messages than this came in a second (the original firmware)
VELOCITY_MIN: Final = 1
# combined odometry is selected if more of its messages than this came in a second (the original firmware)
COMBINED_MIN: Final = 2


_MODES: Final = {None: "", False: "controller", True: "manual"}


class Mode(NamedTuple):
    """The safety gate (armed, stopped, reason for being closed), link, power switches and panel."""

    armed: bool = False
    stopped: bool = False
    reason: str = ""
    link: LinkState = LinkState()
    power: Power = Power()
    panel: Panel = Panel()


def _mode_message(value: Mode) -> dict[str, object]:
    armed, stopped, reason, link, power, panel = value
    return {
        "armed": armed,
        "stopped": stopped,
        "mode": _MODES[panel.manual],
        "link_alive": link.alive,
        "combined": link.combined,
        "atx": _switch(power.atx, power),
        "esc": _switch(power.esc, power),
        "screen": panel.screen,
        "reason": reason,
    }


def _switch(on: bool | None, power: Power) -> str:
    """Return the position of a switch in words; "" if it is unknown."""
    return "" if on is None else f"{'on' if on else 'off'}{'' if power.confirmed else ' (asked)'}"


MODE: Final = declare(
    Topic(
        "/mode",
        Mode,
        "",
        define(
            "txt1_msgs/Mode",
            "std_msgs/Header header\nbool armed\nbool stopped\nstring mode\nbool link_alive\nbool combined\n"
            "string atx\nstring esc\nint32 screen\nstring reason",
        ),
        Rule.CHANGE,
        "armed, manual, link, power switches",
        make=_mode_message,
    )
)


async def mode(ticks: Ticks, state: State, gate: Gate) -> None:
    """Judge the last second by the messages that came in it. A lost link disarms.

    If the robot has a board behind a line, a lost link to the board counts as well.
    """
    velocities = combined = 0
    async for now in ticks:
        link = LinkState(
            alive=state.velocity_count - velocities > VELOCITY_MIN and (state.board is None or state.board.ready),
            combined=state.combined_count - combined > COMBINED_MIN,
        )
        velocities, combined = state.velocity_count, state.combined_count
        if state.link.alive and not link.alive:
            state.tell(now, "link lost")
            # at the instant of the loss this task runs before the controller
            board = state.board
            known = board is not None and not board.ready and board.reason
            gate.disarm(known or "link lost", Fault.LINK)
        state.link = link

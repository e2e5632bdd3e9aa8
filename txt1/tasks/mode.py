"""The mode task: is the host alive, which odometry counts? Priority 2, 1 Hz (thesis 3.3.3)."""

from typing import Final, NamedTuple

from txt1.control.limits import Fault, Gate
from txt1.kernel.ticks import Ticks
from txt1.tasks.fields import LinkState, Panel, Power
from txt1.tasks.state import State
from txt1.telemetry.messages import define
from txt1.telemetry.topics import Rule, Topic, declare

VELOCITY_MIN: Final = 1
"""The link is alive when more Velocity messages than this came in a second (the original firmware)."""
COMBINED_MIN: Final = 2
"""Combined odometry is selected when more such messages than this came in a second (the original firmware)."""


_MODES: Final = {None: "", False: "controller", True: "manual"}


class Mode(NamedTuple):
    """The safety gate (armed, stopped, why it is closed), link, power switches and panel."""

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
    """How a switch stands; "" when nobody knows."""
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
    """Judge the last second by the messages that came in it; a link that is lost disarms.

    Where there is a board behind a link, that one counts as well.
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
            # in the instant in which it is lost this task comes before the controller
            board = state.board
            known = board is not None and not board.ready and board.reason
            gate.disarm(known or "link lost", Fault.LINK)
        state.link = link

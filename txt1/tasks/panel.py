"""The board's panel: the button task, 10 Hz, and the display task, 10 Hz: buzzer and LEDs (thesis 3.3.3).

Drawing takes longer than a controller period, so the screens are drawn elsewhere, from snapshots of the bus.
"""

from collections import deque
from collections.abc import Mapping
from typing import Final

from txt1.control.limits import Gate
from txt1.hal.base import Button, Hal, Indicators
from txt1.kernel.ticks import Ticks
from txt1.tasks.fields import BatteryState, Panel
from txt1.tasks.state import State

# s, of the button task and of the display task
PANEL_PERIOD: Final = 0.1

# s for which the buzzer sounds, and then is silent, by the state of the batteries: as on the original boards
BEEPS: Final[Mapping[BatteryState | None, float]] = {BatteryState.WARNING: 2.0, BatteryState.BAD: 1.0}


async def button(ticks: Ticks, presses: deque[Button], state: State, hal: Hal, gate: Gate) -> None:
    """Act on every press, of the board's joystick or of the operator's keys (`presses`), once."""
    held = Button.NONE
    async for now in ticks:
        inputs = hal.read(now)
        state.backlight = inputs.backlight
        if inputs.buttons != held:
            edges = inputs.buttons & ~held
            held = inputs.buttons
            presses.extend(button for button in Button if button in edges)
        if not presses:
            continue
        panel = state.panel
        while presses:
            panel = press(
                panel, presses.popleft(), rows=len(state.gains.angular.sets), has_pwm=hal.capabilities.by_hand
            )
        if panel.manual != state.panel.manual:
            # a command for one mode is invalid in the other
            gate.renew(now)
            state.tell(now, "manual mode" if panel.manual else "controller mode")
        state.panel = panel


def press(panel: Panel, pressed: Button, rows: int, has_pwm: bool) -> Panel:
    """Return the panel after a press. `rows` is the number of angular gain sets to scroll through.

    Left and right change the screen, up and down scroll the gains, the centre toggles controller and manual mode, if
    the HAL has PWM.
    """
    match pressed:
        case Button.LEFT:
            return panel._replace(screen=panel.screen - 1)
        case Button.RIGHT:
            return panel._replace(screen=panel.screen + 1)
        case Button.UP:
            return panel._replace(scroll=max(panel.scroll - 1, 0))
        case Button.DOWN:
            return panel._replace(scroll=min(panel.scroll + 1, max(rows - 1, 0)))
        case Button.CENTRE if has_pwm:
            return panel._replace(manual=not panel.manual)
    return panel


async def display(ticks: Ticks, state: State, hal: Hal) -> None:
    """Set buzzer and LEDs, once per tick. An LED toggles with every message."""
    async for now in ticks:
        sounds = buzzer(state.link.alive, state.battery.state, now)
        hal.indicate(Indicators(sounds, state.received % 2 == 1, state.transmitted % 2 == 1))


def buzzer(link_alive: bool, battery: BatteryState | None, now: float) -> bool:
    """Return whether the buzzer sounds at `now`, s of the run: without a pause while the link is lost, else in the
    pattern of the batteries' state (thesis 3.6.2).
    """
    period = BEEPS.get(battery) if link_alive else None
    return not link_alive if period is None else now % (2.0 * period) < period

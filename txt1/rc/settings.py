"""The settings of a radio control receiver at this computer."""

from dataclasses import dataclass
from typing import Final, Literal, NamedTuple

from txt1.errors import ConfigError
from txt1.rc.frames import CrsfDecoder, FrameDecoder, SbusDecoder
from txt1.rc.take_over import ModeSwitch, Stick, TakeOver
from txt1.units import Positive

# us by which the positions of a stick or switch have to differ
POSITIONS_APART: Final = 200.0


class Protocol(NamedTuple):
    """A receiver's protocol: its rate, bits a second; its frames on the line; its decoder."""

    baud: int
    framing: str
    decoder: type[FrameDecoder]


BOARD: Final = "board"
"""The port of a receiver that is at the board, such as a Pico."""

PWM_PINS: Final = 20, 21, 22
"""A Pico's pins for the three servo outputs of a receiver, in the drawing."""

PROTOCOLS: Final[dict[str, Protocol]] = {
    "sbus": Protocol(100_000, "8E2", SbusDecoder),
    "crsf": Protocol(420_000, "8N1", CrsfDecoder),
}

UNKNOWN_STICK: Final = Stick()
UNKNOWN_SWITCH: Final = ModeSwitch()


@dataclass(frozen=True, slots=True)
class RcParameters:
    """A radio control receiver; `txt1 calibrate --rc PORT` finds all of it."""

    protocol: Literal["sbus", "crsf", "pwm"] = "crsf"
    """SBUS, or CRSF (ExpressLRS, Crossfire); pwm: three servo outputs, at a board only."""
    port: str | None = None
    """Serial device, socket://host:port, or board: the board has the receiver; null: as --rc says."""
    speed: Positive | None = None
    """Speed at full throttle, m/s; null: the car's fastest, safety.v_max."""
    throttle: Stick = UNKNOWN_STICK
    """Channel and pulses (us) of the throttle: back, neutral, ahead."""
    steering: Stick = UNKNOWN_STICK
    """Channel and pulses (us) of the steering: right, straight, left."""
    switch: ModeSwitch = UNKNOWN_SWITCH
    """Channel and pulses (us) of the switch: at "hand", at "computer"."""


def take_over(parameters: RcParameters) -> TakeOver:
    """Return the rule for these settings; raises ConfigError if something is missing or cannot be."""
    throttle, steering, switch = parameters.throttle, parameters.steering, parameters.switch
    given: dict[str, Stick | ModeSwitch] = {"throttle": throttle, "steering": steering, "switch": switch}
    if missing := [name for name, each in given.items() if not each.channel]:
        raise ConfigError(
            f"rc.{missing[0]}.channel: nobody has told its channel; `txt1 calibrate --rc PORT --write FILE` finds all "
            "of them, and checks that the receiver tells the loss of its transmitter"
        )
    for name, stick in (("throttle", throttle), ("steering", steering)):
        rises = stick.least + POSITIONS_APART <= stick.middle <= stick.most - POSITIONS_APART
        falls = stick.most + POSITIONS_APART <= stick.middle <= stick.least - POSITIONS_APART
        if not (rises or falls):
            told = f"{stick.least:g}, {stick.middle:g}, {stick.most:g}"
            raise ConfigError(
                f"rc.{name}: {told} us do not rise or fall by {POSITIONS_APART:g} us each; calibrate it again"
            )
    if abs(switch.hand - switch.computer) < 2.0 * POSITIONS_APART:
        told = f"{switch.hand:g} and {switch.computer:g} us"
        raise ConfigError(f"rc.switch: {told} are too close for three positions; calibrate it again")
    channels = [each.channel for each in given.values()]
    if len(set(channels)) < len(channels):
        raise ConfigError(f"rc: throttle, steering and switch have the channels {channels}; give three different ones")
    return TakeOver(throttle, steering, switch)


def firmware_settings(
    throttle: Stick, steering: Stick, switch: ModeSwitch, protocol: str = "crsf"
) -> dict[str, object]:
    """Return the setting `receiver` of the Pico's firmware for these channels, with the pins of the drawing."""
    rows = {
        name: [stick.channel, round(stick.least), round(stick.middle), round(stick.most)]
        for name, stick in (("throttle", throttle), ("steering", steering))
    }
    lines: dict[str, object] = {"protocol": protocol, "uart": 1, "rx_pin": 9, "tx_pin": 8}
    channel = switch.channel
    if protocol == "pwm":
        # the pins stand in the order of throttle, steering and switch
        lines = {"protocol": protocol, "pins": [PWM_PINS[each.channel - 1] for each in (throttle, steering, switch)]}
        rows["throttle"][0], rows["steering"][0], channel = 1, 2, 3
    return {**lines, **rows, "switch": [channel, round(switch.hand), round(switch.computer)]}

"""A simulated car behind a Raspberry Pi: the guard drives it over the virtual chips, with faults on the bus."""

import errno
import os
from collections.abc import Sequence
from math import inf
from random import Random
from typing import Final

from txt1.cars.pi.chips import Ads1115Chip, Chip, Ina219Chip, Pca9685Chip, VirtualBus
from txt1.cars.pi.driver import GuardAnswer, PiOptions, answer_of
from txt1.cars.pi.guard import Guarded, GuardSetup, Pca9685, Quadrature
from txt1.config import Config, checked
from txt1.control.limits import Outputs
from txt1.hal.registry import create_sim
from txt1.model.vehicle import PWM_MAX, STEERING_MAX, outputs_of
from txt1.sim.parameters import LineFaults
from txt1.sim.random_streams import random_stream

# bits of a transfer of four bytes: address, register, data, each acknowledged
TRANSFER: Final = 54
# s for which the watchdog keeps the outputs on after a rising edge
MONOSTABLE_TIME: Final = 0.2
# counts around neutral that an ESC takes for it, no more than the dead bands of motors
NEUTRAL: Final = 300.0
# m/s at which an ESC takes the car to stand
ESC_STANDS_SPEED: Final = 0.05
# s for which a cut line leaves the servo board without power
AWAY: Final = 1.0


class LooseBus(VirtualBus):
    """A bus with faults.

    Transfers that a line would lose, tear or corrupt are not acknowledged, as I2C has no checksum.
    """

    def __init__(self, chips: dict[int, Chip], faults: LineFaults, rng: Random) -> None:
        super().__init__(chips)
        self._share = min(1.0, faults.drop + faults.tear + TRANSFER * faults.flip)
        self._rng = rng
        self.dead = False
        """Whether a wire is cut."""

    def _chip(self, address: int) -> Chip:
        if self.dead or (self._share and self._rng.random() < self._share):
            raise OSError(errno.EREMOTEIO, os.strerror(errno.EREMOTEIO))
        return super()._chip(address)


class Monostable:
    """The watchdog on the servo board's output-enable pin, as drawn on the page about the Raspberry Pi.

    Each rising edge at its input keeps the outputs on for `MONOSTABLE_TIME` s. A constant level has no effect.
    """

    def __init__(self) -> None:
        self._level = 0
        self.edge = -inf
        """Time of the last rising edge, s."""

    def set(self, level: int, now: float) -> None:
        """Take a level at `now`, s."""
        if level and not self._level:
            self.edge = now
        self._level = level

    @property
    def ends(self) -> float:
        """Return the time at which the outputs go off, s."""
        return self.edge + MONOSTABLE_TIME


class VirtualEsc:
    """An ESC that goes forward, brakes and reverses, as most hobby ESCs; its neutral is at the counts `neutral`.

    `direct`: it reverses at once.
    """

    def __init__(self, direct: bool, neutral: float) -> None:
        self._direct, self._neutral = direct, neutral
        # what the reverse side has done since the last drive forward, and what it does from the next neutral on
        self._braked = self._reverses = False

    def drives(self, counts: float, rolls: float) -> float:
        """Return the counts that act on a car that rolls at `rolls` m/s."""
        if abs(counts - self._neutral) < NEUTRAL:
            # only a car that stands is let into reverse, where it stays
            self._reverses |= self._braked and abs(rolls) < ESC_STANDS_SPEED
        elif counts > self._neutral:
            self._braked = self._reverses = False
        elif not (self._direct or self._reverses):
            self._braked = True
            return counts if rolls > ESC_STANDS_SPEED else self._neutral
        return counts


class VirtualPi:
    """A virtual servo board with a simulated car behind it, in the same process and on the same clock."""

    def __init__(self, config: Config, setup: GuardSetup) -> None:
        options = checked(PiOptions, config.hal_options, "hal_options")
        self.hal = create_sim(config.model_copy(update={"hal": "sim"}))
        self.vehicle = self.hal.vehicle
        self.board, self.ina219, self.ads1115 = Pca9685Chip(), Ina219Chip(), Ads1115Chip()
        rng = random_stream(config.own_seed, "bus")
        self.bus = LooseBus({setup.address: self.board}, config.serial.fault, rng)
        self._cut = config.serial.fault.cut
        if setup.battery != "none":
            self.bus.chips[setup.battery_address] = self.ina219 if setup.battery == "ina219" else self.ads1115
        self._options, self._setup = options, setup
        wires = config.sim.channels
        sides = (wires.right, wires.left) if config.geometry.steering == "skid" else (wires.motor,)
        self._escs = [VirtualEsc(options.virtual_esc == "direct", each.trim) for each in sides]
        self._encoders = [Quadrature(pins) for pins in setup.encoders]
        self._guard: Guarded | None = None
        self._answer: bytes | None = None
        self.watchdog = None if setup.watchdog is None else Monostable()
        self._out, self._time = False, 0.0
        self.hangs = False
        """Whether the guard hangs, as when the kernel holds it in the bus."""
        # paths of the wheels, and of the edges of their encoders, m
        self._seen, self._turned = (0.0,) * len(self._encoders), [0.0] * len(self._encoders)
        self._counts_per_m = 0.0 if not setup.encoders else 1.0 / config.geometry.count_length

    async def open(self) -> None:
        """Put out neutral."""
        self._answer = None
        await self.hal.open()
        board = Pca9685(self.bus, self._setup)
        self._guard = Guarded(self._setup, self.bus, board, self._encoders, self._feed)
        self._guard.neutral()
        self._move(self.vehicle.time)

    async def close(self) -> None:
        """Put out neutral."""
        if self._guard is not None:
            self._guard.neutral()
            self._move(self.vehicle.time)

    def put(self, pulses: Sequence[float], now: float) -> None:
        """Put out pulses, and move the car."""
        assert self._guard is not None
        if self._cut and self._cut <= now < self._cut + AWAY:
            self.bus.dead = True
        elif self.bus.dead:
            self.bus.dead = False
            self.board.power_up()
        if self.watchdog is not None and self._out and now >= self.watchdog.ends:
            self.vehicle.advance_to(max(self.vehicle.time, self.watchdog.ends))
            self._move(now)
        self.vehicle.advance_to(now)
        paths = self._paths()
        for at, (encoder, path) in enumerate(zip(self._encoders, paths, strict=False)):
            # one pin shows no direction
            further = path - self._seen[at]
            self._turned[at] += abs(further) if len(self._setup.encoders[at]) == 1 else further
            encoder.count = int(self._turned[at] * self._counts_per_m)
        self._seen = paths
        volts = max(self.vehicle.battery_readings()) / self._setup.divider
        self.ina219.voltage = self.ads1115.voltage = volts
        if self.hangs:
            return
        self._time = now
        self._answer = self._guard.answer(pulses)
        self._move(now)

    def _feed(self, level: int) -> None:
        if self.watchdog is not None:
            self.watchdog.set(level, self._time)

    def heard(self, now: float) -> GuardAnswer | None:
        """Return the guard's answer."""
        answer, self._answer = self._answer, None
        return None if answer is None else answer_of(answer)

    def _paths(self) -> tuple[float, ...]:
        right, left = self.vehicle.motion[6:8]
        if len(self._encoders) == 2:
            return right, left
        path = 0.5 * (right + left)
        return (path,)

    def _move(self, now: float) -> None:
        """Move the car by the servo board's outputs, as its ESC and servos read them."""
        self._out = self.watchdog is None or now < self.watchdog.ends
        o = self._options
        pulses = [self.board.pulse(channel) if self._out else 0.0 for channel in self._setup.channels]
        rolls = self.vehicle.state.v
        motors = [
            0.0 if not pulse else esc.drives(PWM_MAX * (pulse - o.motor_neutral) / o.motor_range, rolls)
            for esc, pulse in zip(self._escs, pulses, strict=False)
        ]
        if self.vehicle.skids:
            motor, rear = outputs_of(*motors)
            self.hal.write(Outputs(round(motor), -round(rear), round(rear)), now)
            return
        front = 0.0 if not pulses[1] else STEERING_MAX * (o.straight - pulses[1]) / o.steering_range
        rear = -front
        if len(pulses) > 2:
            rear = 0.0 if not pulses[2] else STEERING_MAX * (pulses[2] - o.rear_straight) / o.rear_range
        self.hal.write(Outputs(round(motors[0]), round(front), round(rear)), now)


def virtual_bus(config: Config, setup: GuardSetup) -> VirtualPi:
    """Return a virtual servo board: `hal_options.bus: virtual`."""
    return VirtualPi(config, setup)

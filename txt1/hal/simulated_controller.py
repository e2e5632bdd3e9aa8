"""A simulated vehicle under a controller that closes its own speed loop, as motor controllers and rover boards do."""

import asyncio
from collections.abc import Callable
from math import copysign
from typing import Final, Generic, Protocol, TypeVar

from txt1.config import Config
from txt1.control.limits import Outputs
from txt1.hal.registry import create_sim
from txt1.link.base import End, Link, connect
from txt1.link.virtual_device import VirtualDevice
from txt1.model.vehicle import PWM_MAX, STEERING_MAX, outputs_of

# s between two steps of a controller's loops
LOOP_PERIOD: Final = 0.005
# proportional gain of the loop: counts for a speed error, as a share of the counts that make this speed
LOOP_GAIN: Final = 1.0
# integral gain of the loop, 1/s
INTEGRAL_GAIN: Final = 4.0


class SimulatedCar:
    """A simulated vehicle; call `move` again and again."""

    def __init__(self, config: Config) -> None:
        self.hal = create_sim(config.model_copy(update={"hal": "sim"}))
        self.vehicle = self.hal.vehicle
        # integrals of the loops, m/s: of the right and left motor, or of the only motor
        self._sides = [0.0, 0.0]
        self._time = 0.0

    @property
    def paths(self) -> tuple[float, float]:
        """Distances that the right and the left wheel have rolled, m."""
        return self.vehicle.motion[6], self.vehicle.motion[7]

    @property
    def speeds(self) -> tuple[float, float]:
        """Speeds of the right and the left side, m/s; of the whole vehicle, if its wheels steer."""
        motion = self.vehicle.motion
        return (motion[4], motion[5]) if self.vehicle.skids else (motion[3], motion[3])

    @property
    def voltage(self) -> float:
        """Voltage of the pack, V."""
        return max(self.vehicle.battery_readings())

    def move(self, now: float) -> None:
        """Move with the last outputs until `now`, s since power-up."""
        self.vehicle.advance_to(now)

    def counts(self, now: float, right: float | None, left: float | None = None) -> tuple[float, float]:
        """Return the motors' counts for speeds in m/s, by the loops; None lets a motor roll."""
        dt, self._time = now - self._time, now
        made = []
        for side, (wanted, v) in enumerate(zip((right, left), self.speeds, strict=True)):
            if wanted is None or wanted == 0.0:
                self._sides[side] = 0.0
                made.append(0.0)
                continue
            error = wanted - v
            self._sides[side] = min(max(self._sides[side] + INTEGRAL_GAIN * error * dt, -1.0), 1.0)
            speed = wanted + LOOP_GAIN * error + self._sides[side]
            parameters = self.vehicle.parameters
            counts = copysign(abs(speed) / parameters.speed_gain + parameters.dead_band, speed)
            made.append(min(max(counts, -PWM_MAX), PWM_MAX))
        return made[0], made[1]

    def steer(self, now: float, motor: float, share: float) -> None:
        """Put out the motor's counts, and a share of the steering's range, left positive."""
        steering = round(STEERING_MAX * share)
        self.hal.write(Outputs(round(motor), -steering, steering), now)

    def skid(self, now: float, right: float, left: float) -> None:
        """Put out the counts of both sides' motors."""
        motor, steering = outputs_of(right, left)
        self.hal.write(Outputs(round(motor), -round(steering), round(steering)), now)


class Controller(VirtualDevice):
    """A virtual motor controller, with a simulated car behind it.

    `step` is its loops; `received` takes the host's bytes.
    """

    def __init__(self, config: Config) -> None:
        self.car = SimulatedCar(config)
        self.line: End = self
        """The controller's end of the line, if needed with faults."""
        self._began = 0.0
        self._task: asyncio.Task[None] | None = None

    def step(self, now: float) -> None:
        """Step the controller's loops; `now` is s since power-up."""
        raise NotImplementedError

    @property
    def now(self) -> float:
        """Seconds since power-up."""
        return asyncio.get_running_loop().time() - self._began

    async def power_up(self) -> None:
        """Start the controller's loops."""
        self._began = asyncio.get_running_loop().time()
        await self.car.hal.open()
        self._task = asyncio.create_task(self._run())

    async def power_down(self) -> None:
        """Stop the loops; harmless when they are stopped already."""
        if self._task is not None:
            self._task.cancel()
            self._task = None
        await self.car.hal.close()

    async def ended(self, duration: float | None = None) -> None:
        """Wait for `duration` seconds, None: for ever; raises an error of the loops."""
        assert self._task is not None
        await asyncio.wait([self._task], timeout=duration)
        if self._task.done():
            self._task.result()

    async def _run(self) -> None:
        while True:
            self.step(self.now)
            await asyncio.sleep(LOOP_PERIOD)


class Powered(Protocol):
    """A virtual device that is powered up when a host opens its port."""

    line: End

    async def power_up(self) -> None:
        """Start the device."""

    async def power_down(self) -> None:
        """Stop the device; harmless when it is stopped already."""


D = TypeVar("D", bound=Powered)


class ControllerPort(Generic[D]):
    """A port with a controller behind it, in the same process and on the same clock."""

    def __init__(self, address: str, make: Callable[[], D]) -> None:
        self.address, self._make = address, make
        self.device: D | None = None

    async def open(self, end: End) -> Link:
        """Return a link to the controller, powered up first if needed."""
        if self.device is None:
            self.device = self._make()
            await self.device.power_up()
        return connect(end, self.device.line)[0]

    async def close(self) -> None:
        """Power the controller down."""
        if self.device is not None:
            device, self.device = self.device, None
            await device.power_down()

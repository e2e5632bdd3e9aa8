"""A simulated vehicle for its hardware layer: takes outputs, returns sensor readings; the caller moves time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import cos, floor, isfinite, nan, sin, tan
from typing import Final, Protocol

from txt1.kernel.clock import Clock
from txt1.model.kinematics import wrap_angle
from txt1.model.vehicle import Geometry
from txt1.sim.battery import Supply, load, voltage_share
from txt1.sim.dynamics import Motion, VehicleState, at_voltage, dynamics, move
from txt1.sim.parameters import Batteries, Box, Faults, Noise, VehicleParameters
from txt1.sim.random_streams import random_stream
from txt1.sim.room import Room

# changes of the floor's drag a second
NOISE_RATE: Final = 50

# s without motion after which the vehicle counts as standing
INSTANT: Final = 1e-9


class SharedWorld(Protocol):
    """The parts of a world (`txt1.sim.world`) that a vehicle in it, and its hardware layer, need."""

    room: Room

    @property
    def vehicles(self) -> list[Vehicle]:
        """The vehicles in the order of their arrival."""

    def add(self, vehicle: Vehicle) -> None:
        """Add a vehicle."""

    def in_the_way(self, vehicle: Vehicle, x: float, y: float, theta: float, margin: float = 0.0) -> str | None:
        """Return the thing that a vehicle at (x, y, theta) would touch, in words."""

    def moving(self, vehicle: Vehicle, time: float) -> list[Box]:
        """Return the movers' boxes at `time`, s of a vehicle's own clock."""

    def expect(self, vehicle: Vehicle, clock: Clock) -> None:
        """Prepare for a run of a vehicle's robot."""

    def advance(self, vehicle: Vehicle, time: float) -> None:
        """Move all vehicles until this vehicle's `time`."""

    def contact(self, vehicle: Vehicle, after: Motion, until: float) -> Motion:
        """Return the motion of a vehicle at `until`, `after` unless something is in its way."""

    def look_round(self, vehicle: Vehicle) -> None:
        """Find the things that may get in a vehicle's way."""


class Vehicle:
    """A vehicle in a world, with batteries, encoders, power switches and seeded noise.

    Args:
        world: the world in which it stands.
        parameters: parameters of the dynamics.
        body: dimensions of the body.
        batteries: their charge, and the load of the electronics.
        noise: standard deviations of its random values.
        start: pose (x, y, theta) in the room, m and rad.
        seed: repeats every random value.
        name: its robot's name.

    Raises ValueError: there is no room for it at the start.
    """

    def __init__(
        self,
        world: SharedWorld,
        parameters: VehicleParameters,
        body: Geometry,
        batteries: Batteries,
        noise: Noise,
        start: tuple[float, float, float],
        seed: int,
        name: str = "",
    ) -> None:
        self.world = world
        self.dynamics = dynamics(parameters, body)
        # function (motion, motor, front, rear, s, drag) -> the motion after s; None: the package's own physics
        self.physics: Callable[[Motion, float, float, float, float, float], Motion] | None = None
        self.parameters = parameters
        self.skids = body.steering == "skid"
        """Whether its sides run at two speeds."""
        if self.skids:
            from txt1.sim.skid import move as move_sides

            self._move_sides = move_sides
        self.body, self.noise, self.name = body, noise, name
        self.faults = Faults()
        self.atx_on = self.esc_on = True
        self.time = 0.0
        """Time of this vehicle, s since its robot's run began."""
        self.began = 0.0
        """Time at which this run began, s since the first run in this world."""
        self.running = False
        """Whether its run has begun."""
        self.accompanied = False
        """Whether other vehicles move in this world."""
        self.piece_ends = 0.0
        """Time until which the floor's drag stays the same, s."""
        self.free = (0.0, 0.0, 0.0, 0.0)
        """Least and largest x and y between which nothing is in reach."""
        self.crowded = False
        """Whether an obstacle or another vehicle may be in reach."""
        self._drag_rng = random_stream(seed, "drag")
        self.supply = Supply(batteries, noise.battery, random_stream(seed, "battery"))
        # The wheels may stop anywhere between two edges of the encoder disc.
        phases = random_stream(seed, "encoder phases")
        self._right_counts, self._left_counts = phases.random(), phases.random()
        self._counts_per_m = 1.0 / body.count_length
        # present drag of the floor, as a share of the speed
        self.drag = 0.0
        self._drag_count = 0
        self._outputs = (0.0, 0.0, 0.0)
        # outputs and steering angles with which it stands and is not moved
        self._rest = (0.0, 0.0, 0.0, nan, nan)
        self.supply.settle(0.0, None)
        # the motor's voltage, as a share of the voltage for which its parameters hold
        self._strength = voltage_share(parameters, self.supply.voltage)
        # the 29th attribute: CPython finds those of an object with more of them slowly
        self.motion: Motion = VehicleState()
        self._put_down(*start)
        world.add(self)

    @property
    def state(self) -> VehicleState:
        """The vehicle's pose and motion."""
        return VehicleState(*self.motion)

    @state.setter
    def state(self, state: VehicleState) -> None:
        self.motion = state
        self.world.look_round(self)

    @property
    def pose(self) -> tuple[float, float, float]:
        """The vehicle's pose (x, y, theta) in the room, m and rad."""
        return self.motion[:3]

    def outline(self, motion: Sequence[float]) -> Box:
        """Return the body's outline at a pose, or in a motion, whose first three fields are a pose."""
        x, y, theta = motion[:3]
        if self.body.centre:
            x, y = x + self.body.centre * cos(theta), y + self.body.centre * sin(theta)
        return Box(x, y, self.body.length, self.body.width, theta)

    # -- outputs -----------------------------------------------------------------------------------------------

    def command(self, motor: float, front: float, rear: float) -> None:
        """Hold these PWM counts on motor and steering from now on."""
        # CPython compares floats with floats quickly
        self._outputs = float(motor), float(front), float(rear)

    def place(self, x: float, y: float, theta: float) -> None:
        """Put the vehicle down at a pose in the room, at rest; m and rad.

        Raises ValueError: there is no room at this pose, or it is not finite.
        """
        self._put_down(x, y, theta)
        self.world.look_round(self)

    def _put_down(self, x: float, y: float, theta: float) -> None:
        theta = wrap_angle(theta)
        if not (isfinite(x) and isfinite(y) and isfinite(theta)):
            raise ValueError(f"the vehicle cannot stand at ({x:g}, {y:g}, {theta:g}): a pose is finite")
        obstacle = self.world.in_the_way(self, x, y, theta)
        if obstacle is not None:
            raise ValueError(f"the vehicle at ({x:g}, {y:g}, {theta:g}) sticks into {obstacle}")
        self.motion = self.state._replace(x=x, y=y, theta=theta, v=0.0, spin=0.0)

    # -- time --------------------------------------------------------------------------------------------------

    def advance_to(self, time: float) -> None:
        """Move the vehicle until `time`, s since its robot's run began; an earlier time changes nothing."""
        if time > self.time:
            if self.accompanied:
                self.world.advance(self, time)
            else:
                self.move_to(time)

    def rewind(self) -> None:
        """Set its time to 0 again, for another run."""
        self.supply.rewind(self.time)
        self._drag_count = 0
        self.time = self.piece_ends = 0.0

    def move_to(self, time: float) -> None:
        """Move until `time`, regardless of other vehicles."""
        while (now := self.time) < time:
            if now >= self.piece_ends:
                self._draw_drag()
            if now >= self.supply.settles:
                self.supply.settle(now, self.faults.voltage)
                self._strength = voltage_share(self.parameters, self.supply.voltage)
            until = time if time < self.piece_ends else self.piece_ends
            after = self.motion_at(until)
            x_min, x_max, y_min, y_max = self.free
            if not (x_min < after[0] < x_max and y_min < after[1] < y_max) and (self.crowded or after != self.motion):
                after = self.world.contact(self, after, until)
            self.arrive(after, until)

    def finish_piece(self) -> None:
        """Move to the end of the present drag's interval, and draw the next drag."""
        self.move_to(self.piece_ends)
        self._draw_drag()

    def motion_at(self, time: float) -> Motion:
        """Return the motion at a time before the drag changes, if nothing is in the way."""
        motor, front, rear = self._outputs
        if self.supply.cut_off or not self.esc_on:
            motor = 0.0
        before, dt = self.motion, time - self.time
        stands = not (before[3] or before[8])
        # this saves 5 % of an idle simulation
        if stands and (motor, front, rear, before[4], before[5]) == self._rest:
            return before
        driven = motor if self._strength == 1.0 else at_voltage(motor, self.parameters.dead_band, self._strength)
        if self.physics is not None:
            after = self.physics(before, driven, front, rear, dt, self.drag)
        elif self.skids:
            after = self._move_sides(before, driven, rear, dt, self.drag, self.parameters, self.body)
        else:
            after = move(before, driven, front, rear, dt, self.drag, self.dynamics)
        if stands and dt > INSTANT and after == before:
            self._rest = motor, front, rear, before[4], before[5]
        return after

    def arrive(self, after: Motion, until: float) -> None:
        """Take a motion at a time; count the encoders' ticks and the motors' load since the last motion."""
        supply = self.supply
        before, dt, powered = self.motion, until - self.time, not supply.cut_off
        self.time, self.motion = until, after
        # the encoders need the ATX supply's 5 V
        if after is not before and powered and self.atx_on:
            faults, counts_per_m = self.faults, self._counts_per_m
            # fields 6 and 7 are the paths rolled by the right and the left encoder wheel
            if not faults.right_encoder:
                self._right_counts += (after[6] - before[6]) * counts_per_m
            if not faults.left_encoder:
                self._left_counts += (after[7] - before[7]) * counts_per_m
        if powered and self.esc_on and abs(self._outputs[0]) > self.parameters.dead_band:
            supply.drawn += dt * (self._load(after) if supply.batteries.by_speed else 1.0)
        else:
            supply.drawn += dt * (supply.batteries.idle_load if self.atx_on else supply.batteries.standby_load)

    def _load(self, motion: Motion) -> float:
        """Return the battery's load while driving, as a share of the full load."""
        body = self.body
        bend = (tan(motion[4]) - tan(motion[5])) * body.radius_min / body.wheelbase
        return load(self.supply.batteries, motion[3], bend)

    def _draw_drag(self) -> None:
        """Draw the floor's drag for the next 20 ms."""
        self.drag = self.noise.drag * self._drag_rng.gauss()
        # whole multiples of the period, so that it does not matter how the caller divides the time; the quotient is
        # exactly the float of the scheduler's tick
        self._drag_count += 1
        self.piece_ends = self._drag_count / NOISE_RATE

    # -- sensors -----------------------------------------------------------------------------------------------

    def sense(self, time: float) -> tuple[tuple[int, int], tuple[float, float], bool, tuple[float, float, float]]:
        """Return the values for a HAL at `time`: encoder counts, battery readings (V), whether they are cut
        off, pose.
        """
        self.advance_to(time)
        supply = self.supply
        if self.time >= supply.read_until:
            supply.read(self.time, self.faults.voltage)
        counts = floor(self._right_counts), floor(self._left_counts)
        return counts, supply.readings, supply.cut_off, self.motion[:3]

    def encoder_counts(self) -> tuple[int, int]:
        """Return the counts of the right and left encoder since the start, forward positive."""
        return floor(self._right_counts), floor(self._left_counts)

    def battery_readings(self) -> tuple[float, float]:
        """Return readings of the two packs' voltages, V, with the converter's noise; 0 for a pack that is not
        connected.
        """
        self.supply.read(self.time, self.faults.voltage)
        return self.supply.readings

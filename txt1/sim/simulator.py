"""The simulated robot as its hardware layer sees it: outputs in, sensor readings out, time moved by the caller."""

from __future__ import annotations

from math import floor, hypot, isfinite
from typing import Final

import numpy as np

from txt1.model.battery import CUT_OFF_V
from txt1.model.kinematics import wrap_angle
from txt1.model.vehicle import Geometry
from txt1.sim.battery import Packs, discharge
from txt1.sim.parameters import Batteries, Faults, Noise, VehicleParameters
from txt1.sim.room import Room, clearance
from txt1.sim.vehicle import DEAD_BAND, Motion, VehicleState, dynamics, move

NOISE_RATE: Final = 50
"""The floor's drag changes so many times a second."""

SETTLE_PERIOD: Final = 1.0
"""The packs' charge is brought up to date once in so many seconds."""

BATTERY_NOISE_PERIOD: Final = 1.0
"""A voltage reading is good for so many seconds."""


class Simulator:
    """A vehicle in a room, with batteries, encoders, power switches and seeded noise.

    Of its attributes there are fewer than 30 on purpose: CPython finds those of a larger object more slowly.

    Args:
        vehicle: parameters of the dynamics.
        body: dimensions.
        room: the four walls.
        batteries: their charge, and the load of the electronics.
        noise: what is random.
        start: pose (x, y, theta) in the room, m and rad.
        seed: repeats every random value.

    """

    def __init__(
        self,
        vehicle: VehicleParameters,
        body: Geometry,
        room: Room,
        batteries: Batteries,
        noise: Noise,
        start: tuple[float, float, float],
        seed: int,
    ) -> None:
        self.dynamics = dynamics(vehicle, body)
        self.body = body
        self.room = room
        self.packs = Packs(batteries.used_1, batteries.used_2)
        self.batteries = batteries
        self.noise = noise
        self.faults = Faults()
        self.atx_on = True
        self.esc_on = True
        self.time = 0.0
        drag_seed, battery_seed, phase_seed = np.random.SeedSequence(seed).spawn(3)
        self._drag_rng = np.random.default_rng(drag_seed)
        self._battery_rng = np.random.default_rng(battery_seed)
        # The wheels stop anywhere between two edges of the encoder disc.
        phases: list[float] = np.random.default_rng(phase_seed).random(2).tolist()
        self._right_counts, self._left_counts = phases[0], phases[1]
        self._drags: list[float] = []
        self._drag = 0.0
        self._drag_count = 0
        self._drag_ends = 0.0
        self._outputs = (0.0, 0.0, 0.0)
        self._voltage_noise = (0.0, 0.0)
        self._readings = (0.0, 0.0)
        self._voltage_noise_ends = 0.0
        self._drawn = 0.0  # seconds of full load since the packs were settled
        self._settle_due = 0.0
        self.voltages = self.packs.voltages()
        """Of the two packs, V; 0 where none is fitted."""
        self.cut_off = False
        """Whether the cut-off circuit has opened: no pack is left above 9.25 V."""
        self._settle_batteries()
        self._counts_per_m = 1.0 / body.count_length
        # as long as the centre is inside this, the walls are out of reach whatever the heading
        reach = 0.5 * hypot(body.length, body.width)
        self._free = 0.5 * room.length - reach, 0.5 * room.width - reach
        self._motion: Motion = VehicleState()
        self.place(*start)

    @property
    def state(self) -> VehicleState:
        """Where the vehicle is and what it does."""
        return VehicleState(*self._motion)

    @state.setter
    def state(self, state: VehicleState) -> None:
        self._motion = state

    @property
    def pose(self) -> tuple[float, float, float]:
        """The vehicle's pose (x, y, theta) in the room, m and rad."""
        return self._motion[:3]

    # -- outputs -----------------------------------------------------------------------------------------------

    def command(self, motor: float, front: float, rear: float) -> None:
        """Hold these PWM counts on motor and steering from now on."""
        self._outputs = motor, front, rear

    def place(self, x: float, y: float, theta: float) -> None:
        """Put the vehicle down at a pose in the room, at rest; m and rad.

        Raises:
            ValueError: it would stick into a wall, or the pose is not finite.

        """
        theta = wrap_angle(theta)
        if not (isfinite(x) and isfinite(y) and isfinite(theta)):
            raise ValueError(f"the vehicle cannot stand at ({x:g}, {y:g}, {theta:g}): a pose is finite")
        if clearance(x, y, theta, self.room, self.body) < 0.0:
            raise ValueError(
                f"the vehicle at ({x:g}, {y:g}, {theta:g}) sticks into a wall of the "
                f"{self.room.length:g} x {self.room.width:g} m room"
            )
        self.state = self.state._replace(x=x, y=y, theta=theta, v=0.0)

    # -- time --------------------------------------------------------------------------------------------------

    def advance_to(self, time: float) -> None:
        """Let the robot move until `time`, in seconds since the start; an instant in the past changes nothing."""
        while self.time < time:
            if self.time >= self._drag_ends:
                self._draw_drag()
            until = time if time < self._drag_ends else self._drag_ends
            self._advance(until - self.time)
            self.time = until

    def _advance(self, dt: float) -> None:
        if self.time >= self._settle_due:
            self._settle_batteries()
        motor, front, rear = self._outputs
        if self.cut_off or not self.esc_on:
            motor = 0.0
        before = self._motion
        after = move(before, motor, front, rear, dt, self._drag, self.dynamics)
        if after != before:
            self._moved(before, after)
        if abs(motor) > self.dynamics[DEAD_BAND]:
            self._drawn += dt
        else:
            self._drawn += dt * (self.batteries.idle_load if self.atx_on else self.batteries.standby_load)

    def _moved(self, before: Motion, after: Motion) -> None:
        """Stop at a wall, and count what the encoders see."""
        x_free, y_free = self._free
        if not (-x_free < after[0] < x_free and -y_free < after[1] < y_free):
            after = self._stop_at_wall(VehicleState(*before), VehicleState(*after))
        self._motion = after
        if self.atx_on and not self.cut_off:  # without the ATX supply's 5 V the encoders see nothing
            # fields 6 and 7 are the paths rolled by the right and the left encoder wheel
            if not self.faults.right_encoder:
                self._right_counts += (after[6] - before[6]) * self._counts_per_m
            if not self.faults.left_encoder:
                self._left_counts += (after[7] - before[7]) * self._counts_per_m

    def _settle_batteries(self) -> None:
        """Take from the packs what was drawn since the last time; they change too slowly to do it more often."""
        self._settle_due = self.time + SETTLE_PERIOD
        self.packs = discharge(self.packs, self._drawn)
        self._drawn = 0.0
        self.voltages = self.packs.voltages()
        self._read_batteries()
        fitted = [voltage for voltage in self.voltages if voltage]  # without any, the external supply feeds us
        self.cut_off = bool(fitted) and max(fitted) <= CUT_OFF_V

    def _stop_at_wall(self, before: VehicleState, after: VehicleState) -> VehicleState:
        """The state at contact if the step ends in a wall: pose and wheels as before it, speed 0."""
        room, body = self.room, self.body
        gap = clearance(after.x, after.y, after.theta, room, body)
        if gap >= 0.0 or gap >= clearance(before.x, before.y, before.theta, room, body):
            return after  # not there yet, or on its way out
        return before._replace(v=0.0, phi_front=after.phi_front, phi_rear=after.phi_rear)

    def _draw_drag(self) -> None:
        """Take the floor's drag for the next 20 ms."""
        if not self._drags:
            self._drags = (self.noise.drag * self._drag_rng.standard_normal(256)).tolist()
        self._drag = self._drags.pop()
        # whole multiples of the period, so that it does not matter how the caller cuts up the time; the quotient is
        # the very float that the scheduler's tick has
        self._drag_count += 1
        self._drag_ends = self._drag_count / NOISE_RATE

    # -- sensors -----------------------------------------------------------------------------------------------

    def sense(self, time: float) -> tuple[tuple[int, int], tuple[float, float], bool, tuple[float, float, float]]:
        """All that a HAL reports, at `time`: encoder counts, battery readings (V), whether they are cut off, pose."""
        self.advance_to(time)
        return self.encoder_counts(), self.battery_readings(), self.cut_off, self.pose

    def encoder_counts(self) -> tuple[int, int]:
        """Counts of the right and left encoder since the start, forward positive."""
        return floor(self._right_counts), floor(self._left_counts)

    def battery_readings(self) -> tuple[float, float]:
        """Readings of the two packs' voltages, V, with the converter's noise; 0 where no pack is fitted."""
        while self.time >= self._voltage_noise_ends:  # one draw per period, however seldom somebody looks
            one, two = self._battery_rng.standard_normal(2).tolist()
            self._voltage_noise = one * self.noise.battery, two * self.noise.battery
            self._voltage_noise_ends += BATTERY_NOISE_PERIOD
            self._read_batteries()
        return self._readings

    def _read_batteries(self) -> None:
        """Keep the readings: they are looked at 61 times a second and change once, with voltages and noise."""
        (one, two), (noise_one, noise_two) = self.voltages, self._voltage_noise
        self._readings = (one + noise_one if one else 0.0), (two + noise_two if two else 0.0)

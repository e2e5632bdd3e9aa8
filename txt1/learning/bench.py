"""A trial on the bare simulation: the same vehicle, loops, odometry and instants as on the runtime, without its tasks.

For studies over thousands of trials. Nothing is modelled anew: `Vehicle` (and with it `txt1.sim.vehicle.move`),
`VelocityLoops` and the odometry's equations are the runtime's own, called in the order in which the scheduler runs the
tasks. So a trial here and one on the running robot agree to the last bit (tests/unit/learning/test_bench.py).
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from txt1.control.limits import clip
from txt1.control.parameters import Limits
from txt1.control.schedule import ANGULAR_GAINS, LINEAR_GAINS, Schedule
from txt1.learning.trial import DONE, DRIVE, MOVE, REST, Pose, Trial
from txt1.model.odometry import Odometry, advance, body_velocity, wheel_speed
from txt1.model.vehicle import STEERING_MAX
from txt1.sensors.light import See
from txt1.sim.simulator import Vehicle
from txt1.tasks.controller import VelocityLoops

CONTROL, LIGHT, LEARN = range(3)
_CYCLE_MS: Final = 400
_INSTANTS: Final = sorted(
    [(ms, CONTROL) for ms in range(0, _CYCLE_MS, 20)]
    + [(ms, LIGHT) for ms in range(0, _CYCLE_MS, 16)]
    + [(ms, LEARN) for ms in range(0, _CYCLE_MS, 50)]
)
"""When which task runs, ms from the start of a cycle of 400 ms, in the scheduler's order."""

DT: Final = 0.02


class Bench:
    """A simulated robot with its velocity loops, a set-point, and nothing else.

    Args:
        vehicle: the vehicle.
        limits: of the set-points and the motor.

    """

    def __init__(self, vehicle: Vehicle, limits: Limits) -> None:
        self.vehicle = vehicle
        self.odometry = Odometry()
        self.pose: Pose = vehicle.pose
        self.command = (0.0, 0.0)
        self._limits = limits
        self._loops = VelocityLoops()
        self._schedule = Schedule(ANGULAR_GAINS)
        self._counts: tuple[int, int] = vehicle.encoder_counts()
        self._still = True
        self._last = -DT

    def control(self, now: float) -> None:
        """The controller task's and the encoder task's cycle at `now` s."""
        vehicle = self.vehicle
        vehicle.advance_to(now)
        v, omega = self.command
        v_now, omega_now = self.odometry.v, self.odometry.omega
        if v_now == 0.0 and v == 0.0:
            self._loops.clear()
            vehicle.command(0, 0, 0)
        else:
            motor, steering = self._loops.step(v, omega, v_now, omega_now, LINEAR_GAINS, self._schedule.at(v_now), DT)
            motor, steering = clip(motor, self._limits.motor_max), clip(steering, STEERING_MAX)
            vehicle.command(int(motor), int(-steering), int(steering))
        dt, self._last = now - self._last, now  # not 0.02 to the last bit, and the runtime divides by it
        counts = vehicle.encoder_counts()
        right, left = counts[0] - self._counts[0], counts[1] - self._counts[1]
        self._counts = counts
        if right or left or not self._still:
            body = vehicle.body
            v, omega = body_velocity(
                wheel_speed(right, body.count_length, dt), wheel_speed(left, body.count_length, dt), body.track_width
            )
            self.odometry = advance(self.odometry, v, omega, dt)
            self._still = not (right or left)
        self.pose = vehicle.pose


def run_trial(trial: Trial, vehicle: Vehicle, see: See, limits: Limits, first_ms: int = 0) -> None:
    """Nothing; the trial is done.

    Args:
        trial: what to do.
        vehicle: the robot, at time 0.
        see: its light sensors.
        limits: of the set-points and the motor.
        first_ms: when the learning begins, ms since the simulation's start; before, the robot rests.

    """
    bench = Bench(vehicle, limits)
    for ms, what in instants():
        now = ms / 1000.0
        if what == CONTROL:
            bench.control(now)
        elif ms < first_ms:
            continue
        elif what == LIGHT:
            if trial.phase is REST or trial.phase is DRIVE:
                vehicle.advance_to(now)
                trial.agent.see(see(vehicle.pose), bench.odometry)
        else:
            if trial.phase is MOVE and bench.odometry.v == bench.odometry.omega == 0.0:
                vehicle.advance_to(now)
                vehicle.place(*trial.start)
                trial.placed(now)
            bench.command = trial.tick(now, True, bench.pose, bench.odometry)
            if trial.phase is DONE:
                return


def instants(begin: int = 0, end: int | None = None) -> Iterator[tuple[int, int]]:
    """When which task runs, from `begin` up to before `end`, ms; for ever without an end."""
    cycle = begin - begin % _CYCLE_MS
    while True:
        for offset, what in _INSTANTS:
            ms = cycle + offset
            if end is not None and ms >= end:
                return
            if ms >= begin:
                yield ms, what
        cycle += _CYCLE_MS

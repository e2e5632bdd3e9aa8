"""A policy that drives: it judges every reading in a thread, and commands through the safety gate like any source.

Its priority is below every human's and every program's (`txt1.teaching.addition`). Any of them takes the wheel from it
at once. When the wheel is free again, it asks again.

It stands, and gives the reason in a line, when

- its sensor is late or frozen: the same bytes again and again while the car moves;
- a reading is from another device, or from another place, than in the lessons: for good;
- its outputs are not finite: for good;
- its doubt is too large. It drives slower from `doubt_slow` on, and stands beyond `doubt_stop`. It goes on by itself
  when the doubt is small again, for which a human may have to drive on;
- it was stopped for more than 0.5 s without its asking (`txt1.control.commander`), or by its sensor. It goes on when
  the robot is armed anew.

A judgement is used at the tick after it was made, so a run in virtual time repeats to the last bit.
"""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import AsyncIterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import asynccontextmanager
from functools import partial
from math import inf
from typing import Any, Final, NamedTuple

import numpy as np

from txt1.control.holding import PAUSE
from txt1.errors import A_STOP, ConfigError
from txt1.kernel.ticks import Ticks
from txt1.robot import Robot
from txt1.sensors.base import Reading
from txt1.sensors.readings import Image, Scan
from txt1.teaching.features import Unfit
from txt1.teaching.foreign_policy import ForeignPolicy
from txt1.teaching.onnx_file import PolicyError
from txt1.teaching.policy import Judgement, Policy
from txt1.telemetry.messages import define
from txt1.telemetry.topics import Rule, Topic, declare

POLICY: Final = "policy"
"""The name of the source of commands, in recordings too."""
TICK: Final = 0.02
"""s between two commands."""
READING_LATE: Final = 0.3
"""s without a reading, or three periods of the sensor if they are longer, after which it stands."""
FROZEN: Final = 0.5
"""s of the same reading, to the last bit, after which it stands if the car is moving."""
STANDING_SPEED: Final = 0.1
"""m/s; a slower car counts as standing."""
DOUBTS_AVERAGED: Final = 5
"""Number of judgements whose mean doubt is used."""
ASK_AGAIN_SHARE: Final = 0.9
"""Share of its period after which a policy from elsewhere is asked again: sensors are not punctual."""
STOPPED: Final = "the robot was stopped; the policy goes on when it is armed anew (press m)"


class Look(NamedTuple):
    """A policy's judgement of a reading, and its consequences."""

    steering: float
    """Share of full lock, left positive."""
    speed: float
    """Share of the largest speed in the lessons."""
    doubt: float
    """Disagreement of its networks."""
    slow: float
    """Doubt from which it drives slower."""
    stop: float
    """Doubt from which it stands."""
    pace: float
    """Share of the speed that the doubt allows, 0 to 1."""
    v: float
    """Speed that it would command, m/s."""
    omega: float
    """Yaw rate that it would command, rad/s."""
    state: str
    """"drives", "waits" for the wheel, or the reason for standing."""


LOOK: Final = declare(
    Topic(
        "/teaching",
        Look,
        "m/s, rad/s",
        define(
            "txt1_msgs/Look",
            "std_msgs/Header header\nfloat64 steering\nfloat64 speed\nfloat64 doubt\nfloat64 slow\nfloat64 stop\n"
            "float64 pace\nfloat64 v\n"
            "float64 omega\nstring state",
        ),
        Rule.EVENT,
        "what a taught policy makes of each reading, and how much it doubts",
        make=Look._asdict,
    )
)


class Pilot:
    """A policy on a robot; `start` lets it drive.

    Raises ConfigError: the robot lacks a sensor of the policy's, or is another car.
    """

    def __init__(self, robot: Robot, policy: Policy | ForeignPolicy) -> None:
        card = policy.card
        for sight in card.sees:
            if sight.kind != "odometry" and sight.sensor not in robot.sensors:
                there = ", ".join(robot.sensors) or "none"
                raise ConfigError(
                    f"the policy sees by '{sight.sensor}' ({sight.kind}), which this robot has not; it has: {there}"
                )
        radius = robot.config.geometry.radius_min
        if abs(radius - card.radius_min) > 0.01 * card.radius_min:
            raise ConfigError(
                f"the policy was taught on a car that turns within {card.radius_min:g} m; this one needs {radius:g} m"
            )
        self.policy = policy
        self.state = "waits"
        self._robot = robot
        self._source = robot.source(POLICY)
        self._first = robot.sensors[card.sees[0].sensor]
        self._late = max(READING_LATE, 3.0 * self._first.period)
        self._thread = ThreadPoolExecutor(1, "txt1 policy")
        self._newest: Reading[Any] | None = None
        self._judging: tuple[float, asyncio.Future[Judgement]] | None = None
        self._judged = -inf
        self._look = Judgement(0.0, 0.0, 0.0)
        self._doubts: deque[float] = deque(maxlen=DOUBTS_AVERAGED)
        self._doubting = False
        self._same: tuple[Any, float] = (None, 0.0)
        """The bytes of the last reading, and the time since which they are the same."""
        self._frozen = False
        self._blind = inf
        """Since when its sensor keeps it standing; inf while it does not."""
        self._epoch: int | None = None
        """Of the arming in which its sensor stopped it."""
        self._failed = ""
        """Why it never drives again; empty if it may."""
        self._told = ""

    def start(self) -> None:
        """Judge every reading from now on, and drive while the wheel is free."""
        self._first.listeners.append(self._heard)
        self._robot.add_task(POLICY, TICK, self._drive)

    async def open(self) -> None:
        """Prepare the thread and the networks, so that no judgement waits for them; raises MissingExtra."""
        await asyncio.get_running_loop().run_in_executor(self._thread, getattr, self.policy, "session")

    async def close(self) -> None:
        """Stop judging."""
        if self._heard in self._first.listeners:
            self._first.listeners.remove(self._heard)
        await asyncio.to_thread(self._thread.shutdown)

    def _heard(self, reading: Reading[Any]) -> None:
        """Begin to judge a reading, unless the last is still being judged."""
        self._newest = reading
        robot, now = self._robot, self._robot.now
        data = _bytes(reading.value)
        if data != self._same[0]:
            self._same = data, now
        if self._judging is not None or self._failed:
            return
        # one from elsewhere is asked at its own rate, if the sensor is quicker
        if isinstance(self.policy, ForeignPolicy) and now - self._judged < ASK_AGAIN_SHARE / self.policy.card.rate:
            return
        values = []
        for sight in self.policy.card.sees:
            if sight.kind == "odometry":
                odometry = robot.odometry
                values.append((odometry.v, odometry.omega))
            elif (last := robot.sensors[sight.sensor].last) is not None and now - last.time <= 2.0 * self._late:
                values.append(last.value)
            else:
                return
        judge = asyncio.get_running_loop().run_in_executor(self._thread, partial(self.policy.judged, values))
        self._judging = now, judge

    async def _drive(self, ticks: Ticks) -> None:
        async for now in ticks:
            self._take(now)
            v, omega, state = self._wanted(now)
            source, epoch = self._source, self._robot.runtime.gate.epoch
            if not self._robot.armed or self._robot.driver.name not in ("", POLICY):
                state, self._blind = "waits", inf
            elif v > 0.0:
                if now - self._blind > PAUSE:
                    self._epoch = epoch
                self._blind = inf
                if source.overruled == A_STOP or self._epoch == epoch:
                    state = STOPPED
                else:
                    if source.overruled:
                        source.request()
                    source.command(v, omega)
            elif source.drives:
                source.release()
                if self._blindness(now):
                    self._blind = now
            self._tell(state, now)

    def _take(self, now: float) -> None:
        """Take a finished judgement."""
        if self._judging is None or not self._judging[1].done():
            return
        (began, future), self._judging = self._judging, None
        try:
            look = future.result()
        except (Unfit, PolicyError) as error:
            self._failed = str(error)
            return
        if not look.finite:
            self._failed = "the policy's outputs are no numbers"
            return
        self._look, self._judged = look, began
        self._doubts.append(look.doubt)
        card = self.policy.card
        pace = self._pace()
        v, omega = self._command(pace)
        self._robot.runtime.bus.publish(
            LOOK, Look(*look, card.doubt_slow, card.doubt_stop, pace, v, omega, self.state), now
        )

    def _pace(self) -> float:
        """Return the share of the speed that the doubt allows: 1 up to `doubt_slow`, 0 from `doubt_stop` on."""
        card = self.policy.card
        doubt = sum(self._doubts) / max(len(self._doubts), 1)
        if doubt >= card.doubt_stop:
            self._doubting = True
        elif doubt <= card.doubt_slow:
            self._doubting = False
        if self._doubting:
            return 0.0
        return min(1.0, (card.doubt_stop - doubt) / max(card.doubt_stop - card.doubt_slow, 1e-9))

    def _command(self, pace: float) -> tuple[float, float]:
        card, look = self.policy.card, self._look
        v = pace * look.speed * min(card.v_max, self._robot.config.safety.v_max)
        return v, look.steering * v / card.radius_min

    def _blindness(self, now: float) -> str:
        """Return why its sensor keeps it standing; empty if it does not."""
        if now - self._judged > self._late:
            return f"'{self._first.name}' is late: no reading for {self._late:g} s"
        stays = now - self._same[1] > max(FROZEN, 2.5 * self._first.period)
        self._frozen = stays and (self._frozen or abs(self._robot.odometry.v) > STANDING_SPEED)
        if self._frozen:
            return f"'{self._first.name}' is frozen: the same reading again and again while the car moves"
        return ""

    def _wanted(self, now: float) -> tuple[float, float, str]:
        """Return v, omega and the state."""
        if self._failed:
            return 0.0, 0.0, self._failed
        if self._judged == -inf:
            return 0.0, 0.0, "no reading yet"
        if blindness := self._blindness(now):
            return 0.0, 0.0, blindness
        pace = self._pace()
        if pace <= 0.0:
            return 0.0, 0.0, "its doubt is too large: no lesson is like this; drive it on"
        v, omega = self._command(pace)
        return (v, omega, "drives") if v > 0.02 else (0.0, 0.0, "stands, as it was taught here")

    def _tell(self, state: str, now: float) -> None:
        if state != self.state:
            self.state = state
            if state not in ("drives", "waits", "no reading yet") and state != self._told:
                self._robot.tell(f"the policy stands: {state}")
            self._told = state


def _bytes(value: Any) -> Any:
    """Return an object that is equal only if the reading is equal to the last bit."""
    match value:
        case Image():
            return value.data
        case Scan():
            return value.ranges.tobytes()
        case np.ndarray():
            return value.tobytes()
    return value


@asynccontextmanager
async def beside(robot: Robot, policy: Policy | ForeignPolicy) -> AsyncIterator[None]:
    """Let the policy drive as soon as the robot is ready; raises ConfigError, MissingExtra."""
    pilot = Pilot(robot, policy)

    async def begin() -> None:
        pilot.start()

    robot.on_ready.append(begin)
    try:
        await pilot.open()
        yield
    finally:
        await pilot.close()

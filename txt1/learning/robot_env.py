"""A task of `txt1.learning.drive_tasks` on the running robot, as a Gymnasium environment (extra `gym`).

    with RobotEnv("light", hal="serial", settings=["serial.port=/dev/ttyUSB0"]) as env:
        seen, _ = env.reset()
        seen, earned, over, late, told = env.step(1)

How it works. The robot runs in a thread of its own, with all its tasks, behind the safety gate. There
`txt1.learning.task` conducts a `StepTrial` as it conducts a learner's trial: it brings the robot to each start, holds
the wheel, and voids an episode that was stopped. At each decision the `StepTrial` hands over what is seen, and takes
the action that `step` was given.

- *Wall clock.* A decision lasts a period. `step` returns when it is over. An action that comes later begins late:
  `info["late_s"]` tells by how much, and `trial.late` counts them. Until then the action before goes on, for at most a
  period; then the robot stands.
- *Starts.* The robot drives to its next start; a simulated one is placed there. With `by_hand` a person puts it there:
  disarm it, carry it, arm it again, and the episode begins where it stands.
- *Stops.* A stop, a disarm, or a person at the wheel voids the episode: `step` returns truncated with the reward 0 and
  `info["void"]`. Nothing of it is to be learned. `reset` waits until the robot is armed again.
- *Recording.* /learning/step has reward and observation of each decision.
"""

import asyncio
import threading
from collections.abc import Awaitable, Callable, Sequence
from contextlib import suppress
from math import inf
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any, ClassVar, Final, NamedTuple

import gymnasium
import numpy as np
from numpy.typing import NDArray

from txt1.config import Config, load
from txt1.errors import HalError, Txt1Error
from txt1.learning.agent import Decision, Readings
from txt1.learning.drive_tasks import RAYS, DriveTask, TaskView, task_named
from txt1.learning.env import Observation, spaces
from txt1.learning.finite_readings import FiniteReadings
from txt1.learning.light_direction import LightFilter
from txt1.learning.task import LearningTask, need_light
from txt1.learning.trial import OVER, Episode, Phase, Pose, ready_to_learn
from txt1.model.odometry import Odometry
from txt1.navigation import PoseSource
from txt1.record.options import to_file
from txt1.robot import Robot

# s that the robot rests on its start
START_REST: Final = 0.5
# s: an action that comes within a tick of the trial is not late
IN_TIME: Final = 0.06


class EnvStep(NamedTuple):
    """What is handed over at a decision."""

    seen: NDArray[np.float32]
    reward: float = 0.0
    terminated: bool = False
    truncated: bool = False
    success: bool = False
    touched: bool = False
    # s by which the action began late
    late: float = 0.0
    # the episode does not count
    void: bool = False


class StepTrial:
    """Episodes of a task by actions from elsewhere; `txt1.learning.task` conducts it. See the module."""

    def __init__(self, task: DriveTask, rng: np.random.Generator, by_hand: bool = False) -> None:
        self.task, self._by_hand = task, by_hand
        # what is seen at each decision, and the actions for it
        self.handed: SimpleQueue[EnvStep] = SimpleQueue()
        self.actions: SimpleQueue[tuple[float, float]] = SimpleQueue()
        self.agent = self
        self.episodes: list[Episode] = []
        self.decided: Callable[[int], None] = lambda _: None
        self.phase = Phase.WAIT
        # along RAYS, m, shape (1, rays); None before the first sweep
        self.ranges: NDArray[np.float64] | None = None
        # actions that began late
        self.late = 0
        self._rng, self._gate, self._filter = rng, FiniteReadings(), LightFilter(spread=inf)
        self._told = Decision(None, None, ())
        # the pose at which the next episode begins
        self.start: Pose = (0.0, 0.0, 0.0)
        self._late, self._since, self._due, self._asked, self._steps = 0.0, 0.0, inf, False, 0
        self._command = (0.0, 0.0)

    def ask(self) -> None:
        """Begin an episode: bring the robot to a new start."""
        x, y, theta = self.task.begin(1, self._rng)[0].tolist()
        self.start = x, y, theta
        self.phase = Phase.MOVE

    def placed(self, now: float) -> None:
        """Note that the robot stands on its start since `now`."""
        self.phase, self._since = Phase.REST, now
        self._filter.clear()
        self._gate.clear()
        self._due, self._asked, self._command, self._steps = inf, False, (0.0, 0.0), 0
        while not self.actions.empty():
            self.actions.get_nowait()

    def see(self, now: float, readings: Readings, odometry: Odometry) -> None:
        """Take a sample of the light, lux."""
        if (passed := self._gate.readings(now, readings)) is not None:
            self._filter.step(passed)

    def look(self, now: float, points: Any, odometry: Odometry) -> None:
        """Take the places where a sweep's beams ended, in the robot's frame, m: the nearest around each ray counts."""
        away = np.abs(np.arctan2(points[:, 1], points[:, 0]) - RAYS[:, None])
        near = np.where(away < 0.5 * (RAYS[1] - RAYS[0]), np.hypot(*points.T), inf)
        self.ranges = near.min(axis=1, initial=inf)[None]

    def tick(
        self, now: float, armed: bool, pose: Pose, odometry: Odometry, touches: bool = False
    ) -> tuple[float, float]:
        """Return the velocity to command, m/s and rad/s, at a pose in the room."""
        if not armed:
            self.void()
        self._since = min(self._since, now)
        if self.phase is Phase.REST:
            seen = self._filter.settled or not self.task.light
            ready = seen and (self.ranges is not None or not self.task.laser)
            if now - self._since < START_REST - 1e-9 or not ready:
                return 0.0, 0.0
            self.phase, self._due = Phase.DRIVE, now
        if self.phase is not Phase.DRIVE:
            return 0.0, 0.0
        if now >= self._due - 1e-9 and not self._asked:
            self._asked = True
            if self._hand(pose, odometry, touches):
                return 0.0, 0.0
        if self._asked and not self.actions.empty():
            self._command = self.actions.get_nowait()
            # the first action of an episode may take its time
            late = now - self._due if self._steps else 0.0
            self._late = late if late > IN_TIME else 0.0
            self.late += self._late > 0.0
            begins = now if self._late or not self._steps else self._due
            self._due, self._asked, self._steps = begins + self.task.period, False, self._steps + 1
            self.decided(0)
        elif now > self._due + self.task.period:
            # whoever drives thinks too long
            self._command = (0.0, 0.0)
        return self._command

    def _hand(self, pose: Pose, odometry: Odometry, touches: bool) -> bool:
        """Hand over what is seen and what came of the last action; return whether the episode is over."""
        seen = TaskView(
            np.array([pose]),
            np.array([[odometry.v, odometry.omega]]),
            np.array([self._filter.readings or (0.0, 0.0, 0.0, 0.0)]),
            np.empty((1, 0)) if self.ranges is None else self.ranges,
            np.array([touches]),
        )
        told = self.task.observed(seen)[0]
        if not self._steps:
            self.task.begun(seen, np.ones(1, bool))
            self._told = Decision(None, None, tuple(told.tolist()))
            self.handed.put(EnvStep(told))
            return False
        rewards, success, lost = (each[0] for each in self.task.judged(seen))
        reward, ended = float(rewards), bool(success | lost)
        late = self._steps * self.task.period >= self.task.time_limit - 1e-9
        self._told = Decision(None, reward, tuple(told.tolist()))
        if ended or late:
            self.phase, self._command = Phase.WAIT, (0.0, 0.0)
            self.decided(OVER)
        self.handed.put(EnvStep(told, reward, ended, late and not ended, bool(success), touches, self._late))
        return ended or late

    def void(self) -> None:
        """The episode does not count."""
        if self.phase is Phase.REST or self.phase is Phase.DRIVE:
            # before its first observation nobody knows of it
            known = self.phase is Phase.DRIVE and (self._steps > 0 or self._asked)
            again = Phase.REST if self._by_hand else Phase.MOVE
            self.phase, self._command, self._since = Phase.WAIT if known else again, (0.0, 0.0), inf
            if known:
                self.handed.put(EnvStep(np.zeros(len(self.task.low), np.float32), truncated=True, void=True))

    def decision(self, odometry: Odometry) -> Decision:
        """Return reward and observation, for recordings."""
        return self._told


class RobotEnv(gymnasium.Env[Observation, Any]):
    """The running robot as an environment; see the module.

    Args:
        task: its name: light, pose, track or clear.
        config: a ready configuration, or None for `settings` (``a.b=c`` each).
        settings: as with ``--set``.
        hal: the hardware layer's name.
        pose: where the robot is; None: as `learning.pose` says.
        by_hand: a person puts the robot on its starts; the first episode begins where it stands.
        arm: whether to arm now; None leaves it to ``safety.auto_arm``.
        log: the file to record to.
        prepare: awaited with the robot before it drives, for sensors of your own.
        run: runs the robot's coroutine; `asyncio.run` by default.

    """

    metadata: ClassVar[dict[str, Any]] = {"render_modes": []}  # type: ignore[misc]

    def __init__(
        self,
        task: str = "light",
        config: Config | None = None,
        *,
        settings: Sequence[str] = (),
        hal: str | None = None,
        pose: Callable[[Robot], PoseSource] | None = None,
        by_hand: bool = False,
        arm: bool | None = None,
        log: Path | None = None,
        prepare: Callable[[Robot], Awaitable[object]] | None = None,
        run: Callable[[Any], object] = asyncio.run,
    ) -> None:
        given = {"hal": hal} if hal else {}
        one = load(None, settings, options=given).config if config is None else config
        self._config = ready_to_learn(one) if task == "light" and one.hal == "sim" else one
        made = task_named(task, self._config)
        self.trial = StepTrial(made, np.random.default_rng(self._config.own_seed), by_hand)
        self.observation_space, self.action_space = spaces(made)
        self._pose, self._arm, self._log, self._prepare, self._by_hand = pose, arm, log, prepare, by_hand
        self._epoch = -1
        self._ready: SimpleQueue[BaseException | None] = SimpleQueue()
        self._failed: BaseException | None = None
        self._thread = threading.Thread(target=self._run, args=(run,), name="txt1 robot", daemon=True)
        self._thread.start()
        if (error := self._ready.get()) is not None:
            raise error

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Bring the robot to a new start; return the first observation. It waits as long as the robot is disarmed."""
        super().reset(seed=seed, options=options)
        trial = self.trial
        while not trial.handed.empty():
            trial.handed.get_nowait()
        asyncio.run_coroutine_threadsafe(self._begin(), self._loop)
        first = self._next().seen
        # whoever armed it anew while it rested has put it there
        self._epoch = self._robot.runtime.gate.epoch
        return first, {}

    def step(self, action: Any) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Carry out a decision on the robot; return observation, reward, terminated, truncated and `info`.

        Raises ValueError: the action is none of the task's; Txt1Error: the robot has failed.
        """
        v, omega = self.trial.task.driven(np.asarray(action)[None])[0].tolist()
        self.trial.actions.put((v, omega))
        one = self._next()
        told = {"success": one.success, "touched": one.touched, "late_s": one.late, "void": one.void}
        return one.seen, one.reward, one.terminated, one.truncated, told

    def close(self) -> None:
        """Stop the robot; raises Txt1Error: it failed, or was not seen to stand."""
        with suppress(RuntimeError):
            # the loop is closed where the robot has ended by itself
            self._loop.call_soon_threadsafe(self._over.set)
        self._thread.join()
        if self._failed is not None:
            raise self._failed

    def _next(self) -> EnvStep:
        while True:
            try:
                return self.trial.handed.get(timeout=0.5)
            except Empty:
                if not self._thread.is_alive():
                    raise self._failed or HalError("the robot has ended") from None

    def _run(self, run: Callable[[Any], object]) -> None:
        try:
            run(self._drive())
        except Txt1Error as error:
            self._failed = error
            self._ready.put(error)

    async def _begin(self) -> None:
        """Bring the robot to a new start, or wait until a person has done so."""
        robot, gate = self._robot, self._robot.runtime.gate
        if not self._by_hand:
            self.trial.ask()
            return
        if self._epoch == gate.epoch:
            robot.tell("put the robot on a new start: disarm it, carry it there, and arm it again")
        while self._epoch == gate.epoch or not robot.armed:
            await asyncio.sleep(0.05)
        self.trial.placed(robot.now)

    async def _drive(self) -> None:
        """Run the robot until the environment is closed."""
        self._loop, self._over = asyncio.get_running_loop(), asyncio.Event()
        about: dict[str, object] = {"environment": self.trial.task.name}
        additions = None if self._log is None else to_file(self._log, about, None)
        async with Robot.open(config=self._config, arm=self._arm, additions=additions) as robot:
            await robot.load_gains()
            if self._prepare is not None:
                await self._prepare(robot)
            if self.trial.task.light:
                await need_light(robot)
            conducted = LearningTask(robot, self.trial, None if self._pose is None else self._pose(robot))
            conducted.start()
            self._robot = robot
            self._ready.put(None)
            ended = asyncio.ensure_future(self._over.wait())
            both: list[asyncio.Future[Any]] = [ended, robot.runtime.scheduler.ended]
            await asyncio.wait(both, return_when=asyncio.FIRST_COMPLETED)
            ended.cancel()

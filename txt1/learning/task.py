"""The learning task: a trial on the running robot, through its public API (thesis 5).

It listens to the light sensors, and a periodic task, `learning`, refreshes the set-point 20 times a second. If the HAL
can place the robot, it is placed at the next start; otherwise it drives there.
"""

import asyncio
from collections.abc import Callable, Sequence
from math import degrees, nan
from typing import Any, Final, NamedTuple

from txt1.config.schema import SensorConfig
from txt1.errors import A_STOP, ConfigError, HalError, NotArmed, Overruled
from txt1.kernel.ticks import Ticks
from txt1.learning.agent import Agent, Doubter, Looker
from txt1.learning.settings import LearningConfig
from txt1.learning.trial import TICK, Episode, Phase, Trial, starts, task_of
from txt1.learning.world import named as world_named
from txt1.learning.world import world_of
from txt1.model.light_sensors import SAMPLE_PERIOD, Readings
from txt1.navigation import Arrival, PoseSource, fused_pose, go_to, map_pose, true_pose, wheel_pose
from txt1.robot import Robot
from txt1.sensors.base import Reading, Sensor
from txt1.sensors.light import topic_of
from txt1.sensors.readings import Scan, TrackerReading, heading
from txt1.sensors.simulated_sensor import SimulatedSensor
from txt1.telemetry.messages import define
from txt1.telemetry.topics import Rule, Topic, declare

# the driver of simulated light sensors
SIMULATED: Final = "sim_light"
# s, the age at which a pose of motion capture is no longer believed
TRACKED: Final = 0.2
# m/s, top speed on the way to a start
TO_START: Final = 0.4
# more than anyone will watch
EPISODES: Final = 10_000
# least distance of the boundary from the simulated room's walls, m
FROM_WALL: Final = 0.5


class LearningStep(NamedTuple):
    """A decision of the learner, or the end of an episode."""

    # from 1
    episode: int
    # row of the learner's table; -1: none
    state: int
    # the decided action; -1: the episode is over
    action: int
    # for the result of the last action; NaN if nothing was learned from it
    reward: float
    # of the actions in this state, after learning
    values: tuple[float, ...]


STEP: Final = declare(
    Topic(
        "/learning/step",
        LearningStep,
        "",
        define(
            "txt1_msgs/LearningStep",
            "std_msgs/Header header\nint32 episode\nint32 state\nint32 action\nfloat64 reward\nfloat64[] values",
        ),
        Rule.EVENT,
        "each decision of the learner, and the end of each episode: action -1",
        make=LearningStep._asdict,
    )
)


class ModelDoubt(NamedTuple):
    """The learner says that its model does not fit what it sees."""

    # from 1
    episode: int
    # the part that the model does not fit
    what: str


DOUBT: Final = declare(
    Topic(
        "/learning/doubt",
        ModelDoubt,
        "",
        define("txt1_msgs/ModelDoubt", "std_msgs/Header header\nint32 episode\nstring what"),
        Rule.EVENT,
        "the learner's model does not fit what it sees; once an episode",
        make=ModelDoubt._asdict,
    )
)


class LearningTask:
    """A trial, conducted on a robot: a `Trial`, or a `StepTrial` whose actions come from elsewhere.

    A disarm voids the episode, and so does another source of commands that takes the wheel. After the arm the robot
    goes to the start once more and repeats the episode.

    `pose` is the robot's place in the room, for the goal and the boundary. None: the simulation's truth; without a
    truth, or if `learning.pose` says so, odometry or the fused pose. `stopped` is asked 20 times a second; the trial is
    over once it returns True.
    """

    def __init__(
        self,
        robot: Robot,
        trial: Any,
        pose: PoseSource | None = None,
        stopped: Callable[[], bool] = lambda: False,
    ) -> None:
        self.trial = trial
        trial.decided = self._tell
        # the last episode is over, or the trial was stopped: no more commands
        self.ended = asyncio.Event()
        self._robot = robot
        # a task without light needs none
        self._light = robot.sensors.get(robot.config.section(LearningConfig).sensor)
        by = robot.config.section(LearningConfig).pose
        self._given = _told_pose(robot, by) if pose is None and by not in ("truth", "odometry") else pose
        self._stopped = stopped
        self._truth = by == "truth" and robot.hal.capabilities.pose
        self._pose = self._given or (true_pose(robot) if self._truth else wheel_pose(robot))
        self._places = robot.hal.capabilities.place
        self._drive: asyncio.Task[Arrival] | None = None
        self._wheel = robot.source("learner")
        # the source that has taken the wheel; the learner waits until the robot is armed anew
        self.overruled = ""
        # the episode in which the learner last said that its model does not fit
        self._doubted = 0
        # of the arming that it waits for to pass
        self._epoch = 0
        sim = robot.config.sim
        blocks = sim.obstacles or sim.movers or sim.room.map is not None
        self._touches: Callable[[], object] = robot.hal.blocked_by if blocks else lambda: False

    def start(self) -> None:
        """Listen to the light sensors during episodes, and add the task to the robot's tasks."""
        trial = self.trial
        if (light := self._light) is not None:
            light.needed = lambda: trial.phase is Phase.REST or trial.phase is Phase.DRIVE
            self._robot.runtime.bus.subscribe(self._see, [light.sensor.topic])
        sweeps = [one.sensor.topic for one in self._robot.sensors.values() if issubclass(one.sensor.topic.type, Scan)]
        if sweeps and isinstance(trial.agent, Looker):
            self._robot.runtime.bus.subscribe(self._look, sweeps)
        self._robot.add_task("learning", TICK, self.learning)

    def _see(self, topic: Topic[Readings], lux: Readings, time: float) -> None:
        """Show the agent a sample of the light."""
        self.trial.see(time, lux, self._robot.odometry)

    def _look(self, topic: Topic[Scan], scan: Scan, time: float) -> None:
        """Show the agent a sweep of the laser."""
        self.trial.look(time, scan.points, self._robot.odometry)

    async def learning(self, ticks: Ticks) -> None:
        """Bring the robot to each start, and command the agent's decisions."""
        robot, trial = self._robot, self.trial
        try:
            async for now in ticks:
                if self.ended.is_set():
                    continue
                if self._stopped():
                    self._let_go()
                    if not robot.armed:
                        trial.void()
                    trial.phase = Phase.DONE
                    self._wheel.release()
                    self.ended.set()
                    continue
                if not self._may_drive():
                    continue
                pose = self._pose.read()
                if trial.phase is Phase.MOVE:
                    if not self._moved(now):
                        continue
                    pose = self._pose.read()
                # without a pose the boundary is unknown, too
                if pose is None:
                    trial.void()
                    self._wheel.command(0.0, 0.0)
                    continue
                if self._light is not None and self._light.reason:
                    raise HalError(f"sensor '{self._light.name}': {self._light.reason}")
                before = trial.phase
                self._wheel.command(*trial.tick(now, robot.armed, pose, robot.odometry, bool(self._touches())))
                if trial.phase is Phase.DONE:
                    self.ended.set()
                elif trial.phase is not before:
                    robot.tell(f"episode {len(trial.episodes) + 1} {trial.phase.value}")
        finally:
            self._let_go()

    def _may_drive(self) -> bool:
        """Whether the learner has the wheel; it holds it all the time, so it notices when another source takes it."""
        if self.overruled:
            if self._robot.runtime.gate.epoch == self._epoch or not self._wheel.request():
                return False
            self.overruled = ""
        elif self._wheel.overruled or (self.trial.phase is not Phase.DRIVE and not self._wheel.request()):
            self._give_way(self._wheel.overruled)
        return not self.overruled

    def _give_way(self, driver: str) -> None:
        """Void the episode, and wait until the robot is armed anew."""
        robot = self._robot
        self.overruled, self._epoch = driver, robot.runtime.gate.epoch
        self._let_go()
        self.trial.void()
        why = "the robot was stopped" if driver == A_STOP else f"'{driver}' drives"
        robot.tell(f"{why}; the learner goes on when it is armed anew (press m)")

    def _tell(self, action: int) -> None:
        """Publish the agent's decision."""
        trial = self.trial
        runtime = self._robot.runtime
        number = len(trial.episodes) + 1
        if isinstance(trial.agent, Doubter) and trial.agent.unfit and self._doubted != number:
            self._doubted = number
            runtime.bus.publish(DOUBT, ModelDoubt(number, trial.agent.unfit), runtime.now)
            self._robot.tell(f"my model does not fit {trial.agent.unfit}")
        if not runtime.bus.wanted(STEP):
            return
        state, reward, values = trial.agent.decision(self._robot.odometry)
        row, earned = -1 if state is None else state, nan if reward is None else reward
        step = LearningStep(len(trial.episodes) + 1, row, action, earned, values)
        runtime.bus.publish(STEP, step, runtime.now)

    def _let_go(self) -> None:
        """Stop driving towards the start."""
        if self._drive is not None:
            self._drive.cancel()
            self._drive = None

    def _moved(self, now: float) -> bool:
        """Whether the robot is at its start now; otherwise send it there."""
        robot, trial = self._robot, self.trial
        if not robot.armed:
            return False
        if self._places:
            self._wheel.command(0.0, 0.0)
            # a robot that rolls must not be lifted
            if robot.odometry.v or robot.odometry.omega:
                return False
            robot.place(*trial.start)
            if self._given is None and not self._truth:
                self._pose = wheel_pose(robot, trial.start)
        else:
            if self._drive is None:
                if self._pose.read() is None:
                    return False
                speed = min(TO_START, robot.config.safety.v_max)
                self._drive = asyncio.ensure_future(
                    go_to(robot, trial.start, pose_source=self._pose, speed=speed, source=self._wheel)
                )
            if not self._drive.done():
                return False
            drive, self._drive = self._drive, None
            error = drive.exception()
            if isinstance(error, Overruled):
                self._give_way(error.driver)
                return False
            # on the way; it drives on later
            if isinstance(error, NotArmed) or self._pose.read() is None:
                return False
            if error is not None:
                raise error
            if not (arrival := drive.result()).arrived:
                robot.tell(f"the start was missed by {arrival.distance:.2f} m, {degrees(arrival.turn):.0f} degrees")
        trial.placed(now)
        return True


def _told_pose(robot: Robot, by: str) -> PoseSource:
    """Return the source of the configured pose: fused, on the map, or motion capture; ConfigError: there is none."""
    if by in ("fused", "map"):
        return fused_pose(robot) if by == "fused" else map_pose(robot)
    if by not in robot.sensors:
        there = ", ".join(["truth", "odometry", "fused", "map", *robot.sensors])
        raise ConfigError(f"learning.pose: there is no sensor '{by}'; there are: {there}")

    def read() -> tuple[float, float, float] | None:
        last = robot.sensors[by].last
        if last is None or robot.now - last.time > TRACKED:
            return None
        seen = last.value
        if not isinstance(seen, TrackerReading):
            raise ConfigError(f"learning.pose: the sensor '{by}' tells no pose; use a motion capture system")
        return seen.x, seen.y, heading(seen.orientation)

    return PoseSource(by, read)


def start(robot: Robot, agent: Agent, pose: PoseSource | None = None, episodes: int = EPISODES) -> LearningTask:
    """Start the learning task beside the robot's other tasks, under an operator's eyes (`txt1 run`).

    The robot has its gains and light sensors (see `need_light`). With `pose` None the configured pose is used.
    """
    config = robot.config
    if robot.hal.capabilities.place:
        room = config.sim.room
        boundary = min(config.section(LearningConfig).boundary, 0.5 * min(room.length, room.width) - FROM_WALL)
        config = config.model_copy(
            update={"learning": config.section(LearningConfig).model_copy(update={"boundary": boundary})}
        )

    def tell(one: Episode) -> None:
        how = "reached the light" if one.success else "lost the light"
        robot.tell(f"episode {one.number}: {how} after {one.time:.1f} s, best possible {one.optimal_time:.1f} s")

    trial = Trial(
        agent, task_of(config), starts(config.own_seed, 1, episodes), config.section(LearningConfig).actions, done=tell
    )
    task = LearningTask(robot, trial, pose)
    task.start()
    return task


class WorldLight(SimulatedSensor[Readings]):
    """The four light sensors of a trial in a world of its own."""

    def __init__(self, trial: Trial, pose: Callable[[], tuple[float, float, float] | None], name: str) -> None:
        super().__init__(topic_of(name), SAMPLE_PERIOD, pose)
        self._trial = trial

    def see(self, pose: tuple[float, float, float], now: float, before: float) -> Reading[Readings]:
        """The readings at `now`, lux."""
        assert self._trial.world is not None
        return Reading(now, self._trial.world.see(now - self._trial.since, pose))


async def need_light(robot: Robot, seed: Sequence[int] | None = None, trial: Trial | None = None) -> None:
    """See to it that the robot has its four light sensors; a simulated robot without gets simulated ones.

    `seed` repeats their noise; None: that of the configuration does. A `trial` gets the world that is asked for, and
    the sensors see that. Raises HalError: there are none; ConfigError: that world cannot be had.
    """
    name = robot.config.section(LearningConfig).sensor
    asked = world_named(robot.config)
    if asked is not None:
        if trial is None or not robot.hal.capabilities.pose:
            raise ConfigError(
                f"learning.world: {asked}: a world is simulated; take hal=sim and txt1 learn, or leave it out"
            )
        import numpy as np

        movers = robot.hal.movers if robot.config.sim.movers else tuple
        trial.world = world_of(robot.config, np.random.default_rng(np.random.SeedSequence(seed)), movers)
        sensor: Sensor[Any] = WorldLight(trial, lambda: robot.runtime.look().pose, name)
    elif name in robot.sensors:
        return
    elif not robot.hal.capabilities.pose:
        raise HalError(
            f"learning needs four light sensors, and with the HAL '{robot.hal.name}' there are none: plug in a "
            f"Phidgets Interface Kit and set sensors.{name}.driver=phidgets_light, which needs the extra 'devices'"
        )
    else:
        options = {} if seed is None else {"seed": list(seed)}
        sensor = robot.runtime.make_sensor(name, SensorConfig(driver=SIMULATED, options=options))
    # until the learner needs it
    (await robot.add_sensor(name, sensor)).needed = lambda: False

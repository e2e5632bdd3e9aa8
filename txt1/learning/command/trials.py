"""The trials of `txt1 learn`: on a robot each, one after the other or side by side in processes.

`conduct` lists the trials that no file holds yet and has them done. `on_robot` does one of them from its number and the
seed alone, so it is the same in any process. Its file is written as it ends, and that is all that `--resume` needs.
"""

import asyncio
import signal
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

from txt1.commands import OK
from txt1.config import Config
from txt1.errors import ConfigError, NotArmed, Overruled, Txt1Error
from txt1.kit.app import App, get_ready
from txt1.learning.agent import Agent
from txt1.learning.experiment import (
    Plan,
    Watch,
    load_result,
    load_results,
    prepare,
    recordings,
    result_file,
    save_result,
)
from txt1.learning.qtable import replace_file
from txt1.learning.registry import LEARNERS, make
from txt1.learning.settings import LearningConfig, refuse_of_studies
from txt1.learning.solvability import refuse_unsolvable
from txt1.learning.task import LearningTask, need_light
from txt1.learning.trial import (
    AGENT,
    SENSORS,
    Commands,
    Episode,
    Trial,
    TrialResult,
    recorded_plan,
    robot_config,
    starts,
    stream,
    task_of,
)
from txt1.learning.world import settled
from txt1.record.options import to_file
from txt1.trials.run import run
from txt1.trials.workers import Workers, stopped

HERE: Final = Workers()
# s of the run at which a trial in simulation begins; by then the robot is ready
BEGIN: Final = 4.0
# why there are no more trials; None: all are complete
Ended = signal.Signals | Txt1Error | None


def conduct(
    plan: Plan, out: Path, resume: bool, watch: Watch, machines: Workers = HERE
) -> tuple[list[TrialResult], Ended]:
    """Return the trials' results in order, and why there are no more; a signal ends the trials, and nothing is lost.

    Raises ConfigError: the directory cannot be used or holds another experiment, or a cluster cannot do the trials.
    """
    if plan.config.hal == "sim":
        refuse_unsolvable(settled(plan.config))
    if machines.cluster is not None and not plan.simulated:
        raise ConfigError("--dask: real robots and sensors are not on a cluster; only simulated ones learn there")
    if machines.cluster is not None and plan.log is not None:
        raise ConfigError("--log: recordings would stay on the cluster's machines; leave out --log or --dask")
    kept = [one for one in prepare(plan, out, resume) if one.complete or not plan.simulated]
    for result in kept:
        for episode in result.episodes:
            watch(result.trial, episode)
    missing = sorted(set(range(1, plan.trials + 1)) - {one.trial for one in kept if one.complete})
    begun = {one.trial: one for one in kept if not one.complete}
    logs = recordings(plan, missing, begun, resume)

    def keep(number: int, text: str) -> None:
        file = result_file(out, number)
        replace_file(file, text)
        for episode in load_result(file).episodes:
            watch(number, episode)

    def here(number: int) -> None:
        done, before, log = partial(watch, number), begun.get(number), logs.get(number)
        on_robot(plan, number, done=done, before=before, out=out, log=log)

    code = OK
    ended: Ended = None
    try:
        if machines.many and plan.simulated and (len(missing) > 1 or machines.cluster is not None):
            told = plan._replace(log=None)._asdict() | {"config": plan.config.model_dump(mode="json")}
            texts = {n: [told, n, str(logs[n].absolute()) if n in logs else None] for n in missing}
            code = run(simulated, texts, machines, keep)
        else:
            code = run(here, dict(zip(missing, missing, strict=True)), None, lambda *_: None)
    except Txt1Error as error:
        ended = error
    results = load_results(out)
    if code != OK and not (len(results) >= plan.trials and all(one.complete for one in results)):
        return results, signal.Signals(code - 128)
    return results, ended


def simulated(told: Sequence[Any]) -> str:
    """Do a trial of a plan in simulation, given with its number and its log; return its file's content."""
    tree, number, log = told
    plan = Plan(**tree | {"config": Config.model_validate(tree["config"])})
    with TemporaryDirectory() as folder:
        out = Path(folder)
        result_file(out, number).parent.mkdir()
        on_robot(plan, number, stopped=stopped, out=out, log=None if log is None else Path(log))
        file = result_file(out, number)
        return file.read_text(encoding="utf-8") if file.exists() else ""


def on_robot(
    plan: Plan,
    number: int,
    *,
    # the learner, in place of the plan's
    agent: Agent | None = None,
    # called with each episode as it ends
    done: Callable[[Episode], None] = lambda _: None,
    # (v, omega) of each action, m/s and rad/s, in place of the configured
    commands: Commands | None = None,
    # asked all the time; the trial ends once it returns True
    stopped: Callable[[], bool] = lambda: False,
    # the result so far of an interrupted trial, which then carries on
    before: TrialResult | None = None,
    # the directory for the result; also written after an error if an episode was completed
    out: Path | None = None,
    # the file to record it to
    log: Path | None = None,
) -> TrialResult:
    """Do a trial of a plan through the robot's real tasks, and return its result.

    A disarm ends the trial, unless the robot arms again by itself. A signal ends it too, and is then passed on.

    Raises HalError: the hardware cannot be used, or there are no light sensors; NotArmed: the robot was disarmed;
    Overruled: another source of commands took the wheel; TaskFault: a task failed; the robot was stopped first.
    """
    config, seed, episodes = settled(plan.config), plan.seed, plan.episodes
    refuse_of_studies(config.section(LearningConfig), LEARNERS.names())
    agent = agent or make(plan.agent, config, stream(seed, number, AGENT))
    commands = commands or config.section(LearningConfig).actions
    trial = Trial(agent, task_of(config), starts(seed, number, episodes), commands, done, plan.keep_paths())
    if before is not None:
        trial.carry_on(before)
    own, told = robot_config(config, seed, number), recorded_plan(agent.name, seed, number, episodes)
    app = App(plan.speed)

    async def learn() -> None:
        async with app.robot(own, additions=to_file(log, told, plan.speed)) as robot:
            await need_light(robot, [seed, number, SENSORS], trial)
            await get_ready(robot, plan.arm or None)
            # always at the same instant
            if robot.hal.capabilities.place:
                await asyncio.sleep(max(0.0, BEGIN - 0.001 - robot.now))
            learning = LearningTask(
                robot,
                trial,
                stopped=lambda: stopped() or not (robot.armed or robot.arms_again) or bool(learning.overruled),
            )
            learning.start()
            await learning.ended.wait()
            if learning.overruled:
                raise Overruled("learner", learning.overruled)
            if len(trial.episodes) < episodes and not stopped():
                raise NotArmed(robot.reason)

    try:
        app.run(learn())
    except Txt1Error:
        trial.void()
        if out is not None and trial.episodes:
            save_result(out, trial.result(number))
        raise
    result = trial.result(number)
    if out is not None:
        save_result(out, result)
    if app.code:
        signal.raise_signal(app.code - 128)
    return result

"""A robot or a virtual board at work under an operator's eyes: screens or status lines, signals, and how it ended."""

from __future__ import annotations

import asyncio
import os
import select
import signal
import sys
from collections.abc import Callable, Coroutine
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Literal, NamedTuple

from txt1.beside import PERIOD as SCREENS_PERIOD
from txt1.beside import PRIORITY as SCREENS_PRIORITY
from txt1.board import Board, Listen
from txt1.command_line import DISARMED, FAULT, OK, SIGNALS
from txt1.config import Config
from txt1.control.limits import Fault
from txt1.errors import HalError, TaskFault
from txt1.kernel.loop import Speed, run
from txt1.kernel.statistics import TaskStatistics
from txt1.kernel.ticks import Ticks
from txt1.learning import running as learning
from txt1.learning.agent import Agent
from txt1.learning.task import need_light
from txt1.record.session import open_view, recording
from txt1.robot import REFRESH, Robot
from txt1.runtime import Runtime
from txt1.ui.terminal import Terminal

if TYPE_CHECKING:
    from txt1.record.live import LiveView

STDOUT: Final = 1
BEAT_MIN: Final = 0.005
"""Shortest time between two heartbeats of the drawing process, s."""
DISARMING: Final = (Fault.LINK, Fault.MISSED, Fault.RUNAWAY, Fault.ODOMETRY, Fault.BATTERY)

View = Literal["screens", "lines", "nothing"]


class Plan(NamedTuple):
    """What a session is to do.

    Attributes:
        speed: of its time (see `txt1.kernel.loop.run`).
        duration: s of its time after which it ends; None: when somebody ends it.
        view: what the operator sees. Without a terminal, and at full speed, lines take the place of screens.
        arm: whether to arm; None leaves it to ``safety.auto_arm``.
        drive: a velocity in m/s and rad/s to command throughout.
        log: the file to record to; None: nothing is recorded.
        serve: host and port of the live view; None: there is none.
        serve_control: whether its clients may drive.
        serve_token: the file with the token that they have to present; None: they need none.
        learn: the learner that is to look for the light.
        policy: the file with the learned table by which to drive to it.

    """

    speed: Speed = None
    duration: float | None = None
    view: View = "screens"
    arm: bool | None = None
    drive: tuple[float, float] | None = None
    log: Path | None = None
    learn: str | None = None
    policy: Path | None = None
    serve: tuple[str, int] | None = None
    serve_control: bool = False
    serve_token: Path | None = None


class Ending:
    """How a session ended: its exit code, why the safety gate is closed, and its report, as far as it came."""

    def __init__(self) -> None:
        self.code = OK
        self.reason = ""
        self.armed = False
        self.report: dict[str, Any] | None = None
        self._subject: Robot | Board | None = None

    def watch(self, subject: Robot | Board) -> None:
        """Disarm this one when a signal comes."""
        self._subject = subject

    def conclude(self, runtime: Runtime) -> None:
        """Take the report of the run."""
        self.reason = runtime.gate.reason
        self.report = report(runtime)

    def interrupt(self, number: signal.Signals, main: asyncio.Task[Any], loop: asyncio.AbstractEventLoop) -> None:
        """End the session because of a signal; a second one is not caught any more."""
        self.code = 128 + number
        if self._subject is not None:
            self._subject.disarm("ended by a signal")
        for each in SIGNALS:
            loop.remove_signal_handler(each)
        main.cancel()


def run_robot(config: Config, plan: Plan) -> Ending:
    """How a run of the robot ended."""
    agent = learning.agent_of(config, plan.learn, plan.policy)  # reads a file, so not in the event loop
    return _conduct(partial(_robot, config, plan, agent), plan)


def run_board(config: Config, plan: Plan, listen: Listen, *, manual: bool) -> Ending:
    """How a run of the virtual board ended; `listen` puts it on a line."""
    return _conduct(partial(_board, config, plan, listen, manual), plan)


def _conduct(session: Callable[[Ending], Coroutine[Any, Any, None]], plan: Plan) -> Ending:
    ending = Ending()
    unexpected: list[Exception] = []

    async def main() -> None:
        loop, task = asyncio.get_running_loop(), asyncio.current_task()
        assert task is not None
        for number in SIGNALS:
            loop.add_signal_handler(number, partial(ending.interrupt, number, task, loop))

        def failed(loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
            error = context.get("exception")
            if not isinstance(error, Exception):
                loop.default_exception_handler(context)
            elif not unexpected:
                unexpected.append(error)
                task.cancel()

        loop.set_exception_handler(failed)
        await session(ending)

    with suppress(asyncio.CancelledError):
        run(main(), speed=plan.speed)
    if unexpected:  # in a callback of the event loop, which would only have logged it
        raise TaskFault("event loop", unexpected[0]) from unexpected[0]
    return ending


# -- the two kinds ---------------------------------------------------------------------------------------------


async def _robot(config: Config, plan: Plan, agent: Agent | None, ending: Ending) -> None:
    view = await _view(plan)
    async with (
        recording(plan.log, config, plan.speed, _told(plan), _say, view) as attach,
        Robot.open(config=config, arm=False, patience=0.0, attach=attach) as robot,
    ):
        if view is not None:
            view.drive(robot.command, config.geometry.radius_min)
        ending.watch(robot)
        if plan.duration is not None:
            robot.runtime.scheduler.end_at(plan.duration)
        getting_ready = asyncio.ensure_future(_get_ready(robot, plan, agent, ending))
        try:
            teleop, radius_min = config.teleop, config.geometry.radius_min
            terminal = partial(Terminal, robot, _beat(plan), teleop.speed, teleop.turn, radius_min)
            await _watch(robot, terminal, plan, ending, getting_ready)
        finally:  # an interrupted run has its report, too
            getting_ready.cancel()
            ending.conclude(robot.runtime)
        board = robot.runtime.state.board
        if ending.code == OK and any(robot.runtime.gate.counts[fault] for fault in DISARMING):
            ending.code = DISARMED
        elif ending.code == OK and _to_be_armed(robot, plan) and board is not None and not ending.armed:
            ending.code, ending.reason = DISARMED, f"never armed: {board.text}"


async def _view(plan: Plan) -> LiveView | None:
    """The live view that was asked for, if any was."""
    if plan.serve is None:
        return None
    token = plan.serve_token
    view = await asyncio.to_thread(open_view, *plan.serve, control=plan.serve_control, token=token)
    _say(f"the live view is at {view.address}{'' if token is None else f'/?token= and the token in {token}'}")
    return view


def _to_be_armed(robot: Robot, plan: Plan) -> bool:
    """Whether to arm when the link is there: it was asked for, and nobody has stopped the robot meanwhile."""
    return (robot.arms_by_itself if plan.arm is None else plan.arm) and not robot.touched


async def _get_ready(robot: Robot, plan: Plan, agent: Agent | None, ending: Ending) -> None:
    """Wait for the link, arm if that is asked for, load the gains, start the script or the learning."""
    if agent is not None:
        await need_light(robot)
    await robot.linked()
    if _to_be_armed(robot, plan):
        robot.arm()
        ending.armed = True
    while not await robot.load_gains():
        if robot.gains_rejected:
            raise HalError("the board did not accept the gains; check control.linear and control.angular")
        robot.tell("the board has not acknowledged the gains yet; they are sent again and again")
    if plan.drive is not None:
        robot.add_task("script", REFRESH, partial(_script, robot=robot, velocity=plan.drive))
    if agent is not None:
        learning.start(robot, agent)


async def _script(ticks: Ticks, robot: Robot, velocity: tuple[float, float]) -> None:
    """Command a constant velocity."""
    async for _ in ticks:
        robot.command(*velocity)


def _told(plan: Plan) -> dict[str, object]:
    """What a recording says about what the run was to do."""
    policy = None if plan.policy is None else str(plan.policy)
    return {"duration": plan.duration, "arm": plan.arm, "drive": plan.drive, "learn": plan.learn, "policy": policy}


def _say(text: str) -> None:
    print(f"txt1: {text}", file=sys.stderr)


async def _board(config: Config, plan: Plan, listen: Listen, manual: bool, ending: Ending) -> None:
    board = Board(config, manual=manual)
    told = {"board": True, **_told(plan)}
    async with recording(plan.log, config, plan.speed, told, _say, await _view(plan)) as attach:
        attach(board.runtime)
        await _serve(board, plan, listen, ending)


async def _serve(board: Board, plan: Plan, listen: Listen, ending: Ending) -> None:
    ending.watch(board)
    listener = await listen(board)
    try:
        print(f"txt1: a virtual board is at {listener.address}", file=sys.stderr)
        await board.power_up()
        if plan.duration is not None:
            board.runtime.scheduler.end_at(plan.duration)
        try:
            await _watch(board, partial(Terminal, board, _beat(plan)), plan, ending)
        finally:
            ending.conclude(board.runtime)
    finally:
        try:
            await board.power_down()
        finally:
            listener.close()
    await board.runtime.scheduler.ended  # raises the TaskFault, if there was one


# -- what the operator sees ------------------------------------------------------------------------------------


def _beat(plan: Plan) -> float:
    """Time between heartbeats of the drawing process, s: 20 a second of the robot's time."""
    speed = 1.0 if plan.speed is None or plan.speed == "max" else plan.speed
    return max(REFRESH / max(speed, 1.0), BEAT_MIN)


async def _watch(
    subject: Robot | Board,
    terminal: Callable[[], Terminal],
    plan: Plan,
    ending: Ending,
    alongside: asyncio.Future[None] | None = None,
) -> None:
    """Let the operator see and drive until the run ends; an error of what goes on alongside ends it as well."""
    ended = subject.runtime.scheduler.ended
    failed = _failure_of(alongside)
    if plan.view == "nothing":
        await _first_of(ended, failed)
        return
    if plan.view == "screens" and plan.speed != "max" and sys.stdin.isatty() and sys.stdout.isatty():
        subject.runtime.watched = True
        async with terminal() as screens:
            subject.runtime.add_task("screens", SCREENS_PRIORITY, SCREENS_PERIOD, screens.screens)
            operator = asyncio.ensure_future(screens.wait())
            await _first_of(ended, operator, failed)
            quit_by_operator = operator.done() and operator.result() == "quit"
            operator.cancel()
            subject.disarm("the run has ended")  # before the screens are put away, which takes its time
        if quit_by_operator or ended.done() or failed.done():
            return
        print("txt1: the terminal was lost and the robot disarmed; Ctrl-C ends the run", file=sys.stderr)
        ending.code = FAULT
    lines = asyncio.ensure_future(_status_lines(subject.runtime))
    await _first_of(ended, lines, failed)
    lines.cancel()


def _failure_of(work: asyncio.Future[None] | None) -> asyncio.Future[None]:
    """A future that is done when the work has failed, and never when it succeeds."""
    failed: asyncio.Future[None] = asyncio.get_running_loop().create_future()

    def look(work: asyncio.Future[None]) -> None:
        if not work.cancelled() and not failed.done() and (error := work.exception()) is not None:
            failed.set_exception(error)

    if work is not None:
        work.add_done_callback(look)
    return failed


async def _first_of(*futures: asyncio.Future[Any]) -> None:
    """Wait for the first of them to be done, and raise its error, if it has one."""
    done, _ = await asyncio.wait(futures, return_when=asyncio.FIRST_COMPLETED)
    for future in done:
        future.result()


async def _status_lines(runtime: Runtime) -> None:
    """Print one status line a second; a reader that has stopped reading misses some, it never holds up the robot."""
    sys.stdout.flush()
    while True:
        _, writable, _ = select.select([], [STDOUT], [], 0.0)  # a pipe is writable while a line fits
        if writable:
            os.write(STDOUT, f"{status_line(runtime)}\n".encode())
        await asyncio.sleep(1.0)


def status_line(runtime: Runtime) -> str:
    """The robot's state in one line."""
    x, y, theta, v, omega = runtime.state.odometry
    gate, voltage = runtime.gate, runtime.state.battery.battery1
    state = "armed" if gate.armed else f"disarmed: {gate.reason}"
    board = runtime.state.board
    if board is not None and not board.ready:
        state += f"; {board.text}"
    battery = "-" if voltage is None else f"{voltage:.2f} V"
    return (
        f"t={runtime.now:8.2f} s  x={x:+.3f} m  y={y:+.3f} m  theta={theta:+.3f} rad  "
        f"v={v:+.3f} m/s  omega={omega:+.3f} rad/s  battery={battery}  {state}"
    )


# -- the report ------------------------------------------------------------------------------------------------


def report(runtime: Runtime) -> dict[str, Any]:
    """What `--json` prints. Of it, `wall_time_s` and `run_time_s` are measured on the wall clock."""
    battery = runtime.state.battery
    return {
        "sim_time_s": round(runtime.now, 9),
        "wall_time_s": runtime.scheduler.wall_time,
        "seed": runtime.config.seed,
        "tasks": {name: _task_report(task) for name, task in runtime.statistics().items()},
        "odometry": runtime.state.odometry._asdict(),
        "battery": {**battery._asdict(), "state": battery.state and battery.state.value},
        "armed": runtime.gate.armed,
        "faults": runtime.faults(),
    }


def _task_report(task: TaskStatistics) -> dict[str, Any]:
    return {
        "cycles": task.cycles,
        "misses": task.misses,
        "lateness_s": task.lateness.percentiles()._asdict(),
        "run_time_s": task.run_time.percentiles()._asdict(),
    }

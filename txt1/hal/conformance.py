"""Promises every hardware layer keeps: the suite that any HAL, ours or a stranger's, can be run through.

With pytest, which collects the `test_` methods of a subclass whose name starts with "Test"::

    from txt1.hal.conformance import HalConformance

    class TestMyCar(HalConformance):
        def make(self):
            return MyCarHal(port="/dev/ttyUSB0")

From the command line, for a HAL that is registered::

    txt1 hal check mycar --set hal_options.port=/dev/ttyUSB0

The promises themselves stand in `txt1.hal.base`; a failure names the one that was broken. A promise that this HAL
cannot break, because it lacks the capability, is skipped.

A HAL that is not `simulated` is driven too: with full throttle for an instant, then neutral. Put the wheels off the
ground.
"""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Iterator
from contextlib import suppress
from functools import partial
from math import hypot, inf, isfinite, nan
from statistics import median
from typing import Any, ClassVar, Final
from unittest import SkipTest

from txt1 import conformance
from txt1.conformance import Promises, named
from txt1.control.schedule import ANGULAR_GAINS, LINEAR_GAINS
from txt1.errors import HalError, NotCapable
from txt1.hal.base import Button, Capabilities, Hal, Indicators, Inputs, Outputs
from txt1.kernel.clock import NS_PER_S, stopwatch_ns
from txt1.kernel.loop import Speed, run
from txt1.model.odometry import Odometry
from txt1.model.vehicle import PWM_MAX
from txt1.protocol.messages import CombinedOdometry, PidSet, Switch

_PROMISES: Final = Promises("txt1.hal.base")
promise, broken, called, waited = _PROMISES.promise, _PROMISES.broken, _PROMISES.called, _PROMISES.waited

PERIOD: Final = 0.02
"""Seconds between two calls: the controller's."""

PROMPT: Final = 0.25 * PERIOD
"""A call may take so long at the median, s, for the controller to keep its period."""

# A HAL obeys either the counts or the set-point, so these carry both.
NEUTRAL: Final = Outputs()
FORWARD: Final = Outputs(motor=3000, v=0.5)
BACKWARD: Final = Outputs(motor=-3000, v=-0.5)
LEFT: Final = Outputs(motor=3000, front=-12000, rear=12000, v=0.5, omega=0.5)
EXTREMES: Final = (
    Outputs(PWM_MAX, PWM_MAX, PWM_MAX, PWM_MAX, PWM_MAX, 1.5, 1.5 / 0.56),
    Outputs(-PWM_MAX, -PWM_MAX, -PWM_MAX, -PWM_MAX, -PWM_MAX, -1.5, -1.5 / 0.56),
)

GAINS: Final = PidSet(LINEAR_GAINS, tuple((s.v_max, *s.gains) for s in ANGULAR_GAINS))
COMBINED: Final = CombinedOdometry(1.0, -2.0, 0.5, 0.3, 0.1)

PATIENCE: Final = 60.0
"""Seconds in which a board behind a link answers and takes its gains, however noisy the link is."""

NOTICEABLE: Final = 0.005
"""The robot has moved when it has moved so far, in m."""


class HalConformance:
    """The promises, one test each. Override `make`, and `held` and the settings where the defaults do not fit."""

    speed: ClassVar[Speed] = "max"
    """Virtual time. None is real time, for a HAL with a peer outside the process or with threads."""

    settle: ClassVar[float] = 3.0
    """Seconds in which every sensor has reported and a robot rolling at 0.5 m/s has stopped."""

    drive: ClassVar[float] = 1.0
    """Seconds of driving at 0.5 m/s or 3000 counts after which the motion is judged.

    A wall within 4 m hides a robot that does not stop, so give a simulated one room.
    """

    def make(self) -> Hal:
        """A new HAL, not opened yet; override this."""
        raise NotImplementedError("override HalConformance.make: it returns a new HAL that is not opened yet")

    def held(self, hal: Hal) -> Outputs | None:
        """What the actuators do now; override this where it can be told. None skips what needs it."""
        return None

    # -- identity and life -------------------------------------------------------------------------------------

    def test_the_name_is_text(self) -> None:
        """Hal.name."""
        name = self.make().name
        promise(isinstance(name, str) and name.strip() != "", "Hal.name", f"is text that is not empty, not {name!r}")

    def test_capabilities_and_name_are_constant(self) -> None:
        """Hal.capabilities."""

        async def body(bench: Bench) -> None:
            hal, before = bench.hal, bench.capabilities
            promise(
                isinstance(before, Capabilities), "Hal.capabilities", f"is a Capabilities, not {type(before).__name__}"
            )
            name = hal.name
            await bench.hold(NEUTRAL, PERIOD)
            promise(hal.capabilities == before, "Hal.capabilities", "is constant, but opening the HAL changed it")
            await hal.close()
            promise(hal.capabilities == before, "Hal.capabilities", "is constant, but closing the HAL changed it")
            promise(hal.name == name, "Hal.name", f"is constant, but {name!r} became {hal.name!r}")

        self._run(body)

    def test_every_field_of_the_capabilities_is_true_or_false(self) -> None:
        """Capabilities."""
        for name, value in vars(self.make().capabilities).items():
            promise(isinstance(value, bool), f"Capabilities.{name}", f"is True or False, not {value!r}")

    def test_closing_twice_is_harmless(self) -> None:
        """Hal.close."""

        async def body(bench: Bench) -> None:
            await bench.hal.close()
            try:
                await bench.hal.close()
            except Exception as error:
                broken("Hal.close", f"is harmless when closed already, but raised {named(error)}")

        self._run(body)

    def test_a_closed_hal_opens_again(self) -> None:
        """Hal.open."""

        async def body(bench: Bench) -> None:
            await bench.hold(NEUTRAL, PERIOD)
            await bench.hal.close()
            try:
                await bench.hal.open()
                await bench.hold(NEUTRAL, PERIOD)
            except Exception as error:
                broken("Hal.open", f"makes the hardware ready again after close, but raised {named(error)}")

        self._run(body)

    def test_opening_leaves_the_outputs_neutral(self) -> None:
        """Hal.open."""

        async def body(bench: Bench) -> None:
            self._expect_held(bench, NEUTRAL, "Hal.open", "leaves the outputs neutral")

        self._run(body)

    def test_closing_leaves_the_outputs_neutral(self) -> None:
        """Hal.close."""

        async def body(bench: Bench) -> None:
            bench.requires("simulated")  # nobody wants a real car to be let go at speed, should this fail
            await bench.hold(FORWARD, self.drive)
            await bench.hal.close()
            if self.held(bench.hal) is not None:
                self._expect_held(bench, NEUTRAL, "Hal.close", "leaves the outputs neutral")
            await bench.hal.open()
            await asyncio.sleep(self.settle)
            stopped = bench.read()
            await asyncio.sleep(self.settle)
            still = bench.moved(stopped, bench.read()) < NOTICEABLE
            promise(still, "Hal.close", "leaves the outputs neutral, but the robot drives on after close and open")

        self._run(body)

    # -- reading -----------------------------------------------------------------------------------------------

    def test_reading_returns_inputs_at_once(self) -> None:
        """Hal.read."""

        async def body(bench: Bench) -> None:
            bench.read()  # which refuses everything else, coroutines first

        self._run(body)

    def test_reading_and_writing_are_prompt(self) -> None:
        """Hal.read and Hal.write."""

        async def body(bench: Bench) -> None:
            for where, call in (("Hal.read", bench.read), ("Hal.write", lambda: bench.write(NEUTRAL))):
                took = []
                for _ in range(25):
                    await asyncio.sleep(PERIOD)
                    begun = stopwatch_ns()
                    call()
                    took.append((stopwatch_ns() - begun) / NS_PER_S)
                promise(
                    median(took) < PROMPT, where, f"never waits, but takes {1e3 * median(took):.1f} ms at the median"
                )

        self._run(body)

    def test_every_input_agrees_with_the_capabilities(self) -> None:
        """Inputs."""

        async def body(bench: Bench) -> None:
            _check_inputs(bench.read(), bench.capabilities, bench.now, complete=False)
            inputs = await bench.hold(NEUTRAL, self.settle)
            _check_inputs(inputs, bench.capabilities, bench.now, complete=True)

        self._run(body)

    def test_reading_twice_at_one_instant_changes_nothing(self) -> None:
        """Hal.read."""

        async def body(bench: Bench) -> None:
            await bench.hold(NEUTRAL, self.settle)
            first, second = bench.read(), bench.read()
            promise(
                (first.ticks, first.pose) == (second.ticks, second.pose),
                "Hal.read",
                f"reports the sensors at `now`, but ticks {first.ticks} and pose {first.pose} became "
                f"{second.ticks} and {second.pose} while time stood still",
            )

        self._run(body)

    def test_it_survives_many_reads_and_gaps(self) -> None:
        """Hal.read."""

        async def body(bench: Bench) -> None:
            for _ in range(500):
                await asyncio.sleep(PERIOD)
                _check_inputs(bench.read(), bench.capabilities, bench.now, complete=False)
            await asyncio.sleep(10.0 * PERIOD)
            _check_inputs(bench.read(), bench.capabilities, bench.now, complete=False)

        self._run(body)

    # -- writing -----------------------------------------------------------------------------------------------

    def test_writing_accepts_everything_between_the_ends(self) -> None:
        """Hal.write."""

        async def body(bench: Bench) -> None:
            for outputs in (NEUTRAL, *EXTREMES, NEUTRAL):
                try:
                    bench.write(outputs)
                except HalError as error:
                    broken("Hal.write", f"takes {outputs}, but raised {named(error)}")

        self._run(body)

    def test_what_was_written_is_held(self) -> None:
        """Hal.write."""

        async def body(bench: Bench) -> None:
            bench.write(LEFT)
            self._expect_held(bench, LEFT, "Hal.write", "holds the outputs from `now` on")
            bench.write(NEUTRAL)
            self._expect_held(bench, NEUTRAL, "Hal.write", "holds the outputs from `now` on")

        self._run(body)

    def test_neutral_outputs_do_not_move_the_robot(self) -> None:
        """Outputs."""

        async def body(bench: Bench) -> None:
            before = await bench.hold(NEUTRAL, self.settle)
            after = await bench.hold(NEUTRAL, self.drive)
            moved = bench.moved(before, after)
            promise(moved < NOTICEABLE, "Outputs", f"are neutral when all are 0, but the robot moved {moved:.3f} m")

        self._run(body)

    def test_neutral_outputs_stop_the_robot(self) -> None:
        """Hal.write."""

        async def body(bench: Bench) -> None:
            bench.requires("simulated")
            await bench.hold(FORWARD, self.drive)
            before = await bench.hold(NEUTRAL, self.settle)
            after = await bench.hold(NEUTRAL, self.drive)
            moved = bench.moved(before, after)
            promise(moved < NOTICEABLE, "Hal.write", f"neutral stops the robot, but it moved on {moved:.3f} m")

        self._run(body)

    # -- driving: what is simulated is driven --------------------------------------------------------------------

    def test_forward_is_positive(self) -> None:
        """Outputs.motor, Outputs.v and Inputs.ticks, Inputs.odometry."""

        async def body(bench: Bench) -> None:
            await self._expect_motion(bench, FORWARD, "forward", 1)

        self._run(body)

    def test_backward_is_negative(self) -> None:
        """Outputs.motor, Outputs.v and Inputs.ticks, Inputs.odometry."""

        async def body(bench: Bench) -> None:
            await self._expect_motion(bench, BACKWARD, "backward", -1)

        self._run(body)

    def test_front_to_the_left_and_rear_to_the_right_turn_left(self) -> None:
        """Outputs.front, Outputs.rear, Outputs.omega."""

        async def body(bench: Bench) -> None:
            bench.requires("simulated")
            before = await bench.hold(NEUTRAL, self.settle)
            after = await bench.hold(LEFT, self.drive)
            if before.ticks is not None and after.ticks is not None:
                right, left = (b - a for a, b in zip(before.ticks, after.ticks, strict=True))
                promise(
                    right > left,
                    "Outputs.front, Outputs.rear",
                    f"turn left for front < 0 < rear, so the right wheel goes further, but the ticks are right {right} "
                    f"and left {left}",
                )
            elif after.odometry is not None:
                omega = after.odometry.omega
                promise(omega > 0.0, "Outputs.omega", f"is left positive, but 0.5 rad/s gave {omega:.3f} rad/s")

        self._run(body)

    # -- power -------------------------------------------------------------------------------------------------

    def test_the_switches_work_or_are_refused(self) -> None:
        """Hal.switch."""

        async def body(bench: Bench) -> None:
            # the ATX supply of a real robot feeds the computer this runs on
            states = (False, True) if bench.capabilities.simulated or not bench.capabilities.power else (True,)
            for switch in Switch:
                for on in states:
                    bench.offers("power", "Hal.switch", partial(bench.hal.switch, switch, on, bench.now))

        self._run(body)

    def test_without_the_esc_nothing_moves(self) -> None:
        """Hal.switch."""

        async def body(bench: Bench) -> None:
            bench.requires("simulated", "power")
            before = await bench.hold(NEUTRAL, self.settle)
            bench.hal.switch(Switch.ESC, False, bench.now)
            moved = bench.moved(before, await bench.hold(FORWARD, self.drive))
            promise(moved < NOTICEABLE, "Hal.switch", f"ESC off lets nothing move, but the robot moved {moved:.3f} m")

        self._run(body)

    # -- loops of its own --------------------------------------------------------------------------------------

    def test_gains_are_taken_or_refused(self) -> None:
        """Hal.load_gains."""

        async def body(bench: Bench) -> None:
            gains = partial(bench.hal.load_gains, GAINS, lambda accepted: None)
            bench.offers("gains", "Hal.load_gains", gains)

        self._run(body)

    def test_combined_odometry_is_taken_or_refused(self) -> None:
        """Hal.offer_odometry."""

        async def body(bench: Bench) -> None:
            odometry = partial(bench.hal.offer_odometry, COMBINED, bench.now)
            bench.offers("combined", "Hal.offer_odometry", odometry)

        self._run(body)

    # -- the rest ----------------------------------------------------------------------------------------------

    def test_indicators_are_set_or_ignored(self) -> None:
        """Hal.indicate."""

        async def body(bench: Bench) -> None:
            for indicators in (Indicators(), Indicators(True, True, True)):
                try:
                    called("Hal.indicate", bench.hal.indicate, indicators)
                except HalError as error:
                    broken("Hal.indicate", f"does nothing where there are no indicators, but raised {named(error)}")

        self._run(body)

    def test_the_robot_is_placed_or_it_is_refused(self) -> None:
        """Hal.place."""

        async def body(bench: Bench) -> None:
            await bench.hold(NEUTRAL, PERIOD)
            bench.offers("place", "Hal.place", partial(bench.hal.place, 0.1, -0.2, 0.3, bench.now))
            bench.requires("place", "pose")
            pose = bench.read().pose
            near = pose is not None and max(map(abs, (pose[0] - 0.1, pose[1] + 0.2, pose[2] - 0.3))) < 1e-6
            promise(near, "Hal.place", f"puts the robot down at (0.1, -0.2, 0.3), but it stands at {pose}")

        self._run(body)

    def test_a_robot_put_down_is_at_rest(self) -> None:
        """Hal.place."""

        async def body(bench: Bench) -> None:
            bench.requires("place", "pose")
            await bench.hold(FORWARD, self.drive)
            bench.write(NEUTRAL)
            bench.hal.place(0.0, 0.0, 0.0, bench.now)
            pose = (await bench.hold(NEUTRAL, self.drive)).pose
            at_rest = pose is not None and hypot(pose[0], pose[1]) < NOTICEABLE
            promise(at_rest, "Hal.place", f"puts the robot down at rest, but it rolled on from (0, 0, 0) to {pose}")

        self._run(body)

    def test_the_robot_is_not_placed_where_it_cannot_stand(self) -> None:
        """Hal.place."""

        async def body(bench: Bench) -> None:
            bench.requires("place")
            for pose in ((nan, 0.0, 0.0), (0.0, inf, 0.0)):
                try:
                    bench.hal.place(*pose, bench.now)
                except ValueError:
                    continue
                broken("Hal.place", f"raises ValueError where the robot cannot stand, but took {pose}")

        self._run(body)

    # -- inside ------------------------------------------------------------------------------------------------

    def _run(self, body: Callable[[Bench], Awaitable[None]]) -> None:
        """Run a test on a new HAL that is open, and close it."""

        async def main() -> None:
            bench = Bench(self.make())
            await waited(bench.hal.open(), "Hal.open")
            try:
                await bench.ready()
                await body(bench)
            except BaseException:
                with suppress(Exception):  # what the test found matters more
                    await bench.hal.close()
                raise
            await waited(bench.hal.close(), "Hal.close")

        run(main(), speed=self.speed)

    def _expect_held(self, bench: Bench, expected: Outputs, where: str, text: str) -> None:
        held = self.held(bench.hal)
        if held is None:
            raise SkipTest("override HalConformance.held to check what the actuators do")
        if bench.capabilities.pwm:
            same = held[:3] == expected[:3]
        else:
            same = (held.v, held.omega) == (expected.v, expected.omega)
        promise(same, where, f"{text}, but the actuators are at {held} instead of {expected}")

    async def _expect_motion(self, bench: Bench, outputs: Outputs, direction: str, sign: int) -> None:
        """Check that the sensors show the robot driving in this direction."""
        bench.requires("simulated")
        before = await bench.hold(NEUTRAL, self.settle)
        after = await bench.hold(outputs, self.drive)
        given = f"motor {outputs.motor}" if bench.capabilities.pwm else f"v {outputs.v} m/s"
        if before.ticks is not None and after.ticks is not None:
            ticks = tuple(b - a for a, b in zip(before.ticks, after.ticks, strict=True))
            promise(
                all(sign * t > 0 for t in ticks),
                "Inputs.ticks",
                f"are forward positive, but {given} ({direction}) changed them by right {ticks[0]}, left {ticks[1]}",
            )
        elif after.odometry is not None:
            v = after.odometry.v
            promise(sign * v > 0.0, "Inputs.odometry", f"is forward positive, but {given} ({direction}) shows v = {v}")
        if not bench.capabilities.pwm:
            moved = bench.moved(before, after)
            promise(
                moved > NOTICEABLE, "Outputs.v", f"is obeyed without pwm, but {given} moved the robot {moved:.3f} m"
            )


class Bench:
    """An open HAL and the time of its run, which starts now."""

    def __init__(self, hal: Hal) -> None:
        self.hal = hal
        self.capabilities = hal.capabilities
        self._loop = asyncio.get_running_loop()
        self._started = self._loop.time()

    @property
    def now(self) -> float:
        """Seconds since the run started."""
        return self._loop.time() - self._started

    def read(self) -> Inputs:
        """The inputs now."""
        inputs = called("Hal.read", self.hal.read, self.now)
        if not isinstance(inputs, Inputs):
            broken("Hal.read", f"returns Inputs, not {type(inputs).__name__}")
        return inputs

    def write(self, outputs: Outputs) -> None:
        """Write outputs now."""
        called("Hal.write", self.hal.write, outputs, self.now)

    async def ready(self) -> None:
        """Wait until the robot can be driven: a board behind a link has to answer, and loops of its own need gains."""
        waits_for_gains = self.capabilities.gains and self.capabilities.simulated
        answers: list[bool] = []
        if waits_for_gains:
            called("Hal.load_gains", self.hal.load_gains, GAINS, answers.append)
        while True:
            link = self.read().link
            if (link is None or link.ready) and (answers or not waits_for_gains):
                break
            promise(self.now < PATIENCE, "BoardLink.ready", f"comes true, but after {PATIENCE:g} s it is {link}")
            await self.hold(NEUTRAL, PERIOD)
        promise(all(answers), "Hal.load_gains", "takes the gains of the thesis, but they were rejected")

    async def hold(self, outputs: Outputs, seconds: float) -> Inputs:
        """The inputs after holding outputs for so long, with a read and a write each period as the tasks do."""
        ends = self.now + seconds - 0.5 * PERIOD
        while True:
            self.write(outputs)
            await asyncio.sleep(PERIOD)
            inputs = self.read()
            if self.now >= ends:
                return inputs

    def moved(self, before: Inputs, after: Inputs) -> float:
        """Metres, about, between two readings, by the best sensor there is: true pose, odometry, ticks."""
        if before.pose is not None and after.pose is not None:
            return hypot(after.pose[0] - before.pose[0], after.pose[1] - before.pose[1])
        if before.ticks is not None and after.ticks is not None:
            # a tick is 0.3 mm
            return max(abs(b - a) for a, b in zip(before.ticks, after.ticks, strict=True)) * 0.0003
        if before.odometry is not None and after.odometry is not None:
            return hypot(after.odometry.x - before.odometry.x, after.odometry.y - before.odometry.y)
        return broken("Inputs", "reports ticks or odometry, but has neither")

    def requires(self, *capabilities: str) -> None:
        """Skip the test unless the HAL has these capabilities."""
        for capability in capabilities:
            if not getattr(self.capabilities, capability):
                raise SkipTest(f"the HAL '{self.hal.name}' has no capability '{capability}'")

    def offers(self, capability: str, where: str, call: Callable[[], object]) -> None:
        """Check that a call works if the HAL has the capability and raises NotCapable if it has not."""
        has = getattr(self.capabilities, capability)
        try:
            called(where, call)
        except NotCapable as error:
            if has:
                broken(where, f"works with the capability '{capability}', but raised {named(error)}")
            promise(
                (error.hal, error.capability) == (self.hal.name, capability),
                where,
                f"names HAL and capability in NotCapable, but '{error.hal}' and '{error.capability}' are others",
            )
        except Exception as error:
            expected = "works" if has else "raises NotCapable"
            broken(where, f"{expected} {'with' if has else 'without'} '{capability}', but raised {named(error)}")
        else:
            promise(has, where, f"raises NotCapable without the capability '{capability}', but did not")


# -- what a reading must be ------------------------------------------------------------------------------------


def _check_inputs(inputs: Inputs, can: Capabilities, now: float, complete: bool) -> None:
    """Check every field against the capabilities; a sensor must have reported by now if `complete`."""
    _check_field("ticks", inputs.ticks, can.ticks, complete, _is_pair_of_ints, "a pair of ints")
    _check_field("batteries", inputs.batteries, can.battery, complete, _is_pair_of_voltages, "a pair of voltages >= 0")
    _check_field("pose", inputs.pose, can.pose, complete, _is_pose, "finite (x, y, theta)")
    odometry = inputs.odometry
    if odometry is None:
        missing = complete and not can.ticks
        promise(not missing, "Inputs.odometry", "is reported by a HAL without ticks, but there is none")
    else:
        fine = isinstance(odometry, Odometry) and all(map(isfinite, odometry))
        promise(fine, "Inputs.odometry", f"is an Odometry of finite numbers, not {odometry!r}")
        arrived = inputs.odometry_time
        promise(
            isfinite(arrived) and arrived <= now + 1e-9,
            "Inputs.odometry_time",
            f"is when it arrived, but {arrived!r} is no time up to now ({now:.3f})",
        )
    promise(isinstance(inputs.cut_off, bool), "Inputs.cut_off", f"is True or False, not {inputs.cut_off!r}")
    buttons = inputs.buttons
    promise(isinstance(buttons, Button), "Inputs.buttons", f"is a Button, not {buttons!r}")
    promise(can.buttons or not buttons, "Inputs.buttons", f"is NONE without the capability 'buttons', not {buttons!r}")
    backlight = inputs.backlight
    fine = backlight is None or 0.0 <= backlight <= 1.0
    promise(fine, "Inputs.backlight", f"is None or from 0 to 1, not {backlight!r}")


def _check_field(
    name: str, value: Any, capable: bool, complete: bool, valid: Callable[[Any], bool], expected: str
) -> None:
    where = f"Inputs.{name}"
    if value is None:
        promise(not (capable and complete), where, f"is {expected} by the capabilities, but None")
    else:
        promise(capable, where, f"is None without the capability, but {value!r}")
        promise(valid(value), where, f"is {expected}, not {value!r}")


def _is_pair_of_ints(value: Any) -> bool:
    return isinstance(value, tuple) and len(value) == 2 and all(type(v) is int for v in value)


def _is_pair_of_voltages(value: Any) -> bool:
    return isinstance(value, tuple) and len(value) == 2 and all(isfinite(v) and v >= 0.0 for v in value)


def _is_pose(value: Any) -> bool:
    return isinstance(value, tuple) and len(value) == 3 and all(map(isfinite, value))


# -- for a command -----------------------------------------------------------------------------------------------


def promises() -> list[str]:
    """The names of all tests, in order."""
    return conformance.promises(HalConformance)


def verdicts(make: Callable[[], Hal]) -> Iterator[tuple[str, str]]:
    """Every promise in words, and "ok", "skipped: ..." or "BROKEN: ...", for the HAL that `make` makes."""
    return conformance.verdicts(HalConformance, make)

"""The promises of every hardware layer, as a suite of tests for any HAL.

Use it in your own test class (see `txt1.conformance`), or from the command line for a registered HAL::

    txt1 hal check mycar --set hal_options.port=/dev/ttyUSB0

`txt1.hal.base` states the promises. A promise about a capability that the HAL lacks is skipped. A real HAL (not
`simulated`) is driven, too: for an instant each at low, medium and full throttle, then neutral. Lift the wheels off the
ground.

Hardware behind a line has promises about bad lines, too: lines that tear, merge, corrupt, delay, lose or cut. They are
tried if `over` returns a HAL with its virtual device at the end of a bad line. It has promises about silence, which are
tried if `behind` returns a HAL whose port is wrapped.
"""

import asyncio
from collections.abc import Callable, Coroutine
from functools import wraps
from math import hypot, inf, isfinite, nan
from typing import Any, ClassVar, Final
from unittest import SkipTest

from txt1.conformance import Conformance, broken, kept, named, opened, promise
from txt1.control.schedule import ANGULAR_GAINS, LINEAR_GAINS
from txt1.errors import NotCapable
from txt1.hal.base import Button, Capabilities, Hal, Indicators, Inputs, Outputs, lacking
from txt1.link.base import Port
from txt1.link.outages import Outage, OutagePort
from txt1.link.silence import LONGEST_PAUSE
from txt1.model.kinematics import wrap_angle
from txt1.model.odometry import Odometry
from txt1.model.vehicle import PWM_MAX, outputs_of
from txt1.protocol.messages import CombinedOdometry, PidSet, Switch
from txt1.sim.parameters import Box, LineFaults

# s between two calls: the controller's
CALL_PERIOD: Final = 0.02

# a HAL obeys either the counts or the set-point, so these outputs have both
NEUTRAL: Final = Outputs()
FORWARD: Final = Outputs(motor=3000, v=0.5)
BACKWARD: Final = Outputs(motor=-3000, v=-0.5)
PIVOT_MOTOR, PIVOT_REAR = map(round, outputs_of(FORWARD.motor, -FORWARD.motor))
# for sides at two speeds: the right side as in FORWARD
PIVOT: Final = Outputs(PIVOT_MOTOR, -PIVOT_REAR, PIVOT_REAR)
LEFT: Final = Outputs(motor=3000, front=-12000, rear=12000, v=0.5, omega=0.5)
# shares of full power that are tried first
STEPS: Final = (0.02, 0.1, 0.3)
EXTREMES: Final = tuple(Outputs._make((*[sign * PWM_MAX] * 5, sign * 1.5, sign * 1.5 / 0.56)) for sign in (1, -1))

GAINS: Final = PidSet(LINEAR_GAINS, tuple((s.v_max, *s.gains) for s in ANGULAR_GAINS))
COMBINED: Final = CombinedOdometry(1.0, -2.0, 0.5, 0.3, 0.1)

# s within which a board behind a link answers and takes its gains, however noisy the link is
LINK_PATIENCE: Final = 60.0
# m after which the robot has moved
NOTICEABLE: Final = 0.005

# s after which the line is cut in the promises about cut lines
CUT: Final = 4.0
# s within which a loss is reported
NOTICED: Final = 1.0
# factor by which two paths from the same counts may differ
PATHS_ALIKE: Final = 1.5
# m or rad between two readings that no motion at 0.5 m/s explains, however late a reading is
LEAP: Final = 0.4


# s from opening to an outage
OUTAGE_BEGINS: Final = 6.0
# texts about one outage: lost, connected again, who might be there, found
TEXTS: Final = 8
# s within which a HAL can drive again when its device is back: the longest pause, and the time to settle
BACK: Final = LONGEST_PAUSE + 10.0


def in_an_outage(
    outage: Outage, lasts: float
) -> Callable[[Callable[..., Coroutine[Any, Any, None]]], Callable[..., None]]:
    """Run a test on a new HAL that is open, whose port has this outage; skip it for a HAL without a port."""

    def decorate(test: Callable[..., Coroutine[Any, Any, None]]) -> Callable[..., None]:
        tested = opened(test)

        @wraps(test)
        def out(self: Any) -> None:
            hal = self.behind(lambda port: OutagePort(port, outage, OUTAGE_BEGINS, lasts))
            if hal is None:
                raise SkipTest("override HalConformance.behind to try outages, where there is a port")
            self.part, self.ends = hal, OUTAGE_BEGINS + lasts
            tested(self)

        return out

    return decorate


def over_a_line(**faults: float) -> Callable[[Callable[..., Coroutine[Any, Any, None]]], Callable[..., None]]:
    """Run a test on a new HAL that is open, over a line with these faults; skip it for a HAL without a line."""

    def decorate(test: Callable[..., Coroutine[Any, Any, None]]) -> Callable[..., None]:
        tested = opened(test)

        @wraps(test)
        def over(self: Any) -> None:
            hal = self.over(LineFaults(**faults))  # type: ignore[arg-type]
            if hal is None:
                raise SkipTest("override HalConformance.over to try bad lines, where there is a line")
            self.part = hal
            tested(self)

        return over

    return decorate


class HalConformance(Conformance[Hal]):
    """The promises, a test for each. Override `make`; override `held` and the settings if the defaults do not fit."""

    interface = Hal
    prompt = 0.25 * CALL_PERIOD

    drive: ClassVar[float] = 1.0
    """Seconds of driving at 0.5 m/s or 3000 counts after which the motion is judged.

    A wall within 4 m would stop a robot that does not stop by itself, so give a simulated robot room.
    """

    # end of the outage, s
    ends = 0.0

    skids: ClassVar[bool] = False
    """Whether no wheel steers, and the sides run at two speeds."""

    def held(self, hal: Hal) -> Outputs | None:
        """Return the present outputs of the actuators; override this if they can be read.

        None skips the tests for them.
        """
        return None

    def over(self, faults: LineFaults) -> Hal | None:
        """Return a new HAL whose line to its virtual device has these faults in both directions; None if it has
        no line.
        """
        return None

    def behind(self, wrap: Callable[[Port], Port]) -> Hal | None:
        """Return a new HAL whose port is `wrap` of the port of its virtual device; None if it has no port."""
        return None

    # -- identity and life -------------------------------------------------------------------------------------

    @opened
    async def test_the_name_is_text(self) -> None:
        name = self.part.name
        promise(isinstance(name, str) and name.strip() != "", "Hal.name", f"is text that is not empty, not {name!r}")

    @opened
    async def test_capabilities_and_name_are_constant(self) -> None:
        hal, new = self.part, self.make()
        name, before = new.name, new.capabilities
        kind = type(before).__name__
        promise(isinstance(before, Capabilities), "Hal.capabilities", f"is a Capabilities, not {kind}")
        await self.hold(NEUTRAL, CALL_PERIOD)
        promise(hal.capabilities == before, "Hal.capabilities", "is constant, but opening the HAL changed it")
        await hal.close()
        promise(hal.capabilities == before, "Hal.capabilities", "is constant, but closing the HAL changed it")
        promise(hal.name == name, "Hal.name", f"is constant, but {name!r} became {hal.name!r}")

    @opened
    async def test_every_field_of_the_capabilities_is_true_or_false(self) -> None:
        for name, value in vars(self.can).items():
            promise(isinstance(value, bool), f"Capabilities.{name}", f"is True or False, not {value!r}")

    @opened
    async def test_it_has_every_member(self) -> None:
        told = "; txt1.hal.PlainHal has plain ones"
        for name in lacking(self.part):
            broken(f"Hal.{name}", f"is there, also for a HAL that needs none{told}")

    @opened
    async def test_the_optional_members_are_as_described(self) -> None:
        hal = self.part
        promise(hal.tap_line(lambda direction, data: None) in (True, False), "Hal.tap_line", "returns True or False")
        hal.clear_loops(self.now)
        blocked = hal.blocked_by()
        promise(blocked is None or isinstance(blocked, str), "Hal.blocked_by", f"is text or None, not {blocked!r}")
        roll, pitch = hal.attitude()
        promise(isfinite(roll + pitch), "Hal.attitude", f"is roll and pitch in rad, not ({roll}, {pitch})")
        for x, y, theta in hal.others():
            promise(isfinite(x + y + theta), "Hal.others", f"are poses (x, y, theta), not ({x}, {y}, {theta})")
        for box in hal.movers():
            promise(isinstance(box, Box), "Hal.movers", f"are boxes of txt1.sim.parameters, not {box!r}")

    @opened
    async def test_a_closed_hal_opens_again(self) -> None:
        await self.hold(NEUTRAL, CALL_PERIOD)
        await self.reopen()
        await self.hold(NEUTRAL, CALL_PERIOD)

    @opened
    async def test_opening_leaves_the_outputs_neutral(self) -> None:
        self.expect_held(NEUTRAL, "Hal.open", "leaves the outputs neutral")

    @opened
    async def test_closing_leaves_the_outputs_neutral(self) -> None:
        # if this fails, a real car must not be left at speed
        self.requires("simulated")
        await self.hold(FORWARD, self.drive)
        await self.part.close()
        if self.held(self.part) is not None:
            self.expect_held(NEUTRAL, "Hal.close", "leaves the outputs neutral")
        await self.part.open()
        await asyncio.sleep(self.settle)
        stopped = self.read()
        await asyncio.sleep(self.settle)
        still = _moved(stopped, self.read()) < NOTICEABLE
        promise(still, "Hal.close", "leaves the outputs neutral, but the robot drives on after close and open")

    # -- reading -----------------------------------------------------------------------------------------------

    @opened
    async def test_reading_returns_inputs_at_once(self) -> None:
        # the placeholder refuses everything else, coroutines first
        self.read()

    @opened
    async def test_reading_and_writing_are_prompt(self) -> None:
        await self.expect_prompt("Hal.read", CALL_PERIOD, self.read)
        await self.expect_prompt("Hal.write", CALL_PERIOD, lambda: self.write(NEUTRAL))

    @opened
    async def test_every_input_agrees_with_the_capabilities(self) -> None:
        self.check_inputs(self.read(), complete=False)
        self.check_inputs(await self.hold(NEUTRAL, self.settle), complete=True)

    @opened
    async def test_reading_twice_at_one_instant_changes_nothing(self) -> None:
        await self.hold(NEUTRAL, self.settle)
        first, second = [(one.ticks, one.pose) for one in (self.read(), self.read())]
        told = f"but ticks and pose {first} became {second} while time stood still"
        promise(first == second, "Hal.read", f"reports the sensors at `now`, {told}")

    @opened
    async def test_it_survives_many_reads_and_gaps(self) -> None:
        for _ in range(500):
            await asyncio.sleep(CALL_PERIOD)
            self.check_inputs(self.read(), complete=False)
        await asyncio.sleep(10.0 * CALL_PERIOD)
        self.check_inputs(self.read(), complete=False)

    # -- writing -----------------------------------------------------------------------------------------------

    @opened
    async def test_writing_accepts_everything_between_the_ends(self) -> None:
        small = [part(outputs, share) for share in STEPS for outputs in EXTREMES]
        for outputs in (NEUTRAL, *small, NEUTRAL, *EXTREMES, NEUTRAL):
            with kept("Hal.write", f"takes {outputs}"):
                self.write(outputs)

    @opened
    async def test_what_was_written_is_held(self) -> None:
        for outputs in (LEFT, NEUTRAL):
            self.write(outputs)
            self.expect_held(outputs, "Hal.write", "holds the outputs from `now` on")

    @opened
    async def test_neutral_outputs_do_not_move_the_robot(self) -> None:
        moved = _moved(await self.hold(NEUTRAL, self.settle), await self.hold(NEUTRAL, self.drive))
        promise(moved < NOTICEABLE, "Outputs", f"are neutral when all are 0, but the robot moved {moved:.3f} m")

    @opened
    async def test_neutral_outputs_stop_the_robot(self) -> None:
        self.requires("simulated")
        await self.hold(FORWARD, self.drive)
        moved = _moved(await self.hold(NEUTRAL, self.settle), await self.hold(NEUTRAL, self.drive))
        promise(moved < NOTICEABLE, "Hal.write", f"neutral stops the robot, but it moved on {moved:.3f} m")

    # -- driving, for simulated HALs -------------------------------------------------------------------------------

    @opened
    async def test_forward_is_positive_and_backward_negative(self) -> None:
        self.requires("simulated")
        for outputs, sign in ((FORWARD, 1), (BACKWARD, -1)):
            before = await self.hold(NEUTRAL, self.settle)
            after = await self.hold(outputs, self.drive)
            self.follows(outputs, after)
            given = f"motor {outputs.motor}" if self.can.pwm else f"v {outputs.v} m/s"
            if ticks := _rolled(before, after):
                told = f"are forward positive, but {given} changed them by right {ticks[0]}, left {ticks[1]}"
                promise(all(sign * t > 0 for t in ticks), "Inputs.ticks", told)
            elif after.odometry is not None:
                v = after.odometry.v
                promise(sign * v > 0.0, "Inputs.odometry", f"is forward positive, but {given} shows v = {v}")
            moved = _moved(before, after)
            obeyed = self.can.pwm or moved > NOTICEABLE
            promise(obeyed, "Outputs.v", f"is obeyed without pwm, but {given} moved the robot {moved:.3f} m")

    @opened
    async def test_front_to_the_left_and_rear_to_the_right_turn_left(self) -> None:
        self.requires("simulated")
        before = await self.hold(NEUTRAL, self.settle)
        after = await self.hold(LEFT, self.drive)
        self.follows(LEFT, after)
        if ticks := _rolled(before, after):
            told = f"the right wheel goes further, but the ticks are right {ticks[0]} and left {ticks[1]}"
            where = "Outputs.front, Outputs.rear"
            promise(ticks[0] > ticks[1], where, f"turn left for front < 0 < rear, so {told}")
        elif after.odometry is not None:
            omega = after.odometry.omega
            promise(omega > 0.0, "Outputs.omega", f"is left positive, but 0.5 rad/s gave {omega:.3f} rad/s")

    @opened
    async def test_sides_that_run_at_two_speeds_come_of_the_outputs_as_written(self) -> None:
        if not self.skids:
            raise SkipTest("its wheels steer")
        self.requires("simulated", "pwm", "ticks")
        paths = []
        for outputs in (FORWARD, PIVOT):
            before = await self.hold(NEUTRAL, self.settle)
            after = await self.hold(outputs, self.drive)
            self.follows(outputs, after)
            paths.append(_rolled(before, after) or (0, 0))
        (right, left), (turning_right, turning_left) = paths
        alike = all(
            0 < b / PATHS_ALIKE < a < b * PATHS_ALIKE for a, b in ((turning_right, right), (-turning_left, left))
        )
        given = f"motor {FORWARD.motor} rolls them by {paths[0]} ticks and rear {PIVOT.rear} by {paths[1]}"
        promise(alike, "Outputs.rear", f"drives the sides as txt1.model.vehicle.sides says, but {given}")

    @opened
    async def test_the_switches_work_or_are_refused(self) -> None:
        # the ATX supply of a real robot feeds the computer that runs the test
        states = (False, True) if self.can.simulated or not self.can.power else (True,)
        for switch in Switch:
            for on in states:
                self.offers("power", "switch", switch, on, self.now)

    @opened
    async def test_without_the_esc_nothing_moves(self) -> None:
        self.requires("simulated", "power")
        before = await self.hold(NEUTRAL, self.settle)
        self.part.switch(Switch.ESC, False, self.now)
        moved = _moved(before, await self.hold(FORWARD, self.drive))
        promise(moved < NOTICEABLE, "Hal.switch", f"ESC off lets nothing move, but the robot moved {moved:.3f} m")

    @opened
    async def test_gains_are_taken_or_refused(self) -> None:
        self.offers("gains", "load_gains", GAINS, lambda accepted: None)

    @opened
    async def test_combined_odometry_is_taken_or_refused(self) -> None:
        self.offers("combined", "offer_odometry", COMBINED, self.now)

    @opened
    async def test_indicators_are_set_or_ignored(self) -> None:
        for indicators in (Indicators(), Indicators(True, True, True)):
            with kept("Hal.indicate", "does nothing where there are no indicators"):
                self.called("indicate", indicators)

    @opened
    async def test_the_robot_is_placed_or_it_is_refused(self) -> None:
        await self.hold(NEUTRAL, CALL_PERIOD)
        self.offers("place", "place", 0.1, -0.2, 0.3, self.now)
        self.requires("place", "pose")
        pose = self.read().pose
        near = pose is not None and max(map(abs, (pose[0] - 0.1, pose[1] + 0.2, pose[2] - 0.3))) < 1e-6
        promise(near, "Hal.place", f"puts the robot down at (0.1, -0.2, 0.3), but it stands at {pose}")

    @opened
    async def test_a_robot_put_down_is_at_rest(self) -> None:
        self.requires("place", "pose")
        await self.hold(FORWARD, self.drive)
        self.write(NEUTRAL)
        self.part.place(0.0, 0.0, 0.0, self.now)
        pose = (await self.hold(NEUTRAL, self.drive)).pose
        at_rest = pose is not None and hypot(pose[0], pose[1]) < NOTICEABLE
        promise(at_rest, "Hal.place", f"puts the robot down at rest, but it rolled on from (0, 0, 0) to {pose}")

    @opened
    async def test_the_robot_is_not_placed_where_it_cannot_stand(self) -> None:
        self.requires("place")
        for pose in ((nan, 0.0, 0.0), (0.0, inf, 0.0)):
            try:
                self.part.place(*pose, self.now)
            except ValueError:
                continue
            broken("Hal.place", f"raises ValueError where the robot cannot stand, but took {pose}")

    # -- promises on bad lines -------------------------------------------------------------------------------------

    @over_a_line(split=True, tear=0.1)
    async def test_a_line_that_tears_is_driven_over(self) -> None:
        await self.drives_over_it()

    @over_a_line(merge=0.113)
    async def test_a_line_that_merges_is_driven_over(self) -> None:
        await self.drives_over_it()

    @over_a_line(flip=1e-4)
    async def test_a_line_that_corrupts_is_driven_over(self) -> None:
        await self.drives_over_it()

    @over_a_line(delay=0.05, jitter=0.05)
    async def test_a_line_that_is_late_is_driven_over(self) -> None:
        await self.drives_over_it()

    @over_a_line(drop=0.1, duplicate=0.1)
    async def test_a_line_that_loses_and_doubles_is_driven_over(self) -> None:
        await self.drives_over_it()

    @over_a_line(cut=CUT)
    async def test_a_line_that_is_cut_is_lost_and_found_again(self) -> None:
        self.requires_a_line()
        link = None
        while self.now < CUT + NOTICED:
            link = (await self.hold(FORWARD, CALL_PERIOD)).link
        told = f"{NOTICED:g} s after the cut there are none; are the faults put on its line?"
        promise(link is not None and link.losses > 0, "BoardLink.losses", f"counts a line that is cut, but {told}")
        await self.ready()

    # -- promises about silence ------------------------------------------------------------------------------------

    @in_an_outage(Outage.SILENT, 1.0)
    async def test_a_device_that_is_silent_for_a_second_is_found_again(self) -> None:
        await self.is_found_again()

    @in_an_outage(Outage.SILENT, 60.0)
    async def test_a_device_that_is_silent_for_a_minute_is_found_again(self) -> None:
        await self.is_found_again()

    @in_an_outage(Outage.UNPLUGGED, 20.0)
    async def test_a_device_that_is_unplugged_is_found_again(self) -> None:
        await self.is_found_again()

    @in_an_outage(Outage.POWER, 10.0)
    async def test_a_device_without_power_behind_its_adapter_is_found_again(self) -> None:
        await self.is_found_again()

    @in_an_outage(Outage.HALF_OPEN, 0.0)
    async def test_a_connection_that_is_half_open_is_made_again(self) -> None:
        await self.is_found_again()

    # -- for the tests -----------------------------------------------------------------------------------------

    async def is_found_again(self) -> None:
        """Check that a device in an outage is lost, told a few times at most, found again and driven again."""
        texts: list[str] = []
        losses = 0
        while self.now < OUTAGE_BEGINS:
            # it drives when the outage begins, and is not yet at a wall
            await self.hold(FORWARD if self.now > OUTAGE_BEGINS - self.drive else NEUTRAL, CALL_PERIOD)
        while self.now < max(self.ends, OUTAGE_BEGINS + NOTICED) or not self.is_ready():
            link = (await self.hold(NEUTRAL, CALL_PERIOD)).link
            if link is not None:
                texts += [link.text] if link.text not in texts[-1:] else []
                losses = link.losses
            told = f"but {BACK:g} s after the outage it is not; the link says: {texts[-1:]}"
            promise(self.now < self.ends + BACK, "BoardLink.ready", f"comes true when the device is back, {told}")
        promise(losses > 0, "BoardLink.losses", "counts a device that falls silent, but there are none")
        promise(len(texts) <= TEXTS, "BoardLink.text", f"tells an outage once, not {len(texts)} times: {texts}")
        before = await self.hold(NEUTRAL, self.settle)
        after = await self.hold(NEUTRAL, self.drive)
        if not self.can.blind:
            moved = _moved(before, after)
            promise(moved < NOTICEABLE, "Hal.write", f"neutral holds the robot, but it moved {moved:.3f} m")
            moved = _moved(after, await self.hold(FORWARD, 2.0 * self.drive))
            promise(moved > NOTICEABLE, "Hal.write", f"is obeyed again after the outage, but it moved {moved:.3f} m")

    def follows(self, outputs: Outputs, after: Inputs) -> None:
        """Skip the test if the HAL says that its motors do not follow these outputs, such as an unknown ESC."""
        if after.held:
            why = "" if after.link is None else f": {after.link.text}"
            raise SkipTest(f"the HAL holds its motors at motor {outputs.motor}, v {outputs.v} m/s{why}")

    def is_ready(self) -> bool:
        """Return whether the device may be driven."""
        link = self.read().link
        return link is None or link.ready

    def requires_a_line(self) -> None:
        """Skip the test unless the hardware is behind a line."""
        if self.read().link is None:
            raise SkipTest(f"the HAL '{self.part.name}' has no line: it reports no BoardLink")

    async def drives_over_it(self) -> None:
        """Check that the robot drives, stops and reports no nonsense, whatever its line does."""
        self.requires_a_line()
        before = last = await self.hold(NEUTRAL, self.settle)
        for _ in range(round(2.0 * self.drive / CALL_PERIOD)):
            now = await self.hold(FORWARD, CALL_PERIOD)
            self.check_inputs(now, complete=False)
            leap = _leap(last, now)
            promise(leap < LEAP, "Hal.read", f"reports the sensors, but it leapt by {leap:.2f} m or rad")
            last = now
            if now.link is not None and not now.link.ready:
                await self.ready()
        if not self.can.blind:
            moved = _moved(before, last)
            promise(moved > 0.2 * self.drive, "Hal.write", f"is obeyed, but the robot moved {moved:.3f} m")
            moved = _moved(await self.hold(NEUTRAL, self.settle), await self.hold(NEUTRAL, self.drive))
            promise(moved < NOTICEABLE, "Hal.write", f"neutral stops the robot, but it moved on {moved:.3f} m")

    @property
    def can(self) -> Capabilities:
        """The HAL's capabilities."""
        return self.part.capabilities

    async def ready(self) -> None:
        """Wait until the robot can be driven: a board behind a link has to answer, and its loops need gains."""
        waits_for_gains = self.can.gains and self.can.simulated
        answers: list[bool] = []
        if waits_for_gains:
            self.called("load_gains", GAINS, answers.append)
        while True:
            link = self.read().link
            if (link is None or link.ready) and (answers or not waits_for_gains):
                break
            told = "its gains are not answered" if link is None or link.ready else f"the link says: {link.text}"
            promise(self.now < LINK_PATIENCE, "BoardLink.ready", f"comes true, but after {LINK_PATIENCE:g} s {told}")
            await self.hold(NEUTRAL, CALL_PERIOD)
        promise(all(answers), "Hal.load_gains", "takes the gains of the thesis, but they were rejected")

    def read(self) -> Inputs:
        """Return the present inputs."""
        inputs = self.called("read", self.now)
        if not isinstance(inputs, Inputs):
            broken("Hal.read", f"returns Inputs, not {type(inputs).__name__}")
        return inputs

    def write(self, outputs: Outputs) -> None:
        """Write outputs now."""
        self.called("write", outputs, self.now)

    async def hold(self, outputs: Outputs, seconds: float) -> Inputs:
        """Hold outputs for `seconds`, with a read and a write each period as the tasks do; return the inputs."""
        ends = self.now + seconds - 0.5 * CALL_PERIOD
        while True:
            self.write(outputs)
            await asyncio.sleep(CALL_PERIOD)
            inputs = self.read()
            if self.now >= ends:
                return inputs

    def requires(self, *capabilities: str) -> None:
        """Skip the test unless the HAL has these capabilities."""
        for capability in capabilities:
            if not getattr(self.can, capability):
                raise SkipTest(f"the HAL '{self.part.name}' has no capability '{capability}'")

    def offers(self, capability: str, method: str, *arguments: object) -> None:
        """Check that a method works if the HAL has the capability and raises NotCapable if it has not."""
        where, has = f"Hal.{method}", f"the capability '{capability}'"
        if getattr(self.can, capability):
            with kept(where, f"works with {has}"):
                self.called(method, *arguments)
            return
        try:
            self.called(method, *arguments)
        except NotCapable as error:
            rightly = (error.hal, error.capability) == (self.part.name, capability)
            told = f"'{error.hal}' and '{error.capability}' are others"
            promise(rightly, where, f"names HAL and capability in NotCapable, but {told}")
        except Exception as error:
            broken(where, f"raises NotCapable without {has}, but raised {named(error)}")
        else:
            broken(where, f"raises NotCapable without {has}, but did not")

    def expect_held(self, expected: Outputs, where: str, text: str) -> None:
        """Check that the actuators have the expected outputs."""
        held = self.held(self.part)
        if held is None:
            raise SkipTest("override HalConformance.held to check what the actuators do")
        obeyed = slice(0, 3) if self.can.pwm else slice(5, 7)
        same = held[obeyed] == expected[obeyed]
        promise(same, where, f"{text}, but the actuators are at {held} instead of {expected}")

    def check_inputs(self, inputs: Inputs, complete: bool) -> None:
        """Check every field against the capabilities; with `complete` every sensor must have reported."""
        can, now = self.can, self.now
        sensors: tuple[tuple[str, bool, int, Callable[[Any], bool], str], ...] = (
            ("ticks", can.ticks, 2, lambda n: type(n) is int, "a pair of ints"),
            ("batteries", can.battery, 2, lambda u: isfinite(u) and u >= 0.0, "a pair of voltages >= 0"),
            ("pose", can.pose, 3, isfinite, "finite (x, y, theta)"),
        )
        for name, capable, length, valid, expected in sensors:
            value, where = getattr(inputs, name), f"Inputs.{name}"
            if value is None:
                promise(not (capable and complete), where, f"is {expected} by the capabilities, but None")
                continue
            promise(capable, where, f"is None without the capability, but {value!r}")
            fine = isinstance(value, tuple) and len(value) == length and all(map(valid, value))
            promise(fine, where, f"is {expected}, not {value!r}")
        odometry, arrived, buttons, backlight = inputs.odometry, inputs.odometry_time, inputs.buttons, inputs.backlight
        absent = odometry is None
        missing = absent and complete and not (can.ticks or can.blind)
        promise(not missing, "Inputs.odometry", "is reported by a HAL without ticks, but there is none")
        sound = isinstance(odometry, Odometry) and all(map(isfinite, odometry))
        for fine, name, expected in (
            (absent or sound, "odometry", "an Odometry of finite numbers"),
            (
                absent or (isfinite(arrived) and arrived <= now + 1e-9),
                "odometry_time",
                f"when it arrived, by {now:.3f}",
            ),
            (isinstance(inputs.cut_off, bool), "cut_off", "True or False"),
            (isinstance(buttons, Button), "buttons", "a Button"),
            (can.buttons or not buttons, "buttons", "NONE without the capability 'buttons'"),
            (backlight is None or 0.0 <= backlight <= 1.0, "backlight", "None or from 0 to 1"),
        ):
            promise(fine, f"Inputs.{name}", f"is {expected}, not {getattr(inputs, name)!r}")


def part(outputs: Outputs, share: float) -> Outputs:
    """Return a share of these outputs."""
    *counts, v, omega = outputs
    return Outputs._make((*(round(share * count) for count in counts), share * v, share * omega))


def _rolled(before: Inputs, after: Inputs) -> tuple[int, int] | None:
    """Return the ticks (right, left) between two readings; None without encoders."""
    if before.ticks is None or after.ticks is None:
        return None
    return after.ticks[0] - before.ticks[0], after.ticks[1] - before.ticks[1]


def _leap(before: Inputs, after: Inputs) -> float:
    """Return the metres or radians between two readings, whichever is more; 0 without odometry and ticks."""
    turned = 0.0
    if before.odometry is not None and after.odometry is not None:
        turned = abs(wrap_angle(after.odometry.theta - before.odometry.theta))
    elif before.ticks is None or after.ticks is None:
        return 0.0
    return max(_moved(before, after), turned)


def _moved(before: Inputs, after: Inputs) -> float:
    """Return the metres between two readings, about, by the best sensor: true pose, ticks of 0.3 mm, or odometry."""
    if before.pose is not None and after.pose is not None:
        return hypot(after.pose[0] - before.pose[0], after.pose[1] - before.pose[1])
    if ticks := _rolled(before, after):
        return max(map(abs, ticks)) * 0.0003
    if before.odometry is not None and after.odometry is not None:
        return hypot(after.odometry.x - before.odometry.x, after.odometry.y - before.odometry.y)
    raise SkipTest("nothing tells whether it moves")

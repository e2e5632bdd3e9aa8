"""Calibration of simulated cars that nobody knows, with operators who see them and measure them as people do."""

from __future__ import annotations

import asyncio
import signal
import subprocess
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import asynccontextmanager
from itertools import pairwise
from math import hypot, tan
from pathlib import Path
from typing import Any

import pytest
from blockbuster import BlockBuster

from tests.e2e.conftest import ENDLESS, may_block
from tests.patience import TXT1
from txt1.cars.pi.driver import PiHal, PiOptions, setup_of
from txt1.cars.pi.virtual_pi import VirtualPi
from txt1.cars.vesc.driver import VescHal, VescOptions
from txt1.cars.vesc.virtual_vesc import Vesc
from txt1.cli import execute
from txt1.commands import FAULT, OK, USAGE
from txt1.config import Config, checked, load
from txt1.config.sources import with_values
from txt1.errors import ConfigError, HalError, NotArmed
from txt1.experiments.calibration.bench import Bench
from txt1.experiments.calibration.floor_steps import _locks
from txt1.experiments.calibration.simulated_operator import SimulatedOperator, judge, passes, unknown_car
from txt1.experiments.calibration.steps import calibrate, steps
from txt1.experiments.command.calibrate import changes
from txt1.hal.channels import rewired
from txt1.hal.registry import create
from txt1.hal.sim import SimHal
from txt1.hal.simulated_controller import ControllerPort
from txt1.kernel.loop import run
from txt1.kit.app import App
from txt1.robot import Robot

KINDS = ("txt1", "f1tenth", "donkeycar", "rover")


@pytest.fixture(autouse=True)
def files_may_be_read_and_written(blocking_calls_fail: BlockBuster) -> None:
    """Before anything runs, and while nothing moves."""
    may_block(blocking_calls_fail, "txt1/config/sources.py", "load")
    may_block(blocking_calls_fail, "txt1/experiments/command/calibrate.py", "keep")


def opener(hal: SimHal) -> Callable[..., Any]:
    @asynccontextmanager
    async def opened(config: Config, unseen: bool) -> AsyncIterator[Robot]:
        wired = rewired(hal, config.channels, config.geometry.steering == "skid", unseen)
        async with Robot.open(wired, config=config) as robot:
            await robot.load_gains()
            yield robot

    return opened


def unknown(kind: str, seed: int) -> tuple[Config, SimHal]:
    """What is believed of a car, and the car."""
    config = load(None, ENDLESS, {}, {"vehicle": kind, "seed": seed}).config
    hal = create(unknown_car(config, seed))
    assert isinstance(hal, SimHal)
    return config, hal


@pytest.mark.parametrize(
    "kind", [kind if kind == "rover" else pytest.param(kind, marks=pytest.mark.long) for kind in KINDS]
)
def test_an_unknown_car_drives_as_it_is_told_once_it_is_calibrated(
    kind: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert execute(["calibrate", "--vehicle", kind, "--practice", "1", "--seed", "7"]) == OK
    assert "1 cars, 0 of them not as they should be" in capsys.readouterr().out


@pytest.mark.long
def test_a_tape_does_not_spoil_the_lock_of_wheels_that_steer_a_little() -> None:
    assert execute(["calibrate", "--vehicle", "txt1", "--practice", "1", "--seed", "190"]) == OK, "its R_min is 1.49 m"


@pytest.mark.long
def test_a_table_of_calibrated_cars_is_gone_on_with(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    table = tmp_path / "rover.csv"
    command = ["calibrate", "--vehicle", "rover", "--write", str(table), "--practice"]
    assert execute([*command, "1"]) == OK
    first = table.read_text()
    assert execute([*command, "2"]) == OK
    assert "2 cars, 0 of them" in capsys.readouterr().out
    assert table.read_text().startswith(first)
    assert [row.partition(",")[0] for row in table.read_text().splitlines()] == ["vehicle", "rover", "rover"]
    assert execute(["calibrate", "--vehicle", "donkeycar", "--write", str(table), "--practice", "1"]) == USAGE
    assert "no table of cars of the kind 'donkeycar'" in capsys.readouterr().err


@pytest.mark.long
@pytest.mark.parametrize("kind", KINDS)
def test_fifty_of_each_kind_do_with_gains_of_their_own(kind: str) -> None:
    assert execute(["calibrate", "--vehicle", kind, "--practice", "50", "--seed", "1000"]) == OK


@pytest.mark.parametrize("kind", KINDS)
def test_it_does_not_before(kind: str) -> None:
    config, hal = unknown(kind, 7)
    believed = with_values(config, {"control.speed_map": [[-4000.0, -1.0], [4000.0, 1.0]]})
    try:
        verdict = run(judge(hal, believed, opener(hal)), speed="max")
    except NotArmed as refused:
        assert "runaway" in str(refused)
    else:
        assert not passes(verdict, 0.0)


class Leaver(SimulatedOperator):
    """An operator who presses Ctrl-C in place of an answer."""

    left = 0

    async def ready(self, key: str, text: str) -> None:
        self._leave()
        await super().ready(key, text)

    async def choose(self, key: str, text: str, options: Sequence[str]) -> str:
        self._leave()
        return await super().choose(key, text, options)

    async def number(self, key: str, text: str, unit: str) -> float:
        self._leave()
        return await super().number(key, text, unit)

    def _leave(self) -> None:
        self.left -= 1
        if self.left == 0:
            raise asyncio.CancelledError


def kept_until(question: int) -> tuple[Config, SimHal, dict[str, Any]]:
    """A car, what is believed of it when its operator leaves at a question, and what was kept."""
    config, hal = unknown("donkeycar", 3)
    kept: dict[str, Any] = {}

    async def broken_off() -> None:
        operator = Leaver(hal, 3)
        operator.left = question
        await calibrate(Bench(config, operator, opener(hal), kept.update), steps(config, hal))

    try:
        run(broken_off(), speed="max")
    except asyncio.CancelledError:
        return config, hal, kept
    raise AssertionError(f"there is no question {question}")


@pytest.mark.long
def test_what_was_found_before_an_interruption_is_kept_whenever_it_comes() -> None:
    kept = [kept_until(question)[2] for question in range(1, 25, 2)]
    for fewer, more in pairwise(kept):
        assert set(fewer) <= set(more)
    assert not kept[0]
    assert [kept[-1]["calibrated"][0], "control.speed_map" in kept[-1]] == ["motor", True]


@pytest.mark.long
def test_an_interrupted_calibration_goes_on_where_it_was() -> None:
    config, hal, kept = kept_until(12)
    config = with_values(config, kept)
    left = [name for name in steps(config, hal) if name not in config.calibrated]
    assert left
    assert "motor" not in left

    async def go_on() -> bool:
        bench = Bench(config, SimulatedOperator(hal, 4), opener(hal), lambda values: None)
        await calibrate(bench, left)
        return passes(await judge(hal, bench.config, opener(hal)), bench.driving)

    assert run(go_on(), speed="max")


STEPS_OF = {
    "donkeycar": ["motor", "steering", "straight", "circle", "speeds"],
    "rover": ["motor", "straight", "turn"],
    "f1tenth": ["motor", "steering", "straight", "circle", "tune"],
    "txt1": ["motor", "steering", "straight", "circle", "tune"],
}
EVERY_STEP = [
    pytest.param(kind, step, marks=() if (kind, step) == ("donkeycar", 3) else pytest.mark.long)
    for kind, names in STEPS_OF.items()
    for step in range(1, len(names) + 1)
]


@pytest.mark.parametrize(("kind", "step"), EVERY_STEP)
def test_ctrl_c_ends_it_at_once_with_the_file_as_far_as_it_has_come(kind: str, step: int, tmp_path: Path) -> None:
    file, names = tmp_path / "mine.yaml", STEPS_OF[kind]
    words = ["calibrate", "--vehicle", kind, "--seed", "3", "--write", str(file), "--speed", "40"]
    with subprocess.Popen([*TXT1, *words], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as process:
        assert process.stdout is not None
        for line in process.stdout:
            if line.startswith(f"-- {step} of {len(names)}"):
                process.send_signal(signal.SIGINT)
                break
        told = process.stdout.read()
    assert process.returncode == 130, told
    assert "the same command goes on there" in told
    done = load(None, (), {}, {"vehicle": str(file)}).config.calibrated if file.exists() else ()
    assert list(done) == names[: step - 1]


def test_a_command_that_finds_the_gate_closed_by_ctrl_c_is_ended_by_ctrl_c() -> None:
    app = App()

    async def work() -> None:
        signal.raise_signal(signal.SIGINT)
        try:
            await asyncio.Future()
        except asyncio.CancelledError:
            raise NotArmed("ended by a signal") from None

    assert app.run(work()) == 130


def test_it_writes_a_vehicles_file_and_shows_before_and_after(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "mine.yaml"
    command = ["calibrate", "--vehicle", "donkeycar", "--seed", "3", "--write", str(file)]
    assert execute([*command, "--step", "motor", "--step", "steering"]) == OK
    told = capsys.readouterr().out
    assert "channels.motor.direction  1 -> -1" in told
    assert "still to do: straight, circle, speeds" in told
    assert execute(command) == OK
    told = capsys.readouterr().out
    assert "1 of 3, straight" in told
    assert "geometry.radius_min" in told
    assert execute(command) == OK
    assert "all steps are done" in capsys.readouterr().out
    config = load(None, (), {}, {"vehicle": str(file)}).config
    assert config.channels == config.sim.channels
    assert config.geometry.wheelbase == 0.174  # what is measured by nobody stays
    drive = ["--drive", "0.5,0", "--duration", "5", "--speed", "max", "--json"]
    assert execute(["run", "--vehicle", str(file), *drive]) == OK
    assert '"armed": true' in capsys.readouterr().out


@pytest.mark.parametrize("more", [[], ["--step", "motor"]])
def test_a_file_of_another_car_is_not_gone_on_with(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], more: Sequence[str]
) -> None:
    file = tmp_path / "mc.yaml"
    file.write_text("geometry: {steering: front, counts_per_rev: 1024}\n")
    before = file.read_text()
    assert execute(["calibrate", "--vehicle", "donkeycar", "--seed", "3", "--write", str(file), *more]) == USAGE
    told = capsys.readouterr().err
    assert "of another car than --vehicle donkeycar: its geometry.wheelbase is" in told
    assert f"go on with it by --vehicle {file}" in told and file.read_text() == before
    assert execute(["calibrate", "--vehicle", str(file), "--seed", "3", "--write", str(file), "--step", "motor"]) == OK


def test_mistakes_in_the_command_line_are_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for words, said in (
        ([], "add --write FILE"),
        (["--write", str(tmp_path / "mine.txt")], "name it mine.yaml"),
        (["--write", str(tmp_path / "mine.yaml"), "--step", "wings"], "--step wings: there is none"),
        (["--write", str(tmp_path / "mine.yaml"), "--practice", "2"], "name it mine.csv"),
    ):
        assert execute(["calibrate", *words]) == USAGE
        assert said in capsys.readouterr().err


def test_a_motor_that_does_not_turn_is_a_fault_with_a_remedy(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = str(tmp_path / "mine.yaml")
    stuck = ["--set", "sim.vehicle.dead_band=20000", "--step", "motor"]
    assert execute(["calibrate", "--vehicle", "f1tenth", "--write", file, *stuck]) == FAULT
    assert "is the motor's power on?" in capsys.readouterr().err


class Slip(SimulatedOperator):
    """An operator who types 0 before the right answer."""

    told = 0

    async def number(self, key: str, text: str, unit: str) -> float:
        self.told += 1
        return 0.0 if self.told % 2 else await super().number(key, text, unit)


def test_a_length_of_nothing_is_asked_for_again_and_the_drive_still_counts() -> None:
    config = load(None, ENDLESS, {}, {"vehicle": "f1tenth", "seed": 1}).config
    hal = create(config)
    assert isinstance(hal, SimHal)
    bench = Bench(config, slip := Slip(hal, 1), opener(hal), lambda values: None)
    run(calibrate(bench, ["circle"]), speed="max")
    assert slip.told == 4  # of a circle to the left and one to the right
    assert abs(bench.config.geometry.radius_min - config.geometry.radius_min) < 0.02


class Stops(SimulatedOperator):
    """An operator who ends it as soon as the vehicle moves."""

    async def seen(self, key: str, text: str) -> None:
        raise ConfigError("ended")


@pytest.mark.parametrize(
    ("step", "own_loops"), [("motor", False), ("steering", False), ("circle", False), ("circle", True)]
)
def test_a_movement_that_a_person_ends_finds_nothing(step: str, own_loops: bool) -> None:
    config, hal = unknown("donkeycar", 3)
    found: list[object] = []
    with pytest.raises(ConfigError, match="ended"):
        run(calibrate(Bench(config, Stops(hal, 3), opener(hal), found.append, own_loops), [step]), speed="max")
    assert not found and abs(hal.vehicle.motion[3]) < 1e-6


class Hasty(SimulatedOperator):
    """An operator who says at once that wheels turn no further."""

    asked = 0

    async def seen(self, key: str, text: str) -> None:
        if key.endswith("_stop"):
            self._seen = self._steered(key)
        else:
            await super().seen(key, text)

    async def choose(self, key: str, text: str, options: Sequence[str]) -> str:
        self.asked += key.endswith("_further")
        return await super().choose(key, text, options)


def both_axles(operator: type[SimulatedOperator], names: Sequence[str], wrong: float = 1.0) -> Bench:
    """A TXT-1 that steers by 11.5 degrees, the scale of its rear axle believed `wrong` times what it is."""
    config = load(None, ENDLESS, {}, {"vehicle": "txt1"}).config
    truth = with_values(config, {"geometry.radius_min": 0.838, "sim.channels.rear.scale": 1.0 / wrong})
    hal = create(truth)
    assert isinstance(hal, SimHal)
    bench = Bench(config, operator(hal, 1), opener(hal), lambda values: None)
    run(calibrate(bench, names), speed="max")
    return bench


@pytest.mark.long
@pytest.mark.parametrize("operator", [SimulatedOperator, Hasty])
def test_an_operator_who_takes_slow_wheels_to_stand_is_asked_again(operator: type[SimulatedOperator]) -> None:
    bench = both_axles(operator, ["steering"])
    for axle in (bench.config.channels.front, bench.config.channels.rear):
        assert axle.scale == pytest.approx(1.0, abs=0.12)
    if isinstance(bench.operator, Hasty):
        assert bench.operator.asked > 8  # two stops of two axles


def test_an_axle_is_checked_against_the_other_by_the_circle() -> None:
    bench = both_axles(SimulatedOperator, ["circle"])
    assert bench.config.geometry.radius_min == pytest.approx(0.838, rel=0.02)
    with pytest.raises(
        HalError, match=r"front wheels steer 11\.\d degrees, and the rear ones 2\.\d: look after the rear"
    ):
        both_axles(SimulatedOperator, ["circle"], wrong=0.2)


@pytest.mark.parametrize(("front", "rear"), [(0.2, -0.2), (0.3, -0.1), (0.25, 0.0), (0.05, -0.3)])
def test_angles_of_both_axles_follow_from_the_circles_of_their_middles(front: float, rear: float) -> None:
    """Beside the point about which both axles turn, found as the crossing of their normals."""
    lever = 0.17
    # normals x = lever - s * tan(front) and x = -lever - s * tan(rear) at the distance s to the left
    across = 2.0 * lever / (tan(front) - tan(rear))
    along = lever - across * tan(front)
    assert _locks(hypot(lever - along, across), hypot(lever + along, across), lever) == pytest.approx(
        (1.0 / hypot(along, across), front, -rear)
    )


def test_circles_that_no_car_drives_are_refused() -> None:
    with pytest.raises(HalError, match="no car of this wheelbase"):
        _locks(3.0, 1.0, 0.17)


def test_outputs_are_put_right_behind_the_gate_and_encoders_before_the_tasks() -> None:
    """A car wired at random and put right drives as one that is wired as it should be, to an encoder count or two."""
    truth = unknown_car(load(None, ENDLESS, {}, {"vehicle": "txt1"}).config, 5).sim.channels

    def driven(*settings: Callable[[Config], Config]) -> tuple[float, ...]:
        config = load(None, [*ENDLESS, "sim.noise.drag=0"], {}, {}).config
        for change in settings:
            config = change(config)

        async def drive() -> tuple[float, ...]:
            async with Robot.open(config=config) as robot:
                await robot.load_gains()
                await robot.drive(0.5, 0.4, 4.0)
                assert robot.pose is not None
                return robot.pose

        return run(drive(), speed="max")

    def wired(config: Config) -> Config:
        return config.model_copy(update={"channels": truth, "sim": config.sim.model_copy(update={"channels": truth})})

    assert driven(wired) == pytest.approx(driven(), abs=0.02)


@pytest.mark.long
def test_a_car_with_a_vesc_that_runs_backwards_and_steers_the_wrong_way() -> None:
    """Its motor controller closes the loops, so what is found are the controller's own settings."""
    believed = load(None, ENDLESS, {}, {"vehicle": "f1tenth", "hal": "vesc"}).config
    own = {"backwards": True, "servo_centre": 0.56, "servo_range": -0.3}
    true = {"geometry.circumference": 0.3, "geometry.radius_min": 0.85}
    vesc = Vesc(with_values(believed, {**true, **{f"hal_options.{key}": value for key, value in own.items()}}))

    def made(config: Config) -> VescHal:
        options = checked(VescOptions, config.hal_options, "hal_options")
        port = ControllerPort("vesc", lambda: vesc)
        return VescHal(port, options, config.geometry, lambda end: end, simulated=True)

    @asynccontextmanager
    async def opened(config: Config, unseen: bool) -> AsyncIterator[Robot]:
        await asyncio.sleep(0.1)  # the controller has to notice that the last line is gone
        async with Robot.open(made(config), config=config) as robot:
            yield robot

    async def found() -> Config:
        bench = Bench(believed, SimulatedOperator(vesc.car.hal, 1), opened, lambda values: None, own_loops=True)
        names = steps(believed, made(believed))
        assert names == ["servo", "scale", "circle"]
        await calibrate(bench, names)
        return bench.config

    config = run(found(), speed="max")
    options = checked(VescOptions, config.hal_options, "hal_options")
    assert options.backwards
    assert options.servo_centre == pytest.approx(0.56, abs=0.01)
    assert config.geometry.circumference == pytest.approx(0.3, rel=0.02)
    assert options.servo_range < 0.0
    # its range of 0.4 goes beyond the linkage's stop at 0.3, so this is the true radius
    assert config.geometry.radius_min == pytest.approx(0.85, rel=0.05)


class Beside(SimulatedOperator):
    """An operator who sees which way the wheels turn now."""

    v: Callable[[], float]

    async def choose(self, key: str, text: str, options: Sequence[str]) -> str:
        if key in ("forward", "backwards"):
            return options[0 if self.v() * (1.0 if key == "forward" else -1.0) > 0.05 else 1]
        return await super().choose(key, text, options)


def found_reverse(*settings: str) -> Config:
    """What is found of the motor of a Donkey Car behind a virtual servo board; its wires are as `sim.channels` says."""
    truth = load(
        None, [*ENDLESS, "hal_options.bus=virtual", *settings], {}, {"vehicle": "donkeycar", "hal": "pi"}
    ).config
    desk = VirtualPi(truth, setup_of(checked(PiOptions, truth.hal_options, "x"), truth.geometry))

    @asynccontextmanager
    async def opened(config: Config, unseen: bool) -> AsyncIterator[Robot]:
        options = checked(PiOptions, config.hal_options, "x")
        hal = PiHal(desk, options, config.geometry, config.channels, simulated=True)
        async with Robot.open(rewired(hal, config.channels, False, unseen), config=config) as robot:
            yield robot

    async def find() -> Config:
        operator = Beside(desk.hal, 1)
        operator.v = lambda: desk.vehicle.state.v
        bench = Bench(truth, operator, opened, lambda values: None, esc=True)
        await calibrate(bench, ["motor", "reverse"])
        return bench.config

    return run(find(), speed="max")


@pytest.mark.parametrize("mode", ["direct", "brake_first"])
def test_the_way_of_an_esc_into_reverse_is_found_with_the_wheels_up(mode: str) -> None:
    config = found_reverse(f"hal_options.virtual_esc={mode}", "sim.channels.motor.trim=150")
    assert config.hal_options["reverse"] == mode
    assert config.channels.motor.direction == 1
    assert config.channels.motor.trim == pytest.approx(150.0, abs=120.0), "to a step of the servo board"


def test_an_esc_with_its_reverse_on_the_side_ahead_has_the_motors_wires_swapped() -> None:
    with pytest.raises(HalError, match="Swap two wires of the motor"):
        found_reverse("sim.channels.motor.direction=-1")


def test_a_hal_whose_motors_have_escs_has_the_step_reverse_and_no_other_has() -> None:
    pi = load(None, ["hal_options.bus=virtual"], {}, {"vehicle": "donkeycar", "hal": "pi"}).config
    assert steps(pi, create(pi)) == ["motor", "reverse", "steering", "straight", "circle", "speeds"]
    assert "reverse" not in steps(*unknown("donkeycar", 1))


@pytest.mark.long
def test_a_rover_without_encoders() -> None:
    blind = ["--vehicle", "rover", "--set", "geometry.counts_per_rev=0", "--set", "safety.v_dead_band=0.1"]
    assert execute(["calibrate", *blind, "--practice", "2", "--seed", "7"]) == OK


def test_a_table_of_gains_is_told_by_its_length() -> None:
    rows = [{"v_max": -1.0, "kp": 1.0, "ki": 25.0, "kd": 0.005}, {"v_max": 9.0, "kp": 2.0, "ki": 25.0, "kd": 0.005}]
    after = with_values(load(None, []).config, {"control.angular": rows})
    told = changes(load(None, []).config, after)
    assert [line.partition(" -> ")[2] for line in told if line.startswith("control.angular")] == ["2 rows"]
    assert all(len(line) < 80 for line in told)

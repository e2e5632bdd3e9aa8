"""`txt1 calibrate`: a dialogue that finds a vehicle's wiring and motion, and writes its file."""

import argparse
import asyncio
import os
import sys
from collections.abc import AsyncIterator, Mapping, Sequence
from contextlib import asynccontextmanager, suppress
from dataclasses import replace
from functools import partial
from math import isfinite
from pathlib import Path
from shutil import get_terminal_size
from textwrap import fill
from typing import Any, Final

import yaml

from txt1.commands import FAULT, OK, add, count, flag, path, takes
from txt1.config import Config, load
from txt1.config.sources import flatten, vehicle_file
from txt1.errors import ConfigError
from txt1.experiments import run_folder
from txt1.experiments.calibration import donkeycar_config, sensors, simulated_operator
from txt1.experiments.calibration.bench import Bench, Operator
from txt1.experiments.calibration.steps import STEPS, calibrate, steps
from txt1.file_limits import read_text
from txt1.hal.base import Hal
from txt1.hal.channels import rewired
from txt1.hal.registry import create
from txt1.hal.sim import SimHal
from txt1.kernel.processors import processors
from txt1.kit.app import App, get_ready
from txt1.kit.options import ROBOT, loaded
from txt1.rc import calibration as rc_calibration
from txt1.rc.settings import BOARD, RcParameters
from txt1.robot import Robot
from txt1.safe_yaml import read_yaml
from txt1.trials.run import run
from txt1.trials.workers import Workers

ENDLESS: Final = ("sim.room.length=.inf", "sim.room.width=.inf")
HEAD: Final = (
    "# Found by txt1 calibrate, which goes on from here with the same --write; use it with --vehicle and this file.\n\n"
)
# what no step measures, so that it stays as the vehicle has it
UNMEASURED: Final = ("steering", "wheelbase", "counts_per_rev")
# answers of a person who agrees, and who does not
AGREED: Final = ("", "y", "yes")
REFUSED: Final = ("n", "no", "q", "quit")
SENSORS: Final = "# Found by txt1 calibrate --sensors of a drive; use it with --config.\n\n"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `calibrate`."""
    add(
        parser,
        ROBOT
        | {
            "--write": takes(
                "FILE", "vehicle file to write; an existing one is continued; with --practice a .csv", path
            ),
            "--step": takes(
                "NAME", f"do only this step, even if it is done; may be repeated: {', '.join(STEPS)}", action="append"
            ),
            "--practice": takes(
                "N",
                "calibrate this number of unknown simulated cars of this kind, and judge how each drives then",
                count,
            ),
            "--sensors": takes(
                "RECORDING",
                "no dialogue: tell what this drive with a filter (estimation.preset) shows of the mounts, clocks and "
                "scales of its sensors, and --write what contradicts their settings, for --config",
                path,
            ),
            "--from": takes(
                "MYCONFIG.PY",
                "no dialogue: take over pins and pulses of a donkeycar, read as data and never run, and --write them",
                path,
                dest="donkeycar",
            ),
            "--rc": takes(
                "PORT",
                "ask only for a radio control whose receiver is at PORT, or board (a Pico's servo inputs): find "
                "its channels, and check that it tells the loss of its transmitter",
            ),
            "--robot": takes("NAME", "with --sensors: name of the robot, if the recording has several"),
            "--ask": flag("ask you about a simulated car, too, and not a simulated operator"),
        },
    )


def main(arguments: argparse.Namespace) -> int:
    """Calibrate a vehicle in a dialogue, or its sensors from a drive; return the exit code."""
    if arguments.sensors is not None:
        return _sensors(arguments)
    if arguments.donkeycar is not None:
        return _donkeycar(arguments)
    if arguments.practice is not None:
        return _practise(arguments)
    if arguments.rc is not None:
        return _radio(arguments)
    file: Path | None = arguments.write
    if file is None:
        raise ConfigError("calibrate writes a file: add --write FILE, for example --write mycar.yaml")
    if file.suffix not in (".yaml", ".yml"):
        raise ConfigError(f"--write {file}: --vehicle takes files that end in .yaml; name it {file.stem}.yaml")
    base = arguments.vehicle
    if file.exists():
        _belongs(arguments, file)
        arguments.vehicle = str(file)
    config = loaded(arguments, ENDLESS).config
    for name in arguments.step or ():
        if name not in STEPS:
            raise ConfigError(f"--step {name}: there is none; there are: {', '.join(STEPS)}")
    hal, operator = _at_the_vehicle(arguments, base, config)
    names = arguments.step or [name for name in steps(config, hal) if name not in config.calibrated]
    if not names:
        print(f"{file}: all steps are done; --step NAME does one again: {', '.join(steps(config, hal))}")
        return OK
    run_folder.make(file.parent)
    tree = _tree(config.vehicle)
    found: dict[str, Any] = {}

    def keep(values: Mapping[str, Any]) -> None:
        for key, value in values.items():
            _set(tree, key, value)
        _write(file, tree)
        found.update(values)

    app = App(arguments.speed if isinstance(operator, Person) else arguments.speed or "max")
    bench = Bench(config, operator, _opener(app, hal), keep, own_loops=not hal.capabilities.pwm, esc=hal.esc)
    try:
        return app.run(calibrate(bench, names))
    finally:
        print("\n".join(changes(config, bench.config)) or "nothing was found")
        left = [name for name in steps(config, hal) if name not in bench.config.calibrated]
        if found:
            print(f"{file}: written, after {bench.driving:.0f} s of driving; drive with --vehicle {file}")
        if left:
            print(f"still to do: {', '.join(left)}; the same command goes on there")


def _belongs(arguments: argparse.Namespace, file: Path) -> None:
    """Raise ConfigError if a file that is there already is of another car than --vehicle."""
    if arguments.vehicle is None:
        return
    named, there = (
        loaded(argparse.Namespace(**vars(arguments) | {"vehicle": name}), ENDLESS).config.geometry
        for name in (arguments.vehicle, str(file))
    )
    for name in UNMEASURED:
        if getattr(named, name) != getattr(there, name):
            raise ConfigError(
                f"--write {file}: it is there, and of another car than --vehicle {arguments.vehicle}: its "
                f"geometry.{name} is {getattr(there, name)}, not {getattr(named, name)}; go on with it by "
                f"--vehicle {file}, or choose another file"
            )


def _donkeycar(arguments: argparse.Namespace) -> int:
    """Print the wiring of a donkeycar, and write it into a vehicle's file."""
    file: Path | None = arguments.write
    if file is not None and file.suffix not in (".yaml", ".yml"):
        raise ConfigError(f"--write {file}: --vehicle takes files that end in .yaml; name it {file.stem}.yaml")
    if file is not None and file.exists():
        raise ConfigError(f"--write {file}: it is there already; choose another name")
    found = donkeycar_config.wiring(arguments.donkeycar)
    vehicle = arguments.vehicle or "donkeycar"
    tree, most = _tree(vehicle), load(None, [], {}, {"vehicle": vehicle}).config.safety.motor_max
    for key, value in found.settings.items():
        if key == "safety.motor_max" and value > most:
            print(f"note: JOYSTICK_MAX_THROTTLE would be {key} {value}; it stays {most}, and you may raise it")
            continue
        print(f"{key}: {value}")
        _set(tree, key, value)
    for remark in found.remarks:
        print(f"note: {remark}")
    if file is not None:
        run_folder.make(file.parent)
        _write(file, tree)
        print(f"{file}: written; drive with --vehicle {file} --hal pi, and measure its motion with")
        print(f"  txt1 calibrate --vehicle {file} --hal pi --write {file}")
    return OK


def _radio(arguments: argparse.Namespace) -> int:
    """Find the channels of a radio control in a dialogue, and write them into a file."""
    file: Path | None = arguments.write
    if file is None or file.suffix not in (".yaml", ".yml"):
        raise ConfigError("--rc: calibrate writes a file: add --write FILE.yaml, for example --write mycar.yaml")
    if not sys.stdin.isatty():
        raise ConfigError("--rc: calibrate asks questions: it needs a terminal")
    if arguments.rc == BOARD:
        arguments.set = [*arguments.set, "rc.port=board", "rc.protocol=pwm"]
    if file.exists():
        _belongs(arguments, file)
    config = loaded(arguments).config
    tree = _tree(str(file) if file.exists() else config.vehicle)
    person = Person()
    given = replace(config.section(RcParameters), port=arguments.rc)
    app = App()

    async def asked() -> None:
        if arguments.rc == BOARD:
            async with app.robot(config, hal=create(config)) as robot:
                await robot.linked(10.0)
                tree["rc"] = await rc_calibration.calibrate(given, person.ready, person.tell, robot=robot)
        else:
            tree["rc"] = await rc_calibration.calibrate(given, person.ready, person.tell)
        run_folder.make(file.parent)
        _write(file, tree)
        print(f"{file}: written; drive with --vehicle {file} --rc")

    return app.run(asked())


def _sensors(arguments: argparse.Namespace) -> int:
    """Print the findings of a drive about the sensors, and write them."""
    file: Path | None = arguments.write
    if file is not None and file.suffix not in (".yaml", ".yml"):
        raise ConfigError(f"--write {file}: --config takes files that end in .yaml; name it {file.stem}.yaml")
    found = sensors.learned(arguments.sensors, arguments.robot)
    print("\n".join(found.lines))
    if not found.settings and not found.values:
        print("nothing contradicts the settings")
        return OK
    for name, settings in found.settings.items():
        print(f"estimation.settings.{name}: {settings}")
    for key, value in found.values.items():
        print(f"{key}: {value}")
    if file is not None:
        tree = read_yaml(read_text(file)) if file.exists() else {}
        if not isinstance(tree, dict):
            raise ConfigError(f"{file}: no settings in it, so nothing can be put beside them")
        for name, settings in found.settings.items():
            for key, value in settings.items():
                _set(tree, f"estimation.settings.{name}.{key}", value)
        for key, value in found.values.items():
            _set(tree, key, value)
        run_folder.make(file.parent)
        _write(file, tree, SENSORS)
        print(f"{file}: written; drive with --config {file}")
    return OK


def _at_the_vehicle(arguments: argparse.Namespace, base: str, config: Config) -> tuple[Hal, Operator]:
    """Return the vehicle and its operator; a simulated car is an unknown car of the kind `base`."""
    hal = create(config)
    if isinstance(hal, SimHal):
        kind = loaded(argparse.Namespace(**vars(arguments) | {"vehicle": base}), ENDLESS).config
        unknown = create(simulated_operator.unknown_car(kind, config.seed))
        assert isinstance(unknown, SimHal)
        told = partial(print, flush=True)
        return unknown, Person() if arguments.ask else simulated_operator.SimulatedOperator(unknown, config.seed, told)
    if not sys.stdin.isatty():
        raise ConfigError("calibrate asks questions: it needs a terminal, or --hal sim to practise")
    return hal, Person()


def _practise(arguments: argparse.Namespace) -> int:
    """Calibrate unknown cars, with seeds counted from the given seed; return 1 if a car does not drive as it should."""
    file: Path | None = arguments.write
    if file is not None and file.suffix != ".csv":
        raise ConfigError(f"--write {file}: --practice writes a table of all cars; name it {file.stem}.csv")
    config = loaded(arguments, ENDLESS).config
    seeds = range(config.seed, config.seed + arguments.practice)
    cars: list[simulated_operator.Practised] = []
    if file is not None:
        run_folder.make(file.parent)
        cars = [car for car in simulated_operator.read_practised(file, config.vehicle) if car.seed in seeds]
    given = [config.model_dump(mode="json"), arguments.speed or "max", arguments.step]
    missing = {seed: [*given, seed] for seed in seeds if seed not in {car.seed for car in cars}}

    def keep(seed: int, told: Sequence[Any]) -> None:
        verdict, driving = told
        cars.append(car := simulated_operator.Practised(seed, simulated_operator.DrivingVerdict(*verdict), driving))
        if file is not None:
            simulated_operator.write_practised(file, config.vehicle, car)

    code = run(practised, missing, Workers(processors()), keep, bar="practice")
    if code != OK:
        return code
    cars.sort(key=lambda car: car.seed)
    failed = [car for car in cars if not car.passes]
    for car in failed:
        print(f"seed {car.seed}: {car.verdict}, {car.driving:.0f} s of driving")
    print(f"{len(cars)} cars, {len(failed)} of them not as they should be; the worst of each:")
    for line in simulated_operator.worst(cars):
        print(f"  {line}")
    return FAULT if failed else OK


def practised(told: Sequence[Any]) -> list[Any]:
    """Calibrate an unknown car; return its driving afterwards, and the s of driving. JSON values both."""
    tree, speed, names, seed = told
    config = Config.model_validate(tree).model_copy(update={"seed": seed})
    hal = create(simulated_operator.unknown_car(config, seed))
    if not isinstance(hal, SimHal):
        raise ConfigError(f"--practice: the HAL '{config.hal}' is not a simulated car; choose --hal sim")
    app = App(speed)
    opener = _opener(app, hal)
    bench = Bench(config, simulated_operator.SimulatedOperator(hal, seed), opener, lambda values: None)
    verdicts: list[simulated_operator.DrivingVerdict] = []

    async def all_of_it() -> None:
        await calibrate(bench, names or steps(bench.config, hal))
        verdicts.append(await simulated_operator.judge(hal, bench.config, opener))

    app.run(all_of_it())
    return [verdicts[0], bench.driving]


def _opener(app: App, hal: Hal) -> Any:
    """Return the function that makes a running robot: on this simulated car, else on the hardware as then
    configured.
    """

    @asynccontextmanager
    async def opened(config: Config, unseen: bool) -> AsyncIterator[Robot]:
        layer = hal if isinstance(hal, SimHal) else create(config)
        wired = rewired(layer, config.channels, config.geometry.steering == "skid", unseen)
        async with app.robot(config, hal=wired) as robot:
            await get_ready(robot, arm=True)
            yield robot

    return opened


def changes(before: Config, after: Config) -> list[str]:
    """Return the differences between two configurations, a short line each."""
    old, new = dict(flatten(before)), dict(flatten(after))
    keys = [key for key in new if not key.startswith(("calibrated", "sim.")) and old.get(key) != new[key]]
    width = max(map(len, keys), default=0)
    told = {key: (_short(old.get(key)), _short(new[key])) for key in keys}
    return [f"{key:{width}}  {a} -> {b if a != b else f'{b}, other values'}" for key, (a, b) in told.items()]


def _short(value: Any) -> str:
    """Return a value as a line of YAML; for a table, such as the gains by speed, its length, as the file shows it."""
    if isinstance(value, list) and value and isinstance(value[0], dict):
        return f"{len(value)} rows"
    return yaml.safe_dump(value, default_flow_style=True, width=10_000).removesuffix("...\n").strip()


def _tree(vehicle: str) -> dict[str, Any]:
    """Return the content of a vehicle's file."""
    file = vehicle_file(vehicle)
    tree = None if file is None else read_yaml(read_text(file))
    return tree if isinstance(tree, dict) else {}


def _set(tree: dict[str, Any], key: str, value: Any) -> None:
    *path, last = key.split(".")
    for name in path:
        tree = tree.setdefault(name, {})
    tree[last] = value


def _write(file: Path, tree: Mapping[str, Any], head: str = HEAD) -> None:
    """Write the file in a single step."""
    part = file.with_name(f".{file.name}.part")
    part.write_text(head + yaml.safe_dump(dict(tree), sort_keys=False, default_flow_style=None), encoding="utf-8")
    os.replace(part, file)


def _filled(text: str) -> str:
    """Return the text with its lines broken between words, for a terminal."""
    if not sys.stdout.isatty():
        return text
    lines = (fill(line, get_terminal_size().columns - 1, subsequent_indent="  ") for line in text.splitlines())
    return "\n".join(lines) + " " * text.endswith(" ")


class Person:
    """The operator at the terminal, who answers by lines."""

    def tell(self, text: str) -> None:
        """Print the text."""
        print(_filled(text), flush=True)

    async def ready(self, key: str, text: str) -> None:
        """Ask until the answer is Enter or yes."""
        while (answer := await self._answer(f"{text} Enter when it is so: ")).lower() not in AGREED:
            if answer.lower() in REFUSED:
                raise ConfigError(f"'{answer}': ended; the results so far are kept")
            print(f"'{answer}' is none of Enter or yes to go on, no to end")

    async def seen(self, key: str, text: str) -> None:
        """Wait for Enter; another answer ends it, as the vehicle moves meanwhile."""
        answer = await self._answer(f"{text} ")
        if answer.lower() not in AGREED:
            raise ConfigError(f"'{answer}' is not Enter: ended; the results so far are kept")

    async def choose(self, key: str, text: str, options: Sequence[str]) -> str:
        """Ask until the answer is the beginning of an option."""
        while True:
            answer = (await self._answer(f"{text} [{'/'.join(options)}] ")).lower()
            fitting = [option for option in options if answer and option.startswith(answer)]
            if len(fitting) == 1:
                return fitting[0]
            print(f"'{answer}' is none of {', '.join(options)}")

    async def number(self, key: str, text: str, unit: str) -> float:
        """Ask until the answer is a number."""
        while True:
            answer = await self._answer(f"{text} [{unit}] ")
            with suppress(ValueError):
                if isfinite(number := float(answer.replace(",", "."))):
                    return number
            print(f"'{answer}' is no number, such as 2.95")

    async def _answer(self, prompt: str) -> str:
        print(_filled(prompt), end="", flush=True)
        loop = asyncio.get_running_loop()
        typed: asyncio.Future[str] = loop.create_future()

        def take() -> None:
            if not typed.done():
                line = sys.stdin.readline()
                if line:
                    typed.set_result(line.strip())
                else:
                    typed.set_exception(ConfigError("no more answers come; the results so far are kept"))

        loop.add_reader(sys.stdin.fileno(), take)
        try:
            return await typed
        finally:
            loop.remove_reader(sys.stdin.fileno())

"""A compiled wheel does what the sources do, to the last bit."""

import json
import os
import subprocess
import sys
import sysconfig
from pathlib import Path
from shutil import copytree, ignore_patterns, which
from typing import Any

import pytest
from mcap.reader import make_reader

from tests.patience import LIMIT

REPOSITORY = Path(__file__).parents[2]
PARTS = ("setup.py", "pyproject.toml", "README.md", "LICENSE", "config", "firmware", "txt1")
RUN = ("run", "--hal", "sim", "--headless", "--json", "--speed", "max", "--seed", "7", "--drive", "0.5,0.5")
SUITES = (
    *("test_robot.py", "test_closed_loop.py", "test_safety.py", "test_learning.py", "test_learning_on_hardware.py"),
    *("test_commander.py", "test_sensors.py", "test_world.py", "../conformance"),
    *("test_processes.py", "test_record_replay.py", "test_estimation.py"),
    *("../unit/ui", "../unit/telemetry", "../unit/estimation"),
)
LEARN = ("learn", "--agent", "thesis", "--trials", "2", "--episodes", "6", "--seed", "3")

pytestmark = [
    pytest.mark.long,
    pytest.mark.skipif(
        which("cc") is None or not Path(sysconfig.get_path("include"), "Python.h").exists(),
        reason="there is no C compiler (cc) or no Python.h",
    ),
]


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder that a compiled wheel is installed into; it is made from a copy, in which nothing is left over."""
    copy, wheels, folder = (tmp_path_factory.mktemp(name) for name in ("copy", "wheels", "installed"))
    for part in PARTS:
        source = REPOSITORY / part
        if source.is_dir():
            copytree(source, copy / part, symlinks=True)
        else:
            (copy / part).write_bytes(source.read_bytes())
    pip("wheel", "--no-build-isolation", "--wheel-dir", str(wheels), str(copy), environment={"COMPILE_TXT1": "1"})
    (wheel,) = wheels.glob("*.whl")
    pip("install", "--target", str(folder), str(wheel))
    return folder


def pip(*arguments: str, environment: dict[str, str] | None = None) -> None:
    command = [sys.executable, "-m", "pip", "--quiet", "--disable-pip-version-check", *arguments, "--no-deps"]
    subprocess.run(command, env=os.environ | (environment or {}), check=True, timeout=10.0 * LIMIT)


def python(package: Path, *arguments: str, folder: Path | None = None) -> str:
    """What Python prints with the txt1 package of a folder; it runs there or in another folder."""
    environment = os.environ | {"PYTHONPATH": str(package)}
    command = [sys.executable, *arguments]
    done = subprocess.run(
        command, cwd=folder or package, env=environment, capture_output=True, text=True, timeout=10.0 * LIMIT
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_the_wheel_is_compiled_and_the_sources_are_not(installed: Path) -> None:
    say = ("-c", "import txt1.kernel.scheduler as module; print(module.__file__)")
    assert Path(python(installed, *say).strip()).suffix in (".so", ".pyd")
    assert Path(python(REPOSITORY, *say).strip()).suffix == ".py"


@pytest.mark.parametrize("hal", ["sim", "serial"])
def test_a_run_and_its_recording_are_the_same(installed: Path, tmp_path: Path, hal: str) -> None:
    def run(package: Path, file: Path) -> dict[str, Any]:
        more = ("--port", "virtual") if hal == "serial" else ("--set", "estimation.preset=vicon")
        command = ("-m", "txt1", *RUN, "--hal", hal, *more, "--duration", "30", "--log", str(file))
        result: dict[str, Any] = json.loads(python(package, *command))
        return unmeasured(result)

    compiled, interpreted = tmp_path / "compiled.mcap", tmp_path / "interpreted.mcap"
    result = run(installed, compiled)
    assert result == run(REPOSITORY, interpreted)
    assert result["odometry"]["x"] != 0.0
    assert content(compiled) == content(interpreted)


def unmeasured(result: dict[str, Any]) -> dict[str, Any]:
    """A run's JSON without what the wall clock measures, and without the recording's path."""
    del result["wall_time_s"]
    result.pop("recording", None)
    for task in result["tasks"].values():
        del task["run_time_s"]
    return result


def content(file: Path) -> tuple[list[Any], list[Any]]:
    """All messages and metadata of a recording, but for when it was made."""
    with file.open("rb") as stream:
        reader = make_reader(stream)
        messages = [
            (schema and (schema.name, schema.data), channel.topic, message.log_time, message.publish_time, message.data)
            for schema, channel, message in reader.iter_messages(log_time_order=False)
        ]
        assert len(messages) > 1000
        metadata = [(one.name, one.metadata | {"wall_start": ""}) for one in reader.iter_metadata()]
    return messages, metadata


def test_what_is_learned_is_the_same(installed: Path, tmp_path: Path) -> None:
    for name, package in (("compiled", installed), ("interpreted", REPOSITORY)):
        python(package, "-m", "txt1", *LEARN, "--out", str(tmp_path / name))
    for file in ("learning.csv", "qtable.json"):
        assert (tmp_path / "compiled" / file).read_bytes() == (tmp_path / "interpreted" / file).read_bytes()


def test_an_environment_works_in_the_next_process_too(installed: Path) -> None:
    pytest.importorskip("numba")
    program = "from txt1.learning.env import DriveEnv; one = DriveEnv(); one.reset(seed=1); print(one.step(1)[1])"
    assert python(installed, "-c", program) == python(installed, "-c", program)


def test_it_keeps_what_the_robot_promises(installed: Path, tmp_path: Path) -> None:
    for part in ("tests", "rigs", "examples", "config", "benchmarks"):  # without the sources
        copytree(REPOSITORY / part, tmp_path / part, ignore=ignore_patterns("__pycache__"))
    (tmp_path / "pyproject.toml").write_bytes((REPOSITORY / "pyproject.toml").read_bytes())
    suites = [str(tmp_path / "tests" / "e2e" / name) for name in SUITES]
    assert " passed" in python(installed, "-m", "pytest", "-n", "2", *suites, folder=tmp_path)

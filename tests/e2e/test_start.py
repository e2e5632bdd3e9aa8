"""From the first import to the exit code: what starting costs, how it is interrupted, how every command ends."""

from __future__ import annotations

import json
import os
import random
import re
import shlex
import signal
import subprocess
import sys
import time
import warnings
from ast import literal_eval
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import ClassVar

import pytest

import txt1
from tests.patience import LIMIT
from txt1.cli import COMMANDS, execute, told
from txt1.commands import USAGE, need
from txt1.errors import MissingExtra, NotCapable
from txt1.hal.base import Capabilities, Hal
from txt1.hal.sim import SimHal
from txt1.installing import installs, installs_package, installs_plugin
from txt1.sensors.depth import RealSenseOptions, realsense_frames
from txt1.version import __version__

ROOT = Path(__file__).parents[2]
SIM = ["run", "--json", "--speed", "max", "--duration"]
HEAVY = {"numpy", "pydantic", "rich", "yaml", "asyncio", "matplotlib"}


def python(*words: str) -> str:
    """What an interpreter of its own prints."""
    done = subprocess.run([sys.executable, *words], cwd=ROOT, capture_output=True, text=True, timeout=LIMIT, check=True)
    return done.stdout


def imported_by(statement: str) -> set[str]:
    """The modules that are there after a statement."""
    *_, loaded = python("-c", f"{statement}; import sys, json; print(json.dumps(list(sys.modules)))").splitlines()
    return set(json.loads(loaded))


# -- what it costs -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "statement",
    [
        "import txt1",
        "import txt1.cli; txt1.cli.execute(['--help'])",
        "import txt1.cli; txt1.cli.execute(['run', '--help'])",
    ],
)
def test_neither_the_package_nor_its_help_imports_what_takes_long(statement: str) -> None:
    assert HEAVY & imported_by(statement) == set()


@pytest.mark.parametrize("command", ["config", "decode", "log", "hal"])
def test_a_command_that_drives_nothing_imports_no_robot(command: str) -> None:
    loaded = imported_by(f"import txt1.cli; txt1.cli.execute(['{command}', '--help'])")
    assert {"txt1.ui.terminal", "txt1.learning", "txt1.experiments", "rich"} & loaded == set()


def test_help_lists_every_command(capsys: pytest.CaptureFixture[str]) -> None:
    assert execute(["--help"]) == 0
    out = capsys.readouterr().out
    assert [name for name in COMMANDS if f"    {name} " not in out and f"    {name}\n" not in out] == []


# -- Ctrl-C ------------------------------------------------------------------------------------------------------


def takes_signals(process: int) -> bool:
    """Whether a process has a handler of its own for SIGTERM, as Python alone has not."""
    mask = Path(f"/proc/{process}/status").read_text().split("SigCgt:")[1].split()[0]
    return bool(int(mask, 16) >> (signal.SIGTERM - 1) & 1)


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="needs Linux's /proc to see the first import")
@pytest.mark.parametrize(
    "command",
    [
        ["run", "--headless"],
        pytest.param(["board", "--tcp", "0"], marks=pytest.mark.long),
        pytest.param(["experiment", "linear-steps"], marks=pytest.mark.long),
    ],
)
def test_ctrl_c_at_any_moment_ends_it_with_130_and_no_traceback(command: list[str], tmp_path: Path) -> None:
    chance = random.Random(1)
    for _ in range(3):
        environment = os.environ | {"PYTHONPATH": str(ROOT)}
        words = [sys.executable, "-m", "txt1", *command]
        with subprocess.Popen(
            words, cwd=tmp_path, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
        ) as process:
            while not takes_signals(process.pid):
                time.sleep(0.001)
            time.sleep(chance.uniform(0.0, 1.5))
            process.send_signal(signal.SIGINT)
            _, err = process.communicate(timeout=LIMIT)
        assert "Traceback" not in err
        assert process.returncode == 130 or (command[0] == "experiment" and process.returncode == 0)


def test_signals_are_taken_before_anything_but_the_interpreter_is_imported() -> None:
    code = (
        "import signal, sys, json; take = signal.signal; seen = []\n"
        "signal.signal = lambda *given: (seen.append(list(sys.modules)), take(*given))\n"
        "sys.argv = ['txt1', '--version']\n"
        "from txt1.__main__ import main\n"
        "try: main()\n"
        "except SystemExit: print(json.dumps(seen[0]))"
    )
    *_, loaded = python("-c", code).splitlines()
    assert {"argparse", "asyncio", "numpy", "txt1.cli"} & set(json.loads(loaded)) == set()


# -- exit codes --------------------------------------------------------------------------------------------------


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    file = tmp_path / "run.mcap"
    python("-m", "txt1", *SIM, "2", "--log", str(file))
    return file


@pytest.mark.parametrize(
    "words",
    [
        "log info FILE",
        "log cat FILE",
        "log export FILE",
        "log recover FILE",
        "replay FILE",
        "replay --verify FILE",
        "report FILE",
        "decode --role host FILE",
        "config check FILE",
        "config show --config FILE",
        "run --config FILE",
        "run --policy FILE",
        "experiment FILE.yaml",
        "experiment compare FILE FILE",
    ],
)
def test_a_file_that_is_not_there_is_2_in_every_command(
    words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert execute([word.replace("FILE", str(tmp_path / "none")) for word in words.split()]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("txt1: ") and err.count("\n") == 1
    assert "none" in err


@pytest.mark.parametrize(
    ("words", "code"),
    [
        (["--version"], 0),
        (["--help"], 0),
        ([*SIM, "2"], 0),
        ([*SIM, "2", "--drive", "-0.3,0.2"], 0),
        ([*SIM, "2", "--drive", "-x"], 2),
        ([*SIM, "2", "--set", "no.such=1"], 2),
        ([*SIM, "12", "--drive", "0.5,0"], 3),
        ([*SIM, "4", "--port", "virtual"], 0),
        ([*SIM, "0.5", "--port", "virtual"], 3),
        ([*SIM, "0.5", "--port", "virtual", "--no-arm"], 1),
        (["run", "--json", "--duration", "1", "--port", "/dev/no-such-port"], 1),
        (["board", "--json", "--duration", "0.2", "--tcp", "0"], 0),
        (["board", "--tcp", "0", "--seed", "-1"], 2),
        (["hal", "check", "nonsense"], 2),
        (["learn", "--agent", "nobody"], 2),
        (["learn", "--set", "safety.auto_arm=never", "--trials", "1"], 2),
        (["experiment", "nonsense"], 2),
        (["experiment", "linear-steps", "--no-figure", "--set", "safety.auto_arm=never"], 2),
        (["tune", "--set", "safety.auto_arm=never"], 2),
        (["doctor", "--port", "/dev/no-such-port"], 1),
        (["config", "show"], 0),
        (["hal", "list"], 0),
    ],
)
def test_exit_codes_mean_the_same_in_every_command(
    words: Sequence[str], code: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert execute(words) == code


@pytest.mark.long
def test_what_is_done_again_without_a_folder_named_gets_a_new_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for _ in range(2):
        assert execute(["learn", "--trials", "1", "--episodes", "1", "--agent", "thesis"]) == 0
        assert execute(["experiment", "linear-steps", "--no-figure"]) == 0
    assert {each.name for each in (tmp_path / "out").iterdir()} == {
        "learn",
        "learn-2",
        "linear-steps",
        "linear-steps-2",
    }


def test_a_topic_that_is_not_there_is_a_mistake_and_those_that_are_there_are_named(
    recording: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    capsys.readouterr()
    assert execute(["log", "cat", str(recording), "--topic", "/nope"]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert "/nope" in err and "/odom" in err


def test_real_hardware_is_checked_only_with_its_wheels_off_the_ground(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    checked: list[str] = []

    def verdicts(suite: type, make: Callable[[], Hal], **settings: object) -> Iterator[tuple[str, str]]:
        assert settings["speed"] is None, "real hardware has real time"
        checked.append(make().name)
        yield "it opens", "ok"

    monkeypatch.setattr(SimHal, "capabilities", Capabilities(ticks=True, pwm=True))
    monkeypatch.setattr("txt1.cli.hal.verdicts", verdicts)
    assert execute(["hal", "check", "sim"]) == 2
    assert "--wheels-up" in capsys.readouterr().err
    assert checked == []
    assert execute(["hal", "check", "sim", "--wheels-up"]) == 0
    assert checked == ["sim"]


def test_a_silent_port_is_a_fault(tmp_path: Path) -> None:
    master, slave = os.openpty()
    words = ["run", "--port", os.ttyname(slave), "--headless", "--duration", "1"]
    done = subprocess.run(
        [sys.executable, "-m", "txt1", *words], cwd=ROOT, capture_output=True, text=True, timeout=LIMIT, check=False
    )
    os.close(master)
    os.close(slave)
    assert done.returncode == 1
    assert "there was no link to the board in 1 s" in done.stderr


@pytest.mark.parametrize("command", ["run --headless", "config show", "decode --role host -"])
def test_an_output_that_nobody_reads_any_more_is_a_normal_end(command: str) -> None:
    reading, writing = os.pipe()
    os.close(reading)
    done = subprocess.run(
        [sys.executable, "-m", "txt1", *command.split()],
        cwd=ROOT,
        stdin=subprocess.DEVNULL,
        stdout=writing,
        stderr=subprocess.PIPE,
        timeout=LIMIT,
        check=False,
    )
    os.close(writing)
    assert done.returncode == 0
    assert b"Traceback" not in done.stderr


@pytest.mark.long
def test_standard_streams_that_are_closed_are_no_numbers_for_files_of_the_robot(tmp_path: Path) -> None:
    words = ["-m", "txt1", "run", "--headless", "--speed", "max", "--duration", "2"]
    words += ["--log", str(tmp_path / "run.mcap")]
    closed = f"import os, sys; os.close(0); os.close(1); os.execv(sys.executable, [sys.executable, *{words}])"
    done = subprocess.run([sys.executable, "-c", closed], cwd=ROOT, stderr=subprocess.PIPE, timeout=LIMIT, check=False)
    assert (done.returncode, done.stderr) == (0, b"")
    assert "MB, complete" in python("-m", "txt1", "log", "info", str(tmp_path / "run.mcap"))


# -- the package -------------------------------------------------------------------------------------------------


def test_the_package_lists_its_public_names() -> None:
    assert set(txt1.__all__) <= set(dir(txt1))
    text = python("-c", "import pydoc, txt1; print(pydoc.render_doc(txt1, renderer=pydoc.plaintext))")
    assert "class Robot" in text and "run(main" in text


def test_a_source_distribution_has_every_folder_that_a_wheel_ships() -> None:
    (folders,) = re.findall(r"(?m)^SHIPPED = (\(.*\))$", (ROOT / "setup.py").read_text())
    grafted = re.findall(r"(?m)^graft (\S+)$", (ROOT / "MANIFEST.in").read_text())
    assert {folder.partition("/")[0] for folder in literal_eval(folders)} <= set(grafted)


def test_a_speed_that_is_none_is_refused_and_the_coroutine_put_away() -> None:
    async def main() -> None:
        """Never begun."""

    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(
            ValueError, match="speed must be 'max', a positive number, or None for real time, not 'fast'"
        ):
            txt1.run(main(), speed="fast")  # type: ignore[arg-type]


def test_a_hal_may_say_in_its_own_words_that_it_is_not_capable() -> None:
    assert str(NotCapable("this car has no switches")) == "this car has no switches"


def test_the_environment_without_gymnasium_names_the_extra() -> None:
    code = (
        "import sys, txt1; sys.modules['gymnasium'] = None\n"
        "try: import txt1.learning.env\n"
        "except txt1.Txt1Error as error: print(error)"
    )
    told = python("-c", code)
    assert told.startswith("txt1.learning.env needs the extra 'gym': ") and told.endswith(f"{installs('gym')}\n")


class Installed:
    """A distribution of txt1 that was installed from somewhere."""

    requires: ClassVar = ['mcap>=1.6; extra == "record"', 'lgpio; (python_version < "4") and extra == "pi"', "numpy"]

    def __init__(self, told: dict[str, object]) -> None:
        self.told = told

    def read_text(self, name: str) -> str | None:
        return json.dumps(self.told) if self.told else None


@pytest.mark.parametrize(
    ("made_by", "told"),
    [
        ("venv", "{python} -m pip install -e FOLDER"),
        ("uv", "uv pip install --python {python} -e FOLDER"),
        ("conda", "conda install --prefix {prefix} pip && {python} -m pip install -e FOLDER"),
        ("pipx", "pipx runpip txt1 install -e FOLDER"),
        ("none", "{python} -m ensurepip && {python} -m pip install -e FOLDER"),
    ],
)
def test_a_package_is_installed_by_whoever_made_the_environment(
    made_by: str, told: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    prefix = tmp_path / "venvs" / "txt1"
    python = prefix / "bin" / "python"
    prefix.mkdir(parents=True)
    if made_by == "conda":
        (prefix / "conda-meta").mkdir()
    if made_by == "pipx":
        (prefix / "pipx_metadata.json").touch()
    monkeypatch.setattr(sys, "prefix", str(prefix))
    monkeypatch.setattr(sys, "base_prefix", str(prefix) if made_by in ("conda", "none") else "/usr")
    monkeypatch.setattr(sys, "executable", str(python))
    monkeypatch.setattr("txt1.installing.shutil.which", lambda name: None)
    pip = object() if made_by == "venv" else None
    monkeypatch.setattr("txt1.installing.find_spec", lambda name: pip)
    assert installs_package("FOLDER", "-e ") == told.format(python=python, prefix=prefix)


def test_an_extra_is_installed_from_where_txt1_came_by_the_python_that_lacks_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    own = tmp_path / ".venv" / "bin"
    monkeypatch.chdir(tmp_path)
    (tmp_path / "pyproject.toml").touch()
    monkeypatch.setattr(sys, "executable", str(own / "python"))
    monkeypatch.setattr(sys, "prefix", str(own.parent))
    came: dict[str, object] = {"url": tmp_path.as_uri(), "dir_info": {"editable": True}}
    monkeypatch.setattr("txt1.installing.distribution", lambda name: Installed(came))
    assert installs("record") == ".venv/bin/python -m pip install -e '.[record]'"
    monkeypatch.setattr("txt1.installing.shutil.which", lambda name: str(own / "python"))
    assert installs("record,plots") == "python -m pip install -e '.[record,plots]'"
    wheel = tmp_path / "a folder" / "txt1-0.2.0-py3-none-any.whl"
    came = {"url": wheel.as_uri(), "archive_info": {}}
    assert installs("record") == "python -m pip install 'mcap>=1.6'", "the wheel is gone"
    assert installs("pi,record") == """python -m pip install 'lgpio; python_version < "4"' 'mcap>=1.6'"""
    wheel.parent.mkdir()
    wheel.touch()
    assert installs("record") == f"python -m pip install './a folder/{wheel.name}[record]'"
    monkeypatch.setattr("txt1.installing.find_spec", lambda name: None)
    assert installs("record") == f"uv pip install --python {own / 'python'} './a folder/{wheel.name}[record]'"
    installed, once = tmp_path / "of pipx" / "venvs" / "txt1-a", tmp_path / "of pipx" / ".cache" / "1234"
    for environment in (installed, once):
        environment.mkdir(parents=True)
        (environment / "pipx_metadata.json").touch()
    monkeypatch.setattr(sys, "prefix", str(installed))
    assert installs("record") == f"pipx runpip txt1-a install '{wheel}[record]'", "pipx works in another folder"
    came = {"url": "https://example.org/txt1.whl"}
    assert installs("record") == "pipx runpip txt1-a install 'txt1[record] @ https://example.org/txt1.whl'"
    monkeypatch.setattr(sys, "prefix", str(once))
    assert installs("record") == "pipx run --spec 'txt1[record] @ https://example.org/txt1.whl' txt1"
    monkeypatch.setattr(sys, "prefix", str(tmp_path / "uv" / "archive-v0" / "1234"))
    assert installs("record") == "uvx --from 'txt1[record] @ https://example.org/txt1.whl' txt1"


def test_a_package_that_does_not_load_is_not_told_to_be_installed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "pyrealsense2.py").write_text('raise ImportError("libusb-1.0.so.0: cannot open shared object file")\n')
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "pyrealsense2", raising=False)
    with pytest.raises(MissingExtra, match=r"does not load: libusb.*; install what it names") as refused:
        next(realsense_frames(RealSenseOptions()))
    assert "pip" not in str(refused.value)


def test_a_plugin_is_installed_from_where_txt1_came(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("txt1.installing.shutil.which", lambda name: sys.executable)
    came: dict[str, object] = {"url": (tmp_path / "wheels" / "txt1-0.2.0-py3-none-any.whl").as_uri()}
    monkeypatch.setattr("txt1.installing.distribution", lambda name: Installed(came))
    pip, wheel = "python -m pip install", f"txt1_ros1-{__version__}-py3-none-any.whl"
    assert installs_plugin("ros1") == f"{pip} ./wheels/{wheel}"
    assert installs_plugin("ros1", "more") == f"{pip} './wheels/{wheel}[more]'"
    came = {"url": "https://example.org/files/txt1-0.2.0-py3-none-any.whl"}
    assert installs_plugin("ros1") == f"{pip} 'txt1-ros1 @ https://example.org/files/{wheel}'"
    came = {"url": "https://example.org/lab/txt1.git", "vcs_info": {"vcs": "git"}}
    assert installs_plugin("lerobot") == (
        f"{pip} 'lerobot_robot_txt1 @ git+https://example.org/lab/txt1.git#subdirectory=plugins/lerobot'"
    )
    (tmp_path / "pipx" / "venvs" / "txt1").mkdir(parents=True)
    (tmp_path / "pipx" / "venvs" / "txt1" / "pipx_metadata.json").touch()
    monkeypatch.setattr(sys, "prefix", str(tmp_path / "pipx" / "venvs" / "txt1"))
    came = {"url": (tmp_path / "txt1-0.2.0-py3-none-any.whl").as_uri()}
    assert installs_plugin("ros1") == f"pipx runpip txt1 install {tmp_path / wheel}"


@pytest.mark.long  # pip takes its time
def test_pip_accepts_the_command_for_a_missing_extra() -> None:
    words = shlex.split(installs("record,plots"))
    done = subprocess.run(
        [sys.executable, *words[1:], "--dry-run", "--no-deps", "--no-build-isolation", "--no-index"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert words[1:4] == ["-m", "pip", "install"] and done.returncode == 0, done.stderr


def test_nothing_says_that_txt1_is_installed_by_its_name() -> None:
    root = Path(__file__).parents[2]
    files = [root / "README.md", *(root / "docs").rglob("*.md"), *(root / "examples").rglob("*.py")]
    files += [*(root / "txt1").rglob("*.py"), *(root / "image").rglob("*.yaml"), root / "CONTRIBUTING.md"]
    by_name = re.compile(r"""pipx? (?:install|inject)\b[^\n`;#,]* '?"?txt1(?:\[[\w,]*\])?(?! @)['"\s]""")
    assert [f"{file}: {found[0]}" for file in files for found in by_name.finditer(file.read_text("utf-8"))] == []


def test_a_missing_extra_ends_with_the_exit_code_of_a_mistake(capsys: pytest.CaptureFixture[str]) -> None:
    assert told(lambda: need("it", "record", "no_such_module")) == USAGE
    assert capsys.readouterr().err.startswith("txt1: it needs the extra 'record': ")


def long_description(address: str) -> str:
    """The README as a wheel carries it."""
    code = (
        "import pathlib, runpy, sys; made = runpy.run_path('setup.py', run_name='read')['long_description']; "
        "print(made(pathlib.Path('README.md').read_text(), sys.argv[1]))"
    )
    return python("-c", code, address)


def test_the_readme_of_a_wheel_has_no_link_that_leads_nowhere() -> None:
    links = re.compile(r"\]\((?!https?://)[^)]*\)")
    assert links.search((ROOT / "README.md").read_text())
    address = "https://example.org/lab/txt1"
    absolute, plain = long_description(address), long_description("")
    assert not links.search(absolute) and not links.search(plain)
    assert f"[Start]({address}/blob/main/docs/start.md)" in absolute
    assert f"]({address}/raw/main/docs/web/drive.webp)" in absolute
    assert "Start (docs/start.md)" in plain and "drive.webp" not in plain

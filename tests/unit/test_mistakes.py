"""Wrong words, files, ports and values: one line each, which names the thing, the value and the remedy."""

import os
import shlex
from pathlib import Path
from typing import NamedTuple

import pytest

from txt1.cli import execute


class Mistake(NamedTuple):
    """A command line (FOLDER stands for the test's), the words that the one line of complaint has, the exit code."""

    words: str
    told: tuple[str, ...]
    code: int = 2


RUN = "run --headless --speed max --duration 1"
MISTAKES = (
    # words and options
    Mistake("rnu", ("'rnu'", "did you mean 'run'?", "txt1 --help")),
    Mistake("--fly", ("--help",)),
    Mistake("run --fly", ("--fly", "txt1 run --help")),
    Mistake("run --hedless", ("--hedless", "did you mean '--headless'?", "txt1 run --help")),
    Mistake("config", ("ACTION", "txt1 config --help")),
    Mistake("log catt first.mcap", ("'catt'", "cat")),
    Mistake("run fast", ("fast", "--help")),
    Mistake("completion fish", ("'fish'", "bash")),
    # values
    Mistake(f"{RUN} --duration -3", ("--duration", "'-3'", "positive")),
    Mistake(f"{RUN} --duration soon", ("--duration", "'soon'", "positive number")),
    Mistake(f"{RUN} --speed 0", ("--speed", "'0'", "max")),
    Mistake(f"{RUN} --drive 0.5", ("--drive", "'0.5'", "0.5,0.3")),
    Mistake(f"{RUN} --drive 0.5,inf", ("--drive", "'inf'", "finite")),
    Mistake(f"{RUN} --seed 1.5", ("--seed", "'1.5'")),
    Mistake(f"{RUN} --seed -1", ("--seed", "'-1'", "from 0")),
    Mistake("learn --episodes 0", ("--episodes", "'0'", "whole number from 1")),
    Mistake("learn --agent einstein", ("'einstein'", "thesis")),
    Mistake("experiment circle-fsat", ("circle-fsat", "circle-fast")),
    Mistake("fleet --robots none", ("--robots", "'none'")),
    # settings
    Mistake(f"{RUN} --set safety.v_max=fast", ("safety.v_max", "'fast'", "number")),
    Mistake(f"{RUN} --set safety.vmax=1", ("safety.vmax", "did you mean 'safety.v_max'")),
    Mistake(f"{RUN} --set safety.v_max=-1", ("safety.v_max", "-1")),
    Mistake(f"{RUN} --set speed", ("--set speed", "key=value")),
    Mistake(f"{RUN} --set sim.start=[9,9,0]", ("sim.start", "9", "another start")),
    Mistake(f"{RUN} --hal vesc --set hal_options.pol_pairs=2", ("hal_options.pol_pairs", "did you mean")),
    Mistake(f"{RUN} --hal robot", ("'robot'", "sim")),
    Mistake(f"{RUN} --vehicle tank", ("tank", "f1tenth")),
    Mistake(f"{RUN} --bridge fax", ("'fax'", "bridge", "installed:")),
    Mistake(f"{RUN} --source ouija", ("'ouija'", "--source")),
    Mistake("sensor check nose", ("'nose'", "light")),
    Mistake("service install --user run --set safety.vmax=1", ("safety.vmax", "did you mean 'safety.v_max'")),
    Mistake("service install --user run --fly", ("--fly", "txt1 run --help")),
    Mistake("sweep seed=1..3 --jobs 1 -- run --json", ("options come first", "txt1 sweep --help")),
    Mistake("sweep seed=1..3 -- run --jsno", ("--jsno", "txt1 run --help")),
    Mistake("sweep seed=1..3", ("settings with their values", "txt1 sweep --help")),
    Mistake("calibrate", ("--write", "mycar.yaml")),
    Mistake("calibrate --write car.txt", ("car.txt", "car.yaml")),
    Mistake("calibrate --write car.yaml --step dance", ("dance", "motor")),
    Mistake("hal new sim", ("'sim'", "another name")),
    Mistake("hal new import", ("'import'", "such as mycar")),
    Mistake("hal new json", ("'json'", "Python module", "another name")),
    Mistake("device submarine --pty x", ("'submarine'", "pico")),
    Mistake("board --pty x --event 3:fly", ("'3:fly'", "12.5:centre")),
    Mistake("run --cooperate convoy", ("--cooperate", "add --fleet")),
    Mistake(f"{RUN} --fleet --name txt01", ("--fleet", "--speed")),
    Mistake(f"{RUN} --web", ("--web", "--speed max")),
    Mistake(f"{RUN} --realtime", ("--realtime", "--speed")),
    # files
    Mistake(f"{RUN} --config FOLDER/none.yaml", ("none.yaml", "No such file", "--config")),
    Mistake(f"{RUN} --config FOLDER", ("FOLDER", "directory")),
    Mistake(f"{RUN} --config FOLDER/broken.yaml", ("broken.yaml:3:1", "not valid YAML")),
    Mistake(f"{RUN} --config FOLDER/binary", ("binary", "UTF-8")),
    Mistake("config check FOLDER/none.yam", ("argument FILE", "none.yam", "check the name")),
    Mistake("log info FOLDER/tub", ("FOLDER/tub", "directory", "txt1 teach"), 1),
    Mistake("report FOLDER/tub", ("FOLDER/tub", "directory", "txt1 teach"), 1),
    Mistake(f"{RUN} --source FOLDER/typo.yaml", ("typo.yaml", "FILE.onnx", "txt1 teach")),
    Mistake("config check FOLDER/typo.yaml", ("safety.v_mx", "did you mean 'safety.v_max'")),
    Mistake(f"{RUN} --policy FOLDER/none.json", ("none.json", "there is no file")),
    Mistake(f"{RUN} --policy FOLDER/typo.yaml", ("typo.yaml", "no Q-table", "txt1 learn"), 1),
    Mistake(f"{RUN} --log FOLDER/no/such/folder/run.mcap", ("FOLDER/no/such/folder", "choose another place")),
    Mistake(f"{RUN} --log ''", ("--log", "''", "give a name")),
    Mistake("replay ''", ("FILE", "''", "give a name")),
    Mistake("log info FOLDER/none.mcap", ("none.mcap", "there is no file")),
    Mistake("log info FOLDER/typo.yaml", ("typo.yaml", "MCAP"), 1),
    Mistake("report FOLDER/empty.mcap", ("empty.mcap",), 1),
    Mistake("report FOLDER/first.mcap -o /", ("--output", "'/'", "such as first")),
    Mistake("log info FOLDER/first.mcap FOLDER/second.mcap", ("second.mcap", "txt1 log info --help")),
    Mistake("demo --out FOLDER/binary", ("FOLDER/binary", "another place")),
    Mistake("run --web --web-folder FOLDER/binary", ("--web-folder", "binary", "a new one")),
    Mistake("replay FOLDER", ("FOLDER", "no bag of ROS", "empty.mcap"), 1),
    Mistake("experiment FOLDER/typo.yaml", ("typo.yaml", "title")),
    Mistake("experiment compare FOLDER FOLDER", ("FOLDER/metrics.json", "an experiment's --out")),
    Mistake("fleet FOLDER/typo.yaml", ("typo.yaml", "robots")),
    Mistake("learn --floor", ("--floor", "python -m txt1_learners.studies floor")),
    Mistake("learn --compare FOLDER/none", ("--compare", "python -m txt1_learners.studies compare FILE")),
    Mistake("learn --worlds FOLDER/none", ("--worlds", "python -m txt1_learners.studies worlds DIR")),
    # lines and ports
    Mistake(f"{RUN} --hal sim --port /dev/ttyUSB0", ("--port /dev/ttyUSB0", "serial")),
    Mistake("run --headless --duration 1 --hal serial --port FOLDER/ttyUSB9", ("ttyUSB9",), 1),
    Mistake("run --headless --duration 1 --hal serial --port virtual --baud 0", ("--baud", "'0'", "from 1")),
    Mistake("board --tcp 99999", ("--tcp", "'99999'", "HOST:PORT")),
    Mistake(f"{RUN} --view 0.0.0.0:8765", ("ssh -L", "0.0.0.0", "--web")),
)


@pytest.fixture(autouse=True)
def files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Files that are not what they should be, in the folder that the commands run in; no settings from outside."""
    for name in os.environ:
        if name.startswith("TXT1_"):
            monkeypatch.delenv(name)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "broken.yaml").write_text("seed: 1\ncontrol: [1,\n")
    (tmp_path / "typo.yaml").write_text("safety: {v_mx: 1.0}\n")
    (tmp_path / "binary").write_bytes(b"\xff\xfe\x00\x80" * 8)
    (tmp_path / "empty.mcap").write_bytes(b"")
    (tmp_path / "first.mcap").write_bytes(b"")
    (tmp_path / "tub").mkdir()


@pytest.mark.parametrize("mistake", MISTAKES, ids=lambda mistake: mistake.words.replace(RUN, "run"))
def test_a_mistake_is_told_in_one_line_with_thing_value_and_remedy(
    mistake: Mistake, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    code = execute(shlex.split(mistake.words.replace("FOLDER", str(tmp_path))))
    out, err = capfd.readouterr()
    assert (code, out) == (mistake.code, "")
    assert err.startswith("txt1: ") and err.count("\n") == 1
    assert "Traceback" not in err
    assert [word for word in mistake.told if word.replace("FOLDER", str(tmp_path)) not in err] == []


def test_a_hal_in_a_folder_that_is_not_installed_is_told_with_its_remedy(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert execute(["hal", "new", "mycarhere"]) == 0
    assert execute(["hal", "check", "mycarhere"]) == 2
    assert "-e ./mycarhere" in capsys.readouterr().err

"""The page "your own HAL in an hour", followed word by word; and what `txt1 hal new` writes keeps all promises."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from txt1.cli import execute

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "your-own-hal.md").read_text()
BLOCKS = re.findall(r"```(sh|python)\n(.*?)```", PAGE, re.DOTALL)


def perform(line: str, folder: Path) -> str:
    """Run a line of the page in a folder, and return what it prints."""
    command, *words = line.split()
    module = {"txt1": ["-m", "txt1"], "pip": ["-m", "pip", "--quiet"], "python": []}[command]
    site = folder / "site"
    ours = {
        "PYTHONPATH": os.pathsep.join((str(site), str(ROOT))), "PYTHONDONTWRITEBYTECODE": "1", "PIP_TARGET": str(site),
        "PIP_NO_INDEX": "1", "PIP_NO_DEPS": "1", "PIP_NO_BUILD_ISOLATION": "0",  # which pip takes for: without it
        "PIP_DISABLE_PIP_VERSION_CHECK": "1", "PIP_ROOT_USER_ACTION": "ignore",
    }  # fmt: skip
    done = subprocess.run(
        [sys.executable, *module, *words],
        cwd=folder,
        env=os.environ | ours,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, f"{line}\n{done.stdout}\n{done.stderr}"
    return done.stdout


@pytest.mark.long
def test_the_page_word_by_word(tmp_path: Path) -> None:
    said = {}
    for kind, text in BLOCKS:
        if kind == "python":
            assert (tmp_path / "mycar" / "mycar.py").exists()
            (tmp_path / "mycar" / "mycar.py").write_text(text)
            continue
        for line in text.splitlines():
            said[line] = perform(line, tmp_path)
    assert "mycar" in said["txt1 hal list"].splitlines()
    assert "BROKEN" not in said["txt1 hal check mycar"]
    (driven,) = (json.loads(text) for line, text in said.items() if line.startswith("txt1 run"))
    assert (driven["odometry"]["x"] > 0.5, driven["faults"]["runaway"]) == (True, 0)


def test_what_is_written_at_first_keeps_all_promises(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert execute(["hal", "new", "my_car", "--to", str(tmp_path)]) == 0
    ours = {"PYTHONPATH": os.pathsep.join((str(ROOT), str(tmp_path / "my_car")))}
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "my_car"], cwd=tmp_path, env=os.environ | ours, capture_output=True,
        text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout
    assert execute(["hal", "new", "my_car", "--to", str(tmp_path)]) == 2
    assert "is there already" in capsys.readouterr().err


@pytest.mark.parametrize(("name", "said"), [("vesc", "one of txt1's own"), ("My-Car", "name of a Python module")])
def test_names_that_cannot_be_are_refused(name: str, said: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert execute(["hal", "new", name]) == 2
    assert said in capsys.readouterr().err

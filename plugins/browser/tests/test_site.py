"""The folder of files, without a browser: what is refused, and what the archive has."""

import sys
import zipfile
from pathlib import Path

import pytest

from txt1.errors import ConfigError
from txt1_browser import site


def test_a_folder_with_other_things_is_not_touched(tmp_path: Path) -> None:
    (tmp_path / "thesis.txt").write_text("mine")
    with pytest.raises(ConfigError, match="something else is there; name a new folder"):
        site.build(tmp_path, tmp_path, print)
    assert (tmp_path / "thesis.txt").read_text() == "mine"


def test_a_folder_without_pyodide_names_what_is_missing(tmp_path: Path) -> None:
    (tmp_path / "given").mkdir()
    with pytest.raises(ConfigError, match=r"pyodide\.mjs is not in it"):
        site.build(tmp_path / "site", tmp_path / "given", lambda text: None)
    assert not (tmp_path / "site").exists()


def test_a_file_that_is_no_package_is_refused(tmp_path: Path) -> None:
    (tmp_path / "x.tgz").write_bytes(b"nothing")
    with pytest.raises(ConfigError, match="no package 'pyodide' of npm"):
        site.build(tmp_path / "site", tmp_path / "x.tgz", lambda text: None)


def test_a_program_that_is_not_there_or_fails_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="no-such-program: it is not installed here"):
        site.run(["no-such-program"], tmp_path, "no-such-program")
    with pytest.raises(ConfigError, match="failed: broken"):
        site.run([sys.executable, "-c", "import sys; sys.exit('broken')"], tmp_path, "python")


@pytest.mark.parametrize("node", ["/usr/bin/node", None])
def test_modules_are_compiled_where_there_is_node(
    node: str | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    given, ran, told = tmp_path / "given", list[str](), list[str]()
    given.mkdir()
    for name in site.NEEDED:
        (given / name).touch()

    def run(command: list[str], work: Path, program: str) -> str:
        ran.append(program)
        if program == "pip":
            with zipfile.ZipFile(work / "pydantic_core-1-cp314.whl", "w") as made:
                made.writestr("pydantic_core/__init__.py", "")
        return ""

    monkeypatch.setattr(site, "run", run)
    monkeypatch.setattr("shutil.which", lambda name: node)
    site.build(tmp_path / "site", given, told.append)
    assert ran == (["pip", "node"] if node else ["pip"])
    assert any("compiles them at each start" in each for each in told) == (node is None)


def test_the_archive_has_what_a_robot_needs_and_nothing_compiled(tmp_path: Path) -> None:
    wheel = tmp_path / "pydantic_core.whl"
    with zipfile.ZipFile(wheel, "w") as made:
        made.writestr("pydantic_core/__init__.py", "")
    site.archive(tmp_path / "packages.zip", wheel)
    names = set(zipfile.ZipFile(tmp_path / "packages.zip").namelist())
    for wanted in (
        "txt1/robot.py",
        "txt1/config/schema.py",
        "txt1_browser/robot_worker.py",
        "pydantic/main.py",
        "yaml/__init__.py",
    ):
        assert wanted in names
    assert not {name for name in names if name.endswith((".so", ".pyd", ".pyc"))}

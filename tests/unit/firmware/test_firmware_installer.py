"""Installing the firmware: on a folder that MicroPython's unix port works in, in place of a board's flash."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

from txt1.cars.pico.installer import digest, digests, files, folder, frame, identities, install
from txt1.cars.pico.virtual_pico import interpreter
from txt1.errors import HalError, MissingExtra

try:
    MICROPYTHON = interpreter()
except MissingExtra:
    pytest.skip("MicroPython's unix port is not installed", allow_module_level=True)


class Folder:
    """A board whose flash is a folder; `limit` cuts off what is copied."""

    def __init__(self, path: Path, limit: int | None = None) -> None:
        self.path, self.limit = path, limit
        self.puts: list[str] = []

    def run(self, script: str) -> str:
        return subprocess.run(
            [MICROPYTHON, "-c", script], cwd=self.path, capture_output=True, text=True, check=True
        ).stdout

    def put(self, source: Path, name: str) -> None:
        self.puts.append(name)
        target = self.path / name
        shutil.copy(source, target)
        if self.limit is not None:
            target.write_bytes(target.read_bytes()[: self.limit])


def test_every_file_is_copied_verified_and_the_one_that_starts_comes_last(tmp_path: Path) -> None:
    board = Folder(tmp_path)
    done = install(board)
    assert done.copied == files() and files()[-1] == "main.py"
    assert digests(board, files()) == {name: digest(folder() / name) for name in files()}
    assert not list(tmp_path.rglob("*.new"))
    assert install(board).copied == [], "a second time there is nothing to do"


def test_what_arrives_torn_leaves_the_old_firmware(tmp_path: Path) -> None:
    install(Folder(tmp_path))
    (tmp_path / "main.py").write_text("old")
    (tmp_path / "settings.json").write_text("{}")
    with pytest.raises(HalError, match=r"main\.py: a file arrived damaged on the board"):
        install(Folder(tmp_path, limit=100))
    assert (tmp_path / "main.py").read_text() == "old"
    assert install(Folder(tmp_path)).copied == ["main.py"]
    assert (tmp_path / "settings.json").read_text() == "{}", "settings stay"


def test_what_was_installed_runs(tmp_path: Path) -> None:
    board = Folder(tmp_path)
    install(board)
    assert board.run("from txt1pico.core import Core\nprint(Core().identity)").strip() == "b'txt1pico'"


def test_a_boards_name_is_found_among_other_frames() -> None:
    stream = b"\x00\xfa" + frame(b"txt1pico 0.2 blue") + b"\xfa\xfb\x04"
    assert list(identities(stream)) == ["txt1pico 0.2 blue"]
    assert list(identities(stream.replace(b"blue", b"blur"))) == [], "its checksum is wrong"

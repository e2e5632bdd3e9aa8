"""The hash of the code that a result came from."""

from __future__ import annotations

from pathlib import Path

import txt1
from txt1.trials.provenance import SHOWS, hash_of

ROOT = Path(txt1.__file__).parent


def package(folder: Path, **changed: str) -> Path:
    made = ("sim/world.py", "control/pid.py", "learning/thesis.py", "kit/app.py")
    for name in (*made, "ui/terminal.py", "web/server.py"):
        file = folder / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(changed.get(file.stem, "1"))
    return folder


def test_a_changed_screen_changes_no_result_and_a_changed_simulation_does(tmp_path: Path) -> None:
    before = hash_of(package(tmp_path / "a"))
    assert hash_of(package(tmp_path / "b", terminal="2", server="2")) == before
    for part in ("world", "pid", "thesis", "app"):
        assert hash_of(package(tmp_path / part, **{part: "2"})) != before
    (tmp_path / "study.py").touch()
    assert hash_of(tmp_path / "a", {"beside/study.py": tmp_path / "study.py"}) != before


def test_what_is_left_out_is_there() -> None:
    for name in (*SHOWS, "kit/app.py"):
        assert (ROOT / name).exists(), f"{name} was moved: so is what makes a result"

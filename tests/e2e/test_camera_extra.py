"""A missing extra ends with the same exit code, wherever it is missed."""

from __future__ import annotations

import sys

import pytest

from txt1.cli import execute
from txt1.commands import USAGE


@pytest.mark.parametrize(("driver", "module"), [("camera", "av"), ("depth_realsense", "pyrealsense2")])
def test_a_camera_without_its_library_ends_as_every_missing_extra(
    driver: str, module: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, module, None)
    run = ["run", "--headless", "--json", "--duration", "1", "--set", f"sensors.seen_{module}.driver={driver}"]
    assert execute(run) == USAGE
    assert "needs the extra 'camera': " in capsys.readouterr().err

"""All members of a hardware layer are in its interface, and nothing asks whether a layer has another."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import txt1
from txt1.cli import execute
from txt1.config import Config
from txt1.errors import HalError
from txt1.hal.base import Hal, Inputs, Outputs, lacking
from txt1.hal.conformance import HalConformance
from txt1.hal.plain_hal import PlainHal
from txt1.hal.sim import SimHal
from txt1.kernel.loop import run
from txt1.runtime import Runtime

ROOT = Path(txt1.__file__).parents[1]
ASKED = re.compile(r"(?:get|has)attr\((?:[a-z_]+\.)*_?hal\b(?!\.)")
# two that pass every member on, and the function that finds missing ones
ALLOWED = {"txt1/hal/base.py", "txt1/hal/channels.py", "txt1/hal/recorded_hal.py"}
OURS = {"open", "close", "read", "write"}


class Own(PlainHal):
    """A HAL as short as it may be."""

    async def open(self) -> None: ...

    async def close(self) -> None: ...

    def read(self, now: float) -> Inputs:
        return Inputs()

    def write(self, outputs: Outputs, now: float) -> None: ...


class Stranger:
    """A HAL that is derived from nothing and lacks what few have."""

    name = "stranger"
    capabilities = PlainHal.capabilities
    open, close, read, write = Own.open, Own.close, Own.read, Own.write
    halt, switch, load_gains = PlainHal.halt, PlainHal.switch, PlainHal.load_gains
    offer_odometry, indicate, place = PlainHal.offer_odometry, PlainHal.indicate, PlainHal.place


LACKS = ["own_channels", "esc", "waits", "tap_line", "clear_loops", "blocked_by", "attitude", "others", "movers"]


def test_no_code_asks_whether_a_hal_has_a_member() -> None:
    files = [path for folder in ("txt1", "plugins") for path in ROOT.glob(f"{folder}/**/*.py")]
    assert len(files) > 100
    found = {str(path.relative_to(ROOT)) for path in files if ASKED.search(path.read_text(encoding="utf-8"))}
    assert found == ALLOWED


def test_a_plain_hal_has_all_members_but_four() -> None:
    assert set(lacking(PlainHal())) == OURS
    assert lacking(Own()) == []
    assert {name for name in vars(Hal) if not name.startswith("_")} >= set(LACKS) | OURS


def test_a_hal_that_lacks_members_is_refused_with_their_names() -> None:
    assert lacking(Stranger()) == LACKS

    async def main() -> None:
        Runtime(Config(), lambda message: None, Stranger())  # type: ignore[arg-type]

    with pytest.raises(HalError, match=r"lacks own_channels, esc, waits, tap_line, .*movers: derive .*PlainHal"):
        run(main(), speed="max")


class Nowhere(SimHal):
    def attitude(self) -> tuple[float, float]:
        return float("nan"), 0.0


@pytest.mark.parametrize(
    ("made", "told"),
    [
        (lambda sim: Stranger(), "Hal.own_channels is there"),
        (lambda sim: Nowhere(sim.vehicle), "Hal.attitude is roll and pitch in rad, not (nan, 0.0)"),
    ],
)
def test_hal_check_names_a_broken_member(
    made: object, told: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from txt1.hal.registry import create

    monkeypatch.setattr("txt1.cli.hal.create", lambda config: made(create(config)))  # type: ignore[operator]
    monkeypatch.setattr("txt1.cli.hal.verdicts", _only_the_members)
    assert execute(["hal", "check", "sim", "--wheels-up"]) == 1
    assert told in capsys.readouterr().out


def _only_the_members(suite: type[HalConformance], make: object, **settings: object) -> object:
    from txt1.conformance import verdicts

    names = [name for name in vars(suite) if name.startswith("test_") and "member" not in name]
    return verdicts(type(suite.__name__, (suite,), dict.fromkeys(names)), make, **settings)  # type: ignore[arg-type]

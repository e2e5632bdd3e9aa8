"""Hardware layers are found by name: ours from a table, a stranger's through the entry-point group `txt1.hal`."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from txt1 import additions
from txt1.additions import Addition
from txt1.config import load
from txt1.errors import ConfigError, HalError
from txt1.hal.registry import HALS, create, is_on_a_line, is_simulated
from txt1.hal.sim import SimHal
from txt1.sim.parameters import Faults

MYCAR = """
from txt1.errors import ConfigError

class MyCar:
    name = "mycar"

    def __init__(self, config):
        self.config = config
        self.port = config.hal_options["port"]

def create(config):
    if config.hal_options.get("port") == "":
        raise ConfigError("hal_options.port: must not be empty")
    return MyCar(config)
"""

Install = Callable[..., None]


@pytest.fixture
def install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Install:
    """Installs a package `mycar` that announces a HAL, as pip would: a module and its dist-info."""

    def install(source: str = MYCAR, name: str = "mycar", value: str = "mycar:create") -> None:
        (tmp_path / "mycar.py").write_text(source)
        info = tmp_path / "mycar-1.0.dist-info"
        info.mkdir()
        (info / "METADATA").write_text("Metadata-Version: 2.1\nName: mycar\nVersion: 1.0\n")
        (info / "entry_points.txt").write_text(f"[txt1.hal]\n{name} = {value}\n")
        monkeypatch.syspath_prepend(tmp_path)
        monkeypatch.delitem(sys.modules, "mycar", raising=False)

    return install


def test_the_simulated_robot_is_there_without_any_package() -> None:
    assert "sim" in HALS.names()
    assert isinstance(create(load().config), SimHal)


def test_the_simulated_robot_is_made_as_configured() -> None:
    hal = create(load(overrides=["sim.start=[1, -1, 0.5]", "sim.faults.right_encoder=true"]).config)
    assert isinstance(hal, SimHal)
    assert hal.read(0.0).pose == (1.0, -1.0, 0.5)
    assert hal.vehicle.faults == Faults(right_encoder=True)


def test_a_start_inside_a_wall_names_the_setting_and_the_remedy() -> None:
    with pytest.raises(ConfigError, match=r"^sim\.start: .*sticks into a wall.*choose another start") as error:
        create(load(overrides=["sim.start=[2.4, 0, 0]"]).config)
    assert "\n" not in str(error.value)


def test_an_unknown_name_lists_the_known_names(install: Install) -> None:
    install()
    with pytest.raises(ConfigError) as error:
        create(load(options={"hal": "nonsense"}).config)
    assert str(error.value) == "hal: there is no HAL 'nonsense'; installed: mycar, pi, serial, sim, vesc, waveshare"


@pytest.mark.parametrize(("typed", "meant"), [("simm", "sim"), ("Mycar", "mycar"), ("mycra", "mycar")])
def test_a_misspelt_name_gets_the_nearest_one(install: Install, typed: str, meant: str) -> None:
    install()
    with pytest.raises(ConfigError, match=f"no HAL '{typed}'.*did you mean '{meant}'\\?$"):
        create(load(options={"hal": typed}).config)


def test_a_strangers_hal_is_made_with_the_whole_configuration(install: Install) -> None:
    install()
    config = load(overrides=["hal=mycar", "hal_options.port=/dev/ttyUSB0", "seed=7"]).config
    hal = create(config)
    assert hal.name == "mycar"
    assert vars(hal) == {"config": config, "port": "/dev/ttyUSB0"}


def test_a_strangers_hal_is_imported_only_when_asked_for(install: Install) -> None:
    install()
    assert "mycar" in HALS.names()
    create(load().config)
    with pytest.raises(ConfigError):
        create(load(overrides=["hal=nonsense"]).config)
    assert "mycar" not in sys.modules
    create(load(overrides=["hal=mycar", "hal_options.port=x"]).config)
    assert "mycar" in sys.modules


def test_a_stranger_cannot_replace_the_simulated_robot(install: Install) -> None:
    install("raise RuntimeError('imported')", name="sim")
    assert HALS.names() == ["pi", "serial", "sim", "vesc", "waveshare"]
    assert isinstance(create(load().config), SimHal)


@pytest.mark.parametrize(
    ("source", "value", "cause"),
    [
        ("import no_such_driver", "mycar:create", "ModuleNotFoundError: No module named 'no_such_driver'"),
        ("raise OSError('no libcar.so')", "mycar:create", "OSError: no libcar.so"),
        ("def create(config", "mycar:create", "SyntaxError"),
        ("", "mycar:create", "AttributeError: module 'mycar' has no attribute 'create'"),
    ],
)
def test_a_hal_that_cannot_be_imported_is_one_clear_error(
    install: Install, source: str, value: str, cause: str
) -> None:
    install(source, value=value)
    with pytest.raises(HalError) as error:
        create(load(overrides=["hal=mycar"]).config)
    message = str(error.value)
    assert message.startswith(f"the HAL 'mycar' ({value}) cannot be imported: {cause}")
    assert "\n" not in message
    assert error.value.__cause__ is not None


def test_a_hal_that_cannot_be_made_is_one_clear_error(install: Install) -> None:
    install()
    with pytest.raises(HalError) as error:
        create(load(overrides=["hal=mycar"]).config)  # no port
    assert str(error.value) == "the HAL 'mycar' (mycar:create) cannot be made: KeyError: 'port'"
    assert isinstance(error.value.__cause__, KeyError)


def test_a_hal_may_refuse_its_settings_itself(install: Install) -> None:
    install()
    with pytest.raises(ConfigError, match=r"^hal_options\.port: must not be empty$"):
        create(load(overrides=["hal=mycar", "hal_options.port=''"]).config)


@pytest.mark.parametrize(
    ("settings", "simulated"),
    [
        (["hal=sim"], True),
        (["hal=serial", "serial.port=virtual"], True),
        (["hal=serial", "serial.port=pico"], True),
        (["hal=serial", "serial.port=/dev/ttyUSB0"], False),
        (["hal=serial"], False),
        (["hal=vesc", "serial.port=vesc"], True),
        (["hal=vesc", "hal_options.bus=virtual"], False),
        (["hal=waveshare", "serial.port=waveshare"], True),
        (["hal=waveshare", "serial.port=/dev/ttyAMA0"], False),
        (["hal=pi", "hal_options.bus=virtual"], True),
        (["hal=pi", "hal_options.bus=1"], False),
        (["hal=pi", "serial.port=virtual"], False),
        (["hal=mycar", "serial.port=virtual", "hal_options.bus=virtual"], False),
    ],
)
def test_a_configuration_says_whether_its_hardware_is_simulated(settings: list[str], simulated: bool) -> None:
    assert is_simulated(load(overrides=settings).config) is simulated


def test_a_hal_is_on_a_line_when_its_addition_brings_a_port_of_its_name(monkeypatch: pytest.MonkeyPatch) -> None:
    assert [name for name in HALS.names() if is_on_a_line(name)] == ["serial", "vesc", "waveshare"]
    mycar = Addition("mycar", parts={"txt1.hal": {"mycar": "mycar:create"}, "txt1.ports": {"mycar": "mycar:port"}})
    monkeypatch.setattr(additions, "known", lambda: {"mycar": mycar})
    assert (is_on_a_line("mycar"), is_on_a_line("vesc")) == (True, False)
    assert is_simulated(load(overrides=["hal=mycar", "serial.port=mycar"]).config)

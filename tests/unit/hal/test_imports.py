"""A hardware layer imports nothing that it does not need: a machine has the base install and its extra, and no more."""

import subprocess
import sys
import tomllib
from pathlib import Path
from unittest import mock

import pytest

from txt1.config import load
from txt1.errors import HalError
from txt1.hal.registry import create
from txt1.installing import installs

PROJECT = tomllib.loads((Path(__file__).parents[3] / "pyproject.toml").read_text())["project"]
OTHERS = {
    "aiohttp", "av", "cryptography", "foxglove", "gymnasium", "lgpio", "matplotlib", "mcap", "numba", "PIL", "pygame",
    "pyrealsense2", "segno", "smbus2", "utm",
}  # fmt: skip
"""What the extras bring."""


HALS = {
    "vesc": ["vehicle=f1tenth", "serial.port=/dev/ttyACM0"],
    "waveshare": ["vehicle=rover", "serial.port=/dev/ttyAMA0", "hal_options.model=ugv-rover"],
    "pi": ["vehicle=donkeycar", "hal_options.bus=registers"],
}


def test_hals_are_made_with_the_base_install() -> None:
    program = (
        "import sys; from txt1.config import load; from txt1.hal.registry import create\n"
        f"for hal, settings in {HALS!r}.items(): create(load(None, settings, {{}}, {{'hal': hal}}).config)\n"
        "print(*sys.modules)"
    )
    found = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout.split()
    assert "txt1.cars.pi.driver" in found
    assert not OTHERS & set(found)


def test_the_extra_of_a_raspberry_pi_is_named_where_it_is_missing() -> None:
    program = (
        "import sys, importlib.util; found = importlib.util.find_spec\n"
        "importlib.util.find_spec = lambda name, package=None: None if name == 'smbus2' else found(name, package)\n"
        "from txt1.cli import execute\n"
        "sys.exit(execute(['run', '--hal', 'pi', '--vehicle', 'donkeycar', '--headless']))"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr.startswith("txt1: the HAL 'pi' needs the extra 'devices': ")
    assert done.stderr.endswith(f"{installs('devices')}\n")


def test_where_lgpio_has_no_wheel_its_package_is_named() -> None:
    with pytest.raises(HalError, match="python3-lgpio"), mock.patch("txt1.cars.pi.driver.find_spec", {"smbus2": 1}.get):
        create(load(None, ["vehicle=donkeycar", "hal_options.output=gpio"], {}, {"hal": "pi"}).config)

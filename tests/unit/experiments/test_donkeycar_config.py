"""A donkeycar's myconfig.py: read as data, never run, with the pulses and pins that donkeycar puts out."""

from __future__ import annotations

from pathlib import Path

import pytest

from txt1.cars.pi.driver import PiOptions
from txt1.cli import execute
from txt1.commands import OK, USAGE
from txt1.config import checked, load
from txt1.errors import ConfigError
from txt1.experiments.calibration.donkeycar_config import wiring

MODERN = """
import os
os.system("touch ran")
PWM_STEERING_THROTTLE = {
    "PWM_STEERING_PIN": "PCA9685.1:41.3", "PWM_STEERING_SCALE": 1.0, "PWM_STEERING_INVERTED": False,
    "PWM_THROTTLE_PIN": "PCA9685.1:41.2", "PWM_THROTTLE_SCALE": 1.0, "PWM_THROTTLE_INVERTED": False,
    "STEERING_LEFT_PWM": 300, "STEERING_RIGHT_PWM": 440,
    "THROTTLE_FORWARD_PWM": 450, "THROTTLE_STOPPED_PWM": 370, "THROTTLE_REVERSE_PWM": 290,
}
"""


def given(folder: Path, text: str, name: str = "myconfig.py") -> Path:
    file = folder / name
    file.write_text(text)
    return file


def test_pins_and_pulses_are_those_that_donkeycar_puts_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    found = wiring(given(tmp_path, MODERN)).settings
    assert not (tmp_path / "ran").exists()
    assert (found["hal_options.bus"], found["hal_options.address"]) == (1, 0x41)
    assert (found["hal_options.steering"], found["hal_options.motor"]) == ([3], [2])
    # 370 of 4096 steps of 1/60 s are 1505.5 us; full left is shorter than straight
    assert found["hal_options.motor_neutral"] == pytest.approx(1505.5, abs=0.1)
    assert found["hal_options.motor_range"] == pytest.approx(80 / 4096 / 60 * 1e6, abs=0.1)
    assert found["hal_options.straight"] == pytest.approx(1505.5, abs=0.1)
    assert found["hal_options.steering_range"] == pytest.approx(-70 / 4096 / 60 * 1e6, abs=0.1)


def test_a_plain_myconfig_has_donkeycars_own_values(tmp_path: Path) -> None:
    found = wiring(given(tmp_path, "# all is as it was\n"))
    assert found.settings["hal_options.steering_range"] == pytest.approx(345.9, abs=0.1)
    assert found.remarks[0].startswith("hal_options.reverse is not in this file")
    assert found.remarks[1:] == ("full reverse is 610 us from rest, as txt1 has 529 us to both sides",)


def test_config_py_beside_it_comes_first_and_single_values_change_it(tmp_path: Path) -> None:
    given(tmp_path, MODERN + "JOYSTICK_MAX_THROTTLE = 0.5\nHALF = 0.25\n", "config.py")
    text = 'PWM_STEERING_THROTTLE["STEERING_LEFT_PWM"] = 310\nJOYSTICK_MAX_THROTTLE = HALF\n'
    found = wiring(given(tmp_path, text)).settings
    assert found["hal_options.steering_range"] == pytest.approx(-65 / 4096 / 60 * 1e6, abs=0.1)
    assert found["safety.motor_max"] == 6000


def test_an_older_car_has_its_values_in_names_of_their_own(tmp_path: Path) -> None:
    text = 'DRIVE_TRAIN_TYPE = "SERVO_ESC"\nSTEERING_CHANNEL = 5\nTHROTTLE_CHANNEL = 4\nSTEERING_LEFT_PWM = 480\n'
    found = wiring(given(tmp_path, text + "PCA9685_I2C_ADDR = 0x42\nPCA9685_I2C_BUSNUM = None\n")).settings
    assert (found["hal_options.steering"], found["hal_options.motor"]) == ([5], [4])
    assert (found["hal_options.bus"], found["hal_options.address"]) == (1, 0x42)


def test_gpio_pins_of_the_header_become_their_numbers(tmp_path: Path) -> None:
    text = MODERN.replace("PCA9685.1:41.3", "RPI_GPIO.BOARD.33").replace("PCA9685.1:41.2", "PIGPIO.BCM.18")
    found = wiring(given(tmp_path, text)).settings
    assert (found["hal_options.output"], found["hal_options.steering"], found["hal_options.motor"]) == (
        "gpio",
        [13],
        [18],
    )


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (
            'DRIVE_TRAIN_TYPE = "DC_TWO_WHEEL"',
            "DRIVE_TRAIN_TYPE: 'DC_TWO_WHEEL'; give PWM_STEERING",
        ),
        ("DRIVE_TRAIN_TYPE = os.environ['TRAIN']", "DRIVE_TRAIN_TYPE: 'os.environ['TRAIN']' is computed, and the file"),
        ('PWM_STEERING_THROTTLE["STEERING_LEFT_PWM"] = f(1)', "STEERING_LEFT_PWM: 'f(1)' is computed"),
        ('PWM_STEERING_THROTTLE["STEERING_LEFT_PWM"] = "x"', "STEERING_LEFT_PWM: 'x'; give a number"),
        (
            'PWM_STEERING_THROTTLE["STEERING_LEFT_PWM"] = 4000',
            "STEERING_LEFT_PWM: 4000.0; give a pulse of 500",
        ),
        ('PWM_STEERING_THROTTLE["PWM_STEERING_PIN"] = "A7"', "PWM_STEERING_PIN: 'A7'; give such as 'PCA9685.1:40.1'"),
        ('PWM_STEERING_THROTTLE["PWM_STEERING_PIN"] = "PIGPIO.BCM.4"', "steering and throttle are on two boards"),
        ('PWM_STEERING_THROTTLE["PWM_THROTTLE_INVERTED"] = True', "PWM_THROTTLE_INVERTED: True; give False"),
        ("PWM_STEERING_THROTTLE = {}", "PWM_STEERING_PIN: not there; give it"),
        ('PWM_STEERING_THROTTLE["THROTTLE_STOPPED_PWM"] = 510', "THROTTLE_STOPPED_PWM has to lie between"),
        ("JOYSTICK_MAX_THROTTLE = 7", "JOYSTICK_MAX_THROTTLE: 7.0; give a share"),
        ("x = (", "no Python in line 1: "),
        ("x = 1\0", "no Python"),
    ],
)
def test_what_cannot_be_taken_over_is_named(text: str, told: str, tmp_path: Path) -> None:
    with pytest.raises(ConfigError) as refused:
        wiring(given(tmp_path, text))
    assert told in str(refused.value) and "\n" not in str(refused.value)


def test_the_command_writes_a_vehicle_for_the_raspberry_pi(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file, written = given(tmp_path, MODERN + "JOYSTICK_MAX_THROTTLE = 1.0\n"), tmp_path / "mycar.yaml"
    assert execute(["calibrate", "--from", str(file), "--write", str(written)]) == OK
    told = capsys.readouterr().out
    assert "hal_options.motor_neutral: 1505.5" in told and "it stays 8000, and you may raise it" in told
    config = load(None, [], {}, {"vehicle": str(written), "hal": "pi"}).config
    options = checked(PiOptions, config.hal_options, "hal_options")
    assert (options.address, options.steering, options.motor) == (0x41, (3,), (2,))
    assert config.geometry.wheelbase == 0.174 and config.safety.motor_max == 8000
    assert execute(["calibrate", "--from", str(file), "--write", str(written)]) == USAGE
    assert execute(["calibrate", "--from", str(tmp_path / "none.py")]) == USAGE
    assert "none.py: cannot read it: No such file" in capsys.readouterr().err

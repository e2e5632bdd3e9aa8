"""The wiring of a donkeycar, from its ``myconfig.py``: which pins steer and drive, and by which pulses.

The file is a program, and it is never run. Assignments of plain values are read as data: numbers, texts, dictionaries,
and names that were assigned before. Every other line is passed over. As donkeycar does, ``config.py`` beside it is
read first, and before it stand donkeycar's own defaults.

donkeycar gives a pulse as a share of 4096 of a period of 1/60 s. Its steering goes from the pulse of full left to that
of full right; its throttle from the pulse of full reverse through the pulse at rest to that of full ahead.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Mapping
from math import isfinite
from pathlib import Path
from typing import Any, Final, NamedTuple

from txt1.errors import ConfigError
from txt1.file_limits import YAML_MAX, read_text
from txt1.model.vehicle import PWM_MAX

# Hz, and steps of a period, of donkeycar's pulses
FREQUENCY: Final = 60.0
STEPS: Final = 4096
MICROSECONDS: Final = 1e6
# us; what a servo or an ESC obeys
PULSES: Final = (500.0, 2500.0)
TRAIN, MODERN = "DRIVE_TRAIN_TYPE", "PWM_STEERING_THROTTLE"
# drive trains with a servo and an ESC on a servo board; older versions have the pulses in names of their own
OLDER: Final = ("I2C_SERVO", "SERVO_ESC")
DEFAULTS: Final[Mapping[str, Any]] = {
    TRAIN: MODERN,
    MODERN: {
        "PWM_STEERING_PIN": "PCA9685.1:40.1",
        "PWM_STEERING_SCALE": 1.0,
        "PWM_STEERING_INVERTED": False,
        "PWM_THROTTLE_PIN": "PCA9685.1:40.0",
        "PWM_THROTTLE_SCALE": 1.0,
        "PWM_THROTTLE_INVERTED": False,
        "STEERING_LEFT_PWM": 460,
        "STEERING_RIGHT_PWM": 290,
        "THROTTLE_FORWARD_PWM": 500,
        "THROTTLE_STOPPED_PWM": 370,
        "THROTTLE_REVERSE_PWM": 220,
    },
    "STEERING_CHANNEL": 1,
    "STEERING_LEFT_PWM": 460,
    "STEERING_RIGHT_PWM": 290,
    "THROTTLE_CHANNEL": 0,
    "THROTTLE_FORWARD_PWM": 500,
    "THROTTLE_STOPPED_PWM": 370,
    "THROTTLE_REVERSE_PWM": 220,
    "PCA9685_I2C_ADDR": 0x40,
    "PCA9685_I2C_BUSNUM": 1,
}
"""donkeycar's own values, version 5."""
PCA9685: Final = re.compile(r"PCA9685\.(\d+):([0-9a-fA-F]+)\.(\d+)")
GPIO: Final = re.compile(r"(?:RPI_GPIO|PIGPIO)\.(BCM|BOARD)\.(\d+)")
# the GPIO numbers of a Raspberry Pi's header, by its pins
HEADER: Final[Mapping[int, int]] = {
    3: 2, 5: 3, 7: 4, 8: 14, 10: 15, 11: 17, 12: 18, 13: 27, 15: 22, 16: 23, 18: 24, 19: 10, 21: 9, 22: 25, 23: 11,
    24: 8, 26: 7, 27: 0, 28: 1, 29: 5, 31: 6, 32: 12, 33: 13, 35: 19, 36: 16, 37: 26, 38: 20, 40: 21,
}  # fmt: skip


class Wiring(NamedTuple):
    """The settings of a donkeycar for txt1, and remarks on what could not be taken over."""

    settings: dict[str, Any]
    """By dotted key."""
    remarks: tuple[str, ...]


class _Values:
    """The values of donkeycar's files; errors name the file, the name and its value."""

    def __init__(self, file: Path, values: Mapping[str, Any], unread: Mapping[str, str]) -> None:
        self.file, self.values, self.unread = file, values, unread

    def wrong(self, name: str, value: object, takes: str) -> ConfigError:
        return ConfigError(f"{self.file}: {name}: {value!r}; give {takes}")

    def value(self, name: str, group: str = "") -> Any:
        """Return a value; raises ConfigError: it is the result of a program, or missing."""
        whole = f"{group}.{name}" if group else name
        for each in (whole, group or name):
            if each in self.unread:
                raise ConfigError(
                    f"{self.file}: {each}: '{self.unread[each]}' is computed, and the file is never run; give a plain "
                    "value"
                )
        table = self.values.get(group, {}) if group else self.values
        if not isinstance(table, dict) or name not in table:
            raise ConfigError(f"{self.file}: {whole}: not there; give it, as donkeycar's cfg_complete.py has it")
        return table[name]

    def number(self, name: str, group: str = "") -> float:
        value = self.value(name, group)
        if isinstance(value, bool) or not isinstance(value, int | float) or not isfinite(value):
            raise self.wrong(f"{group}.{name}" if group else name, value, "a number")
        return float(value)

    def pulse(self, name: str, group: str, scale: float) -> float:
        """Return a pulse in us."""
        steps = self.number(name, group)
        length = steps * scale / STEPS / FREQUENCY * MICROSECONDS
        if not PULSES[0] <= length <= PULSES[1]:
            takes = f"a pulse of {PULSES[0]:g} to {PULSES[1]:g} us at 60 Hz, such as 370"
            raise self.wrong(f"{group}.{name}" if group else name, steps, takes)
        return length


def wiring(file: Path) -> Wiring:
    """Return the wiring that a ``myconfig.py`` tells.

    Raises ConfigError: the file cannot be read, a value is wrong or computed, or the drive train is another than a
    servo with an ESC.
    """
    values, unread = dict(DEFAULTS), dict[str, str]()
    values[MODERN] = dict(DEFAULTS[MODERN])
    for each in (file.with_name("config.py"), file):
        if each == file or each.is_file():
            _read(each, values, unread)
    told = _Values(file, values, unread)
    train = told.value(TRAIN)
    modern = train == MODERN
    if not modern and train not in OLDER:
        raise told.wrong(TRAIN, train, f"{MODERN} or {OLDER[0]}: only a servo with an ESC is read")
    group = MODERN if modern else ""
    settings = _pins(told, modern)
    scales = [told.number(f"PWM_{part}_SCALE", group) if modern else 1.0 for part in ("STEERING", "THROTTLE")]
    for part in ("STEERING", "THROTTLE") if modern else ():
        if told.value(f"PWM_{part}_INVERTED", group):
            raise told.wrong(f"{group}.PWM_{part}_INVERTED", True, "False: inverted pulses are not put out")
    left, right = (told.pulse(f"STEERING_{side}_PWM", group, scales[0]) for side in ("LEFT", "RIGHT"))
    ahead, rest, back = (
        told.pulse(f"THROTTLE_{how}_PWM", group, scales[1]) for how in ("FORWARD", "STOPPED", "REVERSE")
    )
    if abs(left - right) < 1.0 or abs(ahead - rest) < 1.0 or (ahead - rest) * (back - rest) > 0.0:
        raise ConfigError(
            f"{file}: STEERING_LEFT_PWM and STEERING_RIGHT_PWM have to differ, and THROTTLE_STOPPED_PWM has to lie "
            "between THROTTLE_REVERSE_PWM and THROTTLE_FORWARD_PWM; calibrate with donkeycar, or with txt1 calibrate"
        )
    settings |= {
        "hal_options.frequency": FREQUENCY,
        "hal_options.straight": round(0.5 * (left + right), 1),
        "hal_options.steering_range": round(0.5 * (left - right), 1),
        "hal_options.motor_neutral": round(rest, 1),
        "hal_options.motor_range": round(ahead - rest, 1),
    }
    remarks = [
        "hal_options.reverse is not in this file, so the car drives forward only: set it to brake_first or direct, or "
        "let txt1 calibrate find it (step reverse)"
    ]
    if abs((rest - back) - (ahead - rest)) > 10.0:
        remarks.append(
            f"full reverse is {abs(back - rest):.0f} us from rest, as txt1 has {abs(ahead - rest):.0f} us to both sides"
        )
    if "JOYSTICK_MAX_THROTTLE" in values:
        most = told.number("JOYSTICK_MAX_THROTTLE")
        if not 0.0 < most <= 1.0:
            raise told.wrong("JOYSTICK_MAX_THROTTLE", most, "a share, more than 0 and at most 1")
        settings["safety.motor_max"] = round(most * PWM_MAX)
    return Wiring(settings, tuple(remarks))


def _pins(told: _Values, modern: bool) -> dict[str, Any]:
    """Return the settings of the outputs."""
    if not modern:
        bus = told.value("PCA9685_I2C_BUSNUM")
        return {
            "hal_options.output": "pca9685",
            "hal_options.bus": 1 if bus is None else int(told.number("PCA9685_I2C_BUSNUM")),
            "hal_options.address": int(told.number("PCA9685_I2C_ADDR")),
            "hal_options.steering": [int(told.number("STEERING_CHANNEL"))],
            "hal_options.motor": [int(told.number("THROTTLE_CHANNEL"))],
        }
    boards, channels, pins = set(), [], []
    for part in ("STEERING", "THROTTLE"):
        name = told.value(f"PWM_{part}_PIN", MODERN)
        board, pin = (pattern.fullmatch(str(name)) for pattern in (PCA9685, GPIO))
        if board:
            boards.add((int(board[1]), int(board[2], 16)))
            channels.append(int(board[3]))
        elif pin and (pin[1] == "BCM" or int(pin[2]) in HEADER):
            pins.append(int(pin[2]) if pin[1] == "BCM" else HEADER[int(pin[2])])
        else:
            raise told.wrong(f"{MODERN}.PWM_{part}_PIN", name, "such as 'PCA9685.1:40.1' or 'RPI_GPIO.BCM.13'")
    if len(boards) + bool(pins) != 1:
        raise ConfigError(f"{told.file}: {MODERN}: steering and throttle are on two boards; txt1 drives one")
    used = channels or pins
    found = {"hal_options.steering": [used[0]], "hal_options.motor": [used[1]]}
    if pins:
        return {"hal_options.output": "gpio"} | found
    ((bus, address),) = boards
    return {"hal_options.output": "pca9685", "hal_options.bus": bus, "hal_options.address": address} | found


def _read(file: Path, values: dict[str, Any], unread: dict[str, str]) -> None:
    """Add the assignments of a file; those of no plain value go to `unread`, with their text."""
    try:
        text = read_text(file, YAML_MAX)
        tree = ast.parse(text)
    except OSError as error:
        raise ConfigError(f"{file}: cannot read it: {error.strerror}; give donkeycar's myconfig.py") from None
    except UnicodeDecodeError:
        raise ConfigError(f"{file}: not a text file in UTF-8; give donkeycar's myconfig.py") from None
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        line = getattr(error, "lineno", None)
        where = f" in line {line}" if line else ""
        raise ConfigError(
            f"{file}: no Python{where}: {getattr(error, 'msg', error)}; give donkeycar's myconfig.py"
        ) from None
    for node in tree.body:
        if not isinstance(node, ast.Assign):
            continue
        for target in node.targets:
            found = _target(target)
            if found is None:
                continue
            name, key = found
            whole = name if key is None else f"{name}.{key}"
            try:
                value = _plain(node.value, values)
            except (ValueError, RecursionError):
                unread[whole] = (ast.get_source_segment(text, node.value) or "").partition("\n")[0][:60]
                continue
            unread.pop(whole, None)
            if key is None:
                values[name] = value
            elif isinstance(table := values.get(name), dict):
                values[name] = table | {key: value}


def _target(node: ast.expr) -> tuple[str, str | None] | None:
    """Return the name that is assigned to, and its key for NAME["KEY"]; None for anything else."""
    if isinstance(node, ast.Name):
        return node.id, None
    if isinstance(node, ast.Subscript) and isinstance(node.value, ast.Name) and isinstance(node.slice, ast.Constant):
        return node.value.id, str(node.slice.value)
    return None


def _plain(node: ast.expr, values: Mapping[str, Any]) -> Any:
    """Return a literal, or the value of a name that was assigned before; raises ValueError for anything else."""
    if isinstance(node, ast.Name) and node.id in values:
        return values[node.id]
    if isinstance(node, ast.Dict) and None not in node.keys:
        keys = [ast.literal_eval(key) for key in node.keys if key is not None]
        return dict(zip(map(str, keys), (_plain(each, values) for each in node.values), strict=True))
    try:
        return ast.literal_eval(node)
    except (TypeError, SyntaxError, MemoryError) as error:
        raise ValueError(str(error)) from None

"""Learns the sensors' mounts, clocks and scales from a drive: a recording is run again with a filter that learns them.

`txt1.estimation.calibration` has the filter.
"""

from collections.abc import Iterator
from math import hypot, pi
from pathlib import Path
from typing import Any, Final, NamedTuple

from txt1.errors import ConfigError
from txt1.estimation.calibration import START, Calibration
from txt1.estimation.task import Estimator
from txt1.record.reader import robot_in
from txt1.record.verification import verify
from txt1.runtime import Runtime
from txt1.sensors.readings import ImuReading

QUANTITIES: Final = {
    "x": ("further ahead than stated", "m", 1.0),
    "y": ("further to the left than stated", "m", 1.0),
    "delay": ("older than its readings say", "ms", 1e3),
    "slip": ("of the wheels' way, by slip and radius", "%", 100.0),
    "scale": ("too much, by the gyro", "%", 100.0),
    "bias": ("told by a gyro that stands", "rad/s", 1.0),
    "sideways": ("outwards in curves, for each m/s^2", "deg", 180.0 / pi),
}
"""The learned quantities: in words, the unit, and the number of units in an SI unit."""
# share of its sigma before the drive below which the drive has shown a quantity; chosen
SHOWN: Final = 0.7


class SensorFindings(NamedTuple):
    """The findings of a drive about the sensors."""

    lines: list[str]
    """Each quantity with its standard deviation, in words."""
    settings: dict[str, dict[str, Any]]
    """Settings that differ from the recording's, as `estimation.settings`."""


def learned(recording: Path, robot: str | None) -> SensorFindings:
    """Return the findings of a recorded drive about the sensors of a robot; None: the first robot.

    Raises RecordingError: it cannot be run again. Raises ConfigError: it has no sensor of positions.
    """
    runtimes: list[Runtime] = []
    verify(recording, robot_in(recording, robot), runtimes.append)
    runtime = runtimes[0]
    estimator = runtime.part(Estimator)
    if estimator is None or not estimator.calibrations:
        raise ConfigError(
            f"{recording}: nothing to calibrate: drive with a filter that has a sensor of positions, such as "
            "--set estimation.preset=vicon, and with encoders"
        )
    gyros = [name for name, each in runtime.sensors.items() if each.sensor.topic.type is ImuReading]
    lines, settings = [], {}
    for name, calibration in estimator.calibrations.items():
        lines += [f"{name}: {line}" for line in _told(calibration)]
        settings.update(_settings(estimator, name, calibration, [each for each in gyros if each in estimator.settings]))
    return SensorFindings(lines, settings)


def _told(calibration: Calibration) -> Iterator[str]:
    if not calibration.segments:
        yield "the drive shows nothing: it has no motion between positions"
        return
    for (name, (words, unit, factor)), before in zip(QUANTITIES.items(), START, strict=True):
        value, sigma = calibration.learned(name)
        shown = "" if sigma < SHOWN * float(before) ** 0.5 else "; this drive does not show it"
        yield f"{factor * value:.4g} {unit} {words} (sigma {factor * sigma:.2g}{shown})"


def _settings(estimator: Estimator, name: str, calibration: Calibration, gyros: list[str]) -> dict[str, dict[str, Any]]:
    """Return corrected values for the settings that a drive refutes."""
    right, given = calibration.corrections, estimator.settings
    found: dict[str, dict[str, Any]] = {}
    if hypot(right.x, right.y):
        x, y = given[name].lever
        found[name] = {"lever": [round(x + right.x, 4), round(y + right.y, 4)]}
    delay = given[name].delay + right.delay
    if right.delay and delay >= 0.0:
        found.setdefault(name, {})["delay"] = round(delay, 4)
    for gyro in gyros if right.scale else ():
        found[gyro] = {"scale": round((1.0 + given[gyro].scale) * (1.0 + right.scale) - 1.0, 5)}
    return found

"""Learns the sensors' mounts, clocks and scales from a drive: a recording is run again with a filter that learns them.

`txt1.estimation.fusion` has the filter.
"""

from collections.abc import Iterable, Iterator
from functools import partial
from math import hypot, pi
from pathlib import Path
from typing import Any, Final, NamedTuple

from txt1.errors import ConfigError
from txt1.estimation.fusion import Calibrated
from txt1.estimation.sensors import KIND_ENCODERS, Measurement
from txt1.estimation.task import ENCODERS, ESTIMATION_PERIOD, Estimator
from txt1.record.reader import robot_in
from txt1.record.verification import verify
from txt1.runtime import Runtime
from txt1.sensors.readings import ImuReading

QUANTITIES: Final = {
    "x": ("further ahead than stated", "m", 1.0, "curves to both sides"),
    "y": ("further to the left than stated", "m", 1.0, "narrow curves to both sides, each for some seconds"),
    "delay": ("older than its readings say", "ms", 1e3, "hard starts and stops, and curves to both sides"),
    "slip": ("of the wheels' way, by slip and radius", "%", 100.0, "some metres straight on"),
    "scale": ("too much, by the gyro", "%", 100.0, "several full circles to one side"),
    "bias": ("told by a gyro that stands", "rad/s", 1.0, "five seconds at rest"),
    "sideways": ("outwards in curves, for each m/s^2", "deg", 180.0 / pi, "the same curve slowly and fast"),
}
"""The learned quantities: in words, the unit, the number of units in an SI unit, and the manoeuvre that shows it."""
# share of its sigma before the drive below which the drive has shown a quantity; chosen
SHOWN_SHARE: Final = 0.7
# standard deviations beyond which a stated value is wrong: 99.9 %
REFUTED_SIGMAS: Final = 3.3
# m, s and 1, the smallest standard deviations that are written
SIGMA_MIN: Final = 0.001
# rad to each side from which a drive has curves to both, and rad/s, less of which is no curve; chosen
BOTH_SIDES: Final = 0.5
CURVING: Final = 0.1
# standard deviation of slip in curves, which looks like a wider track; chosen
SLIP_SIGMA: Final = 0.02


class SensorFindings(NamedTuple):
    """The findings of a drive about the sensors."""

    lines: list[str]
    """Each quantity with its standard deviation, in words."""
    settings: dict[str, dict[str, Any]]
    """Settings that differ from the recording's, as `estimation.settings`."""
    values: dict[str, float]
    """Others, by their dotted keys."""


def learned(recording: Path, robot: str | None) -> SensorFindings:
    """Return the findings of a recorded drive about the sensors of a robot; None: the first robot.

    Raises RecordingError: it cannot be run again. Raises ConfigError: it has neither a sensor of positions nor a gyro.
    """
    runtimes: list[Runtime] = []
    turned = [0.0, 0.0]

    def attach(runtime: Runtime) -> None:
        runtimes.append(runtime)
        estimator = runtime.part(Estimator)
        if estimator is not None and len(runtimes) == 1:
            estimator.through = partial(_turning, estimator, turned)

    verify(recording, robot_in(recording, robot), attach)
    runtime = runtimes[0]
    estimator = runtime.part(Estimator)
    gyros = [name for name, each in runtime.sensors.items() if each.sensor.topic.type is ImuReading]
    gyros = [each for each in gyros if estimator is not None and each in estimator.settings]
    if estimator is None or not (estimator.fusion.placing or (gyros and ENCODERS in estimator.settings)):
        raise ConfigError(
            f"{recording}: nothing to calibrate: drive with a filter that has a gyro or a sensor of positions, such as "
            "--set estimation.preset=vicon, and with encoders"
        )
    lines, settings = [], {}
    for name in estimator.fusion.placing:
        found = estimator.fusion.parameters(name)
        if min(turned) < BOTH_SIDES:
            # in curves to one side it looks like a frame that is turned, with the mount further to the left
            found["delay"] = found["delay"]._replace(sigma=found["delay"].start)
        lines += [f"{name}: {line}" for line in _told(found)]
        settings.update(_settings(estimator, name, found, gyros))
    track, values = _track(estimator, runtime, gyros)
    return SensorFindings(lines + track, settings, values)


def _turning(estimator: Estimator, turned: list[float], measurement: Measurement) -> Iterable[Measurement]:
    """Add to what the robot has turned to the right and to the left, rad, with each measurement of its wheels."""
    if measurement.kind is KIND_ENCODERS and estimator.estimate is not None:
        omega = estimator.estimate.omega
        turned[omega > 0.0] += ESTIMATION_PERIOD * abs(omega) * (abs(omega) > CURVING)
    return (measurement,)


def _told(found: dict[str, Calibrated]) -> Iterator[str]:
    if not any(map(_shown, found.values())):
        yield "the drive shows nothing: it has no motion between positions"
        return
    for name, (words, unit, factor, manoeuvre) in QUANTITIES.items():
        value, sigma, _ = found[name]
        shown = "" if _shown(found[name]) else f"; this drive does not show it: drive {manoeuvre}"
        yield f"{factor * value:.4g} {unit} {words} (sigma {factor * sigma:.2g}{shown})"


def _shown(one: Calibrated) -> bool:
    return one.sigma < SHOWN_SHARE * one.start


def _refuted(one: Calibrated) -> bool:
    """Whether a stated value is wrong by more than chance: 99.9 %."""
    return _shown(one) and abs(one.value) > REFUTED_SIGMAS * one.sigma


def _track(estimator: Estimator, runtime: Runtime, gyros: list[str]) -> tuple[list[str], dict[str, float]]:
    """Return what the drive shows of the track width in words, and settings for it."""
    if not gyros or ENCODERS not in estimator.settings:
        return ["track: unknown; a gyro and curves to both sides would tell it"], {}
    share, sigma = estimator.fusion.track
    before = estimator.fusion.track_sigma
    if not before:
        return ["track: taken for exact, by estimation.track_sigma"], {}
    line = f"track: {100.0 * share:.3g} % wider than stated, slip in curves included (sigma {100.0 * sigma:.2g}"
    if sigma >= SHOWN_SHARE * before:
        return [f"{line}; this drive does not show it: drive curves to both sides)"], {}
    width = runtime.config.geometry.track_width * (1.0 + share)
    found = {"geometry.track_width": round(width, 4), "estimation.track_sigma": round(hypot(sigma, SLIP_SIGMA), 3)}
    return [f"{line})"], found if abs(share) > 2.0 * hypot(sigma, SLIP_SIGMA) else {}


def _settings(
    estimator: Estimator, name: str, found: dict[str, Calibrated], gyros: list[str]
) -> dict[str, dict[str, Any]]:
    """Return corrected values for the settings that a drive refutes."""
    given, right = estimator.settings, {each: one.value for each, one in found.items() if _refuted(one)}
    settings: dict[str, dict[str, Any]] = {}
    if {"x", "y"} & right.keys():
        x, y = given[name].lever
        settings[name] = {"lever": [round(x + right.get("x", 0.0), 4), round(y + right.get("y", 0.0), 4)]}
        settings[name]["lever_sigma"] = round(max(found["x"].sigma, found["y"].sigma, SIGMA_MIN), 3)
    delay = given[name].delay + right.get("delay", 0.0)
    if "delay" in right and delay >= 0.0:
        settings.setdefault(name, {})["delay"] = round(delay, 4)
        settings[name]["delay_sigma"] = round(max(found["delay"].sigma, SIGMA_MIN), 4)
    for gyro in gyros if "scale" in right else ():
        settings[gyro] = {"scale": round((1.0 + given[gyro].scale) * (1.0 + right["scale"]) - 1.0, 5)}
        settings[gyro]["scale_sigma"] = round(max(found["scale"].sigma, SIGMA_MIN), 4)
    return settings

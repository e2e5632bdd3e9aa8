"""Sensor drivers by name: ours from a table, other packages' through the entry-point group ``txt1.sensors``.

A package announces its driver in its pyproject.toml::

    [project.entry-points."txt1.sensors"]
    thermometer = "mypackage.thermometer:create"

where ``create(setup: txt1.sensors.Setup) -> txt1.sensors.Sensor``; its own settings come in ``setup.options``.
"""

from __future__ import annotations

from typing import Any, Final

from numpy.random import SeedSequence, default_rng

from txt1.config.schema import SensorConfig
from txt1.errors import HalError
from txt1.plugins import Registry
from txt1.sensors.base import Sensor, Setup
from txt1.sensors.impaired import Impaired

DROP_OUTS: Final = 5
"""Marks the random values of a sensor's drop-outs."""

DRIVERS: Final = Registry(
    "sensor driver",
    "txt1.sensors",
    {"sim_light": "txt1.sensors.light:simulated", "phidgets_light": "txt1.sensors.light:phidgets"},
    HalError,
)


def create(given: SensorConfig, setup: Setup) -> Sensor[Any]:
    """A sensor as configured, not opened yet.

    Raises:
        ConfigError: there is no such driver (the message lists those there are), or its settings are wrong.
        HalError: it cannot be imported or made; the cause is chained.

    """
    sensor: Sensor[Any] = DRIVERS.make(f"sensors.{setup.name}.driver", given.driver, setup)
    if given.delay or given.drop_out:
        seed = SeedSequence([setup.config.own_seed, DROP_OUTS, *setup.name.encode()])
        return Impaired(sensor, given.delay, given.drop_out, default_rng(seed))
    return sensor

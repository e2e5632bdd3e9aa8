"""The filter on a robot: its sensors, its topics and its task."""

from functools import partial
from typing import Final

from txt1.config.schema import SensorConfig
from txt1.errors import ConfigError
from txt1.estimation.readings import fusable
from txt1.estimation.settings import EstimationConfig
from txt1.estimation.task import (
    ENCODERS,
    ESTIMATION_PERIOD,
    FILTERED,
    PRIORITY,
    TRUSTS,
    Estimator,
    Wheels,
    estimation,
    missing,
)
from txt1.model.estimate import Estimate
from txt1.protocol.messages import CombinedOdometry
from txt1.runtime import Runtime

TWINS: Final = {"imu": "sim_imu", "gps": "sim_gps", "vicon": "sim_vicon"}
"""Drivers of the sensors that a simulated robot gets by itself when they are to be fused."""


async def prepare(runtime: Runtime, config: EstimationConfig) -> Estimator | None:
    """Start the filter and connect its sensors; return it, or None if no sensor is fused.

    Raises ConfigError: a sensor is missing, or its quantity cannot be fused.
    """
    if not config.names:
        return None
    await _add_twins(runtime, config)
    kinds = {name: runtime.sensors[name].sensor.topic.type for name in config.names if name != ENCODERS}
    for name, kind in kinds.items():
        if not fusable(kind):
            raise ConfigError(f"estimation: '{name}' tells {kind.__name__}, which cannot be fused")
    estimator = Estimator(config, kinds, runtime.config.geometry)
    for name in kinds:
        runtime.sensors[name].listeners.append(partial(estimator.take, name))

    def offer(estimate: Estimate, now: float) -> None:
        x, y, theta, v, omega = estimate[:5]
        runtime.put(CombinedOdometry(x, y, theta, v, omega), now)

    task = partial(
        estimation, estimator=estimator, wheels=partial(wheels, runtime),
        offer=offer if config.loops else None, tell=runtime.state.tell,
    )  # fmt: skip
    runtime.estimate = lambda: estimator.estimate
    runtime.bus.offer(FILTERED, runtime.estimate)
    runtime.bus.offer(TRUSTS, estimator.trusts)
    runtime.on_place.append(estimator.fusion.lifted)
    runtime.add_own_task("estimation", PRIORITY, ESTIMATION_PERIOD, task)
    return estimator


def wheels(runtime: Runtime) -> Wheels:
    """The robot's own part of a cycle of the filter."""
    state = runtime.state
    outputs, v = state.control.outputs, state.control.v
    steering, motor = (float(outputs.rear), float(outputs.motor)) if runtime.hal.capabilities.pwm else (None, None)
    return Wheels(state.odometry, state.odometry_time, steering, v, motor)


async def _add_twins(runtime: Runtime, config: EstimationConfig) -> None:
    """Give a simulated robot the simulated sensors that are to be fused and were not configured."""
    absent = missing(config.names, runtime.sensors)
    for name in absent:
        if not runtime.hal.capabilities.pose or name not in TWINS:
            raise ConfigError(
                f"estimation: there is no sensor '{name}' to be fused; configure sensors.{name}.driver, or choose "
                "others in estimation.sensors"
            )
    for name in absent:
        await runtime.open_sensor(name, SensorConfig(driver=TWINS[name]))

"""Makes measurements for the filter of sensors' readings, by the type of their values."""

from typing import Any, Final

from txt1.config.schema import FusedConfig, Quantity
from txt1.estimation.fusion import Kind, Measurement
from txt1.sensors.base import Reading
from txt1.sensors.readings import FixReading, ImuReading, TrackerReading

QUANTITIES: Final[dict[Kind, tuple[Quantity, ...]]] = {
    Kind.POSE: ("x", "y", "theta"),
    Kind.VELOCITY: ("v", "omega"),
    Kind.GYRO: ("omega",),
}

SIGMAS: Final = {
    ImuReading: {"omega": 0.006},  # rad/s; assumed for a 3DM-GX2
    FixReading: {"x": 1.0, "y": 1.0, "theta": 0.2},  # m, where the receiver tells none; rad
    TrackerReading: {"x": 0.002, "y": 0.002, "theta": 0.003, "v": 0.05, "omega": 0.1},  # m, rad; assumed
}
"""Standard deviations of readings that tell none."""

USUAL: Final = {ImuReading: ("omega",), FixReading: ("x", "y"), TrackerReading: ("x", "y", "theta")}
"""The quantities that are taken where nothing else is configured."""


def fusable(kind: type) -> bool:
    """Whether values of this type can be fused."""
    return kind in USUAL


def measurements(name: str, reading: Reading[Any], settings: FusedConfig) -> list[Measurement]:
    """A sensor's reading as measurements, one for each kind of quantity in it; none of a value of another type."""
    value = reading.value
    kind = type(value)
    wanted = USUAL.get(kind, ()) if settings.fields is None else settings.fields
    time = reading.time - settings.delay
    made = []
    for what in (Kind.GYRO,) if kind is ImuReading else (Kind.POSE, Kind.VELOCITY):
        rows, values, sigmas = [], [], []
        for row, quantity in enumerate(QUANTITIES[what]):
            told = value.rates[2] if what is Kind.GYRO else getattr(value, quantity, None)
            if quantity in wanted and told is not None:
                own = getattr(value, f"sigma_{quantity}", None)
                rows.append(row)
                values.append(told)
                sigmas.append(settings.sigma.get(quantity) or own or SIGMAS[kind].get(quantity, 0.1))
        if rows:
            at = value.mount.x, value.mount.y
            made.append(Measurement(time, name, what, tuple(rows), tuple(values), tuple(sigmas), at))
    return made


def tells_pose(kind: type, settings: FusedConfig) -> bool:
    """Whether a sensor of these values tells where the robot is."""
    wanted = USUAL.get(kind, ()) if settings.fields is None else settings.fields
    return "x" in wanted and "y" in wanted

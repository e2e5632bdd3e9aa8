"""Cars to practise calibration on: simulated unknown cars, each with a simulated operator."""

import asyncio
import csv
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractAsyncContextManager
from math import cos, degrees, dist, hypot, inf, pi, radians, sin
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from txt1.config import Config
from txt1.config.sources import with_values
from txt1.errors import ConfigError
from txt1.hal.sim import SimHal
from txt1.model.channels import NEUTRAL_MAX
from txt1.model.kinematics import wrap_angle
from txt1.model.vehicle import STEERING_LIMIT
from txt1.robot import Robot
from txt1.sim.vehicle import Vehicle

# s between two looks of an operator at the car
OPERATOR_LOOK_PERIOD: Final = 0.05
# standard deviation of a measurement with a tape, m
TAPE_SIGMA: Final = 0.005
# standard deviation of the heading with which the car is placed on the line, rad
ALIGNED: Final = radians(0.2)
# reaction time of an operator, s: at least, at most
REACTION: Final = (0.15, 0.35)
# m that a tyre has to turn before an operator sees it
STIRS: Final = 0.004
# rad that wheels have to steer before an operator sees it
TURNS: Final = radians(0.2)
# s after which wheels that steer less seem to stand
SEEMS_STOPPED: Final = 0.5
# rad of turn at which an operator ends a drive that should be straight
ASKEW: Final = 1.2
# m that it should go
GONE: Final = 3.0
# standard deviation of a measured turn in place, degrees
COUNTED: Final = 3.0

# s of driving before a car is judged
UP_TO_SPEED: Final = 3.0
# s for which it is judged, at least; a turn in place stays below half a turn
JUDGED: Final = 2.0

# m/s, free speed at which the smallest circle is driven
SLOWLY: Final = 0.5
# s, of that
STEP: Final = 0.02

STEERING: Final = ("front", "rear")
# wheelbases in R_min of a car that steers both axles: 0.4 to 1.5 m for a TXT-1
BOTH_AXLES: Final = (1.18, 4.41)


def unknown_car(config: Config, seed: int) -> Config:
    """Return a car of the configured kind as an unknown builder may have made it: random wiring, trims and
    dimensions.
    """
    rng = np.random.default_rng(seed)

    def times(low: float, high: float, value: float) -> float:
        return float(value * rng.uniform(low, high))

    def way() -> int:
        return int(rng.choice((1, -1)))

    body, car = config.geometry, config.sim.vehicle
    band = times(0.7, 1.5, car.dead_band)
    # otherwise it would drive off in neutral
    values: dict[str, Any] = {
        "sim.vehicle.dead_band": band,
        # other physics are valid up to a speed a little above the usual
        "sim.vehicle.speed_gain": times(0.6, 1.6 if config.sim.physics == "plain" else 1.5, car.speed_gain),
        "sim.vehicle.speed_time_constant": times(0.7, 1.3, car.speed_time_constant),
        "sim.vehicle.coast_friction": times(0.7, 1.5, car.coast_friction),
        "geometry.circumference": times(0.85, 1.15, body.circumference),
        "geometry.track_width": times(0.9, 1.1, body.track_width),
        "sim.channels.motor.direction": way(),
        "sim.channels.motor.trim": float(rng.uniform(-0.7, 0.7) * min(band, NEUTRAL_MAX)),
        "sim.channels.right_encoder": way(),
        "sim.channels.left_encoder": way(),
        "sim.channels.encoders_swapped": bool(rng.choice((True, False))),
    }
    if body.steering == "both":
        values["geometry.radius_min"] = times(*BOTH_AXLES, body.wheelbase)
    elif body.steering == "front":
        values["geometry.radius_min"] = times(0.8, 1.25, body.radius_min)
    for axle in STEERING:
        values[f"sim.channels.{axle}.direction"] = way()
        values[f"sim.channels.{axle}.trim"] = float(rng.uniform(-2500.0, 2500.0))
        values[f"sim.channels.{axle}.scale"] = float(rng.uniform(0.7, 1.15))
    for side in ("right", "left"):
        values[f"sim.channels.{side}.direction"] = way()
        values[f"sim.channels.{side}.trim"] = float(rng.uniform(-0.5, 0.5) * min(band, NEUTRAL_MAX))
        values[f"sim.channels.{side}.scale"] = float(rng.uniform(0.9, 1.1))
    return with_values(config, values)


class SimulatedOperator:
    """An operator for a simulated car, who sees its true motion, with the errors of a tape and a person's
    reaction time.

    Args:
        hal: the car's hardware layer.
        seed: repeats the errors.
        tell: called with each text for the operator.

    """

    def __init__(self, hal: SimHal, seed: int, tell: Callable[[str], None] = lambda text: None) -> None:
        self._vehicle = hal.vehicle
        self._rng = np.random.default_rng(seed)
        self.tell = tell
        # distances rolled by the right and left wheels at the last request to watch, m
        self._rolled = (0.0, 0.0)
        # farthest places from its mark in a circle: pose, middle of front and rear axle, m
        self._widest: tuple[float, ...] = (
            0.0,
            0.0,
            0.0,
        )
        # angle of the wheels when the operator last reported that they turn no further, rad
        self._seen = 0.0
        # rad turned since it was put down
        self._turned = 0.0

    async def ready(self, key: str, text: str) -> None:
        """Do it at once."""
        self._rolled = self._vehicle.motion[6:8]
        # the simulated car steers and drives on the floor as on blocks; a real car's tyres carry weight
        if key != "watch" and (lift := getattr(self._vehicle.physics, "lift", None)) is not None:
            lift(key == "blocks")
        if key in ("line", "line_end", "circle"):
            self._vehicle.place(0.0, 0.0, self._rng.normal(0.0, ALIGNED))

    async def seen(self, key: str, text: str) -> None:
        """Look until the event is visible, and report it a little late."""
        angle, still, turned, heading = self._steered(key), 0.0, 0.0, self._vehicle.pose[2]
        marks = self._points()
        self._widest = (0.0, 0.0, 0.0)
        while True:
            await asyncio.sleep(OPERATOR_LOOK_PERIOD)
            x, y, theta = self._vehicle.pose
            gone = (dist(point, mark) for point, mark in zip(self._points(), marks, strict=True))
            self._widest = tuple(map(max, self._widest, gone))
            turned, heading = turned + wrap_angle(theta - heading), theta
            # slow motion becomes visible when it has added up
            still += OPERATOR_LOOK_PERIOD
            if abs(self._steered(key) - angle) > TURNS:
                angle, still = self._steered(key), 0.0
            self._seen = self._steered(key)
            if {
                "turning": max(map(abs, self._since())) > STIRS,
                "gone": hypot(x, y) >= GONE or abs(turned) >= ASKEW,
                "round": abs(turned) >= 2.0 * pi,
            }.get(key, still > SEEMS_STOPPED):
                return await asyncio.sleep(self._rng.uniform(*REACTION))

    async def choose(self, key: str, text: str, options: Sequence[str]) -> str:
        """Return how wheels turned or point, or whether they have turned further."""
        if key.endswith("_further"):
            return options[0 if abs(self._steered(key) - self._seen) > TURNS else 1]
        if key == "turned":
            way = max(self._since(), key=abs)
            self._rolled = self._vehicle.motion[6:8]
            return options[0 if way > 0.0 else 1]
        return options[0 if self._steered(key) > 0.0 else 1]

    async def number(self, key: str, text: str, unit: str) -> float:
        """Return the measurement."""
        x, y, theta = self._vehicle.pose
        half = 0.5 * self._vehicle.body.wheelbase
        if key == "turned":
            right, left = self._since()
            apart = self._vehicle.body.track_width * self._vehicle.parameters.skid
            return degrees((right - left) / apart) + self._rng.normal(0.0, COUNTED)
        truth = {
            "ahead": abs(x),
            "gone": hypot(x, y),
            "off": y,
            "front_off": y + half * sin(theta),
            "rear_off": y - half * sin(theta),
            "diameter": self._widest[0],
            "front_diameter": self._widest[1],
            "rear_diameter": self._widest[2],
        }[key]
        return float(truth + self._rng.normal(0.0, TAPE_SIGMA))

    def _points(self) -> tuple[tuple[float, float], ...]:
        """Return the pose, and the middles of the front and rear axle of a car that steers both, m."""
        x, y, theta = self._vehicle.pose
        half = 0.5 * self._vehicle.body.wheelbase
        return tuple((x + ahead * cos(theta), y + ahead * sin(theta)) for ahead in (0.0, half, -half))

    def _since(self) -> tuple[float, float]:
        right, left = self._vehicle.motion[6:8]
        return right - self._rolled[0], left - self._rolled[1]

    def _steered(self, key: str) -> float:
        front, rear = self._vehicle.motion[4:6]
        return rear if key.startswith("rear") else front


class DrivingVerdict(NamedTuple):
    """The driving of a calibrated car, by its true motion; None for figures that its kind does not have."""

    # largest relative error of the speed at the tested set-points
    speed: float
    # largest heading lost in a metre of driving straight, degrees
    drift: float
    # relative error of R_min
    radius: float | None
    # relative error of the yaw rate of a turn in place
    turn: float | None


def passes(verdict: DrivingVerdict, driving: float) -> bool:
    """Return whether a car drives well enough, given the seconds of driving that its calibration took."""
    shares = verdict.speed, verdict.radius or 0.0, verdict.turn or 0.0
    return max(shares) <= 0.05 and verdict.drift <= 1.0 and driving <= 600.0


class Practised(NamedTuple):
    """A car that was calibrated for practice."""

    seed: int
    verdict: DrivingVerdict
    # s of driving that the calibration took
    driving: float

    @property
    def passes(self) -> bool:
        """Return whether it drives as a calibrated car should."""
        return passes(self.verdict, self.driving)


def worst(cars: Sequence[Practised]) -> Iterator[str]:
    """Yield a line for the largest of each error, and for the longest time of driving."""
    yield f"speed {100.0 * max(car.verdict.speed for car in cars):.1f} %"
    yield f"straight {max(car.verdict.drift for car in cars):.2f} degrees per metre"
    for name, errors in (
        ("R_min", [car.verdict.radius for car in cars]),
        ("turn in place", [car.verdict.turn for car in cars]),
    ):
        known = [error for error in errors if error is not None]
        if known:
            yield f"{name} {100.0 * max(known):.1f} %"
    yield f"{max(car.driving for car in cars) / 60.0:.1f} minutes of driving"


COLUMNS: Final = ("vehicle", "seed", *DrivingVerdict._fields, "driving")


def read_practised(file: Path, vehicle: str) -> list[Practised]:
    """Return the cars of this kind in a table from `write_practised`; none if there is no such file.

    Raises ConfigError: it is another table, or has another kind of car.
    """
    if not file.exists():
        return []
    with file.open(encoding="utf-8", newline="") as lines:
        head, *rows = list(csv.reader(lines)) or [[]]
    if tuple(head) != COLUMNS or any(row[0] != vehicle for row in rows):
        raise ConfigError(f"{file} is no table of cars of the kind '{vehicle}': choose another file")
    return [
        Practised(int(row[1]), DrivingVerdict(*(float(cell) if cell else None for cell in row[2:-1])), float(row[-1]))  # type: ignore[arg-type]
        for row in rows
    ]


def write_practised(file: Path, vehicle: str, car: Practised) -> None:
    """Add a car to a table; the table is made if it is missing."""
    new = not file.exists()
    with file.open("a", encoding="utf-8", newline="") as lines:
        table = csv.writer(lines, lineterminator="\n")
        if new:
            table.writerow(COLUMNS)
        table.writerow((vehicle, car.seed, *car.verdict, car.driving))


async def judge(
    hal: SimHal, config: Config, opened: Callable[[Config, bool], AbstractAsyncContextManager[Robot]]
) -> DrivingVerdict:
    """Drive a calibrated car at half and all of its largest speed forward, at a third backward, and turn in place.

    Raises NotArmed: the safety gate has stopped it.
    """
    vehicle, body, speeds, drifts = hal.vehicle, config.geometry, [], []
    for share in (0.5, 1.0, -0.33):
        v = share * min(config.safety.v_max, _reach(hal, config))
        vehicle.place(0.0, 0.0, 0.0)
        async with opened(config, False) as robot:
            driving = asyncio.ensure_future(robot.drive(v, 0.0, UP_TO_SPEED + 2.0 * JUDGED))
            await asyncio.sleep(UP_TO_SPEED)
            (x, y, theta), path = vehicle.pose, 0.0
            first = theta
            for _ in range(round(2.0 * JUDGED / OPERATOR_LOOK_PERIOD)):
                await asyncio.sleep(OPERATOR_LOOK_PERIOD)
                path += hypot(vehicle.pose[0] - x, vehicle.pose[1] - y)
                x, y = vehicle.pose[:2]
            last = vehicle.pose[2]
            speeds.append(abs(path / (2.0 * JUDGED) / abs(v) - 1.0))
            await driving
            drifts.append(abs(degrees(wrap_angle(last - first))) / path if path else inf)
    if body.steering != "skid":
        return DrivingVerdict(max(speeds), max(drifts), abs(body.radius_min / smallest_circle(vehicle) - 1.0), None)
    async with opened(config, False) as robot:
        driving = asyncio.ensure_future(robot.drive(0.0, 1.0, UP_TO_SPEED + JUDGED))
        await asyncio.sleep(UP_TO_SPEED)
        first = vehicle.pose[2]
        await asyncio.sleep(JUDGED)
        turned = wrap_angle(vehicle.pose[2] - first) / JUDGED
        await driving
    return DrivingVerdict(max(speeds), max(drifts), None, abs(turned - 1.0))


def smallest_circle(vehicle: Vehicle) -> float:
    """Return the radius of a simulated car's circles at full lock and 0.5 m/s, m.

    In other physics it differs from the geometry's: tyres scrub, and the steering gives way.
    """
    if vehicle.physics is None:
        return vehicle.body.radius_min
    vehicle.place(0.0, 0.0, 0.0)
    counts, bends = vehicle.parameters.dead_band + SLOWLY / vehicle.parameters.speed_gain, []
    for lock in (STEERING_LIMIT, -STEERING_LIMIT):
        motion, path, turned = vehicle.motion, 0.0, 0.0
        for step in range(round((UP_TO_SPEED + JUDGED) / STEP)):
            x, y, theta = motion[:3]
            motion = vehicle.physics(motion, counts, -lock, lock, STEP, 0.0)
            if step * STEP >= UP_TO_SPEED:
                path += hypot(motion[0] - x, motion[1] - y)
                turned += wrap_angle(motion[2] - theta)
        bends.append(abs(turned) / path)
    return 2.0 / sum(bends)


def _reach(hal: SimHal, config: Config) -> float:
    """Return the speed that the motor's limit surely allows, m/s."""
    car = hal.vehicle.parameters
    return 0.9 * car.speed_gain * (config.safety.motor_max - car.dead_band)

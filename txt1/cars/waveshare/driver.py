"""Waveshare's rover boards as a HAL: JSON lines over UART or USB, with the firmware of their UGV and WAVE ROVER.

A board with encoders closes a speed loop for each side, and reports paths, speeds and its IMU. A board without encoders
takes PWM. A board stops by itself when no set-point has come for the time of its heartbeat, 3 s at power-up. The driver
sets this time when it opens the line, and every second again, as a board that restarts loses it.
"""

import json
from collections.abc import Callable
from dataclasses import dataclass
from math import hypot
from typing import Any, Final, Literal, NamedTuple, get_args

from txt1.config import Config, checked
from txt1.errors import ConfigError
from txt1.hal.base import Capabilities, Inputs, Outputs
from txt1.hal.line import Line
from txt1.hal.plain_hal import PlainHal
from txt1.hal.registry import faults_of, is_simulated, port_of
from txt1.link.base import End, Port
from txt1.model.kinematics import move_along_arc
from txt1.model.odometry import Odometry
from txt1.model.vehicle import PWM_MAX, Geometry, sides
from txt1.units import Positive, PositiveInt

# commands: L and R, m/s
SPEED: Final = 1
# L and R, -255 to 255
PWM: Final = 11
# whether it reports unasked
FEEDBACK: Final = 131
HEARTBEAT: Final = 136  # ms
# ms between two reports
INTERVAL: Final = 142
# whether it echoes commands
ECHO: Final = 143
# its own reports
REPORT: Final = 1001

PWM_FULL: Final = 255
# bytes; a report has about 200
LINE_MAX: Final = 2048
# ms between two reports
REPORT_PERIOD_MS: Final = 20
SETTINGS_EVERY: Final = 1.0  # s
# V: a larger number is in hundredths of a volt; a smaller one than LOW comes of a sensor that is missing
HUNDREDTHS: Final = 60.0
LOW: Final = 5.0
# m by which paths in whole centimetres jump
ROUNDED: Final = 0.011
# m/s at which a side may have rolled on although it reports a stand
UNNOTICED_SPEED: Final = 0.3
# s within which delayed reports may arrive all at once
BURST: Final = 0.1
# s without a report, after which a board that starts at 0 has restarted: reports come every 20 ms
RESTART_GAP: Final = 0.2
# change of a side's speed between reports: m/s, and m/s^2 in addition
KICK: Final = 1.0, 10.0
# change of a yaw rate between reports: rad/s, and rad/s^2 in addition
SWING: Final = 2.0, 100.0
# s for which a yaw rate is valid
YAW_RATE_AGE_MAX: Final = 0.2
# reports at rest after which it is known which axis of the board points up
UPRIGHT: Final = 5
# reports at rest after which the gyroscope's bias is known
CALM: Final = 25
# larger numbers are malformed
LARGEST_NUMBER: Final = 1e9


def line(command: int, **values: float) -> bytes:
    """Return a command as a line for the board."""
    return json.dumps({"T": command} | values, separators=(",", ":")).encode() + b"\n"


class Lines:
    """Finds the objects in a stream of lines, even if lines are torn or run into each other.

    `faults` counts the lines of which a part was discarded.
    """

    def __init__(self) -> None:
        self.faults = 0
        self._rest = b""
        self._decoder = json.JSONDecoder()

    def feed(self, data: bytes) -> list[dict[str, Any]]:
        """Take bytes; return the objects that they complete."""
        *lines, self._rest = (self._rest + data).split(b"\n")
        if len(self._rest) > LINE_MAX:
            self.faults += 1
            self._rest = b""
        return [found for text in lines for found in self._objects(text[-LINE_MAX:])]

    def _objects(self, text: bytes) -> list[dict[str, Any]]:
        words, found, at, clean = text.decode("ascii", "replace").strip(), [], 0, True
        while (start := words.find("{", at)) >= 0:
            clean &= not words[at:start].strip()
            try:
                value, at = self._decoder.raw_decode(words, start)
            except (ValueError, RecursionError):
                # a torn line: another may begin after its brace
                clean, at = False, start + 1
                continue
            if isinstance(value, dict):
                found.append(value)
        self.faults += not (clean and not words[at:].strip())
        return found


def number(value: Any) -> float | None:
    """Return a finite number of the board's; None for anything else."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not -LARGEST_NUMBER < value < LARGEST_NUMBER:
        return None
    return float(value)


Triple = tuple[float, float, float]
Up = Literal["auto", "+x", "-x", "+y", "-y", "+z", "-z"]
Paths = Literal["auto", "m", "cm"]
Model = Literal["ugv-rover", "ugv-beast", "rasp-rover", "ugv01", "wave-rover", "ugv02"]
# of models whose reports have the PWM counts in place of speeds, as their motors have no encoders
BLIND: Final = ("wave-rover", "ugv02")
# largest cosine of the angle between an axis of the board and gravity at which the axis is not vertical: 30 degrees,
# as a rover may stand on a slope
SLOPE: Final = 0.866


def vertical(acceleration: Triple) -> Up | None:
    """Return the axis of the board that points up, from its acceleration at rest; None: none does."""
    length = hypot(*acceleration)
    for name, component in zip("xyz", acceleration, strict=True):
        if length and abs(component) > SLOPE * length:
            # at rest the sensor is accelerated upwards
            return ("+" if component > 0.0 else "-") + name  # type: ignore[return-value]
    return None


class BoardReport(NamedTuple):
    """The board's report; None for values that it lacks."""

    # speed of the side, m/s
    left: float | None
    right: float | None
    # distance rolled by the side, m
    path_left: float | None
    path_right: float | None
    voltage: float | None  # V
    # rate about the vertical axis, in raw counts
    gyro: float | None


def paths_of(found: dict[str, Any]) -> Paths:
    """Return the unit of the paths that the version of this report's firmware has; auto: the report does not tell.

    Waveshare changed both units in one version, from floats in V and m to whole numbers in 0.01 V and cm. No rover has
    a battery of more than HUNDREDTHS or less than LOW.
    """
    voltage = number(found.get("v"))
    if voltage is None or voltage < LOW:
        return "auto"
    return "cm" if voltage > HUNDREDTHS else "m"


def report_of(found: dict[str, Any], paths: Paths = "auto", gyro_of: str = "gz") -> BoardReport | None:
    """Return the report in an object; None if it is another object.

    `paths` is the unit of its paths; auto: unknown, so they are not used. `gyro_of` is the field of the rate about the
    vertical axis.
    """
    if found.get("T") != REPORT:
        return None
    left, right, path_left, path_right, voltage, gyro = (
        number(found.get(name)) for name in ("L", "R", "odl", "odr", "v", gyro_of)
    )
    if voltage is not None and (paths == "cm" or voltage > HUNDREDTHS):
        voltage /= 100.0
    if paths == "cm":
        path_left = None if path_left is None else path_left / 100.0
        path_right = None if path_right is None else path_right / 100.0
    elif paths == "auto":
        path_left = path_right = None
    return BoardReport(left, right, path_left, path_right, voltage, gyro)


def acceleration_of(found: dict[str, Any]) -> Triple | None:
    """Return the acceleration in a report, in raw counts; None if it has none."""
    x, y, z = (number(found.get(name)) for name in ("ax", "ay", "az"))
    return None if x is None or y is None or z is None else (x, y, z)


def rolls_on(before: BoardReport, after: BoardReport, dt: float) -> bool:
    """Return whether the sides' speeds explain their paths in `dt` s."""
    for was, now, u, v in (
        (before.path_left, after.path_left, before.left, after.left),
        (before.path_right, after.path_right, before.right, after.right),
    ):
        fastest = max(abs(u or 0.0), abs(v or 0.0))
        most = ROUNDED + 1.5 * fastest * max(dt, BURST) + UNNOTICED_SPEED * dt
        if was is not None and now is not None and abs(now - was) > most:
            return False
    return True


def began_anew(before: BoardReport, after: BoardReport, dt: float) -> bool:
    """Return whether both paths are newly 0, at rest, after a pause of `dt` s: a board starts like this.

    `rolls_on` is not enough: its tolerance grows with the pause, so after a long pause a restart looks like a drive
    back.
    """
    was, now = (before.path_left, before.path_right), (after.path_left, after.path_right)
    if None in was or None in now or after.left or after.right or dt < RESTART_GAP:
        return False
    return max(map(abs, now)) < ROUNDED <= max(map(abs, was))  # type: ignore[arg-type]


def goes_on(before: BoardReport, after: BoardReport, dt: float, gyro: float) -> bool:
    """Return whether a report may follow another `dt` s later: lines have no checksum, so a digit may be wrong."""
    kicks = [abs((now or 0.0) - (was or 0.0)) for was, now in zip(before[:2], after[:2], strict=True)]
    swing = abs(gyro * ((after.gyro or 0.0) - (before.gyro or 0.0)))
    return max(kicks) <= KICK[0] + KICK[1] * dt and swing <= SWING[0] + SWING[1] * dt and rolls_on(before, after, dt)


@dataclass(frozen=True, slots=True)
class WaveshareOptions:
    """Settings of the HAL, under `hal_options`; the port is `serial.port`."""

    baud: PositiveInt = 115200
    """Bits a second."""
    model: Model | None = None
    """The rover, whose firmware gives reports their meaning; needed on a real port, unless `encoders` is set."""
    encoders: bool | None = None
    """Whether its motors have encoders; null: as the model says. Without them it takes PWM by control.speed_map."""
    paths: Paths = "auto"
    """Unit of the paths that the firmware tells; auto: by the voltage, whose unit changed in the same version."""
    up: Up = "auto"
    """Axis of the board that points up; auto: by gravity, at the first rest."""
    heartbeat: Positive = 0.5
    """Time without a set-point after which the board stops by itself, s."""
    gyro: float = 0.001064
    """Yaw rate for a count of the gyroscope, rad/s: 1 / 16.4 degrees/s; 0: not used."""

    @property
    def closed(self) -> bool:
        """Whether it has encoders, so that its board closes the speed loops."""
        return self.model not in BLIND if self.encoders is None else self.encoders


class WaveshareHal(PlainHal):
    """A rover with such a board."""

    name = "waveshare"

    def __init__(
        self,
        port: Port,
        options: WaveshareOptions,
        geometry: Geometry,
        wrap: Callable[[End], End],
        simulated: bool = False,
    ) -> None:
        closed = options.closed
        self.capabilities = Capabilities(
            odometry=closed, pwm=not closed, battery=True, halt=closed, simulated=simulated
        )
        self.line = Line(port, wrap, "reports of the rover's board", self._greet, self._take, hal=self.name)
        self._options, self._geometry = options, geometry
        self._lines = Lines()
        # faults of earlier streams
        self._skipped = 0
        self._forget()

    def _forget(self) -> None:
        self._odometry: Odometry | None = None
        self._report: BoardReport | None = None
        # a report that does not follow from the last
        self._doubted: BoardReport | None = None
        self._doubts = 0
        # loop time of the last report
        self._taken = 0.0
        self._batteries: tuple[float, float] | None = None
        # loop time of the last voltage
        self._measured = 0.0
        # the unit of its paths, once two reports have told the same; and what the last one told
        self._paths: Paths = self._options.paths
        self._told_paths: Paths = "auto"
        # loop time
        self._set = -SETTINGS_EVERY
        self._bias, self._calm = 0.0, 0
        # the board's axis that points up, once it is known; and the sum of the accelerations at rest
        self._up: Up | None = None if self._options.up == "auto" else self._options.up
        self._felt, self._rested, self._leans = (0.0, 0.0, 0.0), 0, False
        self._gyro_of = "gz" if self._up is None else f"g{self._up[1]}"
        self._halted = False

    async def open(self) -> None:
        """Open the port."""
        self._forget()
        await self.line.open()

    async def close(self) -> None:
        """Stop the rover, and close the port."""
        await self.line.close(self._drive(Outputs()))

    def _greet(self) -> None:
        self._skipped += self._lines.faults
        self._lines = Lines()
        self._report = self._doubted = None
        self._set = self.line.time() - SETTINGS_EVERY
        # ends an unfinished line of an earlier host
        self.line.send(b"\n")

    def read(self, now: float) -> Inputs:
        """Return odometry from the sides' paths and the gyroscope, and the battery's voltage."""
        link = self.line.report(now, {"line_damaged": self._skipped + self._lines.faults, "doubted": self._doubts})
        time = self.line.run_time(self._taken)
        return Inputs(
            odometry=self._odometry if self._options.closed else None,
            odometry_time=time,
            batteries=self._batteries,
            battery_time=self.line.run_time(self._measured),
            link=link,
        )

    def write(self, outputs: Outputs, now: float) -> None:
        """Send the sides' speeds every time, as the heartbeat, and the settings once a second."""
        data = self._drive(outputs if self.line.ready else Outputs())
        time = self.line.time()
        if time >= self._set + SETTINGS_EVERY - 1e-9:
            self._set = time
            heartbeat = round(1000.0 * self._options.heartbeat)
            for command, value in ((ECHO, 0), (FEEDBACK, 1), (INTERVAL, REPORT_PERIOD_MS), (HEARTBEAT, heartbeat)):
                data += line(command, cmd=value)
        self.line.send(data)

    def halt(self, outputs: Outputs, now: float) -> None:
        """Take the motors' PWM away, past the speed loops, until a speed is commanded."""
        self._halted = True
        self.line.send(self._drive(Outputs()))

    def _drive(self, outputs: Outputs) -> bytes:
        if not self._options.closed:
            right, left = (
                round(min(max(counts / PWM_MAX, -1.0), 1.0) * PWM_FULL) for counts in sides(outputs.motor, outputs.rear)
            )
            return line(PWM, L=left, R=right)
        self._halted &= not (outputs.v or outputs.omega)
        if self._halted:
            return line(PWM, L=0, R=0)
        turn = 0.5 * self._geometry.track_width * outputs.omega
        return line(SPEED, L=round(outputs.v - turn, 4), R=round(outputs.v + turn, 4))

    # -- what comes ------------------------------------------------------------------------------------------------

    def _take(self, data: bytes) -> None:
        for found in self._lines.feed(data):
            if self._paths == "auto" and found.get("T") == REPORT:
                told, self._told_paths = self._told_paths, paths_of(found)
                self._paths = told if told == self._told_paths else "auto"
            report = report_of(found, self._paths, self._gyro_of)
            if report is not None:
                self._take_report(self._seen_upright(report, found))

    def _take_report(self, report: BoardReport) -> None:
        time = self.line.time()
        since = time - self._taken
        if self._report is not None and not goes_on(self._report, report, since, self._options.gyro):
            first = self._doubted is None or not goes_on(self._doubted, report, since, self._options.gyro)
            self._doubted = report
            # a lost report does no harm, as paths are totals; a second report that agrees is believed
            if first:
                self._doubts += 1
                return
        self._doubted = None
        before, self._report = self._report, report
        dt, self._taken = min(since, YAW_RATE_AGE_MAX), time
        self.line.heard()
        if before is None:
            dt = 0.0
            self.line.tell(f"the rover's board answers; it stops by itself after {self._options.heartbeat:g} s")
        if report.voltage is not None:
            self._batteries, self._measured = (max(0.0, report.voltage), 0.0), time
        left, right = report.left or 0.0, report.right or 0.0
        paths = left * dt, right * dt
        now = report.path_left, report.path_right
        then = (None, None) if before is None else (before.path_left, before.path_right)
        if None not in now and None not in then:
            paths = now[0] - then[0], now[1] - then[1]  # type: ignore[operator]
            if before is not None and (not rolls_on(before, report, since) or began_anew(before, report, since)):
                paths = 0.0, 0.0
                self.line.down("the rover's board restarted: its paths started again at 0")
        v, omega = 0.5 * (left + right), (right - left) / self._geometry.track_width
        distance, turn = 0.5 * (paths[0] + paths[1]), (paths[1] - paths[0]) / self._geometry.track_width
        rate = self._yaw_rate(report.gyro, still=left == right == 0.0)
        if rate is not None:
            omega, turn = rate, rate * dt
        old = self._odometry or Odometry()
        if distance:
            x, y, theta = move_along_arc(old.x, old.y, old.theta, distance, turn / distance, 0.0)
        else:
            x, y, theta = move_along_arc(old.x, old.y, old.theta + turn, 0.0, 0.0, 0.0)
        self._odometry = Odometry(x, y, theta, v, omega)

    def _seen_upright(self, report: BoardReport, found: dict[str, Any]) -> BoardReport:
        """Return the report with the rate about the axis that points up; without a rate while that is not known."""
        if self._up is None:
            acceleration = acceleration_of(found)
            if acceleration is None:
                # a board that tells no gravity: its z axis is taken for it
                return report
            if not (report.left or report.right):
                self._rest(acceleration)
            return report._replace(gyro=None)
        if self._up[0] == "-" and report.gyro is not None:
            return report._replace(gyro=-report.gyro)
        return report

    def _rest(self, acceleration: Triple) -> None:
        """Look which axis points up, after UPRIGHT reports at rest."""
        self._felt = tuple(map(sum, zip(self._felt, acceleration, strict=True)))  # type: ignore[assignment]
        self._rested += 1
        if self._rested < UPRIGHT:
            return
        self._up = vertical(self._felt)
        self._felt, self._rested = (0.0, 0.0, 0.0), 0
        if self._up is not None:
            self._gyro_of = f"g{self._up[1]}"
        elif not self._leans:
            self._leans = True
            self.line.tell("no axis of the rover's board is vertical: set hal_options.up to use its gyroscope")

    def _yaw_rate(self, gyro: float | None, still: bool) -> float | None:
        """Return the yaw rate from the gyroscope, rad/s; None until its bias is known from reports at rest."""
        if gyro is None or not self._options.gyro:
            return None
        if still:
            self._calm += 1
            self._bias += (gyro - self._bias) / min(self._calm, 4 * CALM)
        if self._calm < CALM:
            return None
        return 0.0 if still else self._options.gyro * (gyro - self._bias)


def create(config: Config) -> WaveshareHal:
    """Make the rover's board behind the configured line."""
    options = checked(WaveshareOptions, config.hal_options, "hal_options")
    # the virtual rover has encoders
    if options.model is None and options.encoders is None and not is_simulated(config):
        raise ConfigError(
            "hal_options.model: which rover is it? No report names it, and without encoders the same fields are PWM "
            f"counts. Choose one of {', '.join(get_args(Model))}"
        )
    if config.geometry.steering != "skid":
        raise ConfigError("geometry.steering: a Waveshare rover has sides that run at two speeds; choose skid")
    port = port_of(config, options.baud, "txt1 device waveshare")
    return WaveshareHal(port, options, config.geometry, faults_of(config), is_simulated(config))

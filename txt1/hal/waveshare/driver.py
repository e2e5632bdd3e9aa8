"""Waveshare's rover boards as a HAL: JSON lines over UART or USB, with the firmware of their UGV and WAVE ROVER.

Boards with encoders close a speed loop for each side, and report paths, speeds and their IMU; those without take PWM.
They stop by themselves when no set-point has come for as long as their heartbeat says, 3 s as they come: it is set when
the line is opened, and again every second, as a board that restarts forgets it.
"""

import json
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

from txt1.config import Config, checked
from txt1.errors import ConfigError
from txt1.hal.base import Capabilities, Inputs, Outputs
from txt1.hal.line import Line
from txt1.hal.plain import PlainHal
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
# whether it reports without being asked
FEEDBACK: Final = 131
HEARTBEAT: Final = 136  # ms
# between two reports, ms
INTERVAL: Final = 142
# whether it sends back what it is sent
ECHO: Final = 143
# what it reports itself
REPORT: Final = 1001

PWM_FULL: Final = 255
# bytes; a report has about 200
LINE_MAX: Final = 2048
# ms between two reports
EVERY: Final = 20
SETTINGS_EVERY: Final = 1.0  # s
# V: more than this is hundredths of one, and paths are in cm
HUNDREDTHS: Final = 60.0
# m by which paths in whole centimetres leap
ROUNDED: Final = 0.011
# m/s with which a side may have rolled on although it says that it stands
SLOW: Final = 0.3
# s in whose course reports that were held back may come at once
BURST: Final = 0.1
# s without a report, after which a board that begins at 0 has restarted: reports come every 20 ms
RESTART: Final = 0.2
# by which a side's speed changes from report to report: m/s, and m/s^2 besides
KICK: Final = 1.0, 10.0
# likewise a yaw rate: rad/s, and rad/s^2
SWING: Final = 2.0, 100.0
# s: a yaw rate holds no longer
GAP: Final = 0.2
# reports at rest that make the gyroscope's bias known
CALM: Final = 25
# numbers beyond this are none
LARGEST_NUMBER: Final = 1e9


def line(command: int, **values: float) -> bytes:
    """A command as the board reads it."""
    return json.dumps({"T": command} | values, separators=(",", ":")).encode() + b"\n"


class Lines:
    """Finds the objects in a stream of lines, also in lines that are torn or run into each other.

    `faults` counts the lines of which something was thrown away.
    """

    def __init__(self) -> None:
        self.faults = 0
        self._rest = b""
        self._decoder = json.JSONDecoder()

    def feed(self, data: bytes) -> list[dict[str, Any]]:
        """The objects that these bytes complete."""
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
                # torn: another may begin behind its brace
                clean, at = False, start + 1
                continue
            if isinstance(value, dict):
                found.append(value)
        self.faults += not (clean and not words[at:].strip())
        return found


def number(value: Any) -> float | None:
    """A finite number of the board's; None for anything else."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not -LARGEST_NUMBER < value < LARGEST_NUMBER:
        return None
    return float(value)


class BoardReport(NamedTuple):
    """The board's report; None where it has no such value."""

    # speed of that side, m/s
    left: float | None
    right: float | None
    # rolled by that side, m
    path_left: float | None
    path_right: float | None
    voltage: float | None  # V
    # about the vertical axis, as it comes
    gyro: float | None


def report_of(found: dict[str, Any]) -> BoardReport | None:
    """The report in an object; None where it is another one."""
    if found.get("T") != REPORT:
        return None
    left, right, path_left, path_right, voltage, gyro = (
        number(found.get(name)) for name in ("L", "R", "odl", "odr", "v", "gz")
    )
    if voltage is not None and voltage > HUNDREDTHS:
        voltage /= 100.0
        path_left = None if path_left is None else path_left / 100.0
        path_right = None if path_right is None else path_right / 100.0
    return BoardReport(left, right, path_left, path_right, voltage, gyro)


def rolls_on(before: BoardReport, after: BoardReport, dt: float) -> bool:
    """Whether the sides' paths, `dt` s later, are as far as their speeds can have brought them."""
    for was, now, u, v in (
        (before.path_left, after.path_left, before.left, after.left),
        (before.path_right, after.path_right, before.right, after.right),
    ):
        fastest = max(abs(u or 0.0), abs(v or 0.0))
        most = ROUNDED + 1.5 * fastest * max(dt, BURST) + SLOW * dt
        if was is not None and now is not None and abs(now - was) > most:
            return False
    return True


def began_anew(before: BoardReport, after: BoardReport, dt: float) -> bool:
    """Whether both paths are 0, at rest, behind a pause of `dt` s, and were not before: so a board begins.

    The tolerance of `rolls_on` grows with the pause, so it takes a restart behind a long one for a drive back.
    """
    was, now = (before.path_left, before.path_right), (after.path_left, after.path_right)
    if None in was or None in now or after.left or after.right or dt < RESTART:
        return False
    return max(map(abs, now)) < ROUNDED <= max(map(abs, was))  # type: ignore[arg-type]


def goes_on(before: BoardReport, after: BoardReport, dt: float, gyro: float) -> bool:
    """Whether a report may follow another `dt` s later: lines have no check sum, and a wrong digit is one as well."""
    kicks = [abs((now or 0.0) - (was or 0.0)) for was, now in zip(before[:2], after[:2], strict=True)]
    swing = abs(gyro * ((after.gyro or 0.0) - (before.gyro or 0.0)))
    return max(kicks) <= KICK[0] + KICK[1] * dt and swing <= SWING[0] + SWING[1] * dt and rolls_on(before, after, dt)


@dataclass(frozen=True, slots=True)
class WaveshareOptions:
    """Settings of the HAL, under `hal_options`; the port is `serial.port`."""

    baud: PositiveInt = 115200
    """Bits a second."""
    encoders: bool = True
    """Whether its motors have them; without, as on the WAVE ROVER, it takes PWM and is driven by control.speed_map."""
    heartbeat: Positive = 0.5
    """Time without a set-point after which the board stops by itself, s."""
    gyro: float = 0.001064
    """Yaw rate for a count of gz, rad/s: 1 / 16.4 degrees/s; negative where the board lies upside down; 0: not used."""


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
        closed = options.encoders
        self.capabilities = Capabilities(
            odometry=closed, pwm=not closed, battery=True, halt=closed, simulated=simulated
        )
        self._line = Line(port, wrap, "reports of the rover's board", self._greet, self._take, hal=self.name)
        self._options, self._geometry = options, geometry
        self._lines = Lines()
        # faults of streams that are gone
        self._skipped = 0
        self._forget()

    def _forget(self) -> None:
        self._odometry: Odometry | None = None
        self._report: BoardReport | None = None
        # one that does not follow from it
        self._doubted: BoardReport | None = None
        self._doubts = 0
        # loop time of the report
        self._taken = 0.0
        self._batteries: tuple[float, float] | None = None
        # loop time
        self._set = -SETTINGS_EVERY
        self._bias, self._calm = 0.0, 0
        self._halted = False

    async def open(self) -> None:
        """Open the port."""
        self._forget()
        await self._line.open()

    async def close(self) -> None:
        """Have it stand, and close the port."""
        await self._line.close(self._drive(Outputs()))

    def _greet(self) -> None:
        self._skipped += self._lines.faults
        self._lines = Lines()
        self._report = self._doubted = None
        self._set = self._line.time() - SETTINGS_EVERY
        # ends what an earlier host has left half said
        self._line.send(b"\n")

    def read(self, now: float) -> Inputs:
        """Odometry by the sides' paths and the gyroscope, and the battery's voltage."""
        link = self._line.report(now, {"line_damaged": self._skipped + self._lines.faults, "doubted": self._doubts})
        time = self._line.run_time(self._taken)
        return Inputs(
            odometry=self._odometry if self._options.encoders else None,
            odometry_time=time,
            batteries=self._batteries,
            battery_time=time,
            link=link,
        )

    def write(self, outputs: Outputs, now: float) -> None:
        """Send the sides' speeds every time, which is the heartbeat, and the settings once a second."""
        data = self._drive(outputs if self._line.ready else Outputs())
        time = self._line.time()
        if time >= self._set + SETTINGS_EVERY - 1e-9:
            self._set = time
            heartbeat = round(1000.0 * self._options.heartbeat)
            for command, value in ((ECHO, 0), (FEEDBACK, 1), (INTERVAL, EVERY), (HEARTBEAT, heartbeat)):
                data += line(command, cmd=value)
        self._line.send(data)

    def halt(self, outputs: Outputs, now: float) -> None:
        """Take the motors' PWM away, past the speed loops, until a speed is asked for."""
        self._halted = True
        self._line.send(self._drive(Outputs()))

    def _drive(self, outputs: Outputs) -> bytes:
        if not self._options.encoders:
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
            report = report_of(found)
            if report is not None:
                self._take_report(report)

    def _take_report(self, report: BoardReport) -> None:
        time = self._line.time()
        since = time - self._taken
        if self._report is not None and not goes_on(self._report, report, since, self._options.gyro):
            first = self._doubted is None or not goes_on(self._doubted, report, since, self._options.gyro)
            self._doubted = report
            # nothing is lost: paths count on, and a second one that says the same is believed
            if first:
                self._doubts += 1
                return
        self._doubted = None
        before, self._report = self._report, report
        dt, self._taken = min(since, GAP), time
        self._line.heard()
        if before is None:
            dt = 0.0
            self._line.tell(f"the rover's board answers; it stops by itself after {self._options.heartbeat:g} s")
        if report.voltage is not None:
            self._batteries = max(0.0, report.voltage), 0.0
        left, right = report.left or 0.0, report.right or 0.0
        paths = left * dt, right * dt
        now = report.path_left, report.path_right
        then = (None, None) if before is None else (before.path_left, before.path_right)
        if None not in now and None not in then:
            paths = now[0] - then[0], now[1] - then[1]  # type: ignore[operator]
            if before is not None and (not rolls_on(before, report, since) or began_anew(before, report, since)):
                paths = 0.0, 0.0
                self._line.down("the rover's board restarted: its paths began anew")
        elif None not in now:
            paths = 0.0, 0.0
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

    def _yaw_rate(self, gyro: float | None, still: bool) -> float | None:
        """The yaw rate by the gyroscope, rad/s; None until its bias is known, which it shows while the wheels stand."""
        if gyro is None or not self._options.gyro:
            return None
        if still:
            self._calm += 1
            self._bias += (gyro - self._bias) / min(self._calm, 4 * CALM)
        if self._calm < CALM:
            return None
        return 0.0 if still else self._options.gyro * (gyro - self._bias)


def create(config: Config) -> WaveshareHal:
    """The rover's board behind the configured line."""
    options = checked(WaveshareOptions, config.hal_options, "hal_options")
    if config.geometry.steering != "skid":
        raise ConfigError("geometry.steering: a Waveshare rover has sides that run at two speeds; choose skid")
    port = port_of(config, options.baud, "txt1 device waveshare")
    return WaveshareHal(port, options, config.geometry, faults_of(config), is_simulated(config))

"""GPS through gpsd: decodes its JSON lines from TCP into fixes, in metres on the UTM grid."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from math import isfinite, radians
from typing import Annotated, Any, Final

from annotated_types import MinLen

from txt1.config.sources import checked
from txt1.model.kinematics import wrap_angle
from txt1.sensors.base import Setup
from txt1.sensors.geodesy import UtmGrid
from txt1.sensors.readings import GPS_MOUNT, FixReading, Mount, fix_topic
from txt1.sensors.stream import Codec, Measured, Streamed, Unwrapped
from txt1.units import NotNegative

WATCH: Final = b'?WATCH={"enable":true,"json":true%s};\n'
UNWATCH: Final = b'?WATCH={"enable":false};\n'
# standard deviations in gpsd's errors, which are for 95 %
CONFIDENCE: Final = 1.96
# bytes; gpsd's longest lines, with all satellites, have about 10 000
LINE_MAX: Final = 65536
DAY: Final = 86400.0  # s
# s between a fix and the latest errors that belong to it
ERRORS_AGE_MAX: Final = 2.0
# m/s: below this speed a track has no meaning
TRACK_SPEED_MIN: Final = 0.1


def seconds_of_day(stamp: str) -> float | None:
    """Return the seconds since midnight of a time such as 2026-05-04T10:20:30.250Z; None if it is malformed."""
    try:
        hours, minutes, seconds = stamp.partition("T")[2].rstrip("Z").split(":")
        return 3600.0 * int(hours) + 60.0 * int(minutes) + float(seconds)
    except ValueError:
        return None


class GpsdDecoder(Codec[FixReading]):
    """Decodes gpsd's lines into fixes.

    `datum` is latitude and longitude in degrees; None: the first fix. `device` is gpsd's path of the receiver; None: it
    has one only.
    """

    def __init__(
        self, datum: tuple[float, float] | None = None, mount: Mount = GPS_MOUNT, device: str | None = None
    ) -> None:
        asked = b"" if device is None else b',"device":' + json.dumps(device).encode()
        super().__init__(WATCH % asked, UNWATCH)
        self.satellites: int | None = None
        """Number of satellites used for the fix; None until gpsd reports it."""
        self.grid = None if datum is None else UtmGrid(*datum)
        self._mount, self._device = mount, device
        # the receivers that sent fixes
        self._devices: set[str] = set()
        self._day = Unwrapped(DAY)
        self._errors: tuple[float | None, float | None, float | None] = (None, None, None)

    def feed(self, data: bytes) -> list[Measured[FixReading]]:
        """Take bytes; return the fixes that they complete."""
        *lines, self._rest = (self._rest + data).split(b"\n")
        if len(self._rest) > LINE_MAX:
            self._rest = b""
            self.faults += 1
        found = []
        for line in lines:
            if not line.strip():
                continue
            try:
                report = json.loads(line)
            except (ValueError, RecursionError):
                self.faults += 1
                continue
            if isinstance(report, dict) and (fix := self._take(report)) is not None:
                found.append(fix)
        return found

    def _take(self, report: Mapping[str, Any]) -> Measured[FixReading] | None:
        """Return the fix of a report; None if the report has none."""
        if report.get("class") == "ERROR":
            self.faults += 1
            self.trouble = f"gpsd says: {report.get('message')}"
        if not self._is_meant(report):
            return None
        if report.get("class") == "SKY":
            used = report.get("uSat")
            if not isinstance(used, int) and isinstance(report.get("satellites"), list):
                used = sum(1 for each in report["satellites"] if isinstance(each, dict) and each.get("used") is True)
            self.satellites = used if isinstance(used, int) else None
        if report.get("class") == "GST":
            self._errors = _stamp(report), _number(report, "lon"), _number(report, "lat")
        if report.get("class") != "TPV":
            return None
        # without a fix, too: the receiver lives
        self.idle, self.trouble = True, ""
        if report.get("mode") not in (2, 3):
            return None
        latitude, longitude = _number(report, "lat"), _number(report, "lon")
        if latitude is None or longitude is None or not (-80.0 <= latitude <= 84.0 and -180.0 <= longitude <= 180.0):
            return None
        if self.grid is None:
            self.grid = UtmGrid(latitude, longitude)
        try:
            x, y = self.grid.place(latitude, longitude)
        except ValueError:
            # too far from the datum's zone
            self.faults += 1
            return None
        v, track, off = _number(report, "speed"), _number(report, "track"), _number(report, "epd")
        theta = None
        if track is not None and v is not None and v > TRACK_SPEED_MIN:
            theta = wrap_angle(self.grid.direction(track, latitude, longitude))
        height = next((h for key in ("altMSL", "altHAE", "alt") if (h := _number(report, key)) is not None), None)
        seconds = _stamp(report)
        sigma_x, sigma_y = self._estimated(seconds)
        fix = FixReading(
            latitude,
            longitude,
            x,
            y,
            height,
            theta,
            v,
            int(report["mode"]),
            sigma_x if (told := _sigma(report, "epx")) is None else told,
            sigma_y if (told := _sigma(report, "epy")) is None else told,
            None if off is None else radians(off) / CONFIDENCE,
            _sigma(report, "eps"),
            self.satellites,
            self._mount,
        )
        return Measured(fix, None if seconds is None else self._day(seconds))

    def _is_meant(self, report: Mapping[str, Any]) -> bool:
        """Return whether a report is of the receiver that is meant, or of none."""
        device = report.get("device")
        if not isinstance(device, str) or report.get("class") not in ("TPV", "SKY", "GST"):
            return True
        if self._device is not None:
            return device == self._device
        if report.get("class") == "TPV":
            self._devices.add(device)
        if len(self._devices) > 1:
            self.idle = True
            self.trouble = f"gpsd has the receivers {', '.join(sorted(self._devices))}: give options.device one of them"
        return len(self._devices) < 2

    def _estimated(self, seconds: float | None) -> tuple[float | None, float | None]:
        """Return the receiver's own standard deviations east and north, m, from its sentence GST; None: it
        sends none.
        """
        time, *errors = self._errors
        if time is not None and seconds is not None and abs(seconds - time) > ERRORS_AGE_MAX:
            return None, None
        x, y = (error if error is not None and error > 0.0 else None for error in errors)
        return x, y


def _stamp(report: Mapping[str, Any]) -> float | None:
    stamp = report.get("time")
    return seconds_of_day(stamp) if isinstance(stamp, str) else None


def _number(report: Mapping[str, Any], key: str) -> float | None:
    value = report.get(key)
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    return float(value) if abs(value) < 1e12 and isfinite(value) else None


def _sigma(report: Mapping[str, Any], key: str) -> float | None:
    value = _number(report, key)
    return None if value is None else value / CONFIDENCE


@dataclass(frozen=True, slots=True)
class GpsOptions:
    """The address of gpsd, and the origin of the grid."""

    address: Annotated[str, MinLen(1)] = "socket://127.0.0.1:2947"
    """Address of gpsd."""
    device: str | None = None
    """gpsd's path of the receiver, such as /dev/ttyACM0; null: gpsd has one only."""
    datum: tuple[float, float] | None = None
    """Latitude and longitude of the origin, degrees; null: the first fix."""
    latency: NotNegative = 0.0
    """Time from measuring to sending, s: about 0.2 for a receiver at 5 Hz and 4800 baud."""
    mount: Mount = GPS_MOUNT
    """x, y, z (m) and yaw (rad) of the antenna on the vehicle."""


def create(setup: Setup) -> Streamed[FixReading]:
    """Make the driver ``gps_gpsd``; options: those of `GpsOptions`. Raises MissingExtra without the extra gps."""
    given = checked(GpsOptions, setup.options, f"sensors.{setup.name}.options")
    # reports a missing extra or a wrong datum now
    UtmGrid(*(given.datum or (0.0, 0.0)))
    last = GpsdDecoder(given.datum)

    # the datum is kept when the connection is lost
    def codec() -> GpsdDecoder:
        nonlocal last
        grid, last = last.grid, GpsdDecoder(given.datum, given.mount, given.device)
        last.grid = last.grid or grid
        return last

    return Streamed(
        fix_topic(setup.name),
        0.1,
        given.address,
        codec,
        latency=given.latency,
        server="gpsd or `txt1 sensor virtual gps",
    )

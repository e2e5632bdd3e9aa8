"""A virtual GPS: NMEA sentences like a receiver's, and JSON like gpsd's."""

import json
from math import hypot, pi
from typing import Any

from txt1.link.base import Link
from txt1.sensors.base import Reading
from txt1.sensors.geodesy import UtmGrid
from txt1.sensors.gps_gpsd import CONFIDENCE
from txt1.sensors.readings import FixReading
from txt1.sensors.virtual_sensor import Talker, VirtualSensor

KNOT = 1852.0 / 3600.0  # m/s
# date at which every run begins, at midnight
DATE = "2026-05-04"
VERSION = {"class": "VERSION", "release": "3.22", "rev": "3.22", "proto_major": 3, "proto_minor": 14}


def clock(time: float) -> str:
    """Return a time of the run as a time of day, hh:mm:ss.ss."""
    hundredths = round(time * 100.0) % 8_640_000
    minutes, rest = divmod(hundredths, 6000)
    return f"{minutes // 60:02d}:{minutes % 60:02d}:{rest / 100.0:05.2f}"


def sentence(text: str) -> bytes:
    """Return a sentence with its checksum, the exclusive or of its characters."""
    check = 0
    for character in text.encode():
        check ^= character
    return f"${text}*{check:02X}\r\n".encode()


def degrees(value: float, digits: int, letters: str) -> str:
    """Return degrees in NMEA's form: degrees and minutes in one number, and the hemisphere."""
    minutes = round(abs(value) * 60.0, 6)
    whole, rest = divmod(minutes, 60.0)
    return f"{int(whole):0{digits}d}{rest:09.6f},{letters[value < 0.0]}"


def nmea(reading: Reading[FixReading]) -> bytes:
    """Return the sentences GGA, RMC and GST of a fix."""
    fix, time = reading.value, clock(reading.time).replace(":", "")
    place = f"{degrees(fix.latitude, 2, 'NS')},{degrees(fix.longitude, 3, 'EW')}"
    satellites = 8 if fix.satellites is None else fix.satellites
    year, month, day = DATE.split("-")
    speed = "" if fix.v is None else f"{fix.v / KNOT:.4f}"
    track = "" if (value := true_track(fix)) is None else f"{value:.2f}"
    sigma_x, sigma_y = fix.sigma_x or 0.0, fix.sigma_y or 0.0
    height = 0.0 if fix.altitude is None else fix.altitude
    return b"".join(
        map(
            sentence,
            (
                f"GPGGA,{time},{place},1,{satellites:02d},1.0,{height:.1f},M,0.0,M,,",
                f"GPRMC,{time},A,{place},{speed},{track},{day}{month}{year[2:]},,,A",
                f"GPGST,{time},{hypot(sigma_x, sigma_y):.2f},,,,{sigma_y:.2f},{sigma_x:.2f},{2.0 * sigma_x:.2f}",
            ),
        )
    )


def true_track(fix: FixReading) -> float | None:
    """Return the direction of motion, degrees clockwise from true north in [0, 360)."""
    if fix.theta is None:
        return None
    return UtmGrid(fix.latitude, fix.longitude).track(fix.theta, fix.latitude, fix.longitude)


def report(reading: Reading[FixReading]) -> dict[str, Any]:
    """Return gpsd's TPV report of a fix; errors are for 95 %."""
    fix = reading.value
    sigma_theta = None if fix.sigma_theta is None else fix.sigma_theta * 180.0 / pi
    told = {
        "class": "TPV",
        "device": "/dev/ttyS0",
        "mode": fix.mode,
        "time": f"{DATE}T{clock(reading.time)}0Z",
        "lat": fix.latitude,
        "lon": fix.longitude,
        "altMSL": fix.altitude,
        "track": true_track(fix),
        "speed": fix.v,
        "epx": error95(fix.sigma_x),
        "epy": error95(fix.sigma_y),
        "eps": error95(fix.sigma_v),
        "epd": error95(sigma_theta),
    }
    return {key: value for key, value in told.items() if value is not None}


def error95(sigma: float | None) -> float | None:
    """Return gpsd's error (95 %) for a standard deviation."""
    return None if sigma is None else sigma * CONFIDENCE


def receiver() -> Talker:
    """Return a receiver on a serial line, which sends the sentences of each fix; gpsd can read it."""
    return Talker(nmea)


class VirtualGpsd(VirtualSensor):
    """Gpsd's end of a connection. It sends reports to a client that watches."""

    def __init__(self) -> None:
        self._watched = False

    def connected(self, link: Link) -> None:
        """Greet a client."""
        self._watched = False
        super().connected(link)
        self._tell(VERSION)

    def received(self, data: bytes) -> None:
        """Obey ?WATCH; ignore everything else."""
        *commands, self._rest = (self._rest + data)[-4096:].split(b";")
        for command in commands:
            name, _, text = command.strip().partition(b"=")
            if name != b"?WATCH":
                continue
            try:
                wanted = json.loads(text) if text else {}
            except (ValueError, RecursionError):
                self._tell({"class": "ERROR", "message": "unparseable ?WATCH"})
                continue
            self._watched = bool(isinstance(wanted, dict) and wanted.get("enable", True))
            self._tell({"class": "WATCH", "enable": self._watched, "json": self._watched})

    def show(self, reading: Reading[FixReading]) -> None:
        """Report a fix."""
        if self._watched:
            self._tell(report(reading))

    def _tell(self, told: dict[str, Any]) -> None:
        self.send(json.dumps(told).encode() + b"\r\n")

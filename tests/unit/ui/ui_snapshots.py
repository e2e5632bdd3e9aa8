"""A made-up robot: snapshots without any task behind them."""

from __future__ import annotations

from math import cos, pi, sin

from txt1.control.schedule import ANGULAR_GAINS, LINEAR_GAINS, Schedule
from txt1.hal.base import BoardLink, Capabilities, Outputs
from txt1.kernel.statistics import Percentiles
from txt1.model.odometry import Odometry
from txt1.tasks.fields import (
    Battery,
    BatteryState,
    Command,
    Control,
    Encoders,
    Event,
    GainTable,
    LinkState,
    Panel,
    Power,
    Snapshot,
    Source,
    TaskReport,
)

RATES = {
    "controller": (4, 50.0),
    "serial": (4, None),
    "encoder": (3, 50.0),
    "mode": (2, 1.0),
    "display": (2, 10.0),
    "odometry": (2, 20.0),
    "battery": (1, 1.0),
    "button": (1, 10.0),
    "learning": (1, 2.0),
}

SIM = Capabilities(
    ticks=True,
    pwm=True,
    battery=True,
    power=True,
    servos=True,
    buttons=True,
    place=True,
    pose=True,
    simulated=True,
)


def full(time: float = 83.4, screen: int = 0) -> Snapshot:
    """A simulated robot that drives circles and has something to say on every screen."""
    angle = 0.5 * time
    x, y = 1.5 * cos(angle), 1.5 * sin(angle)
    theta = (angle + pi / 2 + pi) % (2 * pi) - pi
    times = Percentiles(12.3e-6, 345.6e-6, 1.234e-3, 34.5e-3)
    return Snapshot(
        time=time,
        hal="sim",
        capabilities=SIM,
        armed=True,
        stopped=False,
        reason="",
        faults={"bad_frames": 3, "stale_commands": 0, "clipped": 12},
        command=Command(0.5, 0.25, time - 0.05),
        gains=GainTable(LINEAR_GAINS, Schedule(ANGULAR_GAINS), True),
        power=Power(True, False),
        servos=(1200, -1200),
        received=int(time * 20),
        transmitted=int(time * 20) + 1,
        encoders=Encoders(31, 29),
        odometry=Odometry(x - 1.5, y, theta, 0.512, 0.25 + 0.1 * sin(time)),
        pose=(x, y, theta),
        board=None,
        odometry_age=0.0,
        link=LinkState(True, False),
        control=Control(
            Outputs(1815, -7351, 7351, 1200, -1200, 0.5, 0.25),
            0.5,
            0.25,
            Source.ENCODER,
            ANGULAR_GAINS[9].gains,
        ),
        battery=Battery(11.84, 0.0, BatteryState.GOOD, 2400.0),
        panel=Panel(screen, 0, False),
        backlight=0.62,
        buzzer=True,
        room=(5.0, 5.0),
        light=(0.0, 0.0),
        tasks=tuple(
            TaskReport(name, priority, rate, 123456, 0 if name != "display" else 2, times, times)
            for name, (priority, rate) in RATES.items()
        ),
        events=tuple(Event(1.5 * i, f"event number {i}: the gains were accepted by the board") for i in range(20)),
    )


def blind(time: float = 83.4, screen: int = 0) -> Snapshot:
    """A robot behind a HAL that knows nothing but odometry."""
    return full(time, screen)._replace(
        hal="serial",
        capabilities=Capabilities(),
        encoders=Encoders(),
        control=Control(v=0.5, omega=0.25),
        battery=Battery(),
        backlight=None,
        pose=None,
        board=BoardLink(
            True, 1, "link lost: no odometry for 0.45 s", "the board answers on /dev/ttyUSB0", {"line_bad_checksum": 3}
        ),
        odometry_age=0.023,
        room=None,
        light=None,
        command=None,
    )

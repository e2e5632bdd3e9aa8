"""A made-up robot: snapshots without any task behind them."""

from __future__ import annotations

from math import cos, pi, sin

from txt1.control.commander import Driver
from txt1.control.schedule import ANGULAR_GAINS, LINEAR_GAINS, Schedule
from txt1.fleet.members import Member
from txt1.hal.base import BoardLink, Capabilities, Outputs
from txt1.kernel.statistics import Percentiles
from txt1.model.odometry import Odometry
from txt1.sensors.base import SENSORS, SensorState
from txt1.tasks.battery import BATTERIES
from txt1.tasks.controller import SETPOINT
from txt1.tasks.diagnostics import FAULTS
from txt1.tasks.encoder import ENCODERS, ODOMETRY, POSE
from txt1.tasks.fields import (
    BACKLIGHT,
    BOARD,
    CAPABILITIES,
    COMMAND,
    DRIVER,
    EVENTS,
    GAIN_TABLE,
    SERVOS,
    SURROUNDINGS,
    TASK_REPORTS,
    TRAFFIC,
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
    Source,
    Surroundings,
    TaskReport,
    Traffic,
)
from txt1.tasks.mode import MODE, Mode
from txt1.telemetry.snapshot import Snapshot

TEAM = (
    Member("txt01", True, pose=(-2.479, 1.136, 0.5), v=0.512, driver="program", battery=12.164),
    Member(
        "txt02",
        False,
        "look what is in its way, arm (m), drive back (s): blocked: a wall",
        (10.25, -3.5, 0.0),
        -0.31,
        battery=9.81,
        age=0.0385,
    ),
    Member("txt03", False, alive=False, pose=(0.75, 0.75, 0.0), battery=12.17, age=12.4, offset=0.00019),
    Member("txt04", True, pose=(0.5, -0.75, 0.0), battery=12.02, age=0.0412, offset=0.0013, silent="txt01"),
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
    outputs = Outputs(1815, -7351, 7351, 1200, -1200, 0.5, 0.25)
    return Snapshot(time, "sim", {}).replaced(
        {
            CAPABILITIES: SIM,
            MODE: Mode(True, False, "", LinkState(True, False), Power(True, False, True), Panel(screen, 0, False)),
            FAULTS: {"bad_frames": 3, "stale_commands": 0, "clipped": 12},
            COMMAND: Command(0.5, 0.25, time - 0.05),
            GAIN_TABLE: GainTable(LINEAR_GAINS, Schedule(ANGULAR_GAINS), True),
            SERVOS: (1200, -1200),
            DRIVER: Driver("keys", 3.0, {"program": 7}),
            TRAFFIC: Traffic(int(time * 20), int(time * 20) + 1),
            ENCODERS: Encoders(31, 29),
            ODOMETRY: Odometry(x - 1.5, y, theta, 0.512, 0.25 + 0.1 * sin(time)),
            POSE: (x, y, theta),
            SETPOINT: Control(outputs, 0.5, 0.25, Source.ENCODER, ANGULAR_GAINS[9].gains),
            BATTERIES[0]: Battery(11.84, 0.0, BatteryState.WARNING, 2400.0),
            BACKLIGHT: 0.62,
            SURROUNDINGS: Surroundings((5.0, 5.0), (0.0, 0.0)),
            TASK_REPORTS: tuple(
                TaskReport(name, priority, rate, 123456, 0 if name != "display" else 2, times, times)
                for name, (priority, rate) in RATES.items()
            ),
            EVENTS: tuple(Event(1.5 * i, f"event number {i}: the gains were accepted by the board") for i in range(20)),
            SENSORS: (
                SensorState("light", "lx", {"front": 812.5, "rear": 20.0}, time - 0.016, True, "", 5000, 0),
                SensorState("thermometer", "°C", {"value": 21.5}, time - 2.0, False, "no reading", 40, 3),
                SensorState("sonar", "m", {}, None, False, "no reading yet", 0, 0),
            ),
        }
    )


def mode(snapshot: Snapshot, **changes: object) -> Snapshot:
    """The snapshot with other fields of its mode."""
    return snapshot.replaced({MODE: snapshot[MODE]._replace(**changes)})


def blind(time: float = 83.4, screen: int = 0) -> Snapshot:
    """A robot behind a HAL that knows nothing but odometry."""
    unknown = (ENCODERS, BATTERIES[0], BACKLIGHT, POSE, SURROUNDINGS, COMMAND)
    board = BoardLink(
        True, 1, "link lost: no odometry for 0.45 s", "the board answers on /dev/ttyUSB0", {"line_bad_checksum": 3}
    )
    return full(time, screen).replaced(
        {
            **dict.fromkeys(unknown),
            CAPABILITIES: Capabilities(),
            SETPOINT: Control(v=0.5, omega=0.25),
            BOARD: board,
            TRAFFIC: Traffic(1668, 1669, 0.023),
        },
        name="serial",
    )

"""Waveshare's rover boards: lines of JSON, however they come, and a rover that is driven by them."""

import asyncio
import json
from collections.abc import Callable, Coroutine
from math import hypot
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from txt1.cars.waveshare import driver as waveshare
from txt1.cars.waveshare.driver import (
    BoardReport,
    Lines,
    Paths,
    WaveshareHal,
    WaveshareOptions,
    began_anew,
    goes_on,
    paths_of,
    report_of,
    rolls_on,
)
from txt1.cars.waveshare.virtual_rover import Waveshare
from txt1.config import Config, checked, load
from txt1.control.limits import Outputs
from txt1.errors import ConfigError
from txt1.hal.base import Inputs
from txt1.hal.registry import create
from txt1.hal.simulated_controller import ControllerPort
from txt1.kernel.loop import run
from txt1.link.base import End, Link, connect
from txt1.model.kinematics import move_along_arc
from txt1.model.odometry import Odometry
from txt1.robot import Robot
from txt1.sim.parameters import LineFaults

# as a UGV rover sends it: whole centimetres, hundredths of a volt
UGV = b'{"T":1001,"L":0.25,"R":-0.5,"ax":309,"gz":-89,"mx":12,"odl":56,"odr":-20,"v":1216}'
# as earlier firmware does: m and V
EARLIER = b'{"T":1001,"L":0.25,"R":-0.5,"r":1.5,"gz":0.3,"odl":0.56,"odr":-0.2,"v":11.0}'


def test_golden_commands() -> None:
    assert waveshare.line(waveshare.SPEED, L=0.5, R=-0.25) == b'{"T":1,"L":0.5,"R":-0.25}\n'
    assert waveshare.line(waveshare.PWM, L=164, R=164) == b'{"T":11,"L":164,"R":164}\n'
    assert waveshare.line(waveshare.HEARTBEAT, cmd=3000) == b'{"T":136,"cmd":3000}\n'
    assert waveshare.line(waveshare.FEEDBACK, cmd=1) == b'{"T":131,"cmd":1}\n'


def test_golden_reports() -> None:
    assert report_of(json.loads(UGV), "cm") == BoardReport(0.25, -0.5, 0.56, -0.2, 12.16, -89.0)
    assert report_of(json.loads(EARLIER), "m") == BoardReport(0.25, -0.5, 0.56, -0.2, 11.0, 0.3)
    assert report_of({"T": 1005, "L": 1}) is None
    assert report_of({"T": 1001, "L": "1", "R": True, "v": float("nan")}) == BoardReport(*[None] * 6)


@pytest.mark.parametrize(
    ("stream", "faults"),
    [
        (UGV + b"\r\n", 0),
        (UGV + UGV + b"\n", 0),  # the line's end was lost
        (UGV[:30] + UGV + b"\n", 1),  # torn, the rest lost
        (b"{" + UGV + b"\n", 1),
        (UGV[30:] + b"\n" + UGV + b"\n", 1),
        (b"\xff\xfe\x00garbage" + UGV + b"\n", 1),
        (b"{" * 3000 + b"\n" + UGV + b"\n", 2),
    ],
)
def test_the_last_whole_object_is_found(stream: bytes, faults: int) -> None:
    lines = Lines()
    found = [each for byte in stream for each in lines.feed(bytes((byte,)))]
    assert found[-1] == json.loads(UGV)
    assert lines.faults == faults


objects = st.dictionaries(
    st.text(max_size=5), st.none() | st.booleans() | st.integers() | st.text(max_size=5), max_size=5
)


@given(st.lists(objects, max_size=4), st.data())
def test_objects_come_out_however_the_stream_is_cut(sent: list[dict[str, Any]], data: st.DataObject) -> None:
    stream, lines, got = b"".join(json.dumps(each).encode() + b"\n" for each in sent), Lines(), []
    while stream:
        size = data.draw(st.integers(1, len(stream)))
        got += lines.feed(stream[:size])
        stream = stream[size:]
    assert (got, lines.faults) == (sent, 0)


@given(st.binary(max_size=3000))
def test_rubbish_costs_no_line_behind_it(rubbish: bytes) -> None:
    lines = Lines()
    for each in lines.feed(rubbish + b"\n"):
        report_of(each)
    assert lines.feed(UGV + b"\n") == [json.loads(UGV)]


@given(
    st.recursive(
        st.none() | st.floats() | st.integers() | st.text(max_size=3), lambda inner: st.lists(inner, max_size=3)
    )
)
def test_no_value_of_a_field_is_taken_for_a_number_that_is_none(value: Any) -> None:
    report = report_of({"T": 1001, "L": value, "v": value})
    assert report is not None
    assert report.left is None or abs(report.left) < 1e9


# -- the rover ---------------------------------------------------------------------------------------------------------


def config(*words: str) -> Config:
    settings = ["vehicle=rover", "serial.port=waveshare", "hal_options.model=ugv-rover"]
    settings += ["sim.room.length=.inf", "sim.room.width=.inf", *words]
    return load(None, settings, {}, {"hal": "waveshare"}).config


def on_the_desk(made: Config) -> tuple[WaveshareHal, ControllerPort[Waveshare]]:
    """The HAL, and the port with a board that it drives."""
    port = ControllerPort("waveshare", lambda: Waveshare(made))
    return WaveshareHal(
        port, checked(WaveshareOptions, made.hal_options, "x"), made.geometry, lambda end: end, True
    ), port


@pytest.mark.parametrize("gyro", ["0.001064", "0"])
def test_it_drives_and_turns_as_asked_and_its_odometry_is_true(gyro: str) -> None:
    made = config(f"hal_options.gyro={gyro}")
    hal, port = on_the_desk(made)

    async def drive() -> None:
        async with Robot.open(hal, config=made) as robot:
            await robot.linked(5.0)
            await asyncio.sleep(1.0)  # in which the gyroscope's bias shows
            robot.arm()
            assert port.device is not None
            await robot.drive(0.5, 0.6, 4.0)
            assert (robot.odometry.v, robot.odometry.omega) == pytest.approx((0.5, 0.6), rel=0.05)
            await robot.drive(0.0, 1.0, 2.0)
            true = port.device.car.vehicle.state
            assert hypot(robot.odometry.x - true.x, robot.odometry.y - true.y) < 0.05
            assert robot.odometry.theta == pytest.approx(true.theta, abs=0.1)

    run(drive(), speed="max")


def test_the_board_is_given_its_heartbeat_and_gets_it_again() -> None:
    made = config("hal_options.heartbeat=0.4")
    hal, port = on_the_desk(made)

    async def look() -> None:
        async with Robot.open(hal, config=made) as robot:
            await robot.linked(5.0)
            assert port.device is not None
            assert port.device.heartbeat == 400.0
            port.device.heartbeat = 3000.0  # it has restarted
            await asyncio.sleep(1.1)
            assert port.device.heartbeat == 400.0

    run(look(), speed="max")


def test_without_encoders_it_is_driven_by_its_speed_map() -> None:
    made = config("hal_options.encoders=false", "control.speed_map=[[1000, 0.11], [4000, 0.59]]")
    hal, port = on_the_desk(made)

    async def drive() -> None:
        async with Robot.open(hal, config=made) as robot:
            robot.arm()
            await robot.drive(0.4, 0.0, 3.0)
            assert port.device is not None
            assert port.device.car.vehicle.state.v == pytest.approx(0.4, rel=0.1)

    run(drive(), speed="max")


class Script:
    """A port with a board behind it that says what it is told to."""

    address = "script"
    hal: WaveshareHal

    async def open(self, end: End) -> Link:
        return connect(end, self)[0]

    async def close(self) -> None:
        pass

    def connected(self, link: Link) -> None:
        self.link = link

    def received(self, data: bytes) -> None:
        pass

    def lost(self, reason: str) -> None:
        pass

    async def say(self, centimetres: int, times: int = 1, speed: float = 0.0, **others: float) -> None:
        """Report a path of both sides, so many times 20 ms apart."""
        told = {"T": 1001, "L": speed, "R": speed, "odl": centimetres, "odr": centimetres, "gz": 0, "v": 1200} | others
        for _ in range(times):
            self.link.write(json.dumps(told).encode() + b"\n")
            await asyncio.sleep(0.02)


def told_by(script: Script, say: Callable[[], Coroutine[Any, Any, None]]) -> Inputs:
    """What the HAL reports when the board has said that."""
    made = config()
    hal = script.hal = WaveshareHal(script, WaveshareOptions(), made.geometry, lambda end: end, True)

    async def look() -> Inputs:
        await hal.open()
        await say()
        inputs = hal.read(1.0)
        await hal.close()
        return inputs

    return run(look(), speed="max")


@pytest.mark.parametrize("wrong", [{"odl": 900}, {"odr": -100}, {"L": 8.0}, {"gz": 9000}, {"odl": 112, "odr": 180}])
def test_a_digit_that_is_wrong_once_is_no_motion(wrong: dict[str, float]) -> None:
    script = Script()

    async def say() -> None:
        await script.say(100, 30)
        await script.say(100, **wrong)
        await script.say(100, 5)

    inputs = told_by(script, say)
    assert inputs.odometry == Odometry()
    assert inputs.link is not None
    assert (inputs.link.losses, inputs.link.faults["doubted"]) == (0, 1)


def test_what_is_said_twice_is_believed_and_a_path_that_begins_anew_is_a_restart() -> None:
    script = Script()

    async def say() -> None:
        await script.say(100, 30)
        await script.say(0, 1)
        await script.say(1, 5, speed=0.3)

    inputs = told_by(script, say)
    assert inputs.link is not None
    assert (inputs.link.losses, inputs.link.reason) == (1, "the rover's board restarted: its paths started again at 0")
    assert inputs.odometry is not None
    assert (inputs.odometry.x, inputs.odometry.v) == (0.0, 0.3)


@pytest.mark.parametrize("pause", [0.2, 0.29, 0.5, 1.0, 2.0, 2.9, 10.0, 60.0])
def test_a_restart_is_noticed_whatever_its_pause_and_the_pose_does_not_leap(pause: float) -> None:
    script = Script()
    seen: list[Inputs] = []

    async def say() -> None:
        for centimetres in range(0, 164, 2):
            await script.say(centimetres, speed=1.0)
        seen.append(script.hal.read(1.0))
        await asyncio.sleep(pause)
        await script.say(0, 5)

    inputs, before = told_by(script, say), seen[0]
    assert before.odometry is not None and inputs.odometry is not None and inputs.link is not None
    assert before.odometry.x == pytest.approx(1.62)
    assert inputs.odometry.x == before.odometry.x
    assert inputs.link.losses == 1 and "restarted" in f"{inputs.link.reason} {inputs.link.text}"


@given(st.floats(-1.5, 1.5), st.floats(-10.0, 10.0), st.floats(0.0, 1.0), st.floats(0.0, 0.5))
def test_no_motion_of_a_rover_is_doubted(v: float, acceleration: float, dt: float, begin: float) -> None:
    dt = round(dt, 2)
    after = min(max(v + acceleration * dt, -1.5), 1.5)
    path = begin + 0.5 * (v + after) * dt
    one, two = (
        BoardReport(u, u, int(100.0 * p) / 100.0, int(100.0 * p) / 100.0, 12.0, 0.0)
        for u, p in ((v, begin), (after, path))
    )
    assert rolls_on(one, two, dt)
    assert goes_on(one, two, dt, 0.001064)


def test_a_cut_line_disarms_and_is_found_again() -> None:
    made = config()
    cut = made.model_copy(update={"serial": made.serial.model_copy(update={"fault": LineFaults(cut=3.0)})})

    async def drive() -> None:
        async with Robot.open(create(cut), config=cut) as robot:
            await robot.linked(5.0)
            robot.arm()
            robot.command(0.3, 0.0)
            await asyncio.sleep(3.0)
            assert not robot.armed
            assert "link lost" in robot.runtime.gate.reason
            await robot.linked(5.0)

    run(drive(), speed="max")


def test_a_car_that_steers_is_refused() -> None:
    with pytest.raises(ConfigError, match="choose skid"):
        create(load(None, ["serial.port=waveshare", "hal_options.model=ugv-rover"], {}, {"hal": "waveshare"}).config)


# -- what goes over the line, and what is made of what comes -----------------------------------------------------------


@pytest.mark.parametrize(
    ("stream", "faults"),
    [
        (b"x" * 2048, 0),
        (b"x" * 2049, 1),
        (b"x" * 4000 + b"y" * 100, 1),
        (b"\n\r\n", 0),
        (b"[1]\n", 1),
        (b'{"T":1} x\n', 1),
        (b'{"T":1}{"T":\n', 1),
        (b'x {"T":1} {"T":1}\n', 1),
    ],
)
def test_each_line_of_which_a_part_is_lost_is_a_fault(stream: bytes, faults: int) -> None:
    lines = Lines()
    lines.feed(stream)
    assert lines.faults == faults
    assert lines.feed(b"\n" + UGV + b"\n")[-1] == json.loads(UGV)


def test_of_a_line_that_is_too_long_only_its_end_is_looked_at() -> None:
    assert Lines().feed(b" " * 3000 + UGV + b"\n") == [json.loads(UGV)]
    assert Lines().feed(UGV + b" " * 2040 + b"\n") == []
    lines = Lines()
    lines.feed(UGV + b" " * 2040)
    assert lines.feed(b"\n") == [], "a line without an end is forgotten"


@pytest.mark.parametrize(
    ("value", "expected"),
    [(1e9, None), (-1e9, None), (999999999, 999999999.0), (-999999999.0, -999999999.0), (False, None), (None, None)],
)
def test_larger_numbers_are_malformed(value: Any, expected: float | None) -> None:
    assert waveshare.number(value) == expected


@pytest.mark.parametrize(
    ("told", "paths", "expected"),
    [
        ({"v": 60.0, "odl": 2.0, "odr": 3.0}, "m", (2.0, 3.0, 60.0)),
        ({"v": 61.0, "odl": 200, "odr": 300}, "cm", (2.0, 3.0, 0.61)),
        ({"odl": 2.0, "odr": 3.0}, "auto", (None, None, None)),
        # the sensor of its voltage is missing
        ({"v": 0, "odl": 200, "odr": 300}, "auto", (None, None, 0.0)),
        ({"v": 1200, "odl": 200}, "cm", (2.0, None, 12.0)),
        ({"v": 1200, "odr": 200}, "cm", (None, 2.0, 12.0)),
    ],
)
def test_voltages_that_no_rover_has_are_hundredths_and_paths_then_centimetres(
    told: dict[str, float], paths: Paths, expected: tuple[float | None, ...]
) -> None:
    assert paths_of(told) == paths
    report = report_of({"T": 1001} | told, paths)
    assert report is not None
    assert (report.path_left, report.path_right, report.voltage) == expected


@pytest.mark.parametrize(("paths", "rolled"), [("auto", 0.5), ("cm", 0.48), ("m", 48.0)])
def test_without_a_voltage_paths_count_only_in_a_unit_that_is_set(paths: Paths, rolled: float) -> None:
    """It rolls on for 50 reports at 0.5 m/s, and tells centimetres."""
    seen: list[Inputs] = []

    async def look(hal: WaveshareHal, script: Kept) -> None:
        hal.read(0.0)
        for k in range(51):
            await script.report(L=0.5, R=0.5, odl=k, odr=k, v=0)
            await asyncio.sleep(0.02)
        seen.append(hal.read(1.0))

    scripted(look, paths=paths)
    (inputs,) = seen
    assert inputs.odometry is not None
    if paths == "m":
        # they fit no speed, so they are not believed
        assert inputs.link is not None and inputs.link.faults["doubted"] > 0
    else:
        assert inputs.odometry.x == pytest.approx(rolled, abs=0.03)


def test_a_wrong_digit_in_a_voltage_does_not_change_the_unit_of_paths() -> None:
    async def look(hal: WaveshareHal, script: Kept) -> None:
        hal.read(0.0)
        await script.report(L=0.5, R=0.5, odl=1.0, odr=1.0, v=1216)
        for k in range(1, 51):
            await asyncio.sleep(0.02)
            await script.report(L=0.5, R=0.5, odl=1.0 + 0.01 * k, odr=1.0 + 0.01 * k, v=12.16)
        told = hal.read(1.0)
        assert told.odometry is not None and told.odometry.x == pytest.approx(0.5, abs=0.03)
        assert told.batteries == (12.16, 0.0)

    scripted(look)


def at(path: float | None = 0.0, v: float | None = 0.0, gyro: float | None = 0.0) -> BoardReport:
    """A report of a rover that goes straight."""
    return BoardReport(v, v, path, path, 12.0, gyro)


@pytest.mark.parametrize(
    ("before", "after", "dt", "explained"),
    [
        (at(1.0), at(1.01), 0.02, True),  # paths in whole centimetres
        (at(1.0), at(0.99), 0.02, True),
        (at(1.0), at(1.03), 0.02, False),
        (at(1.0), at(1.0 + 0.011 + 0.3 * 0.9), 1.0, True),  # it rolled on at first
        (at(1.0), at(1.0 + 0.011 + 0.3 * 1.1), 1.0, False),
        (at(1.0, v=1.0), at(1.0 + 1.5 * 0.1), 0.02, True),  # delayed reports come all at once
        (at(1.0), at(1.0 + 1.5 * 0.1, v=1.0), 0.02, True),
        (at(1.0, v=1.0), at(1.0 + 0.19, v=1.0), 0.02, False),
        (at(1.0, v=-1.0), at(0.86, v=-1.0), 0.02, True),
        (at(1.0, v=1.0), at(1.0 + 1.9, v=1.0), 1.0, False),
        (at(1.0, v=1.0), at(1.0 + 1.7, v=1.0), 1.0, True),
        (at(1.0, v=0.4), at(1.0 + 0.8, v=0.4), 1.0, True),
        (at(1.0, v=None), at(1.03, v=None), 0.02, False),
        (at(1.0, v=None), at(1.05, v=1.0), 0.02, True),
        (at(1.0, v=1.0), at(1.05, v=None), 0.02, True),
        (at(None), at(5.0), 0.02, True),  # without a path there is nothing to explain
        (at(5.0), at(None), 0.02, True),
        (at(None), at(None), 0.02, True),
    ],
)
def test_speeds_explain_paths_within_their_bounds(
    before: BoardReport, after: BoardReport, dt: float, explained: bool
) -> None:
    assert rolls_on(before, after, dt) is explained
    for side in ("path_left", "path_right"):  # the other side stands
        other = before._replace(path_left=after.path_left, path_right=after.path_right)
        assert rolls_on(other._replace(**{side: getattr(before, side)}), after, dt) is explained


@pytest.mark.parametrize(
    ("before", "after", "dt", "follows"),
    [
        (at(v=0.0), at(v=1.19), 0.02, True),
        (at(v=0.0), at(v=-1.19), 0.02, True),
        (at(v=0.0), at(v=1.22), 0.02, False),
        (at(v=0.5), at(v=-0.72), 0.02, False),
        (at(v=1.0), at(v=2.0), 0.02, True),
        (at(v=0.0), at(v=10.9), 1.0, True),
        (at(v=0.0), at(v=11.5), 1.0, False),
        (at(v=None), at(v=1.19), 0.02, True),
        (at(v=None), at(v=1.22), 0.02, False),
        (at(v=1.19), at(v=None), 0.02, True),
        (at(v=1.22), at(v=None), 0.02, False),
        (at(gyro=0.0), at(gyro=3990.0), 0.02, True),  # in thousandths of a radian a second
        (at(gyro=0.0), at(gyro=4010.0), 0.02, False),
        (at(gyro=-3000.0), at(gyro=900.0), 0.02, True),
        (at(gyro=-3000.0), at(gyro=1100.0), 0.02, False),
        (at(gyro=0.0), at(gyro=101900.0), 1.0, True),
        (at(gyro=0.0), at(gyro=102100.0), 1.0, False),
        (at(gyro=None), at(gyro=3999.5), 0.02, True),
        (at(gyro=None), at(gyro=4000.5), 0.02, False),
        (at(gyro=3999.5), at(gyro=None), 0.02, True),
        (at(gyro=4000.5), at(gyro=None), 0.02, False),
        (at(path=1.0), at(path=2.0), 0.02, False),
    ],
)
def test_a_report_follows_another_unless_speed_yaw_rate_or_path_leaps(
    before: BoardReport, after: BoardReport, dt: float, follows: bool
) -> None:
    assert goes_on(before, after, dt, 0.001) is goes_on(before, after, dt, -0.001) is follows
    if before.left != after.left:  # a single side is enough
        assert goes_on(before, after._replace(left=before.left), dt, 0.001) is follows
        assert goes_on(before, after._replace(right=before.right), dt, 0.001) is follows


@pytest.mark.parametrize(
    ("before", "after", "dt", "anew"),
    [
        (at(1.0), at(0.0), 0.2, True),
        (at(1.0), at(0.0), 0.19, False),
        (at(1.0), at(0.01), 9.0, True),
        (at(1.0), at(0.02), 9.0, False),
        (at(0.02), at(0.0), 9.0, True),
        (at(0.01), at(0.0), 9.0, False),  # it has hardly moved
        (at(1.0), at(0.0, v=0.1), 9.0, False),
        (at(1.0), BoardReport(0.1, 0.0, 0.0, 0.0, 12.0, 0.0), 9.0, False),
        (at(1.0), BoardReport(0.0, 0.1, 0.0, 0.0, 12.0, 0.0), 9.0, False),
        (at(1.0), BoardReport(0.0, 0.0, 0.0, 1.0, 12.0, 0.0), 9.0, False),
        (BoardReport(0.0, 0.0, 0.0, -1.0, 12.0, 0.0), at(0.0), 9.0, True),
        (at(None), at(0.0), 9.0, False),
        (at(1.0), at(None), 9.0, False),
    ],
)
def test_paths_that_are_0_again_after_a_pause_are_a_restart(
    before: BoardReport, after: BoardReport, dt: float, anew: bool
) -> None:
    assert began_anew(before, after, dt) is anew


class Kept(Script):
    """A board that says what it is told to, and keeps what it is sent."""

    def __init__(self) -> None:
        self.came = b""

    def received(self, data: bytes) -> None:
        self.came += data

    async def sent(self) -> list[dict[str, Any]]:
        """What came since the last call."""
        await asyncio.sleep(0.0)
        await asyncio.sleep(0.0)
        came, self.came = self.came, b""
        return [json.loads(each) for each in came.splitlines() if each]

    async def report(self, **told: float) -> None:
        self.link.write(json.dumps({"T": 1001} | told).encode() + b"\n")
        await asyncio.sleep(0.0)
        await asyncio.sleep(0.0)


def scripted(look: Callable[[WaveshareHal, Kept], Coroutine[Any, Any, None]], **options: Any) -> None:
    """Do this with an open HAL and its board."""

    async def body() -> None:
        script = Kept()
        hal = WaveshareHal(script, WaveshareOptions(**options), config().geometry, lambda end: end)
        await hal.open()
        await look(hal, script)
        await hal.close()

    run(body(), speed="max")


async def settle(hal: WaveshareHal, script: Kept) -> None:
    """Report until it takes set-points, and until the settings are sent."""
    hal.read(0.0)
    await script.say(0, 30)
    hal.write(Outputs(), 0.6)
    await script.sent()


TRACK = config().geometry.track_width
RESTS, NO_POWER = {"T": 1, "L": 0.0, "R": 0.0}, {"T": 11, "L": 0, "R": 0}


@pytest.mark.parametrize(
    ("outputs", "encoders", "expected"),
    [
        (Outputs(), True, RESTS),
        (Outputs(v=0.5), True, {"T": 1, "L": 0.5, "R": 0.5}),
        (Outputs(omega=2.0 / TRACK), True, {"T": 1, "L": -1.0, "R": 1.0}),
        (Outputs(v=0.5, omega=-0.6 / TRACK), True, {"T": 1, "L": 0.8, "R": 0.2}),
        (Outputs(v=0.123456), True, {"T": 1, "L": 0.1235, "R": 0.1235}),
        (Outputs(motor=24000, v=0.0), True, RESTS),
        (Outputs(), False, NO_POWER),
        (Outputs(motor=12000, v=9.0), False, {"T": 11, "L": 128, "R": 128}),
        (Outputs(motor=-24000), False, {"T": 11, "L": -255, "R": -255}),
        (Outputs(motor=24000, rear=18000), False, {"T": 11, "L": 191, "R": 255}),
        (Outputs(motor=-24000, rear=18000), False, {"T": 11, "L": -255, "R": -191}),
    ],
)
def test_the_board_is_sent_commands_after_it_has_answered_for_a_while(
    outputs: Outputs, encoders: bool, expected: dict[str, float]
) -> None:
    rests = RESTS if encoders else NO_POWER

    async def look(hal: WaveshareHal, script: Kept) -> None:
        hal.write(outputs, 0.0)
        assert (await script.sent())[0] == rests
        await settle(hal, script)
        hal.write(outputs, 1.0)
        assert await script.sent() == [expected]
        hal.write(Outputs(), 1.02)
        assert await script.sent() == [rests]
        hal.write(outputs, 1.04)
        await script.sent()
        await asyncio.sleep(0.5)  # it is silent
        hal.read(1.6)
        hal.write(outputs, 1.6)
        assert (await script.sent())[0] == rests
        await hal.close()
        sent = await script.sent()
        assert sent and all(each == rests for each in sent)

    scripted(look, encoders=encoders)


def test_an_emergency_stop_takes_the_power_away_until_a_speed_is_commanded() -> None:
    async def look(hal: WaveshareHal, script: Kept) -> None:
        await settle(hal, script)
        for again in (Outputs(v=0.2), Outputs(omega=0.2)):
            hal.halt(Outputs(v=0.2), 1.0)
            assert await script.sent() == [NO_POWER], "at once, without waiting for the next tick"
            hal.write(Outputs(), 1.02)
            assert await script.sent() == [NO_POWER]
            hal.write(again, 1.04)
            assert (await script.sent())[0]["T"] == 1
            hal.write(Outputs(), 1.06)
            assert await script.sent() == [RESTS]
        hal.halt(Outputs(), 1.08)
        await hal.close()
        assert NO_POWER in await script.sent()
        await hal.open()
        hal.write(Outputs(), 0.0)
        assert (await script.sent())[0] == RESTS, "another run knows nothing of it"

    scripted(look)


def test_the_settings_are_sent_first_each_second_and_to_every_new_line() -> None:
    settings = [{"T": 143, "cmd": 0}, {"T": 131, "cmd": 1}, {"T": 142, "cmd": 20}, {"T": 136, "cmd": 2000}]

    async def look(hal: WaveshareHal, script: Kept) -> None:
        async def set_() -> list[dict[str, Any]]:
            hal.write(Outputs(), 0.0)
            return (await script.sent())[1:]

        await asyncio.sleep(0.0)
        await asyncio.sleep(0.0)
        assert script.came == b"\n", "ends an unfinished line of an earlier host"
        assert await set_() == settings
        assert await set_() == []
        await asyncio.sleep(0.98)
        assert await set_() == []
        await asyncio.sleep(0.02)
        assert await set_() == settings
        assert await set_() == []
        script.link.close()
        await asyncio.sleep(0.2)
        assert await set_() == settings

    scripted(look, heartbeat=2.0)


def test_the_settings_are_those_of_a_rover_with_encoders_unless_others_are_given() -> None:
    async def look(hal: WaveshareHal, script: Kept) -> None:
        told = hal.capabilities
        assert (told.odometry, told.pwm, told.battery, told.halt, told.simulated) == (True, False, True, True, False)
        hal.write(Outputs(), 0.0)
        assert {"T": 136, "cmd": 500} in await script.sent()

    scripted(look)
    assert WaveshareOptions() == WaveshareOptions(115200, None, None, "auto", "auto", 0.5, 0.001064)
    told = WaveshareHal(Kept(), WaveshareOptions(encoders=False), config().geometry, lambda end: end).capabilities
    assert (told.odometry, told.pwm, told.battery, told.halt) == (False, True, True, False)


def test_the_battery_is_told_with_the_time_of_its_report_and_is_never_negative() -> None:
    async def look(hal: WaveshareHal, script: Kept) -> None:
        assert hal.read(0.0).batteries is None
        await asyncio.sleep(0.25)
        await script.report(v=1260)
        await asyncio.sleep(0.25)
        told = hal.read(0.5)
        assert (told.batteries, told.battery_time, told.odometry_time) == ((12.6, 0.0), 0.25, 0.25)
        assert told.link is not None
        assert told.link.text == "the rover's board answers; it stops by itself after 0.5 s"
        await script.report(L=0)
        assert hal.read(0.5).batteries == (12.6, 0.0), "a report without a voltage changes nothing"
        await script.report(v=-1)
        assert hal.read(0.5).batteries == (0.0, 0.0)
        await hal.close()
        await hal.open()
        assert hal.read(0.0).batteries is None, "another run knows nothing of it"

    scripted(look)


def test_damage_of_all_lines_is_counted_and_what_was_half_said_on_one_is_forgotten() -> None:
    async def look(hal: WaveshareHal, script: Kept) -> None:
        def faults() -> tuple[int, int]:
            link = hal.read(0.0).link
            assert link is not None
            return link.faults["line_damaged"], link.faults["doubted"]

        assert faults() == (0, 0)
        script.link.write(b"x\ny\n" + b'{"T":1001,')
        await script.sent()
        assert faults() == (2, 0)
        script.link.close()
        await asyncio.sleep(0.2)
        await script.say(0, 3)
        assert faults() == (2, 0)
        script.link.write(b"x\n")
        await script.say(300)
        assert faults() == (3, 1)
        script.link.close()
        await asyncio.sleep(0.2)
        await script.say(300, 3)
        assert faults() == (3, 1), "the first report of a line is not doubted"
        told = hal.read(0.0)
        assert told.odometry == Odometry() and told.link is not None and "restarted" not in told.link.reason
        await hal.close()
        await hal.open()
        assert faults()[1] == 0

    scripted(look)


def test_only_a_report_that_agrees_with_the_doubted_one_is_believed() -> None:
    async def look(hal: WaveshareHal, script: Kept) -> None:
        await script.say(100, 3)
        for wrong, doubted in ((300, 1), (600, 2), (100, 2), (600, 3), (100, 3)):
            await script.say(wrong)
            told = hal.read(0.0)
            assert told.link is not None
            assert (told.link.faults["doubted"], told.link.losses, told.odometry) == (doubted, 0, Odometry())

    scripted(look)


@pytest.mark.parametrize(
    ("reports", "expected"),
    [
        # paths, m: left 1, right 1.1
        ([{"odl": 1.0, "odr": 1.0}, {"odl": 1.01, "odr": 1.01}], Odometry(0.01, 0.0, 0.0, 0.0, 0.0)),
        (
            [{"odl": 1.0, "odr": 1.0, "L": -0.5, "R": 0.5}, {"odl": 0.99, "odr": 1.01, "L": -0.5, "R": 0.5}],
            Odometry(0.0, 0.0, 0.02 / TRACK, 0.0, 1.0 / TRACK),
        ),
        # speeds alone: 0.1 s at 0.5 m/s
        ([{"L": 0.5, "R": 0.5}, {"L": 0.5, "R": 0.5}], Odometry(0.05, 0.0, 0.0, 0.5, 0.0)),
        ([{"L": -0.5, "R": 0.5}, {"L": -0.5, "R": 0.5}], Odometry(0.0, 0.0, 0.1 / TRACK, 0.0, 1.0 / TRACK)),
        ([{}, {}], Odometry()),
        # a path that is new, or of one side only, moves nothing by itself: the speeds do
        ([{"L": 0.5, "R": 0.5}, {"odl": 7.0, "odr": 7.0, "L": 0.5, "R": 0.5}], Odometry(0.05, 0.0, 0.0, 0.5, 0.0)),
        ([{"odl": 7.0, "odr": 7.0, "L": 0.5, "R": 0.5}], Odometry(0.0, 0.0, 0.0, 0.5, 0.0)),
        (
            [{"odl": 7.0, "L": 0.5, "R": 0.5}, {"odl": 7.0, "L": 0.5, "R": 0.5}],
            Odometry(0.05, 0.0, 0.0, 0.5, 0.0),
        ),
        ([{"odl": 7.0, "odr": 7.0, "L": 0.5, "R": 0.5}, {"L": 0.5, "R": 0.5}], Odometry(0.05, 0.0, 0.0, 0.5, 0.0)),
    ],
)
def test_paths_move_the_rover_and_without_them_its_speeds(reports: list[dict[str, float]], expected: Odometry) -> None:
    async def look(hal: WaveshareHal, script: Kept) -> None:
        await asyncio.sleep(1.0)  # the first report moves nothing
        for told in reports:
            await script.report(**told)
            await asyncio.sleep(0.1)
        assert hal.read(1.0).odometry == pytest.approx(expected, abs=1e-12)

    scripted(look, paths="m")


def test_a_curve_is_an_arc_and_a_pause_counts_for_a_fifth_of_a_second_at_most() -> None:
    async def look(hal: WaveshareHal, script: Kept) -> None:
        await script.report(L=0.4, R=0.6)
        await asyncio.sleep(5.0)
        await script.report(L=0.4, R=0.6)
        turn = 0.2 * 0.2 / TRACK
        told = hal.read(1.0).odometry
        assert told is not None
        assert (told.x, told.y, told.theta) == pytest.approx(move_along_arc(0.0, 0.0, 0.0, 0.1, turn / 0.1, 0.0))
        assert (told.v, told.omega) == pytest.approx((0.5, 0.2 / TRACK))

    scripted(look)


def test_the_gyroscope_counts_once_its_bias_is_known_from_reports_at_rest() -> None:
    async def look(hal: WaveshareHal, script: Kept) -> None:
        async def turned(gyro: float | None, side: float) -> tuple[float, float]:
            before = hal.read(1.0).odometry or Odometry()
            await script.report(L=-side, R=side, **({} if gyro is None else {"gz": gyro}))
            after = hal.read(1.0).odometry
            await asyncio.sleep(0.02)
            assert after is not None
            return after.omega, after.theta - before.theta

        wheels = 0.2 / TRACK
        for count in range(24):
            assert (await turned(30.0 if count % 2 else 50.0, 0.0))[0] == 0.0
        assert await turned(140.0, 0.1) == pytest.approx((wheels, 0.02 * wheels)), "24 reports are too few"
        assert await turned(40.0, 0.0) == (0.0, 0.0)
        assert await turned(140.0, 0.1) == pytest.approx((0.1, 0.002)), "100 counts above the bias of 40"
        assert await turned(-60.0, 0.1) == pytest.approx((-0.1, -0.002))
        assert await turned(None, 0.1) == pytest.approx((wheels, 0.02 * wheels))
        for _ in range(200):
            await turned(40.0, 0.0)
        await turned(140.0, 0.0)
        assert await turned(141.0, 0.1) == pytest.approx((0.1, 0.002)), "the bias moves by a hundredth for each report"
        assert await turned(241.0, 0.0) == (0.0, 0.0)

    scripted(look, gyro=0.001)


def test_a_rover_whose_sides_run_at_different_speeds_does_not_stand() -> None:
    async def look(hal: WaveshareHal, script: Kept) -> None:
        for told in ({"L": 0.1, "R": 0.0}, {"L": 0.0, "R": 0.1}, {"L": 0.1, "R": 0.1}):
            for _ in range(30):
                await script.report(gz=500, **told)
                await asyncio.sleep(0.02)
            odometry = hal.read(1.0).odometry
            assert odometry is not None
            assert odometry.omega == pytest.approx((told["R"] - told["L"]) / TRACK), "no bias is known"

    scripted(look)


def test_a_restart_loses_the_board_and_the_rover_stays_where_it_was() -> None:
    async def look(hal: WaveshareHal, script: Kept) -> None:
        await script.say(100, 30)
        await script.report(odl=102, odr=102, v=1200, L=0.5, R=0.5)
        before = hal.read(1.0)
        assert before.odometry is not None and before.link is not None
        assert (before.odometry.x, before.link.ready, before.link.losses) == (pytest.approx(0.02), True, 0)
        await asyncio.sleep(0.02)
        for _ in range(2):
            await script.report(odl=0, odr=0, v=1200, L=0.5, R=0.5)
        told = hal.read(1.1)
        assert told.odometry is not None and told.link is not None
        assert (told.odometry.x, told.link.ready, told.link.losses) == (before.odometry.x, False, 1)
        hal.write(Outputs(v=0.5), 1.1)
        assert (await script.sent())[0] == RESTS

    scripted(look)


# -- which rover it is, and how its board is mounted -------------------------------------------------------------------


@pytest.mark.parametrize(
    ("model", "encoders"),
    [
        ("ugv-rover", True),
        ("ugv-beast", True),
        ("rasp-rover", True),
        ("ugv01", True),
        ("wave-rover", False),
        ("ugv02", False),
    ],
)
def test_speeds_of_a_rover_without_encoders_are_pwm_counts_and_no_odometry(model: str, encoders: bool) -> None:
    hal = WaveshareHal(Kept(), checked(WaveshareOptions, {"model": model}, "x"), config().geometry, lambda end: end)
    assert (hal.capabilities.odometry, hal.capabilities.pwm) == (encoders, not encoders)

    async def look(hal: WaveshareHal, script: Kept) -> None:
        await script.report(L=154, R=154, r=-1.2, p=0.4, v=11.8)
        await asyncio.sleep(0.02)
        odometry = hal.read(0.1).odometry
        assert (odometry is None) is not encoders

    scripted(look, model=model)


def test_a_real_rover_has_to_be_named() -> None:
    real = ["vehicle=rover", "serial.port=/dev/ttyUSB7"]
    with pytest.raises(ConfigError, match=r"hal_options\.model: which rover is it\? .* wave-rover, ugv02"):
        create(load(None, real, {}, {"hal": "waveshare"}).config)
    for setting in ("model=wave-rover", "encoders=true"):
        assert create(load(None, [*real, f"hal_options.{setting}"], {}, {"hal": "waveshare"}).config)


@pytest.mark.parametrize(
    ("acceleration", "up"),
    [
        ((0.0, 0.0, 8192.0), "+z"),
        ((0.0, 8172.0, -48.0), "+y"),
        ((0.0, -300.0, -8100.0), "-z"),
        ((-8192.0, 100.0, 100.0), "-x"),
        # a slope of 20 degrees is not another mounting
        ((0.0, 2802.0, 7698.0), "+z"),
        ((0.0, 5793.0, 5793.0), None),
        ((0.0, 0.0, 0.0), None),
    ],
)
def test_which_axis_is_up_is_read_of_gravity_at_rest(acceleration: tuple[float, float, float], up: str | None) -> None:
    assert waveshare.vertical(acceleration) == up


async def turned(hal: WaveshareHal, script: Kept, gravity: dict[str, int], rates: dict[str, int]) -> float:
    """The heading after a rest of 0.6 s and a second of driving with these rates."""
    told = {"ax": 0, "ay": 0, "az": 0, "gx": 0, "gy": 0, "gz": 0} | gravity
    for _ in range(30):
        await script.say(0, **told)
    for _ in range(50):
        await script.say(0, speed=0.01, **(told | rates))
    odometry = hal.read(2.0).odometry
    assert odometry is not None
    return odometry.theta


@pytest.mark.parametrize(
    ("gravity", "rates", "options"),
    [
        ({"az": 8192}, {"gz": 940}, {}),
        ({"ay": 8172, "az": -48}, {"gy": 940}, {}),
        ({"az": -8192}, {"gz": -940}, {}),
        ({"ay": 2802, "az": 7698}, {"gz": 940}, {}),
        ({"ay": 8172}, {"gx": 940}, {"up": "+x"}),
    ],
)
def test_a_board_in_any_position_measures_the_turn(
    gravity: dict[str, int], rates: dict[str, int], options: dict[str, Any]
) -> None:
    async def look(hal: WaveshareHal, script: Kept) -> None:
        assert await turned(hal, script, gravity, rates) == pytest.approx(940 * 0.001064, rel=0.05)

    scripted(look, **options)


def test_a_board_that_leans_is_told_and_its_gyroscope_is_not_used() -> None:
    async def look(hal: WaveshareHal, script: Kept) -> None:
        assert await turned(hal, script, {"ay": 5793, "az": 5793}, {"gz": 940}) == 0.0
        link = hal.read(2.0).link
        assert link is not None and "set hal_options.up" in link.text

    scripted(look)


def test_a_voltage_that_is_missing_changes_no_unit_and_keeps_its_own_time() -> None:
    async def look(hal: WaveshareHal, script: Kept) -> None:
        hal.read(0.0)
        await script.report(v=1200, odl=100, odr=100, L=0.5, R=0.5)
        await asyncio.sleep(0.02)
        await script.report(odl=101, odr=101, L=0.5, R=0.5)
        told = hal.read(0.02)
        assert told.odometry is not None and told.odometry.x == pytest.approx(0.01)
        assert (told.batteries, told.battery_time, told.odometry_time) == ((12.0, 0.0), 0.0, 0.02)

    scripted(look)

"""Waveshare's rover boards: lines of JSON, however they come, and a rover that is driven by them."""

import asyncio
import json
from collections.abc import Callable, Coroutine
from math import hypot
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from txt1.config import Config, checked, load
from txt1.errors import ConfigError
from txt1.hal.base import Inputs
from txt1.hal.double import DoublePort
from txt1.hal.registry import create
from txt1.hal.waveshare import driver as waveshare
from txt1.hal.waveshare.double import Waveshare
from txt1.hal.waveshare.driver import BoardReport, Lines, WaveshareHal, WaveshareOptions, goes_on, report_of, rolls_on
from txt1.kernel.loop import run
from txt1.link.base import End, Link, connect
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
    assert report_of(json.loads(UGV)) == BoardReport(0.25, -0.5, 0.56, -0.2, 12.16, -89.0)
    assert report_of(json.loads(EARLIER)) == BoardReport(0.25, -0.5, 0.56, -0.2, 11.0, 0.3)
    assert report_of({"T": 1005, "L": 1}) is None
    assert report_of({"T": 1001, "L": "1", "R": True, "v": float("nan")}) == BoardReport(*[None] * 6)


@pytest.mark.parametrize(
    ("stream", "faults"),
    [
        (UGV + b"\r\n", 0),
        (UGV + UGV + b"\n", 0),  # the line's end was lost
        (UGV[:30] + UGV + b"\n", 1),  # torn, the rest lost
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
    settings = ["vehicle=rover", "serial.port=waveshare", "sim.room.length=.inf", "sim.room.width=.inf", *words]
    return load(None, settings, {}, {"hal": "waveshare"}).config


def on_the_desk(made: Config) -> tuple[WaveshareHal, DoublePort[Waveshare]]:
    """The HAL, and the port with a board that it drives."""
    port = DoublePort("waveshare", lambda: Waveshare(made))
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
        create(load(None, ["serial.port=waveshare"], {}, {"hal": "waveshare"}).config)

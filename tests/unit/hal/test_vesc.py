"""VESC motor controllers: their packets, byte by byte, and a car that is driven by one."""

import asyncio
import sys
from importlib import import_module
from importlib.util import find_spec, module_from_spec, spec_from_file_location
from math import hypot
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from txt1.config import Config, load
from txt1.errors import ConfigError, TaskFault
from txt1.hal.double import DoublePort
from txt1.hal.registry import create
from txt1.hal.vesc import driver as vesc
from txt1.hal.vesc.double import Vesc
from txt1.hal.vesc.driver import PacketId, Unpacker, VescHal, VescOptions, packet
from txt1.kernel.loop import run
from txt1.link.base import Link, connect
from txt1.robot import Robot
from txt1.sim.parameters import LineFaults

WORDS = ("vehicle=f1tenth", "sim.room.length=.inf", "sim.room.width=.inf", "sim.noise.drag=0")


def crc_bit_by_bit(data: bytes) -> int:
    """CRC16 with the polynomial x^16 + x^12 + x^5 + 1, begun at 0: as the protocol's description has it."""
    crc = 0
    for byte in data:
        crc ^= byte << 8
        for _ in range(8):
            crc = (crc << 1 ^ 0x1021 if crc & 0x8000 else crc << 1) & 0xFFFF
    return crc


# -- bytes, worked out by hand: start, length, command, number, CRC, end -----------------------------------------------


@pytest.mark.parametrize(
    ("frame", "golden"),
    [
        (vesc.ask(PacketId.GET_VALUES), "02 01 04 4084 03"),
        (vesc.ask(PacketId.FW_VERSION), "02 01 00 0000 03"),
        (vesc.ask(PacketId.ALIVE), "02 01 1e f3ff 03"),
        (vesc.ask(PacketId.GET_APPCONF), "02 01 11 0210 03"),
        (vesc.order(PacketId.SET_RPM, 1000.0), "02 05 08 000003e8 2b58 03"),
        (vesc.order(PacketId.SET_DUTY, 0.5), "02 05 05 0000c350 3aa5 03"),
        (vesc.order(PacketId.SET_CURRENT, 3.0), "02 05 06 00000bb8 37ac 03"),
        (vesc.order(PacketId.SET_CURRENT_BRAKE, 5.0), "02 05 07 00001388 2174 03"),
        (vesc.order(PacketId.SET_SERVO_POS, 0.5), "02 03 0c 01f4 e9cb 03"),
        (vesc.order(PacketId.SET_RPM, -1000.0)[:7], "02 05 08 fffffc18"),
    ],
)
def test_golden_packets(frame: bytes, golden: str) -> None:
    assert frame == bytes.fromhex(golden)


VALUES = bytes.fromhex(
    "04 00fa 0113 000003e8 000001f4 00000000 00000000 007b ffffd8f0 007e 00000000 00000000 00000000 00000000 "
    "ffffff9c 000000c8 02"
)
"""25.0 and 27.5 degrees, 10 A, 5 A, duty 0.123, -10000 turns a minute, 12.6 V, tachometer -100 and 200, fault 2."""
REST = bytes.fromhex("00000000 01 00fa 00fa 00fa 00000000 00000000")


def test_golden_values() -> None:
    told = vesc.Values(25.0, 27.5, 10.0, 5.0, 0.123, -10000, 12.6, -100, 200, 2, None)
    assert vesc.values_of(VALUES + REST) == told  # firmware 5
    assert vesc.values_of(VALUES + REST + b"\x01") == told._replace(timed_out=True)  # firmware 6
    assert vesc.values_of(VALUES[:-1]) is None


def test_the_time_out_stands_behind_signature_and_number() -> None:
    assert vesc.timeout_of(bytes.fromhex("11 0b5c8f1d 00 000001f4 00000000")) == 0.5
    assert vesc.timeout_of(bytes.fromhex("11 0b5c8f1d 00 ffffffff")) is None


def test_a_long_payload_has_its_length_in_two_bytes() -> None:
    payload = bytes(300)
    assert packet(payload)[:3] == b"\x03\x01\x2c"
    assert Unpacker().feed(packet(payload)) == [payload]


# -- the stream --------------------------------------------------------------------------------------------------------

payloads = st.binary(min_size=1, max_size=300)


@given(st.lists(payloads, max_size=4), st.data())
def test_packets_come_out_however_the_stream_is_cut(sent: list[bytes], data: st.DataObject) -> None:
    stream, unpacker, got = b"".join(map(packet, sent)), Unpacker(), []
    while stream:
        size = data.draw(st.integers(1, len(stream)))
        got += unpacker.feed(stream[:size])
        stream = stream[size:]
    assert (got, unpacker.faults) == (sent, 0)


@given(st.binary(max_size=600), payloads)
def test_rubbish_costs_no_packet_behind_it(rubbish: bytes, payload: bytes) -> None:
    unpacker = Unpacker()
    unpacker.feed(rubbish)
    assert payload in unpacker.feed(packet(payload))


@given(payloads, st.data())
def test_a_packet_with_a_wrong_bit_is_none(payload: bytes, data: st.DataObject) -> None:
    frame = bytearray(packet(payload))
    bit = data.draw(st.integers(0, 8 * len(frame) - 1))
    frame[bit // 8] ^= 1 << bit % 8
    assert payload not in Unpacker().feed(bytes(frame))


@given(payloads)
def test_the_check_sum_is_that_of_the_description(payload: bytes) -> None:
    assert int.from_bytes(packet(payload)[-3:-1]) == crc_bit_by_bit(payload)


# -- another reader and writer -----------------------------------------------------------------------------------------


@pytest.fixture
def pyvesc(monkeypatch: pytest.MonkeyPatch) -> Any:
    """PyVESC as pyvesc-fix has it, under the name by which it imports itself."""
    found = find_spec("pyvesc_fix")
    if found is None or found.origin is None:
        pytest.skip("not installed: pip install pyvesc-fix, which the extra 'dev' does")
    folders = list(found.submodule_search_locations or ())
    spec = spec_from_file_location("pyvesc", found.origin, submodule_search_locations=folders)
    assert spec is not None and spec.loader is not None
    for name in [name for name in sys.modules if name.partition(".")[0] == "pyvesc"]:
        monkeypatch.delitem(sys.modules, name)
    module = module_from_spec(spec)
    monkeypatch.setitem(sys.modules, "pyvesc", module)
    spec.loader.exec_module(module)
    return module


def test_pyvesc_has_the_same_numbers_for_the_commands(pyvesc: Any) -> None:
    numbers = import_module("pyvesc.VESC.messages").VedderCmd
    theirs = {number.name.removeprefix("COMM_"): int(number) for number in numbers}
    assert {command.name: theirs[command.name] for command in PacketId} == {each.name: each.value for each in PacketId}


@pytest.mark.parametrize(
    ("frame", "name", "field", "value"),
    [
        (vesc.order(PacketId.SET_RPM, -4321.0), "SetRPM", "rpm", -4321),
        (vesc.order(PacketId.SET_DUTY, 0.25), "SetDutyCycle", "duty_cycle", 0.25),
        (vesc.order(PacketId.SET_CURRENT, 2.5), "SetCurrent", "current", 2.5),
        (vesc.order(PacketId.SET_CURRENT_BRAKE, 5.0), "SetCurrentBrake", "current_brake", 5.0),
        (vesc.order(PacketId.SET_SERVO_POS, 0.31), "SetServoPosition", "servo_pos", 0.31),
    ],
)
def test_pyvesc_reads_what_we_write(pyvesc: Any, frame: bytes, name: str, field: str, value: float) -> None:
    message, consumed = pyvesc.decode(frame)
    assert (type(message).__name__, getattr(message, field), consumed) == (name, value, len(frame))


def test_we_read_what_pyvesc_writes(pyvesc: Any) -> None:
    setters, getters = (import_module(f"pyvesc.VESC.messages.{name}") for name in ("setters", "getters"))
    assert pyvesc.encode(setters.SetDutyCycle(0.25)) == vesc.order(PacketId.SET_DUTY, 0.25)
    assert pyvesc.encode(setters.SetServoPosition(0.31)) == vesc.order(PacketId.SET_SERVO_POS, 0.31)
    assert pyvesc.encode(setters.Alive()) == vesc.ask(PacketId.ALIVE)
    assert pyvesc.encode_request(getters.GetValues()) == vesc.ask(PacketId.GET_VALUES)
    assert pyvesc.encode_request(getters.GetVersion()) == vesc.ask(PacketId.FW_VERSION)


class Listener:
    """An end of a link that keeps what comes."""

    def __init__(self) -> None:
        self.came = b""

    def connected(self, link: Link) -> None:
        self.link = link

    def received(self, data: bytes) -> None:
        self.came += data

    def lost(self, reason: str) -> None:
        pass


@pytest.mark.parametrize("firmware", [(5, 2), (6, 5)])
def test_pyvesc_drives_the_car_on_the_desk_and_reads_its_values(pyvesc: Any, firmware: tuple[int, int]) -> None:
    setters, getters = (import_module(f"pyvesc.VESC.messages.{name}") for name in ("setters", "getters"))

    async def drive() -> None:
        device, host = Vesc(config(), firmware), Listener()
        connect(host, device.line)
        await device.power_up()

        async def asked(what: Any) -> Any:
            host.came = b""
            host.link.write(pyvesc.encode_request(what))
            await asyncio.sleep(0.01)
            return pyvesc.decode(host.came)[0]

        host.link.write(pyvesc.encode(setters.SetServoPosition(0.7)))
        for _ in range(30):
            host.link.write(pyvesc.encode(setters.SetDutyCycle(0.1)))
            await asyncio.sleep(0.1)
        version, values = await asked(getters.GetVersion()), await asked(getters.GetValues())
        assert (version.comm_fw_version, version.fw_version_major) == firmware
        car, options = device.car, VescOptions()
        turns = options.pole_pairs * options.gear / config().geometry.circumference
        assert car.vehicle.state.v > 0.5
        assert values.rpm == pytest.approx(60.0 * turns * car.vehicle.state.v, rel=0.01)
        assert values.tachometer == pytest.approx(6.0 * turns * sum(car.paths) / 2.0, rel=0.01)
        assert (values.tachometer_abs, values.duty_cycle_now) == (values.tachometer, 0.1)
        assert values.v_in == pytest.approx(car.voltage, abs=0.2)
        assert (values.temp_fet, values.mc_fault_code) == (25.0, b"\0")
        assert car.vehicle.state.theta > 0.3
        await device.power_down()

    run(drive(), speed="max")


# -- the car -----------------------------------------------------------------------------------------------------------


def config(*words: str) -> Config:
    return load(None, [*WORDS, "serial.port=vesc", *words], {}, {"hal": "vesc"}).config


def on_the_desk(
    *words: str, firmware: tuple[int, int] = (6, 5), timeout: float = 1.0
) -> tuple[VescHal, DoublePort[Vesc]]:
    """The HAL, and the port with a VESC that it drives."""
    made = config(*words)
    port = DoublePort("vesc", lambda: Vesc(made, firmware, timeout))
    return VescHal(port, vesc.checked(VescOptions, made.hal_options, "x"), made.geometry, lambda end: end, True), port


@pytest.mark.parametrize("firmware", [(5, 2), (6, 5)])
def test_it_drives_at_the_speed_and_in_the_curve_that_are_asked_for(firmware: tuple[int, int]) -> None:
    hal, port = on_the_desk(firmware=firmware)

    async def drive() -> None:
        async with Robot.open(hal, config=config()) as robot:
            await robot.linked(5.0)
            robot.arm()
            await robot.drive(1.0, 0.8, 4.0)
            assert port.device is not None
            true = port.device.car.vehicle.state
            assert robot.odometry.v == pytest.approx(1.0, rel=0.02)
            assert robot.odometry.omega == pytest.approx(0.8, rel=0.02)
            assert hypot(robot.odometry.x - true.x, robot.odometry.y - true.y) < 0.08, (
                "it slides sideways by 0.8 degrees"
            )
            assert f"firmware {firmware[0]}.0{firmware[1]}, stops by itself after 1 s" in str(robot.runtime.state.board)

    run(drive(), speed="max")


def test_a_motor_and_a_servo_the_other_way_round_are_settings() -> None:
    hal, port = on_the_desk("hal_options={backwards: true, servo_range: -0.4}")

    async def drive() -> None:
        async with Robot.open(hal, config=config()) as robot:
            await robot.linked(5.0)
            robot.arm()
            await robot.drive(1.0, 0.5, 2.0)
            assert port.device is not None
            assert port.device.car.vehicle.state.v == pytest.approx(1.0, rel=0.05)
            assert (robot.odometry.x > 0.5, robot.odometry.theta > 0.2) == (True, True)

    run(drive(), speed="max")


def test_a_fault_of_the_controller_disarms_and_is_named() -> None:
    hal, port = on_the_desk()

    async def drive() -> None:
        async with Robot.open(hal, config=config()) as robot:
            await robot.linked(5.0)
            robot.arm()
            robot.command(1.0, 0.0)
            await asyncio.sleep(0.2)
            assert port.device is not None
            port.device.fault = 6
            await asyncio.sleep(0.1)
            assert (robot.armed, robot.runtime.gate.reason) == (False, "the VESC reports a fault: motor too hot")
            with pytest.raises(Exception, match="motor too hot"):
                robot.arm()
            port.device.fault = 0
            await asyncio.sleep(1.0)
            robot.arm()

    run(drive(), speed="max")


@pytest.mark.parametrize("pause", [0.05, 0.5, 2.0, 10.0, 60.0])
def test_a_restart_is_noticed_whatever_its_pause_and_the_pose_does_not_leap(
    pause: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    hal, port = on_the_desk()

    async def drive() -> None:
        async with Robot.open(hal, config=config()) as robot:
            await robot.linked(5.0)
            robot.arm()
            await robot.drive(0.5, 0.0, 1.0)
            await robot.drive(0.0, 0.0, 1.0)
            device, there = port.device, robot.odometry.x
            assert device is not None
            assert there > 0.1
            begin = device.car.paths
            monkeypatch.setattr(type(device), "send", lambda self, data: None)
            await asyncio.sleep(pause)
            monkeypatch.undo()
            # its counters begin at 0
            monkeypatch.setattr(type(device.car), "paths", property(lambda car: (0.0, 0.0)))
            vars(device).update(_distance=0.0, _last=0.0)
            await asyncio.sleep(0.2)
            assert sum(begin) > 0.2
            assert not robot.armed
            board = robot.runtime.state.board
            assert board is not None
            assert "restarted" in f"{board.reason} {board.text}"
            assert robot.odometry.x == pytest.approx(there, abs=0.01)

    run(drive(), speed="max")


def test_old_firmware_is_refused_with_what_to_do() -> None:
    hal, _ = on_the_desk(firmware=(3, 40))

    async def drive() -> None:
        async with Robot.open(hal, config=config()):
            await asyncio.sleep(1.0)

    with pytest.raises(TaskFault, match=r"firmware 3\.40: update it with VESC Tool"):
        run(drive(), speed="max")


def test_a_controller_that_never_stops_by_itself_is_remarked_on() -> None:
    hal, _ = on_the_desk(timeout=0.0)

    async def look() -> None:
        async with Robot.open(hal, config=config()) as robot:
            await robot.linked(5.0)
            assert "never stops by itself: set 0.5 s in VESC Tool" in str(robot.runtime.state.board)

    run(look(), speed="max")


def test_a_noisy_line_is_driven_over() -> None:
    noisy = config().model_copy(
        update={
            "serial": config().serial.model_copy(
                update={"fault": LineFaults(drop=0.05, flip=1e-4, split=True, delay=0.01, jitter=0.01)}
            )
        }
    )

    async def drive() -> None:
        async with Robot.open(create(noisy), config=noisy) as robot:
            await robot.linked(5.0)
            robot.arm()
            await robot.drive(1.0, 0.0, 5.0)
            assert robot.odometry.x > 4.0
            assert robot.runtime.state.board is not None
            assert robot.runtime.state.board.faults["line_damaged"] > 0

    run(drive(), speed="max")


def test_a_cut_line_disarms_and_is_found_again() -> None:
    cut = config().model_copy(update={"serial": config().serial.model_copy(update={"fault": LineFaults(cut=3.0)})})

    async def drive() -> None:
        async with Robot.open(create(cut), config=cut) as robot:
            await robot.linked(5.0)
            robot.arm()
            robot.command(0.5, 0.0)
            await asyncio.sleep(3.0)
            assert not robot.armed
            assert "link lost" in robot.runtime.gate.reason
            await robot.linked(5.0)

    run(drive(), speed="max")


def test_a_rover_is_refused() -> None:
    with pytest.raises(ConfigError, match="a VESC drives one motor"):
        create(load(None, ["vehicle=rover", "serial.port=vesc"], {}, {"hal": "vesc"}).config)

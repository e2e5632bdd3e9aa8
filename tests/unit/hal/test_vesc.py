"""VESC motor controllers: their packets, byte by byte, and a car that is driven by one."""

import asyncio
import sys
from collections.abc import Callable, Coroutine
from importlib import import_module
from importlib.util import find_spec, module_from_spec, spec_from_file_location
from math import hypot
from struct import pack
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.examples import some
from txt1.cars.vesc import driver as vesc
from txt1.cars.vesc.driver import PacketId, Unpacker, VescHal, VescOptions, packet
from txt1.cars.vesc.virtual_vesc import Vesc
from txt1.config import Config, load
from txt1.control.limits import Outputs
from txt1.errors import ConfigError, HalError, TaskFault
from txt1.hal.registry import create
from txt1.hal.simulated_controller import ControllerPort
from txt1.kernel.loop import run
from txt1.link.base import End, Link, connect
from txt1.model.odometry import Odometry
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


@pytest.mark.parametrize(
    ("command", "parts"),
    [
        (PacketId.SET_RPM, 1),
        (PacketId.SET_DUTY, 100000),
        (PacketId.SET_CURRENT, 1000),
        (PacketId.SET_CURRENT_BRAKE, 1000),
        (PacketId.SET_SERVO_POS, 1000),
    ],
)
def test_a_number_is_sent_in_parts_of_its_unit(command: PacketId, parts: int) -> None:
    size = 2 if command is PacketId.SET_SERVO_POS else 4
    for value in (1, -3):
        assert vesc.order(command, float(value)) == packet(
            bytes((command,)) + (value * parts).to_bytes(size, signed=True)
        )


VALUES = bytes.fromhex(
    "04 00fa 0113 000003e8 000001f4 00000000 00000000 007b ffffd8f0 007e 00000000 00000000 00000000 00000000 "
    "ffffff9c 000000c8 02"
)
"""25.0 and 27.5 degrees, 10 A, 5 A, duty 0.123, -10000 turns a minute, 12.6 V, tachometer -100 and 200, fault 2."""
REST = bytes.fromhex("00000000 01 00fa 00fa 00fa 00000000 00000000")


def test_golden_values() -> None:
    told = vesc.Values(25.0, 27.5, 10.0, 5.0, 0.123, -10000, 12.6, -100, 200, 2, None)
    assert vesc.values_of(VALUES + REST) == told  # firmware 5
    assert vesc.values_of(VALUES + REST + b"\x01") == told._replace(timed_out=True, killed=False)  # firmware 6
    assert vesc.values_of(VALUES + REST + b"\x02") == told._replace(timed_out=False, killed=True)
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
        pytest.skip("not installed: pip install pyvesc-fix, which the group dev does")
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
) -> tuple[VescHal, ControllerPort[Vesc]]:
    """The HAL, and the port with a VESC that it drives."""
    made = config(*words)
    port = ControllerPort("vesc", lambda: Vesc(made, firmware, timeout))
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


def test_an_answer_of_old_firmware_ends_no_drive() -> None:
    hal, port = on_the_desk()

    async def drive() -> None:
        async with Robot.open(hal, config=config()) as robot:
            await robot.linked(5.0)
            robot.arm()
            await robot.drive(1.0, 0.0, 1.0)
            assert port.device is not None
            port.device.send(packet(bytes((PacketId.FW_VERSION, 3, 40)) + bytes(16)))
            await robot.drive(1.0, 0.0, 1.0)
            assert robot.odometry.v == pytest.approx(1.0, rel=0.02)
            assert "firmware 3.40 was ignored" in str([event.text for event in robot.runtime.state.events])

    run(drive(), speed="max")


@pytest.mark.parametrize("pause", some(0.05, 2.0, rest=(0.5, 10.0, 60.0)))
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


# -- what goes over the line, and what is made of what comes -----------------------------------------------------------


@pytest.mark.parametrize("size", [1, 255, 256, 257, 512])
def test_a_packet_is_found_once_all_its_bytes_are_there(size: int) -> None:
    payload, unpacker = bytes((7,)) * size, Unpacker()
    frame = packet(payload)
    assert (frame[0], len(frame)) == ((2, size + 5) if size < 256 else (3, size + 6))
    assert unpacker.feed(frame[:1]) == unpacker.feed(frame[1:-1]) == []
    assert unpacker.feed(frame[-1:]) == [payload]
    assert unpacker.faults == 0


@pytest.mark.parametrize(
    ("stream", "faults"),
    [
        (b"\x01", 1),
        (b"\x02\x00", 1),  # an empty payload
        (b"\x04" + packet(b"a"), 1),
        (b"\x01\x01" + packet(b"a") + b"\x05\x05" + packet(b"b"), 2),
        (packet(b"a") + packet(b"b"), 0),
        (packet(b"a")[:-1], 0),
        (packet(b"a")[:-1] + b"\x04", 1),
        (packet(b"a")[:-2] + b"\x00\x03", 1),
        (b"\x03\x00\xff" + packet(bytes(255))[2:], 1),  # a short payload with a long head
        (packet(bytes(513)), 1),  # longer than any answer
        (b"\x03\x02", 0),
    ],
)
def test_each_stretch_of_other_bytes_is_a_fault(stream: bytes, faults: int) -> None:
    unpacker = Unpacker()
    unpacker.feed(stream)
    unpacker.feed(b"")
    assert unpacker.faults == faults


def test_a_long_head_is_no_packet_unless_its_payload_needs_it() -> None:
    assert Unpacker().feed(b"\x03\x00\xff" + packet(bytes(255))[2:]) == []
    assert Unpacker().feed(packet(bytes(513))) == []
    unpacker = Unpacker()
    assert unpacker.feed(b"\x03\x01\x00") == []
    assert unpacker.feed(packet(bytes(256))[3:]) == [bytes(256)]
    unpacker = Unpacker()
    unpacker.feed(b"\x03\x02\x01")  # 513 bytes are not waited for
    assert unpacker.feed(packet(b"a")) == [b"a"]


@pytest.mark.parametrize(("status", "timed_out"), [(b"\x00", False), (b"\x01", True), (b"\x02", False), (b"", None)])
def test_the_first_bit_of_the_status_says_that_no_command_came_in_time(status: bytes, timed_out: bool | None) -> None:
    told = vesc.values_of(VALUES + REST + status)
    assert told is not None and told.timed_out is timed_out
    assert vesc.values_of(VALUES) == vesc.values_of(VALUES + REST)


@pytest.mark.parametrize(("ms", "timeout"), [(0, 0.0), (1, 0.001), (600_000, 600.0), (600_001, None), (2**31, None)])
def test_a_time_out_of_more_than_ten_minutes_is_another_layout_of_the_settings(ms: int, timeout: float | None) -> None:
    head = bytes((17, 0x0B, 0x5C, 0x8F, 0x1D, 0))
    assert vesc.timeout_of(head + ms.to_bytes(4)) == timeout
    assert vesc.timeout_of(head + ms.to_bytes(4)[:3]) is None


def test_the_settings_are_those_of_a_slash_unless_others_are_given() -> None:
    hal = create(config())
    assert isinstance(hal, VescHal)
    assert hal.own_channels == VescOptions(115200, 2, 11.82, False, 0.5, 0.4, 5.0)


class Script(Listener):
    """A port with a VESC behind it that answers what it is told to, and keeps what it is sent."""

    address = "script"

    async def open(self, end: End) -> Link:
        return connect(end, self)[0]

    async def close(self) -> None: ...

    async def sent(self) -> list[bytes]:
        """What came since the last call."""
        await asyncio.sleep(0.0)
        await asyncio.sleep(0.0)
        payloads, self.came = Unpacker().feed(self.came), b""
        return payloads

    async def tell(self, payload: bytes) -> None:
        self.link.write(packet(payload))
        await asyncio.sleep(0.0)
        await asyncio.sleep(0.0)

    async def values(
        self, tachometer: int = 0, distance: int = 0, erpm: int = 0, volts: int = 120, fault: int = 0
    ) -> None:
        body = pack(">hhiiiihihiiiiiiB", *[0] * 7, erpm, volts, *[0] * 4, tachometer, distance, fault)
        await self.tell(b"\x04" + body)


def scripted(look: Callable[[VescHal, Script], Coroutine[Any, Any, None]], **options: Any) -> None:
    """Do this with an open HAL and its VESC."""

    async def body() -> None:
        script = Script()
        hal = VescHal(script, VescOptions(**options), config().geometry, lambda end: end)
        await hal.open()
        await look(hal, script)
        await hal.close()

    run(body(), speed="max")


async def settle(hal: VescHal, script: Script) -> None:
    """Answer until it takes set-points."""
    hal.read(0.0)
    for _ in range(30):
        await script.values()
        await asyncio.sleep(0.02)
    await script.sent()


def orders_in(payloads: list[bytes]) -> list[tuple[PacketId, int]]:
    """What is commanded in these payloads, with its number; requests have no number."""
    return [(PacketId(each[0]), int.from_bytes(each[1:], signed=True)) for each in payloads if len(each) > 1]


STRAIGHT, BRAKED = (PacketId.SET_SERVO_POS, 500), (PacketId.SET_CURRENT_BRAKE, 5000)
FULL_BRAKE, ROLLS = (PacketId.SET_DUTY, 0), (PacketId.SET_CURRENT, 0)


@pytest.mark.parametrize(
    ("v", "omega", "options", "expected"),
    [
        (0.0, 0.0, {}, [BRAKED, STRAIGHT]),
        (0.0, 2.0, {}, [BRAKED, STRAIGHT]),  # a car that stands does not turn
        (0.0, 0.0, {"brake": 0.0}, [ROLLS, STRAIGHT]),
        (1.0, 0.0, {"pole_pairs": 3, "gear": 10.0}, [(PacketId.SET_RPM, 1800.0), STRAIGHT]),
        (-2.0, 0.0, {"pole_pairs": 3, "gear": 10.0}, [(PacketId.SET_RPM, -3600.0), STRAIGHT]),
        (1.0, 0.0, {"pole_pairs": 3, "gear": 10.0, "backwards": True}, [(PacketId.SET_RPM, -1800.0), STRAIGHT]),
        (1e9, 0.0, {}, [(PacketId.SET_RPM, 1e6), STRAIGHT]),
        (-1e9, 0.0, {}, [(PacketId.SET_RPM, -1e6), STRAIGHT]),
        (2.0, 1e3, {}, [None, (PacketId.SET_SERVO_POS, 900)]),
        (2.0, -1e3, {}, [None, (PacketId.SET_SERVO_POS, 100)]),
        (-2.0, 1e3, {}, [None, (PacketId.SET_SERVO_POS, 100)]),
        (2.0, 1e3, {"servo_range": -0.4}, [None, (PacketId.SET_SERVO_POS, 100)]),
        (2.0, 1e3, {"servo_range": 0.8}, [None, (PacketId.SET_SERVO_POS, 1000)]),
        (2.0, -1e3, {"servo_range": 0.8}, [None, (PacketId.SET_SERVO_POS, 0)]),
        (1.0, 0.0, {"servo_centre": 0.47}, [None, (PacketId.SET_SERVO_POS, 470)]),
    ],
)
def test_the_controller_is_sent_what_is_commanded_within_its_limits(
    v: float, omega: float, options: dict[str, Any], expected: list[tuple[PacketId, float] | None]
) -> None:
    circumference = config().geometry.circumference

    async def look(hal: VescHal, script: Script) -> None:
        hal.write(Outputs(v=v, omega=omega), 0.0)
        rest = ROLLS if options.get("brake") == 0.0 else BRAKED
        before = orders_in(await script.sent())
        assert before[0] == rest, "nothing drives before the controller has answered for a while"
        assert before[1][1] == 1000 * options.get("servo_centre", 0.5)
        await settle(hal, script)
        hal.write(Outputs(v=v, omega=omega), 1.0)
        (drive, steer) = orders_in(await script.sent())
        if expected[0] is not None:
            command, value = expected[0]
            if command is PacketId.SET_RPM and abs(value) < 1e6:
                value /= circumference
            assert drive == (command, round(value))
        assert steer == expected[1]
        hal.write(Outputs(v=0.0, omega=omega), 1.1)
        assert orders_in(await script.sent()) == [rest, (PacketId.SET_SERVO_POS, before[1][1])], "and it rests again"

    scripted(look, **options)


def test_a_curve_is_steered_by_its_curvature() -> None:
    geometry = config().geometry

    async def look(hal: VescHal, script: Script) -> None:
        await settle(hal, script)
        for share in (0.5, -0.25):
            hal.write(Outputs(v=2.0, omega=2.0 * geometry.curvature(share)), 1.0)
            assert orders_in(await script.sent())[1] == (PacketId.SET_SERVO_POS, round(500 + 400 * share))

    scripted(look)


def test_an_emergency_stop_brakes_with_all_the_motor_has_until_a_speed_is_commanded() -> None:
    async def look(hal: VescHal, script: Script) -> None:
        await settle(hal, script)
        hal.write(Outputs(v=1.0), 1.0)
        await script.sent()
        hal.halt(Outputs(), 1.0)
        assert orders_in(await script.sent()) == [FULL_BRAKE], "at once, without waiting for the next tick"
        hal.write(Outputs(), 1.02)
        assert orders_in(await script.sent()) == [FULL_BRAKE, STRAIGHT]
        hal.write(Outputs(v=1.0), 1.04)
        assert orders_in(await script.sent())[0][0] is PacketId.SET_RPM
        hal.write(Outputs(), 1.06)
        assert orders_in(await script.sent()) == [BRAKED, STRAIGHT]
        hal.halt(Outputs(), 1.08)
        await hal.close()
        assert set(orders_in(await script.sent())) == {FULL_BRAKE, STRAIGHT}
        await hal.open()
        hal.write(Outputs(), 0.0)
        assert orders_in(await script.sent()) == [BRAKED, STRAIGHT], "another run knows nothing of it"

    scripted(look)


@pytest.mark.parametrize(("brake", "rest"), [(5.0, BRAKED), (0.0, ROLLS)])
def test_closing_leaves_the_motor_without_power(brake: float, rest: tuple[PacketId, int]) -> None:
    async def look(hal: VescHal, script: Script) -> None:
        await settle(hal, script)
        hal.write(Outputs(v=1.0), 1.0)
        await script.sent()
        await hal.close()
        sent = orders_in(await script.sent())
        assert sent[:2] == [rest, STRAIGHT] and set(sent) == {rest, STRAIGHT}

    scripted(look, brake=brake)


def test_firmware_and_settings_are_asked_for_each_second_until_known() -> None:
    values, firmware, settings = b"\x04", b"\x00", b"\x11"

    async def look(hal: VescHal, script: Script) -> None:
        async def asked() -> list[bytes]:
            hal.write(Outputs(), 0.0)
            return [each for each in await script.sent() if len(each) == 1]

        assert await asked() == [values, firmware, settings]
        await asyncio.sleep(0.98)
        assert await asked() == [values]
        await asyncio.sleep(0.02)
        assert await asked() == [values, firmware, settings]
        await script.tell(b"\x00\x06\x05")
        await asyncio.sleep(1.0)
        assert await asked() == [values, firmware, settings], "the settings are not known"
        script.link.close()
        await asyncio.sleep(0.5)
        assert await asked() == [values, firmware, settings], "at once: another controller may be there now"
        await script.tell(b"\x00\x06\x05")
        await script.tell(b"\x11" + bytes(5) + (500).to_bytes(4))
        await asyncio.sleep(1.0)
        assert await asked() == [values]
        script.link.close()
        await asyncio.sleep(0.5)
        assert await asked() == [values, firmware, settings]
        await script.tell(b"\x11" + bytes(5) + (500).to_bytes(4))
        await asyncio.sleep(1.0)
        assert await asked() == [values, firmware, settings], "the firmware is not known"

    scripted(look)


@pytest.mark.parametrize(
    ("answers", "text"),
    [
        ([b"\x00\x05\x02"], "VESC with firmware 5.02"),
        ([b"\x00\x06\x05abc"], "VESC with firmware 6.05"),
        ([500, b"\x00\x06\x05"], "VESC with firmware 6.05, stops by itself after 0.5 s"),
        ([b"\x00\x06\x05", 1000], "VESC with firmware 6.05, stops by itself after 1 s"),
        ([b"\x00\x06\x05", 1001], "VESC with firmware 6.05, stops by itself after 1.001 s: set 0.5 s in VESC Tool"),
        ([b"\x00\x06\x05", 0], "VESC with firmware 6.05, never stops by itself: set 0.5 s in VESC Tool"),
        ([b"\x00\x06\x05", 2**31], "VESC with firmware 6.05"),
        ([500], "connected to memory, waiting for answers of the VESC"),
        ([b"\x00\x06"], "connected to memory, waiting for answers of the VESC"),
    ],
)
def test_firmware_and_time_out_are_told_and_a_long_time_out_is_remarked_on(
    answers: list[bytes | int], text: str
) -> None:
    async def look(hal: VescHal, script: Script) -> None:
        for each in answers:
            await script.tell(each if isinstance(each, bytes) else b"\x11" + bytes(5) + each.to_bytes(4))
        link = hal.read(0.0).link
        assert link is not None
        told, _, advice = link.text.partition(", App Settings, General")
        assert (told, advice) == (text, "")

    scripted(look)


@pytest.mark.parametrize("major", [0, 3, 4])
def test_firmware_before_5_ends_the_run(major: int) -> None:
    async def look(hal: VescHal, script: Script) -> None:
        await script.tell(bytes((0, major, 99)))
        with pytest.raises(HalError, match=rf"firmware {major}\.99: update it with VESC Tool: 5 and 6 are spoken"):
            hal.read(0.0)

    scripted(look)


def test_the_battery_is_told_with_the_time_of_its_report_and_is_never_negative() -> None:
    async def look(hal: VescHal, script: Script) -> None:
        assert (hal.read(0.0).batteries, hal.read(0.0).odometry) == (None, None)
        await asyncio.sleep(0.25)
        await script.values(volts=126)
        await asyncio.sleep(0.25)
        told = hal.read(0.5)
        assert (told.batteries, told.battery_time, told.odometry_time) == ((12.6, 0.0), 0.25, 0.25)
        assert told.link is not None
        assert "fault" not in told.link.text
        await script.values(volts=-1)
        assert hal.read(0.5).batteries == (0.0, 0.0)
        script.link.close()
        await asyncio.sleep(0.2)
        told = hal.read(0.7)
        assert (told.batteries, told.odometry, told.odometry_time) == (None, Odometry(), 0.5), "of a line that was lost"

    scripted(look)


def test_damage_of_all_lines_is_counted() -> None:
    async def look(hal: VescHal, script: Script) -> None:
        def damaged() -> int:
            link = hal.read(0.0).link
            assert link is not None
            return link.faults["line_damaged"]

        assert damaged() == 0
        script.link.write(b"\x01")
        await script.sent()
        assert damaged() == 1
        script.link.write(b"\x01\x02\x07")  # and half a packet
        await script.sent()
        script.link.close()
        await asyncio.sleep(0.2)
        assert damaged() == 2
        await script.values()
        assert damaged() == 2, "the half packet is forgotten"
        script.link.write(b"\x01")
        await script.sent()
        assert damaged() == 3

    scripted(look)


@pytest.mark.parametrize(
    ("before", "fault", "reason"),
    [
        (False, 2, "under-voltage"),
        (True, 2, "under-voltage"),
        (True, 99, "code 99"),
    ],
)
def test_a_controller_with_a_fault_is_lost_until_the_fault_is_gone(before: bool, fault: int, reason: str) -> None:
    async def look(hal: VescHal, script: Script) -> None:
        if before:
            await settle(hal, script)
        for _ in range(30):
            await script.values(fault=fault)
            await asyncio.sleep(0.02)
        link = hal.read(2.0).link
        assert link is not None
        assert (link.ready, link.losses, link.text) == (False, int(before), f"the VESC reports a fault: {reason}")
        await script.values(fault=3)
        link = hal.read(2.0).link
        assert link is not None and link.text == "the VESC reports a fault: gate driver", "the newest is told"
        hal.write(Outputs(v=1.0), 2.0)
        assert orders_in(await script.sent())[0] == BRAKED
        await settle(hal, script)
        link = hal.read(3.0).link
        assert link is not None and link.ready

    scripted(look)


def test_every_fault_of_the_firmware_is_told_in_words() -> None:
    async def look(hal: VescHal, script: Script) -> None:
        told = []
        for code in range(1, 34):
            await script.values(fault=code)
            link = hal.read(0.0).link
            assert link is not None
            told.append(link.text.removeprefix("the VESC reports a fault: "))
        assert told == list(vesc.FAULTS.values()), "each code has words"
        assert (told[0], told[9], told[23]) == (
            "over-voltage",
            "restarted by its watchdog",
            "settings of the motor lost",
        )

    scripted(look)


COUNT = 6 * VescOptions().pole_pairs * VescOptions().gear
"""Counts of the tachometer in a turn of the wheels."""


@pytest.mark.parametrize("backwards", [False, True])
@pytest.mark.parametrize(
    ("first", "second", "moved"),
    [
        ((0, 0), (200, 200), 200),
        ((200, 200), (50, 350), -150),
        ((2**31 - 50, 2**31 - 50), (-(2**31) + 50, -(2**31) + 50), 100),  # the counters run over
        ((-(2**31) + 50, 7), (2**31 - 50, 107), -100),
        ((200, 200), (200, 200), 0),
        ((200, 200), (201, 199), None),  # the path without sign never gets shorter
        ((0, 0), (-200, -1), None),
        ((0, 0), (900, 900), None),  # 2.1 m between two reports
        ((0, 0), (-900, 900), None),
        ((0, 0), (800, 800), 800),  # 1.9 m
    ],
)
def test_the_tachometer_moves_the_car_and_a_leap_is_a_restart(
    first: tuple[int, int], second: tuple[int, int], moved: int | None, backwards: bool
) -> None:
    length = config().geometry.circumference / COUNT * (-1.0 if backwards else 1.0)

    async def look(hal: VescHal, script: Script) -> None:
        await script.values(*first)
        before = hal.read(1.0)
        assert before.odometry is not None and before.link is not None
        await script.values(*second, erpm=900)
        after = hal.read(1.0)
        assert after.odometry is not None and after.link is not None
        assert after.odometry.x - before.odometry.x == pytest.approx((moved or 0) * length)
        assert after.odometry.v == pytest.approx(900 / 60 * 6 * length)
        restarts = after.link.losses - before.link.losses
        assert restarts == (moved is None)
        assert ("restarted: its tachometer started again at 0" in after.link.reason) == (moved is None)

    scripted(look, backwards=backwards)


def test_the_pose_of_a_new_run_begins_at_the_origin_and_turns_with_the_steering() -> None:
    geometry = config().geometry

    async def look(hal: VescHal, script: Script) -> None:
        await settle(hal, script)
        hal.write(Outputs(v=1.0, omega=geometry.curvature(0.5)), 1.0)
        await script.values(100, 100)
        told = hal.read(1.0).odometry
        assert told is not None
        assert told.theta == pytest.approx(100 * geometry.circumference / COUNT * geometry.curvature(0.5))
        await hal.close()
        await hal.open()
        await script.values(300, 300)
        hal.read(0.0)
        assert hal.read(0.0).odometry == Odometry()

    scripted(look)


def test_the_vesc_says_what_it_can_do() -> None:
    made = config()
    hal = VescHal(Script(), VescOptions(gear=3.0), made.geometry, lambda end: end)
    told = hal.capabilities
    assert (told.odometry, told.battery, told.halt, told.pwm, told.ticks, told.simulated) == (
        True, True, True, False, False, False,
    )  # fmt: skip
    assert hal.own_channels == VescOptions(gear=3.0)


@pytest.mark.parametrize("trouble", ["killed", "fault"])
def test_a_controller_in_trouble_is_told_and_its_port_stays_open_as_it_answers(trouble: str) -> None:
    hal, port = on_the_desk()

    async def drive() -> None:
        async with Robot.open(hal, config=config()) as robot:
            await robot.linked(5.0)
            robot.arm()
            robot.command(0.4, 0.0)
            await asyncio.sleep(0.2)
            assert port.device is not None
            setattr(port.device, trouble, 5 if trouble == "fault" else True)
            await asyncio.sleep(30.0)
            assert not robot.armed
            board = robot.runtime.state.board
            assert board is not None
            words = {"killed": "the VESC's kill switch is on", "fault": "transistors too hot"}
            assert words[trouble] in board.reason
            assert (board.ready, board.losses, board.faults["reconnects"]) == (False, 1, 0)
            setattr(port.device, trouble, 0)
            await robot.linked(5.0)
            assert not robot.armed, "it is there again, and nobody has armed it"

    run(drive(), speed="max")

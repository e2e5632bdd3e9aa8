"""The example that makes somebody else's simulator a car: its frames, its laser, and a drive in IR-SIM."""

from __future__ import annotations

import ast
from pathlib import Path
from typing import Any

import pytest

from txt1.protocol.decoder import Decoder
from txt1.protocol.layout import Role, encode
from txt1.protocol.messages import PidResponse, Velocity
from txt1.sensors.laser_ld19 import Ld19Decoder

FOLDER = Path(__file__).parents[2] / "examples" / "simulator"
PROGRAM = FOLDER / "irsim_car.py"


@pytest.fixture(scope="module")
def bridge() -> dict[str, Any]:
    """Its imports but the simulator, its constants and its functions, without the run."""
    kept = [
        each
        for each in ast.parse(PROGRAM.read_text()).body
        if isinstance(each, ast.FunctionDef | ast.ImportFrom)
        or (isinstance(each, ast.Import) and each.names[0].name != "irsim")
    ]
    names: dict[str, Any] = {}
    exec(compile(ast.Module(kept, []), str(PROGRAM), "exec"), names)
    return names


def test_it_has_at_most_60_lines_of_code() -> None:
    assert sum(bool(line.strip()) for line in PROGRAM.read_text().splitlines()) <= 60


def test_its_frames_are_those_of_the_wire(bridge: dict[str, Any]) -> None:
    sent = encode(Velocity(0.5, 0.75))
    assert bridge["frame"](0x67, sent[4:-2]) == sent
    assert Decoder(Role.HOST).feed(bridge["frame"](0x70, b"\x3c")) == [PidResponse(True)]


def test_it_finds_frames_in_noise_and_piece_by_piece(bridge: dict[str, Any]) -> None:
    one, two = encode(Velocity(0.5, 0.75)), encode(Velocity(-0.25, 0.0))
    damaged = one[:-1] + bytes((one[-1] ^ 1,))
    stream, found = bytearray(), []
    for byte in b"\xfa\x00" + one + b"\xfa\xfb\xff" + damaged + two + bytes(300):
        stream.append(byte)
        found += bridge["frames"](stream)
    assert found == [(0x67, one[4:-2]), (0x67, two[4:-2])]


def test_its_laser_is_an_ld19_whose_beams_point_where_the_simulator_s_do(bridge: dict[str, Any]) -> None:
    # the simulator's beams: anticlockwise from straight behind
    ranges = [4.0] * 360
    ranges[180], ranges[270], ranges[90] = 1.0, 2.0, 3.0
    decoder, scans = Ld19Decoder(), []
    for turn in range(4):
        for packet in bridge["turn"](ranges, 100.0 * turn):
            scans += decoder.feed(packet)
    scan = scans[-1].value
    seen = {round(-k * scan.angle_step, 1): float(each) for k, each in enumerate(scan.ranges) if each < 4.0}
    assert seen == pytest.approx({0.0: 1.0, 1.6: 3.0, 4.7: 2.0}), "ahead 1 m, right 3 m, left 2 m"

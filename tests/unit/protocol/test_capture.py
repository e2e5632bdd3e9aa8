"""A capture in words and as JSON."""

from __future__ import annotations

import json

import pytest

from txt1.errors import CaptureError, Txt1Error
from txt1.protocol.capture import as_dict, decode, describe, read_hex, summary
from txt1.protocol.decoder import Decoder
from txt1.protocol.layout import Role, encode
from txt1.protocol.messages import PidSet, PowerControl, Switch, Velocity

STREAM = (
    b"\0"
    + encode(Velocity(0.5, -0.75))
    + b"\xfa\xfb\x05\x67"
    + encode(PowerControl(Switch.ESC, True))
    + encode(PidSet((11.0, 18.0, 0.25), ((-0.15, 1.0, 30.0, 0.005),)))
    + b"\xfa\xfb\x04"
)


def test_a_capture_is_one_line_per_message_and_fault_with_its_offset() -> None:
    decoder = Decoder(Role.BOARD)
    lines = [describe(*each) for each in decode(decoder, (STREAM[k : k + 3] for k in range(0, len(STREAM), 3)))]
    assert lines == [
        "       1  Velocity  v=0.5 omega=-0.75",
        "      11  fault: bad length  [FA FB 05 67]",
        "      15  PowerControl  switch=ESC on=True",
        "      23  PidSet  linear=[11.0, 18.0, 0.25] angular=[[-0.15, 1.0, 30.0, 0.005]]",
        "      57  fault: expired  [FA FB 04]",
    ]
    assert summary(decoder) == (
        "60 bytes, 1 Velocity, 1 PowerControl, 1 PidSet, 1 bad length, 1 expired, 8 bytes in no frame"
    )


def test_json_has_offset_type_and_fields() -> None:
    events = list(decode(Decoder(Role.BOARD), [STREAM]))
    assert [as_dict(*each) for each in events] == [
        {"offset": 1, "type": "Velocity", "v": 0.5, "omega": -0.75},
        {"offset": 11, "type": "FrameFault", "reason": "bad length", "head": "FA FB 05 67"},
        {"offset": 15, "type": "PowerControl", "switch": "ESC", "on": True},
        {"offset": 23, "type": "PidSet", "linear": [11.0, 18.0, 0.25], "angular": [[-0.15, 1.0, 30.0, 0.005]]},
        {"offset": 57, "type": "FrameFault", "reason": "expired", "head": "FA FB 04"},
    ]
    assert all(json.loads(json.dumps(as_dict(*each))) == as_dict(*each) for each in events)


@pytest.mark.parametrize(
    "text",
    [
        "FA FB 04 67 01 F4 02 EE 5B ED",
        "fafb0467 01f402ee5bed",
        "  0xFA,0xFB, 0x04 0x67\n\n\t01F4 0x02EE  # the check value\n5B\r\nED\n",
        "# nothing\nFAFB046701F402EE5BED",
    ],
)
def test_hexadecimal_text_is_read_however_it_is_set(text: str) -> None:
    assert b"".join(read_hex(text.splitlines(keepends=True))) == encode(Velocity(0.5, 0.75))


@pytest.mark.parametrize(
    ("text", "line", "column", "what"),
    [
        ("FA FB\n04 6G", 2, 5, "'G' is no hexadecimal digit"),
        ("FA FB FA FX", 1, 11, "'X' is no hexadecimal digit"),
        ("0xFA 0xZZ", 1, 8, "'Z' is no hexadecimal digit"),
        ("\n\n  FAF", 3, 3, "'FAF' ends in half a byte"),
        ("A FA", 1, 1, "'A' ends in half a byte"),
        ("FA 0x", 1, 4, "'0x' ends in half a byte"),
        ("FA ٣٣", 1, 4, "is no hexadecimal digit"),
    ],
)
def test_what_is_no_hexadecimal_text_is_named_with_line_and_column(
    text: str, line: int, column: int, what: str
) -> None:
    with pytest.raises(CaptureError, match=what) as caught:
        list(read_hex(text.splitlines()))
    assert str(caught.value).startswith(f"line {line}, column {column}: ")
    assert isinstance(caught.value, Txt1Error)

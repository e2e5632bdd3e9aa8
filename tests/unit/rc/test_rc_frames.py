"""The frames of radio control receivers: other people's published bytes judge what is read."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from txt1.rc.frames import CRSF_CHANNELS, CrsfDecoder, RcFrame, SbusDecoder, crc8, crsf_frame, telemetry, unpack
from txt1.rc.virtual_receiver import packed, sbus_frame

# ArduPilot's libraries/AP_RCProtocol/examples/RCProtocolTest/RCProtocolTest.cpp: sbus_bytes, and the pulses that it
# expects, which begin at 875 us where the makers' begin at 880
ARDUPILOT = bytes.fromhex("0F4C1C5F323438DD89830F7C") + bytes(13)
ARDUPILOTS = (1562, 1496, 1000, 1531, 1806, 2006, 1495, 1495, *(875,) * 8)

# Betaflight's src/test/unit/rx_crsf_unittest.cc: two captured frames, the first channels that it expects, raw, and
# their pulses
BETAFLIGHT = (
    bytes.fromhex("001816BD089FF4AEF7BDEF7DEFFBADFD452B5A0100000000006C"),
    bytes.fromhex("001816BD089FF4AAF7BDEF7DEFFBADFD452B5A01000000000094"),
)
BETAFLIGHTS = (999, 1501, 1492, 1495)
# ... and its frame of another kind, whose checksums it checks
NEGOTIATION = bytes.fromhex("C80C32C8EC0A7001001E84802272")
# example of kielerrr/CRSFv2-elrs, README.md
ELRS = bytes.fromhex("ee1816e1e3de09c7d78a56800f7ce0031ff8c0073ef0810f7c36")


def test_ardupilots_bytes_of_sbus_have_the_channels_that_it_expects() -> None:
    first, second = SbusDecoder().feed(ARDUPILOT * 2)
    assert first == second and first.lost is False and first.pulses is not None
    assert [pulse - 5 for pulse in first.pulses] == pytest.approx(ARDUPILOTS, abs=1)


def test_betaflights_captured_frames_of_crsf_have_the_channels_that_it_expects() -> None:
    decoder = CrsfDecoder()
    first, second = decoder.feed(BETAFLIGHT[0] + BETAFLIGHT[1])
    assert first.pulses is not None and second.pulses is not None and decoder.faults == 0
    assert first.pulses[:4] == pytest.approx(BETAFLIGHTS, abs=1.5)
    # its fourth channel is two steps lower in the second frame
    assert second.pulses[:3] == first.pulses[:3] and 1 <= first.pulses[3] - second.pulses[3] <= 2
    assert first.lost is None


def test_other_peoples_checksums_of_crsf_are_right() -> None:
    for frame in (*BETAFLIGHT, NEGOTIATION, ELRS):
        assert crc8(frame[2:-1]) == frame[-1]
    assert CrsfDecoder().feed(NEGOTIATION) == []
    (heard,) = CrsfDecoder().feed(ELRS)
    assert heard.pulses is not None and heard.pulses[8:] == (1500,) * 8


def test_a_frame_that_is_marked_lost_does_not_count_and_a_failsafe_is_a_loss() -> None:
    # bit 2 and bit 3 of the byte before the last, as in ArduPilot's AP_RCProtocol_SBUS.cpp
    def marked(flags: int) -> bytes:
        return ARDUPILOT[:-2] + bytes((flags, 0))

    decoder = SbusDecoder()
    assert len(decoder.feed(ARDUPILOT * 2)) == 2
    assert decoder.feed(marked(0x04)) == []
    assert decoder.feed(marked(0x08)) == decoder.feed(marked(0x0C)) == [RcFrame(None, True)]
    assert len(decoder.feed(marked(0x03))) == 1, "channels 17 and 18"


def test_link_statistics_tell_a_loss_and_are_no_channels() -> None:
    # TBS's crsf.md, frame 0x14: the third byte is the uplink's quality, per cent
    for quality, lost in ((100, False), (1, False), (0, True)):
        assert CrsfDecoder().feed(crsf_frame(0x14, bytes((60, 70, quality, 9, 0, 4, 3, 50, 100, 9)))) == [
            RcFrame(None, lost)
        ]


@given(st.lists(st.integers(0, 0x7FF), min_size=16, max_size=16))
def test_packed_channels_are_read_back(raw: list[int]) -> None:
    pulses = [880 + each * 5 // 8 for each in raw]
    assert unpack(packed([880 + each * 0.625 for each in raw])) == tuple(pulses)


@given(st.binary(max_size=40), st.integers(0, 25), st.data())
def test_after_noise_sbus_is_in_step_within_three_frames(noise: bytes, cut: int, data: st.DataObject) -> None:
    decoder = SbusDecoder()
    decoder.feed(ARDUPILOT * 2 + ARDUPILOT[:cut] + noise)
    found = [each for k in range(5) for each in decoder.feed(ARDUPILOT)]
    assert found[-1].pulses == unpack(ARDUPILOT[1:])


@given(st.binary(max_size=40))
def test_after_noise_crsf_is_in_step_again(noise: bytes) -> None:
    decoder = CrsfDecoder()
    decoder.feed(noise)
    # noise may promise 64 bytes
    found = [each for _ in range(6) for each in decoder.feed(BETAFLIGHT[0])]
    assert found and found[-1].pulses == unpack(BETAFLIGHT[0][3:])


@given(st.integers(0, 23), st.integers(0, 7))
def test_a_flipped_bit_of_crsf_moves_no_stick(at: int, bit: int) -> None:
    frame = bytearray(BETAFLIGHT[0])
    frame[2 + at] ^= 1 << bit
    assert [each for each in CrsfDecoder().feed(bytes(frame)) if each.pulses] == []


def test_frames_may_come_byte_by_byte() -> None:
    sbus, crsf = SbusDecoder(), CrsfDecoder()
    assert sum(len(sbus.feed(bytes((byte,)))) for byte in ARDUPILOT * 3) == 3
    assert sum(len(crsf.feed(bytes((byte,)))) for byte in BETAFLIGHT[0] + ELRS) == 2


def test_the_virtual_receivers_frames_are_those_of_others() -> None:
    pulses = [pulse + 5 for pulse in ARDUPILOTS]
    assert SbusDecoder().feed(sbus_frame(pulses) * 2)[0].pulses == pytest.approx(pulses, abs=1)
    assert crsf_frame(CRSF_CHANNELS, ELRS[3:-1])[1:] == ELRS[1:]


def test_the_telemetry_is_what_another_reader_expects() -> None:
    # the battery: 74 tenths of a volt as crsf-parser 0.3.2 (PyPI) builds them
    battery = bytes.fromhex("c80a08004a00000000000041")
    # the mode: as Betaflight's telemetry_crsf_unittest.cc expects "ACRO", letter by letter
    mode = bytes((0xC8, 7, 0x21, *b"HAND", 0))
    assert telemetry(7.4, "HAND")[:-1] == battery + mode
    assert telemetry(None, "HAND") == telemetry(7.4, "HAND")[len(battery) :]

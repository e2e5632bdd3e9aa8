"""The decoder: what is delivered, what is a fault, and that nothing upsets it (thesis 3.5)."""

from __future__ import annotations

import gc
import os
import random
import tracemalloc
from collections.abc import Iterable
from itertools import pairwise

import protocol_streams as streams
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.examples import examples
from txt1.protocol.decoder import OLD_COMMANDS, Decoder, Event, FrameFault, Reason
from txt1.protocol.layout import Role, checksum, encode
from txt1.protocol.messages import (
    BatteryLevels,
    EncoderOdometry,
    PidResponse,
    PidSet,
    PowerControl,
    PwmCommand,
    Switch,
    Velocity,
)

ONE = encode(Velocity(0.5, 0.75))
TWO = encode(Velocity(-0.5, 0.25))
LONGEST_FRAME = 242
"""Bytes of a PID set with 14 angular sets."""

BYTES_OF_NOISE = int(os.environ.get("FUZZ_BYTES", "200_000"))
"""FUZZ_BYTES=10_000_000 python -m pytest tests/unit/protocol -k grammar takes fifty times as long."""


def listen(role: Role, reads: Iterable[bytes], *, expire: bool = True) -> tuple[Decoder, list[tuple[int, Event]]]:
    """A decoder and its events with their offsets."""
    decoder = Decoder(role)
    heard: list[tuple[int, Event]] = []
    for read in reads:
        heard += zip(*reversed((decoder.feed(read), decoder.offsets)), strict=True)
        assert decoder.pending < LONGEST_FRAME
    if expire:
        heard += zip(*reversed((decoder.expire(), decoder.offsets)), strict=True)
        assert decoder.pending == 0
    return decoder, heard


def messages(heard: list[tuple[int, Event]]) -> list[tuple[int, bytes]]:
    return [(at, encode(event)) for at, event in heard if not isinstance(event, FrameFault)]


def reasons(heard: list[tuple[int, Event]]) -> list[Reason]:
    return [event.reason for _, event in heard if isinstance(event, FrameFault)]


def cut(stream: bytes, places: list[int]) -> list[bytes]:
    edges = [0, *sorted(min(place, len(stream)) for place in places), len(stream)]
    return [stream[start:end] for start, end in pairwise(edges)]


def check_against_the_rule(stream: bytes, role: Role, decoder: Decoder, heard: list[tuple[int, Event]]) -> None:
    """What was delivered is what the rule says, in order, and every byte is accounted for."""
    intact = streams.frames_by_the_rule(stream, role)
    bad_values = {at for at, event in heard if isinstance(event, FrameFault) and event.reason is Reason.BAD_VALUE}
    assert messages(heard) == [(at, frame) for at, frame in intact if at not in bad_values]
    assert bad_values <= {at for at, _ in intact}
    assert [at for at, _ in heard] == sorted(at for at, _ in heard)
    assert all(event.offset == at for at, event in heard if isinstance(event, FrameFault))
    covered = {byte for at, frame in intact for byte in range(at, at + len(frame))}
    assert decoder.skipped == len(stream) - len(covered)
    assert decoder.position == len(stream)
    assert sum(decoder.messages.values()) == len(messages(heard))
    assert {reason: count for reason, count in decoder.faults.items() if count} == {
        reason: reasons(heard).count(reason) for reason in set(reasons(heard))
    }


def test_frames_are_delivered_in_order_each_with_its_last_byte() -> None:
    decoder = Decoder(Role.BOARD)
    for place, byte in enumerate(ONE + TWO):
        events = decoder.feed(bytes([byte]))
        assert events == {9: [Velocity(0.5, 0.75)], 19: [Velocity(-0.5, 0.25)]}.get(place, [])
    assert decoder.messages[Velocity] == 2
    assert decoder.skipped == decoder.pending == 0
    assert decoder.feed(b"") == []
    assert decoder.offsets == []


def test_a_short_frame_does_not_wait_behind_a_long_one_that_came_in_pieces() -> None:
    decoder = Decoder(Role.BOARD)
    switch = encode(PowerControl(Switch.ESC, True))
    assert decoder.feed(ONE[:6]) == []
    assert decoder.feed(ONE[6:]) == [Velocity(0.5, 0.75)]
    assert [decoder.feed(switch[k : k + 1]) for k in range(8)] == [[]] * 7 + [[PowerControl(Switch.ESC, True)]]


def test_what_looks_like_a_header_inside_an_intact_frame_is_no_fault() -> None:
    backwards = Velocity(-1.285, -1.285)  # twice FA FB
    checksum_ends_in_fa = PwmCommand(0xFA00, 0)
    longer = PidSet((-1.285, -1.285, -1.285), ())
    decoder, heard = listen(Role.BOARD, [encode(backwards) + encode(longer) + encode(checksum_ends_in_fa)])
    assert [event for _, event in heard] == [backwards, longer, checksum_ends_in_fa]
    assert not any(decoder.faults.values())
    assert decoder.skipped == 0


@pytest.mark.parametrize("kind", [bytes, bytearray, memoryview])
def test_bytes_come_as_bytes_bytearray_or_memoryview(kind: type) -> None:
    decoder = Decoder(Role.BOARD)
    assert decoder.feed(kind(ONE[:4])) == []
    assert decoder.feed(kind(ONE[4:])) == [Velocity(0.5, 0.75)]


FRAMES = {role: streams.MESSAGES[role].map(encode) for role in Role}
ANY_FRAME = st.one_of(*FRAMES.values())
GARBAGE = st.one_of(
    st.binary(max_size=30),
    st.lists(st.sampled_from([0xFA, 0xFB, 0x70, 0x67, 0x04, 0xEC, 0x0C, 0x01, 0x00]), max_size=20).map(bytes),
    ANY_FRAME.flatmap(lambda frame: st.integers(0, len(frame) - 1).map(lambda end: frame[:end])),
    st.sampled_from([b"\xfa\xfb", b"\xfa\xfb\xff", b"\xfa\xfb\xec\x70", b"\xfa", b"\xfa\xfa\xfb", b"\xfa\xfb\x14\x69"]),
    st.randoms(use_true_random=False).map(lambda rng: streams.nested(ONE, rng)),
)


@pytest.mark.parametrize("role", Role)
@settings(max_examples=examples(80))
@given(st.data())
def test_any_mixture_in_any_pieces_delivers_what_the_rule_says(role: Role, data: st.DataObject) -> None:
    stream = b"".join(data.draw(st.lists(st.one_of(ANY_FRAME, FRAMES[role], GARBAGE), max_size=10)))
    at_once, heard = listen(role, [stream])
    check_against_the_rule(stream, role, at_once, heard)
    pieces = cut(stream, data.draw(st.lists(st.integers(0, len(stream)), max_size=20)))
    for reads in (pieces, [bytes([byte]) for byte in stream]):
        decoder, again = listen(role, reads)
        assert again == heard
        assert (decoder.skipped, decoder.faults) == (at_once.skipped, at_once.faults)
        assert listen(role, reads, expire=False)[1] == listen(role, [stream], expire=False)[1]


@pytest.mark.parametrize("role", Role)
def test_the_rule_holds_on_the_grammar(role: Role) -> None:
    for seed in range(40):
        stream = streams.grammar(random.Random(seed), 600)
        check_against_the_rule(stream, role, *listen(role, [stream]))


@pytest.mark.parametrize("role", Role)
def test_the_grammar_never_raises_and_memory_stays_bounded(role: Role) -> None:
    rng = random.Random(7)
    decoder = Decoder(role)
    fed = delivered = 0
    tracemalloc.start()
    try:
        while fed < BYTES_OF_NOISE // 2:
            stream = streams.grammar(rng, 20_000)
            fed += len(stream)
            place = 0
            while place < len(stream):
                size = rng.choice((1, 7, 64, 1000))
                events = decoder.feed(stream[place : place + size])
                place += size
                delivered += sum(not isinstance(event, FrameFault) for event in events)
                assert len(events) == len(decoder.offsets)
                assert decoder.pending < LONGEST_FRAME
            if rng.random() < 0.3:
                delivered += sum(not isinstance(event, FrameFault) for event in decoder.expire())
        del events, stream
        gc.collect()  # empties the interpreter's own store of used tuples, too
        held, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert held < 20_000
    assert decoder.position == fed
    assert sum(decoder.messages.values()) == delivered > fed / 1000


@pytest.mark.parametrize(
    "unit", [b"\xfa\xfb\xf9", b"\xfa", b"\xfa\xfb", b"\xfa\xfb\xec\x70", b"\xfa\xfb\x14\x69", b"\0"]
)
def test_hostile_streams_hold_back_less_than_a_frame(unit: bytes) -> None:
    stream = unit * (50_000 // len(unit))
    decoder, _ = listen(Role.BOARD, (stream[start : start + 37] for start in range(0, len(stream), 37)))
    assert decoder.skipped == len(stream)
    assert decoder.pending < LONGEST_FRAME


@pytest.mark.parametrize(
    "prefix", [b"\xfa", b"\xfa\xfb", b"\xfa\xfb\xff", b"\xfa\xfb\x04", b"\xfa\xfb\x04\x67", b"\xfa\xfa"]
)
def test_a_false_header_before_a_stream_of_velocities_costs_nothing(prefix: bytes) -> None:
    stream = prefix + b"".join(encode(Velocity(0.1 * k, -0.1 * k)) for k in range(20))
    _, heard = listen(Role.BOARD, [stream], expire=False)
    assert [event for _, event in heard if not isinstance(event, FrameFault)] == [
        Velocity(round(0.1 * k, 3), round(-0.1 * k, 3)) for k in range(20)
    ]


def test_a_false_header_of_the_longest_frame_only_delays() -> None:
    stream = b"\xfa\xfb\xec\x70" + ONE * 30
    _, heard = listen(Role.BOARD, [stream], expire=False)
    assert len(messages(heard)) == 30
    assert reasons(heard) == [Reason.BAD_CHECKSUM]
    decoder = Decoder(Role.BOARD)
    assert decoder.feed(stream[:44]) == []
    assert decoder.expire()[1:] == [Velocity(0.5, 0.75)] * 4


def test_an_illegal_length_and_command_are_refused_with_the_fourth_byte() -> None:
    for role in Role:
        for length in range(256):
            for command in (0x00, *range(0x60, 0x78), 0xFA, 0xFB, 0xFF):
                decoder = Decoder(role)
                assert decoder.feed(bytes([0xFA, 0xFB, length])) == []
                events = decoder.feed(bytes([command]))
                legal = length in streams.LENGTHS[role].get(command, ())
                assert len(events) == (not legal)
                if legal:
                    assert decoder.pending == 4
                elif (length, command) in OLD_COMMANDS:
                    assert events == [FrameFault(Reason.OLD_COMMAND, 0, bytes([0xFA, 0xFB, length, command]))]
                elif command in streams.LENGTHS[role] or length > 249:
                    assert events == [FrameFault(Reason.BAD_LENGTH, 0, bytes([0xFA, 0xFB, length, command]))]
                else:
                    assert events == [FrameFault(Reason.UNKNOWN_COMMAND, 0, bytes([0xFA, 0xFB, length, command]))]


def test_the_same_command_means_a_pid_set_one_way_and_its_response_the_other() -> None:
    question, answer = encode(PidSet((1.0, 2.0, 3.0), ())), encode(PidResponse(True))
    assert question[3] == answer[3] == 0x70
    assert [event for _, event in listen(Role.BOARD, [answer + question])[1]] == [
        FrameFault(Reason.BAD_LENGTH, 0, answer[:4]),
        PidSet((1.0, 2.0, 3.0), ()),
    ]
    assert [event for _, event in listen(Role.HOST, [question + answer])[1]] == [
        FrameFault(Reason.BAD_LENGTH, 0, question[:4]),
        PidResponse(True),
    ]


def test_a_wrong_checksum_is_a_fault_and_the_next_frame_is_delivered() -> None:
    broken = ONE[:-1] + bytes([ONE[-1] ^ 1])
    decoder, heard = listen(Role.BOARD, [broken + TWO])
    assert heard == [(0, FrameFault(Reason.BAD_CHECKSUM, 0, broken[:8])), (10, Velocity(-0.5, 0.25))]
    assert decoder.faults[Reason.BAD_CHECKSUM] == 1
    assert decoder.skipped == 10


def test_a_lost_byte_costs_its_own_frame_alone() -> None:
    for missing in range(len(ONE)):
        stream = TWO + ONE[:missing] + ONE[missing + 1 :] + TWO + TWO
        _, heard = listen(Role.BOARD, [stream])
        assert [event for _, event in heard if not isinstance(event, FrameFault)] == [Velocity(-0.5, 0.25)] * 3


@pytest.mark.parametrize(
    ("role", "body"),
    [
        (Role.BOARD, b"\x6e\x02\x01"),
        (Role.BOARD, b"\x6e\xff\x00"),
        (Role.BOARD, b"\x6e\x01\x02"),
        (Role.HOST, b"\x70\x00"),
        (Role.HOST, b"\x70\x3d"),
    ],
)
def test_a_byte_that_stands_for_nothing_is_a_bad_value_in_an_intact_frame(role: Role, body: bytes) -> None:
    check = (body[0] << 8 | body[1]) ^ (body[2] if len(body) == 3 else 0)
    frame = bytes([0xFA, 0xFB, len(body) - 1]) + body + check.to_bytes(2, "big")
    after = ONE if role is Role.BOARD else encode(PidResponse(True))
    decoder, heard = listen(role, [frame + after])
    assert heard[0] == (0, FrameFault(Reason.BAD_VALUE, 0, frame[:8]))
    assert [at for at, _ in heard] == [0, len(frame)]
    assert decoder.skipped == 0
    assert sum(decoder.messages.values()) == 1


@pytest.mark.parametrize(("length", "command"), sorted(OLD_COMMANDS))
@pytest.mark.parametrize("role", Role)
def test_the_old_commands_are_counted_and_disturb_nothing(role: Role, length: int, command: int) -> None:
    after = encode(PowerControl(Switch.ESC, True) if role is Role.BOARD else BatteryLevels(12.0, 11.0))
    old = bytes([0xFA, 0xFB, length, command, *range(length), 0x12, 0x34])
    decoder, heard = listen(role, [(old + after) * 3])
    assert decoder.faults == {**dict.fromkeys(Reason, 0), Reason.OLD_COMMAND: 3}
    assert len(messages(heard)) == 3
    assert decoder.skipped == 3 * len(old)


def test_a_frame_inside_a_longer_valid_one_is_data() -> None:
    outer = streams.nested(ONE, random.Random(2))
    assert streams.frame_at(outer, 0, Role.BOARD)
    assert ONE in outer
    decoder, heard = listen(Role.BOARD, [outer])
    assert [at for at, _ in heard] == [0]
    assert decoder.messages == {**dict.fromkeys(decoder.messages, 0), PidSet: 1}


def test_of_two_valid_frames_that_overlap_both_are_delivered() -> None:
    # The first one's last byte FA (6F00 + 00FA) and an FB behind it are the header of the second.
    first = encode(PwmCommand(0xFA00, 0))
    assert first[-2:] == b"\x6f\xfa"
    second = encode(PwmCommand(5, 6))
    decoder, heard = listen(Role.BOARD, [first + second[1:]])
    assert heard == [(0, PwmCommand(0xFA00, 0)), (len(first) - 1, PwmCommand(5, 6))]
    assert decoder.skipped == 0


@pytest.mark.parametrize("end", range(1, len(ONE)))
def test_a_half_frame_expires_and_nothing_of_it_is_left(end: int) -> None:
    decoder = Decoder(Role.BOARD)
    assert decoder.feed(TWO + ONE[:end]) == [Velocity(-0.5, 0.25)]
    assert decoder.pending == end
    assert decoder.expire() == [FrameFault(Reason.EXPIRED, 10, ONE[:end][:8])]
    assert decoder.offsets == [10]
    assert (decoder.pending, decoder.skipped, decoder.faults[Reason.EXPIRED]) == (0, end, 1)
    assert decoder.expire() == []
    assert decoder.feed(ONE[end:]) == []
    assert decoder.feed(ONE) == [Velocity(0.5, 0.75)]
    assert decoder.offsets == [20]


def test_expiry_delivers_what_a_false_header_held_up_and_gives_up_on_the_rest() -> None:
    decoder = Decoder(Role.BOARD)
    assert decoder.feed(b"\xfa\xfb\xec\x70" + ONE + b"\0" + TWO + ONE[:5]) == []
    assert decoder.expire() == [
        FrameFault(Reason.EXPIRED, 0, b"\xfa\xfb\xec\x70" + ONE[:4]),
        Velocity(0.5, 0.75),
        Velocity(-0.5, 0.25),
        FrameFault(Reason.EXPIRED, 25, ONE[:5]),
    ]
    assert decoder.offsets == [0, 4, 15, 25]
    assert decoder.skipped == 10


def test_silence_between_frames_is_no_fault() -> None:
    decoder = Decoder(Role.HOST)
    frame = encode(EncoderOdometry(1.0, 2.0, 0.5, 0.1, 0.2))
    for _ in range(5):
        assert len(decoder.feed(frame + b"\0")) == 1
        assert decoder.expire() == []
    assert decoder.skipped == 5
    assert not any(decoder.faults.values())


def test_a_new_decoder_knows_its_end_and_holds_nothing() -> None:
    decoder = Decoder(Role.BOARD)
    assert (decoder.role, decoder.position, decoder.offsets, decoder.pending, decoder.skipped) == (
        Role.BOARD,
        0,
        [],
        0,
        0,
    )


def test_a_switch_that_there_is_not_is_told_with_its_place_in_the_stream() -> None:
    frame = bytearray(encode(PowerControl(Switch.ESC, True)))
    frame[4] = 7
    frame[-2:] = checksum(frame[3:-2]).to_bytes(2, "big")
    decoder = Decoder(Role.BOARD)
    decoder.feed(b"noise")
    _, fault = decoder.feed(ONE + bytes(frame))
    assert fault == FrameFault(Reason.BAD_VALUE, 15, bytes(frame[:8]))
    assert decoder.offsets == [5, 15]

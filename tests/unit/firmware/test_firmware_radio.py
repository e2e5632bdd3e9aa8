"""A radio control at the firmware: the same rule as at the computer, also while the host hangs, dies or floods."""

from __future__ import annotations

import random
from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from txt1pico import facts, radio, store
from txt1pico.core import Core

from tests.examples import examples
from tests.unit.firmware.test_firmware_core import GAINS, Small
from tests.unit.rc.test_rc_frames import ARDUPILOT, BETAFLIGHT, ELRS
from txt1.control.hand import DEFAULT_HAND
from txt1.protocol.decoder import Decoder
from txt1.protocol.layout import Role, encode
from txt1.protocol.messages import EncoderOdometry, Message, PowerControl, PwmTest, Switch, Velocity
from txt1.protocol.radio_control import RcPermit, RcReport
from txt1.rc.frames import CRSF_CHANNELS, CRSF_STATISTICS, CrsfDecoder, SbusDecoder, crsf_frame, telemetry
from txt1.rc.settings import firmware_settings
from txt1.rc.take_over import RcState, TakeOver
from txt1.rc.virtual_receiver import STEERING, SWITCH, THROTTLE, packed, sbus_frame

STATES = (RcState.LOST, RcState.WAITING, RcState.DRIVES, RcState.HALF_WAY, RcState.COMPUTER)
PLACES = {"hand": 2000, "half way": 1500, "computer": 1000}
DT = 0.02


def given_to(protocol: str = "crsf") -> dict[str, Any]:
    """The firmware's settings of the virtual transmitter."""
    lines: dict[str, Any] = {"pins": [20, 21, 22]} if protocol == "pwm" else {"uart": 1, "rx_pin": 9, "tx_pin": 8}
    rows = firmware_settings(THROTTLE, STEERING, SWITCH)
    return {"protocol": protocol, **lines, **{name: rows[name] for name in ("throttle", "steering", "switch")}}


class Car:
    """A core with a radio control and a host, and wheels that follow its motor."""

    def __init__(self, protocol: str = "crsf") -> None:
        self.hand = radio.Radio(store.check({"receiver": given_to(protocol)})["receiver"])
        self.core = Core(hand=self.hand)
        self.decoder, self.heard = Decoder(Role.HOST), list[Any]()
        self.protocol, self.throttle, self.steering, self.switch, self.on = protocol, 1500, 1480, "hand", True
        data = encode(GAINS)
        self.core.receive(data, len(data))

    def frame(self) -> bytes:
        """What the receiver sends in a cycle."""
        pulses = [self.steering, self.throttle, 1500, 1500, PLACES[self.switch], *(1500,) * 11]
        if self.protocol == "sbus":
            return sbus_frame(pulses)
        return crsf_frame(CRSF_CHANNELS, packed(pulses))

    def run(self, seconds: float, host: Callable[[int], list[Message | bytes]] = lambda k: []) -> None:
        """Let time pass; `host` returns what the host sends in a cycle."""
        for k in range(round(seconds / DT)):
            for message in host(k):
                data = message if isinstance(message, bytes) else encode(message)
                for at in range(0, len(data), 500):
                    self.core.receive(data[at : at + 500], len(data[at : at + 500]))
            if self.on and self.protocol == "pwm":
                self.hand.pulses(self.throttle, self.steering, PLACES[self.switch])
            elif self.on:
                data = self.frame()
                self.hand.receive(data, len(data))
            wheel = int(self.core.outputs[0] / 150)
            self.core.step(wheel, wheel, 12000, 0, 0, 1)
            transmitter = self.core.transmitter
            self.heard += self.decoder.feed(bytes(transmitter.buffer[: transmitter.length]))
            transmitter.length = 0

    @property
    def moves(self) -> bool:
        return any(self.core.outputs[:3])


def commands(v: float) -> Callable[[int], list[Message | bytes]]:
    """A host that commands a speed 20 times a second."""
    return lambda k: [Velocity(v, 0.0)] if k % 5 in (0, 2) else []


def floods(k: int) -> list[Message | bytes]:
    """A host that floods the line with commands of full speed, and with noise."""
    noise = random.Random(k).randbytes(200)
    return [Velocity(1.5, 0.0), noise] * 5 + [Velocity(-1.5, 1.0), PwmTest(8000, 0, 0, 0, 0)] * 5


HOSTS: dict[str, Callable[[int], list[Message | bytes]]] = {
    "dead": lambda k: [],
    "drives on": commands(0.8),
    "floods": floods,
}


@pytest.mark.parametrize("protocol", radio.PROTOCOLS)
@pytest.mark.parametrize("host", HOSTS)
def test_the_hand_takes_over_and_stops_whatever_the_host_does(protocol: str, host: str) -> None:
    car = Car(protocol)
    car.run(0.5)
    car.switch = "computer"
    car.run(3.0, commands(0.0))
    car.run(1.5, commands(0.8))
    assert car.core.armed and car.core.v == 800
    car.switch, car.throttle = "hand", 1000
    car.run(0.06, HOSTS[host])
    assert car.core.v == -1500
    car.throttle = 1500
    car.run(1.5, HOSTS[host])
    assert car.core.v == 0, "the loops brake"
    car.throttle = 1700
    car.run(0.5, HOSTS[host])
    assert 0 < car.core.v < 700 and car.moves
    car.switch = "half way"
    car.run(1.0, HOSTS[host])
    assert car.core.v == 0 and not car.moves


@pytest.mark.parametrize("host", HOSTS)
@pytest.mark.parametrize("switch", PLACES)
def test_a_loss_stops_in_every_position_of_the_switch_whatever_the_host_does(host: str, switch: str) -> None:
    car = Car()
    car.run(3.0, commands(0.0))
    car.switch, car.throttle = switch, 2000
    car.run(1.0, commands(0.0))
    car.run(1.0, HOSTS[host])
    car.on = False
    car.run(0.28, HOSTS[host])
    assert car.hand.state == radio.LOST and not car.moves
    car.run(3.0, HOSTS[host])
    assert not car.moves
    car.on = True
    car.run(3.0, HOSTS[host])
    assert car.hand.state == radio.WAITING and not car.moves
    car.switch, car.throttle = "hand", 1500
    car.run(1.2, HOSTS[host])
    car.throttle = 2000
    car.run(0.3, HOSTS[host])
    assert car.core.v == 1500 and car.moves


def test_at_power_up_nothing_moves_until_the_switch_is_at_hand_at_neutral() -> None:
    car = Car()
    car.switch, car.throttle = "computer", 1500
    car.run(4.0, lambda k: commands(0.0 if k < 120 else 0.5)(k))
    assert not car.moves and car.hand.state == radio.WAITING
    car.switch, car.throttle = "hand", 2000
    car.run(3.0)
    assert not car.moves
    car.throttle = 1500
    car.run(0.3)
    car.throttle = 2000
    car.run(0.3)
    assert car.moves


def test_the_computer_drives_again_only_by_a_fresh_command() -> None:
    car = Car()
    car.run(3.0, commands(0.0))
    car.switch = "computer"
    car.run(1.0, commands(0.5))
    assert not car.moves, "it commanded while the hand had the wheel"
    car.run(0.3, commands(0.0))
    car.run(0.3, commands(0.5))
    assert car.core.v == 500
    car.switch = "hand"
    car.run(0.1, commands(0.5))
    car.switch = "computer"
    car.run(3.0, commands(0.5))
    assert not car.moves


def test_a_stop_of_the_host_binds_the_hand_and_outlives_the_host() -> None:
    car = Car()
    car.run(2.0, commands(0.0))
    car.throttle = 1800
    car.run(0.5)
    assert car.moves
    car.run(1.0, lambda k: [RcPermit(False, True), Velocity(0.0, 0.0)])
    assert not car.moves
    # another host begins, and is not armed
    car.run(1.0, lambda k: [RcPermit(False), Velocity(0.0, 0.0)])
    for switch in ("computer", "hand"):
        car.switch, car.throttle = switch, 1500
        car.run(1.5)
        car.throttle = 1800
        car.run(3.0)
        assert not car.moves, "taking over clears no stop, and the host has died since"
    car.run(0.3, lambda k: [RcPermit(True), Velocity(0.5, 0.0)])
    assert not car.moves, "the stick was held while the host armed"
    car.throttle = 1500
    car.run(1.2)
    car.throttle = 1800
    car.run(0.3)
    assert car.moves


def test_a_host_that_dies_unarmed_frees_the_hand_which_has_to_let_go_first() -> None:
    """It was not armed yet, or hung and lost its arming: nobody has stopped the car."""
    car = Car()
    car.throttle = 1800
    car.run(2.0, lambda k: [RcPermit(False), Velocity(0.0, 0.0)])
    assert not car.moves, "the gate of a host that is heard binds the hand"
    car.run(5.0)
    assert not car.moves, "the stick is held"
    car.throttle = 1500
    car.run(1.5)
    car.throttle = 1800
    car.run(0.3)
    assert car.moves


def test_a_host_that_hangs_unarmed_binds_the_hand_again_when_it_goes_on() -> None:
    car = Car()
    car.run(1.0, lambda k: [RcPermit(False), Velocity(0.0, 0.0)])
    car.run(3.0)
    car.throttle = 1800
    car.run(0.5)
    assert car.moves
    car.run(0.5, lambda k: [RcPermit(False), Velocity(0.0, 0.0)])
    assert not car.moves


def test_an_esc_that_is_off_stays_off_under_the_hand() -> None:
    car = Car()
    car.run(2.0)
    car.throttle = 1800
    car.run(0.3)
    assert car.moves
    car.run(0.5, lambda k: [PowerControl(Switch.ESC, False)])
    assert not car.moves


def test_a_guard_of_a_host_that_is_heard_lowers_the_hand() -> None:
    car = Car()
    car.run(2.0, commands(0.0))
    car.throttle = 2000
    car.run(0.5, lambda k: [RcPermit(True), Velocity(0.4, 0.0)])
    assert car.core.v == 400
    car.run(0.5, lambda k: [RcPermit(True), Velocity(0.0, 0.0)])
    assert car.core.v == 0
    car.run(0.5)
    assert car.core.v == 1500, "it has died, and stopped nothing"


def test_a_host_is_told_who_drives_as_often_as_odometry() -> None:
    car = Car()
    car.throttle = 1500
    car.run(2.0, commands(0.0))
    car.throttle, car.steering = 2000, 1050
    car.run(0.5, commands(0.0))
    report = next(each for each in reversed(car.heard) if isinstance(each, RcReport))
    v, omega = DEFAULT_HAND.velocity(1.5, 1.0, 1.0)
    assert (report.state, report.v) == (radio.HAND, round(1000 * v))
    assert report.omega == pytest.approx(1000 * omega, abs=1)
    assert (
        abs(sum(isinstance(e, RcReport) for e in car.heard) - sum(isinstance(e, EncoderOdometry) for e in car.heard))
        <= 1
    )


def test_a_runaway_under_the_hand_disarms_until_the_throttle_was_let_go_for_a_second() -> None:
    car = Car()
    car.run(2.0)
    car.throttle = 2000
    car.run(0.5)
    car.core.odometry.v = 0
    for _ in range(40):
        data = car.frame()
        car.hand.receive(data, len(data))
        car.core.step(0, 0, 12000, 0, 0, 1)
    assert not car.core.armed and not car.moves
    car.run(2.0)
    assert not car.moves
    car.throttle = 1500
    car.run(1.3)
    car.throttle = 1700
    car.run(0.2)
    assert car.moves


# -- beside the computer's rule and decoders ----------------------------------------------------------------------

FRAMES = st.tuples(
    st.sampled_from([880, 1000, 1200, 1440, 1500, 1520, 1700, 2000, 2101]),
    st.sampled_from([900, 1050, 1480, 1950]),
    st.sampled_from([850, 1000, 1240, 1260, 1500, 1740, 1760, 2000]),
)


@given(st.lists(st.tuples(st.sampled_from(["frame", "lost", "silence", "let go"]), FRAMES), max_size=30))
@settings(max_examples=examples(200))
def test_it_decides_as_the_computers_rule(steps: list[tuple[str, tuple[int, int, int]]]) -> None:
    hand, rule, now = radio.Radio(given_to("pwm")), TakeOver(THROTTLE, STEERING, SWITCH), 0.0
    for what, (throttle, steering, switch) in steps:
        if what == "silence":
            for _ in range(14):
                now += DT
                hand.step(20)
        elif what == "lost":
            lost = bytes((0xC8, 12, CRSF_STATISTICS, *bytes(10)))
            told = crsf_frame(CRSF_STATISTICS, lost[3:])
            hand.receive(told, len(told))
            rule.take(None, True, now)
        elif what == "let go":
            hand.let_go()
            rule.let_go()
        else:
            now += DT
            hand.step(20)
            hand.pulses(Small(throttle), Small(steering), Small(switch))
            pulses = [steering, throttle, 0, 0, switch, *(0,) * 11]
            rule.take(pulses, False, now)
        wish = rule.look(now)
        assert STATES[hand.state] is wish.state
        v, omega = DEFAULT_HAND.velocity(1.5, wish.ahead, wish.left, wheel=True)
        assert hand.v / 1000 == pytest.approx(v, abs=0.003)
        assert hand.omega / 16000 == pytest.approx(omega, abs=0.02)


@given(
    st.sampled_from(["sbus", "crsf"]),
    st.lists(
        st.one_of(
            st.binary(max_size=30),
            st.sampled_from(
                [
                    ARDUPILOT,
                    ARDUPILOT * 2,
                    ARDUPILOT[:-2] + b"\x08\0",
                    ARDUPILOT[:-2] + b"\x04\0",
                    *BETAFLIGHT,
                    ELRS,
                    crsf_frame(CRSF_STATISTICS, bytes(10)),
                    crsf_frame(CRSF_STATISTICS, bytes((1,) * 10)),
                ]
            ),
        ),
        max_size=12,
    ),
)
@settings(max_examples=examples(200))
def test_it_finds_the_frames_that_the_computer_finds(protocol: str, pieces: list[bytes]) -> None:
    hand, told = radio.Radio(given_to(protocol)), []
    hand.take = lambda throttle, steering, switch: told.append((throttle, steering, switch))
    hand.lose = lambda: told.append("lost")
    for piece in pieces:
        hand.receive(piece, len(piece))
    decoder = SbusDecoder() if protocol == "sbus" else CrsfDecoder()
    expected: list[object] = []
    for heard in (each for piece in pieces for each in decoder.feed(piece)):
        if heard.pulses is not None:
            expected.append((heard.pulses[1], heard.pulses[0], heard.pulses[4]))
        elif heard.lost:
            expected.append("lost")
    assert told == expected


def test_the_transmitter_is_told_what_the_computer_would_tell() -> None:
    car = Car()
    car.run(2.0)
    told = bytes(car.hand.telemetry[: car.hand.telemetry_length])
    assert told == telemetry(12.0, "HAND")
    car.run(1.0, lambda k: [RcPermit(False)])
    assert bytes(car.hand.telemetry[: car.hand.telemetry_length]) == telemetry(12.0, "HAND")


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        ({"protocol": "ibus"}, "protocol is one of pwm, sbus, crsf, not 'ibus'"),
        ({"throttle": None}, "it takes throttle"),
        ({"throttle": [0, 1000, 1500, 2000]}, "throttle takes a channel from 1 to 16 and 3 pulses"),
        ({"steering": [1, 1000, 2100, 2000]}, "the pulses of steering do not rise or fall by 200 us"),
        ({"switch": [5, 1500, 1700]}, "the pulses of switch do not rise or fall by 400 us"),
        ({"switch": [2, 1000, 2000]}, "need three different channels"),
        ({"colour": 1}, "unknown setting colour"),
    ],
)
def test_a_receivers_settings_that_cannot_be_are_refused(changed: dict[str, Any], told: str) -> None:
    whole = given_to() | changed
    with pytest.raises(store.SettingsError, match=told):
        store.check({"receiver": {name: value for name, value in whole.items() if value is not None}})


def test_a_fast_hand_stays_within_the_cars_limits() -> None:
    car = Car()
    car.run(2.0)
    car.throttle, car.steering = 2100, 950
    car.run(0.5)
    assert car.core.v == facts.V_MAX
    assert abs(car.core.omega) <= facts.V_MAX * 16000 // facts.RADIUS_MIN

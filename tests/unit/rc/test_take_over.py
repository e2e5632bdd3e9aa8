"""Who drives, by a radio control's switch, sticks and link."""

from __future__ import annotations

import pytest

from txt1.errors import ConfigError
from txt1.rc.settings import RcParameters, take_over
from txt1.rc.take_over import ModeSwitch, RcState, RcWish, Stick, TakeOver
from txt1.rc.virtual_receiver import STEERING, SWITCH, THROTTLE

AT = {"hand": 2000, "half way": 1500, "computer": 1000}


def frame(switch: str = "hand", throttle: int = 1500, steering: int = 1480) -> list[int]:
    """The pulses of a frame."""
    return [steering, throttle, 1500, 1500, AT.get(switch, 0) or int(switch), *(1500,) * 11]


class Bench:
    """A rule that gets a frame every 20 ms."""

    def __init__(self) -> None:
        self.rule, self.now = TakeOver(THROTTLE, STEERING, SWITCH), 0.0

    def run(self, seconds: float, pulses: list[int] | None, lost: bool | None = False) -> RcWish:
        """Send frames for so long."""
        for _ in range(round(seconds / 0.02)):
            self.now += 0.02
            if pulses is not None or lost:
                self.rule.take(pulses, lost, self.now)
        return self.rule.look(self.now)


@pytest.fixture
def bench() -> Bench:
    """A rule whose hand drives."""
    bench = Bench()
    assert bench.run(0.2, frame()) == RcWish(RcState.DRIVES)
    return bench


@pytest.mark.parametrize("switch", AT)
@pytest.mark.parametrize("throttle", [1500, 2000, 1000])
def test_at_power_up_only_hand_with_the_throttle_at_neutral_begins(switch: str, throttle: int) -> None:
    begun = Bench().run(5.0, frame(switch, throttle))
    assert begun.state is (RcState.DRIVES if (switch, throttle) == ("hand", 1500) else RcState.WAITING)
    assert begun.ahead == 0.0


@pytest.mark.parametrize("switch", AT)
@pytest.mark.parametrize("loss", ["silence", "failsafe", "out of range"])
def test_a_loss_is_one_in_every_position_of_the_switch(bench: Bench, switch: str, loss: str) -> None:
    held = frame(switch, 2000)
    assert bench.run(1.0, held).state not in (RcState.LOST, RcState.WAITING)
    gone = {"silence": (None, None), "failsafe": (None, True), "out of range": (frame(switch, 880), False)}[loss]
    assert bench.run(0.30, *gone).state is RcState.LOST
    # the stick is still held when the link is back
    assert bench.run(5.0, held).state is RcState.WAITING
    assert bench.run(0.1, frame("computer")).state is RcState.WAITING
    assert bench.run(0.1, frame("half way")).state is RcState.WAITING
    assert bench.run(0.1, frame("hand")).state is RcState.DRIVES
    assert bench.run(0.1, frame("hand", 2000)) == RcWish(RcState.DRIVES, 1.0)


def test_a_quarter_of_a_second_without_frames_is_borne(bench: Bench) -> None:
    bench.run(0.1, frame("hand", 2000))
    bench.now += 0.24
    assert bench.rule.look(bench.now) == RcWish(RcState.DRIVES, 1.0)
    bench.now += 0.02
    assert bench.rule.look(bench.now).state is RcState.LOST


def test_a_loss_that_nobody_looked_at_counts(bench: Bench) -> None:
    bench.now += 1.0
    bench.rule.take(frame("computer", 2000), False, bench.now)
    assert bench.rule.look(bench.now).state is RcState.WAITING
    bench.run(0.1, frame())
    bench.rule.take(None, True, bench.now)
    bench.rule.take(frame("computer"), False, bench.now)
    assert bench.rule.look(bench.now).state is RcState.WAITING


def test_link_statistics_are_no_sign_of_life() -> None:
    bench = Bench()
    bench.rule.take(None, False, 0.0)
    assert bench.run(0.1, frame(), None).state is RcState.DRIVES
    for _ in range(20):
        bench.now += 0.02
        bench.rule.take(None, False, bench.now)
    assert bench.rule.look(bench.now).state is RcState.LOST


def test_an_uplink_of_quality_0_stops_although_channels_come(bench: Bench) -> None:
    bench.rule.take(None, True, bench.now)
    assert bench.run(1.0, frame("computer"), None).state is RcState.LOST
    bench.rule.take(None, False, bench.now)
    assert bench.run(0.1, frame("computer"), None).state is RcState.WAITING


def test_the_switch_says_who_drives_and_half_way_is_zero(bench: Bench) -> None:
    for switch, state, ahead in (
        ("hand", RcState.DRIVES, -1.0),
        ("1800", RcState.DRIVES, -1.0),
        ("1700", RcState.HALF_WAY, 0.0),
        ("half way", RcState.HALF_WAY, 0.0),
        ("1300", RcState.HALF_WAY, 0.0),
        ("1200", RcState.COMPUTER, 0.0),
        ("computer", RcState.COMPUTER, 0.0),
        ("hand", RcState.DRIVES, -1.0),
    ):
        assert bench.run(0.1, frame(switch, 1000)) == RcWish(state, ahead)


def test_sticks_reach_their_ends_both_ways_and_rest_in_the_middle(bench: Bench) -> None:
    assert bench.run(0.1, frame("hand", 2000, 1050)) == RcWish(RcState.DRIVES, 1.0, 1.0)
    assert bench.run(0.1, frame("hand", 1000, 1950)) == RcWish(RcState.DRIVES, -1.0, -1.0)
    assert bench.run(0.1, frame("hand", 1530, 1450)) == RcWish(RcState.DRIVES, 0.0, 0.0)


def test_after_letting_go_was_asked_a_held_stick_does_not_drive(bench: Bench) -> None:
    bench.run(0.1, frame("hand", 2000))
    bench.rule.let_go()
    assert bench.run(1.0, frame("hand", 2000)) == RcWish(RcState.DRIVES, 0.0)
    bench.run(0.1, frame("hand"))
    assert bench.run(0.1, frame("hand", 2000)).ahead == 1.0


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        ({"throttle": Stick()}, "rc.throttle.channel: nobody has told its channel"),
        ({"switch": ModeSwitch()}, "rc.switch.channel: nobody has told its channel"),
        ({"throttle": Stick(2, 1000, 1100, 2000)}, "rc.throttle: 1000, 1100, 2000 us do not rise or fall"),
        ({"steering": Stick(1, 1000, 2100, 2000)}, "rc.steering: "),
        ({"switch": ModeSwitch(5, 1500, 1700)}, "rc.switch: 1500 and 1700 us are too close"),
        ({"switch": ModeSwitch(2, 1000, 2000)}, r"channels \[2, 1, 2\]; give three different ones"),
    ],
)
def test_settings_that_cannot_be_are_refused(changed: dict[str, Stick | ModeSwitch], told: str) -> None:
    whole = {"throttle": THROTTLE, "steering": STEERING, "switch": SWITCH} | changed
    with pytest.raises(ConfigError, match=told):
        take_over(RcParameters(**whole))  # type: ignore[arg-type]

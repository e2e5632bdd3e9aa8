"""A stop is verified: by the speed that follows it, and nothing that is none is taken for a fault."""

from collections.abc import Callable
from itertools import pairwise
from math import e, inf, log
from random import Random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from txt1.control.standstill import DELAY, ENVELOPE_MARGIN, MEASURE_TIME, Standstill, Stop, coasting_time, envelope

PERIOD = 0.05


def stops_of(
    speed: Callable[[float], float | None],
    duration: float = 6.0,
    *,
    driven: float | None = 1.0,
    armed: bool = False,
    connected: bool = True,
    fastest: float = inf,
) -> list[tuple[float, Stop]]:
    """When the stop at 0 s became what, for a speed (m/s) by the time since then; driven at so many m/s before it."""
    watch, seen = Standstill(fastest), []
    if driven is not None:
        watch.step(-PERIOD, driven, commanded=True, armed=True, connected=True)
    for k in range(round(duration / PERIOD)):
        now = k * PERIOD
        stop = watch.step(now, speed(now), commanded=False, armed=armed, connected=connected)
        if not seen or seen[-1][1] is not stop:
            seen.append((now, stop))
    return seen


def kinds(seen: list[tuple[float, Stop]]) -> list[Stop]:
    return [stop for _, stop in seen]


def coasting(v0: float, t: float) -> float:
    """The speed of a vehicle that coasts from v0 m/s since 0 s."""
    return envelope(v0, t + DELAY)


@given(v0=st.floats(-1.6, 1.6), late=st.floats(0.0, DELAY))
def test_a_vehicle_that_coasts_needs_no_more_than_zeros(v0: float, late: float) -> None:
    sign = 1.0 if v0 > 0.0 else -1.0
    seen = stops_of(lambda t: sign * coasting(abs(v0), t - late), driven=v0)
    assert kinds(seen) == [Stop.SLOWING, Stop.STANDING]
    assert seen[-1][0] <= coasting_time(abs(v0)) + 0.4


@given(v=st.floats(0.12, 1.6), sign=st.sampled_from((-1.0, 1.0)))
def test_a_vehicle_that_drives_on_gets_a_pwm_test_and_then_no_esc(v: float, sign: float) -> None:
    seen = stops_of(lambda t: sign * v, driven=v)
    assert kinds(seen) == [Stop.SLOWING, Stop.PWM_ZEROS, Stop.ESC_OFF]
    if v >= 0.3:
        assert [time for time, _ in seen] == pytest.approx([0.0, 0.5, 1.0])


def test_even_a_slow_vehicle_that_never_stands_is_no_stop() -> None:
    seen = stops_of(lambda t: 0.09, driven=0.1)
    assert kinds(seen) == [Stop.SLOWING, Stop.PWM_ZEROS, Stop.ESC_OFF]
    # half a second after one that coasts has come to 0, which takes 0.15 + 0.6 ln(1 + v0 / 0.1) s
    assert [time for time, _ in seen] == pytest.approx([0.0, 1.05, 2.1])
    assert stepped(*[0.09] * 21, 0.05)[1][-1] is Stop.SLOWING, "one that stands at that instant may stay so"


def test_one_that_a_pwm_test_stops_keeps_its_esc() -> None:
    seen = stops_of(lambda t: 0.6 if t < MEASURE_TIME else coasting(0.6, t - MEASURE_TIME), driven=0.6)
    assert kinds(seen) == [Stop.SLOWING, Stop.PWM_ZEROS, Stop.STANDING]


def test_a_vehicle_that_still_accelerates_gets_the_envelope_of_the_speed_it_reaches() -> None:
    seen = stops_of(lambda t: 0.8 + t if t < 0.15 else coasting(0.95, t - DELAY), driven=0.8)
    assert kinds(seen) == [Stop.SLOWING, Stop.STANDING]


def test_without_odometry_the_stop_is_not_verified_and_calls_for_more() -> None:
    assert kinds(stops_of(lambda t: None)) == [Stop.SLOWING, Stop.PWM_ZEROS, Stop.ESC_OFF]


def test_where_nothing_can_be_sent_the_means_keep_their_time() -> None:
    assert kinds(stops_of(lambda t: None, connected=False)) == [Stop.SLOWING]


@pytest.mark.parametrize("armed", [False, True])
def test_a_car_that_is_pushed_never_has_its_esc_taken(armed: bool) -> None:
    def pushed(t: float) -> float:
        return 0.7 if 2.0 < t < 5.0 else 0.0

    expected = [Stop.UNASKED, Stop.STANDING] if not armed else []
    for driven in (None, 0.5):
        seen = kinds(stops_of(pushed, 8.0, driven=driven, armed=armed))
        assert seen == [Stop.NONE if driven is None else Stop.SLOWING, Stop.STANDING, *expected]


@pytest.mark.parametrize("driven", [None, 0.04])
def test_what_an_original_board_reads_of_a_car_that_hardly_moves_is_standing(driven: float | None) -> None:
    random = Random(1)
    for _ in range(20):
        assert kinds(stops_of(lambda t: random.choice((0.0, 0.022, 0.045, -0.045)), driven=driven))[-1] is Stop.STANDING


def test_a_stop_ends_when_the_vehicle_is_commanded_again() -> None:
    watch = Standstill()
    for k in range(100):
        stop = watch.step(k * PERIOD, 0.6, commanded=k % 8 < 4, armed=True, connected=True)
        assert stop in (Stop.NONE, Stop.SLOWING)


def test_the_envelope_is_that_of_a_car_which_coasts() -> None:
    assert [envelope(1.0, t) for t in (0.0, 0.1, 0.15)] == [1.0, 1.0, 1.0]
    assert envelope(1.0, 0.75) == pytest.approx(1.1 / e - 0.1), "after a delay of 0.15 s and a time constant of 0.6"
    assert coasting_time(1.0) == pytest.approx(0.15 + 0.6 * log(11.0))


def stepped(*speeds: float | None, driven: float | None = 1.0, **how: bool) -> tuple[Standstill, list[Stop]]:
    """A stop at 0 s of a vehicle that was commanded at `driven` m/s, with these speeds every 50 ms from then on."""
    watch = Standstill()
    watch.step(-PERIOD, driven, commanded=True, armed=True, connected=True)
    means = {"commanded": False, "armed": False, "connected": True} | how
    return watch, [watch.step(round(k * PERIOD, 9), v, **means) for k, v in enumerate(speeds)]


def test_half_a_second_after_a_stop_0_1_m_s_too_much_is_no_stop() -> None:
    slowest = envelope(1.0, 0.5) + 0.1
    assert stepped(1.0, *[0.9] * 9, slowest - 1e-6)[1][-1] is Stop.SLOWING
    assert stepped(1.0, *[0.9] * 9, slowest + 1e-6)[1][-1] is Stop.PWM_ZEROS
    assert stepped(-1.0, *[0.9] * 9, -slowest - 1e-6)[1][-1] is Stop.PWM_ZEROS
    assert stepped(1.0, *[0.9] * 9)[1][-1] is Stop.SLOWING, "not before"


def test_speeds_reached_in_the_first_0_15_s_count_and_later_speeds_do_not() -> None:
    assert stepped(1.0, 1.0, 1.0, -1.3, *[1.0] * 6, envelope(1.3, 0.5) + 0.09)[1][-1] is Stop.SLOWING
    assert stepped(1.0, 1.0, 1.0, 1.0, 1.3, *[1.0] * 5, envelope(1.3, 0.5) + 0.09)[1][-1] is Stop.PWM_ZEROS
    assert stepped(1.0, 0.2, *[0.9] * 8, envelope(1.0, 0.5) + 0.09)[1][-1] is Stop.SLOWING


def test_a_stop_at_an_unknown_speed_counts_from_the_largest_speed() -> None:
    allowed = envelope(1.5, 0.5) + 0.1
    assert stepped(None, *[0.8] * 9, allowed - 1e-6)[1][-1] is Stop.SLOWING
    assert stepped(None, *[0.8] * 9, allowed + 1e-6)[1][-1] is Stop.PWM_ZEROS


def test_it_stands_when_it_was_at_0_05_at_most_for_0_3_s_after_the_stop() -> None:
    for speed, stop in ((0.05, Stop.STANDING), (-0.05, Stop.STANDING), (0.0501, Stop.SLOWING)):
        stops = stepped(*[speed] * 7, driven=0.0)[1]
        assert stops == [*[Stop.SLOWING] * 6, stop]
    assert stepped(0.0, 0.0, 0.06, *[0.0] * 6)[1][-1] is Stop.SLOWING, "without a break"
    assert stepped(0.0, 0.0, 0.06, *[0.0] * 7)[1][-1] is Stop.STANDING
    assert stepped(0.0, 0.0, None, *[0.0] * 6)[1][-1] is Stop.SLOWING
    watch = Standstill()
    for k in range(20):
        watch.step(k * PERIOD, 0.0, commanded=True, armed=True, connected=True)
    assert watch.step(1.0, 0.0, commanded=False, armed=True, connected=True) is Stop.SLOWING, "not what was before it"


def test_who_moves_at_more_than_0_1_for_half_a_second_without_a_command_is_told_of() -> None:
    at_rest = [0.0] * 7
    for speed, stop in ((0.1, Stop.STANDING), (0.101, Stop.UNASKED), (-0.101, Stop.UNASKED)):
        stops = stepped(*at_rest, *[speed] * 11)[1]
        assert stops[6:] == [*[Stop.STANDING] * 11, stop]
    assert stepped(*at_rest, *[0.2] * 10, 0.1, *[0.2] * 10)[1][-1] is Stop.STANDING, "without a break"
    assert stepped(*at_rest, *[0.2] * 10, None, *[0.2] * 10)[1][-1] is Stop.UNSEEN
    assert stepped(*at_rest, *[0.2] * 20, armed=True)[1][-1] is Stop.STANDING, "but not while it is armed"
    assert stepped(*at_rest, *[0.2] * 11, *[0.0] * 6)[1][-1] is Stop.UNASKED
    assert stepped(*at_rest, *[0.2] * 11, *[0.0] * 7)[1][-1] is Stop.STANDING
    pushed = Standstill()
    for k in range(11):
        stop = pushed.step(k * PERIOD, 0.2, commanded=False, armed=False, connected=True)
    assert stop is Stop.UNASKED, "before anybody has ever driven it"
    assert not pushed.drove


def test_what_stood_and_is_not_seen_any_more_does_not_stand() -> None:
    at_rest = [0.0] * 7
    assert stepped(*at_rest)[0].stands(6 * PERIOD)
    watch, stops = stepped(*at_rest, None, *[0.0] * 7)
    assert stops[6:] == [Stop.STANDING, *[Stop.UNSEEN] * 7, Stop.STANDING], "seen again for 0.3 s"
    assert stepped(*at_rest, None, *[0.2] * 11)[1][-1] is Stop.UNASKED
    assert stepped(*at_rest, None, *[0.2] * 11, armed=True)[1][-1] is Stop.UNSEEN
    watch, stops = stepped(*at_rest, 0.06)
    assert stops[-1] is Stop.STANDING and not watch.stands(7 * PERIOD), "it has just begun to move"
    assert not stepped(*at_rest, None)[0].stands(7 * PERIOD)
    assert not stepped(0.0, 0.0)[0].stands(PERIOD)


def test_what_a_stop_called_for_is_remembered_and_whether_anybody_saw_it() -> None:
    new = Standstill()
    assert (new.stop, new.failed, new.blind, new.drove) == (Stop.NONE, Stop.NONE, False, False)
    for speeds, failed, blind in (
        ([1.0] * 10, Stop.NONE, False),
        ([1.0] * 11, Stop.PWM_ZEROS, False),
        ([1.0] * 21, Stop.ESC_OFF, False),
        ([None] * 11, Stop.PWM_ZEROS, True),
        ([None] * 21, Stop.ESC_OFF, True),
        ([*[None] * 20, 1.0], Stop.ESC_OFF, False),
        ([1.0] * 31, Stop.ESC_OFF, False),
    ):
        watch, _ = stepped(*speeds)
        assert (watch.failed, watch.blind, watch.drove) == (failed, blind, True)


def test_each_means_has_half_a_second_from_when_something_could_be_sent() -> None:
    watch, stops = stepped(*[None] * 20, connected=False)
    assert stops[-1] is Stop.SLOWING
    for k in range(20, 29):
        assert watch.step(k * PERIOD, None, commanded=False, armed=False, connected=True) is Stop.SLOWING
    assert watch.step(29 * PERIOD, None, commanded=False, armed=False, connected=True) is Stop.PWM_ZEROS
    assert stepped(*[1.0] * 11, connected=False)[1][-1] is Stop.PWM_ZEROS, "what is seen to move is told so at any rate"


@given(v0=st.floats(0.0, 1.6))
def test_the_envelope_decays_to_zero_in_its_time(v0: float) -> None:
    speeds = [envelope(v0, k * 0.01) for k in range(400)]
    assert all(later <= earlier for earlier, later in pairwise(speeds))
    assert envelope(v0, coasting_time(v0) + 1e-6) == 0.0
    assert envelope(v0, 0.0) == pytest.approx(v0)
    assert ENVELOPE_MARGIN > 0.0


@given(jump=st.floats(2.0, 1e6), v=st.floats(0.12, 1.6))
def test_a_counter_that_jumps_gives_a_stop_no_more_time_than_the_fastest_car(jump: float, v: float) -> None:
    seen = stops_of(lambda t: jump if t < 0.1 else v, driven=v, fastest=2.0)
    assert kinds(seen) == [Stop.SLOWING, Stop.PWM_ZEROS, Stop.ESC_OFF]
    assert seen[1][0] <= coasting_time(2.0) + 0.5 + PERIOD


@pytest.mark.parametrize("speed", [2.1, -4.4])
def test_what_runs_away_by_itself_loses_its_esc_and_what_is_pushed_keeps_it(speed: float) -> None:
    assert kinds(stops_of(lambda t: 0.0 if t < 1.0 else speed, driven=None, fastest=2.0)) == [
        Stop.NONE,
        Stop.STANDING,
        Stop.ESC_OFF,
    ]
    pushed = stops_of(lambda t: 0.0 if t < 1.0 else 1.9, driven=None, fastest=2.0)
    assert kinds(pushed) == [Stop.NONE, Stop.STANDING, Stop.UNASKED]


@pytest.mark.parametrize("between", [-4.4, 0.3, 0.0])
def test_loops_that_race_during_a_stop_lose_the_esc_at_the_second_reading(between: float) -> None:
    """The loops of a board may flip between their limits; a look may also fall between two of these moments."""
    seen = stops_of(lambda t: -4.4 if round(t / PERIOD) % 3 == 0 else between, driven=1.0, fastest=2.0)
    assert kinds(seen)[:2] == [Stop.SLOWING, Stop.ESC_OFF]
    assert seen[1][0] == pytest.approx(0.15)


@pytest.mark.parametrize(("apart", "expected"), [(0.1, False), (0.15, True), (1.0, True), (1.05, False), (3.0, False)])
def test_two_readings_above_any_command_count_if_one_jump_did_not_make_both(apart: float, expected: bool) -> None:
    """In every state but that of a vehicle that is commanded: then the safety gate decides."""
    for begin in (0.05, 1.0):
        jumps = (round(begin / PERIOD), round((begin + apart) / PERIOD))
        seen = stops_of(lambda t, jumps=jumps: 2.1 if round(t / PERIOD) in jumps else 0.0, fastest=2.0, duration=7.0)
        assert (Stop.ESC_OFF in kinds(seen)) is expected, (begin, seen)


@pytest.mark.parametrize(("speed", "expected"), [(2.0, False), (-2.0, False), (2.001, True), (-2.001, True)])
def test_the_fastest_command_itself_is_no_race(speed: float, expected: bool) -> None:
    assert (Stop.ESC_OFF in kinds(stops_of(lambda t: speed, driven=2.0, fastest=2.0, duration=0.3))) is expected


def test_a_commanded_vehicle_faster_than_any_command_is_no_failed_stop() -> None:
    watch = Standstill(2.0)
    for k in range(60):
        assert watch.step(k * PERIOD, 2.5, commanded=True, armed=True, connected=True) is Stop.NONE
    assert watch.failed is Stop.NONE


def test_a_vehicle_whose_speed_fell_faster_than_it_can_is_not_seen_to_stand() -> None:
    watch = Standstill()
    watch.step(0.0, 1.0, commanded=True, armed=True, connected=True)

    def after(duration: float, v: float, *, fell: bool) -> Stop:
        nonlocal now
        for _ in range(round(duration / PERIOD)):
            now += PERIOD
            watch.step(now, v, commanded=False, armed=False, connected=True, fell=fell)
        return watch.stop

    now = 0.0
    assert after(0.3, 0.0, fell=True) is Stop.SLOWING, "it may be seen to move again"
    assert after(0.1, 0.0, fell=True) is Stop.UNSEEN
    assert after(5.0, 0.0, fell=True) is Stop.UNSEEN and not watch.stands(now)
    assert after(0.05, 0.0, fell=False) is Stop.STANDING and watch.stands(now)
    assert after(0.05, 0.0, fell=True) is Stop.UNSEEN
    assert after(0.6, 0.5, fell=False) is Stop.UNASKED
    assert after(0.4, 0.0, fell=True) is Stop.UNSEEN


def test_a_vehicle_never_commanded_whose_speed_fell_is_not_seen_to_stand() -> None:
    watch = Standstill()
    for k in range(8):
        watch.step(k * PERIOD, 0.0, commanded=False, armed=False, connected=True, fell=True)
    assert watch.stop is Stop.UNSEEN

"""A stop is verified: by the speed that follows it, and nothing that is none is taken for a fault."""

from collections.abc import Callable
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from txt1.control.standstill import DELAY, GRACE, MARGIN, Standstill, Stop, coasting_time, envelope

PERIOD = 0.05


def stops_of(
    speed: Callable[[float], float | None],
    duration: float = 6.0,
    *,
    driven: float | None = 1.0,
    armed: bool = False,
    connected: bool = True,
) -> list[tuple[float, Stop]]:
    """When the stop at 0 s became what, for a speed (m/s) by the time since then; driven at so many m/s before it."""
    watch, seen = Standstill(), []
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
        assert [time for time, _ in seen] == pytest.approx([0.0, GRACE, 2.0 * GRACE])


def test_even_a_slow_vehicle_that_never_stands_is_no_stop() -> None:
    assert kinds(stops_of(lambda t: 0.09, driven=0.1)) == [Stop.SLOWING, Stop.PWM_ZEROS, Stop.ESC_OFF]


def test_one_that_a_pwm_test_stops_keeps_its_esc() -> None:
    seen = stops_of(lambda t: 0.6 if t < GRACE else coasting(0.6, t - GRACE), driven=0.6)
    assert kinds(seen) == [Stop.SLOWING, Stop.PWM_ZEROS, Stop.STANDING]


def test_one_that_was_still_getting_faster_has_the_envelope_of_what_it_reached() -> None:
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


@given(jitter=st.lists(st.sampled_from((0.0, 0.022, 0.045, -0.045)), min_size=120, max_size=120))
def test_what_an_original_board_reads_of_a_car_that_hardly_moves_is_standing(jitter: list[float]) -> None:
    for driven in (None, 0.04):
        assert kinds(stops_of(lambda t: jitter[round(t / PERIOD)], driven=driven))[-1] is Stop.STANDING


def test_a_stop_ends_when_the_vehicle_is_commanded_again() -> None:
    watch = Standstill()
    for k in range(100):
        stop = watch.step(k * PERIOD, 0.6, commanded=k % 8 < 4, armed=True, connected=True)
        assert stop in (Stop.NONE, Stop.SLOWING)


@given(v0=st.floats(0.0, 1.6))
def test_the_envelope_decays_to_zero_in_its_time(v0: float) -> None:
    speeds = [envelope(v0, k * 0.01) for k in range(400)]
    assert all(later <= earlier for earlier, later in pairwise(speeds))
    assert envelope(v0, coasting_time(v0) + 1e-6) == 0.0
    assert envelope(v0, 0.0) == pytest.approx(v0)
    assert MARGIN > 0.0

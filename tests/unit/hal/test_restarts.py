"""What the serial HAL makes of a board's poses."""

from math import cos, pi, sin

from hypothesis import given, settings
from hypothesis import strategies as st
from pytest import approx, mark

from tests.examples import examples
from txt1.hal.restarts import JUMP_TIME, at_origin, jumped, started_again
from txt1.hal.serial import follow
from txt1.model.kinematics import wrap_angle
from txt1.model.odometry import Odometry, advance
from txt1.protocol.messages import EncoderOdometry

PERIOD = 0.05
SPEEDS = st.floats(-1.5, 1.5)
CURVATURES = st.floats(-1.0 / 0.56, 1.0 / 0.56)


def sent(odometry: Odometry) -> EncoderOdometry:
    """The odometry as an original board sends it: whole mm and mrad, theta from 0 to 6.283."""
    return EncoderOdometry(
        round(odometry.x, 3),
        round(odometry.y, 3),
        round(odometry.theta % (2.0 * pi), 3),
        round(odometry.v, 3),
        round(odometry.omega, 3),
    )


@given(v=SPEEDS, curvature=CURVATURES, dt=st.floats(0.0, 0.5), held_back=st.floats(0.0, JUMP_TIME))
def test_no_motion_that_the_vehicle_can_make_looks_like_a_restart(
    v: float, curvature: float, dt: float, held_back: float
) -> None:
    start = Odometry(1.0, -2.0, 3.1, v, v * curvature)
    assert not jumped(sent(start), sent(advance(start, v, v * curvature, dt + held_back)), dt)


@mark.parametrize("before", [Odometry(0.4, 0.0, 0.0), Odometry(1.0, 1.0, 0.3, 0.3, 0.0), Odometry(0.0, 0.0, 2.0)])
def test_a_pose_that_starts_anew_at_zero_is_a_restart(before: Odometry) -> None:
    assert jumped(sent(before), sent(Odometry()), PERIOD)


def test_a_heading_that_passes_a_full_turn_is_no_restart() -> None:
    before, after = Odometry(theta=-0.02, v=0.5, omega=0.8), Odometry(theta=0.02, v=0.5, omega=0.8)
    assert sent(before).theta > 6.2
    assert not jumped(sent(before), sent(after), PERIOD)


def test_unscaled_odometry_is_the_boards_own_with_its_heading_wrapped() -> None:
    pose = EncoderOdometry(1.234, -0.5, 6.0, 0.512, -0.128)
    assert follow(None, pose, pose, 1.0) == Odometry(1.234, -0.5, wrap_angle(6.0), 0.512, -0.128)


@settings(max_examples=examples(25))
@given(curvature=CURVATURES, v=st.floats(0.1, 1.0))
def test_the_scale_corrects_a_board_that_reads_low(curvature: float, v: float) -> None:
    """Path and velocities as a board with the right wheels would have them, within its millimetres and milliradians."""
    low = 0.937
    true = board = Odometry()
    corrected, before = follow(None, sent(board), sent(board), 1.0 / low), sent(board)
    for _ in range(200):
        true = advance(true, v, v * curvature, PERIOD)
        board = advance(board, low * v, low * v * curvature, PERIOD)
        corrected, before = follow(corrected, before, sent(board), 1.0 / low), sent(board)
    assert corrected.v == approx(v, abs=0.002)
    assert corrected.omega == approx(v * curvature, abs=0.002)
    assert wrap_angle(corrected.theta - true.theta) == approx(0.0, abs=0.01)
    assert (corrected.x, corrected.y) == (approx(true.x, abs=0.03), approx(true.y, abs=0.03))


def test_scaled_odometry_goes_on_where_the_board_was_found() -> None:
    found = EncoderOdometry(2.0, 1.0, pi / 2, 0.0, 0.0)
    start = follow(None, found, found, 1.1)
    after = follow(start, found, EncoderOdometry(2.0, 1.1, pi / 2, 0.5, 0.0), 1.1)
    assert (after.x, after.y) == (approx(2.0 + 0.11 * cos(pi / 2)), approx(1.0 + 0.11 * sin(pi / 2)))


def pose(x: float = 0.0, y: float = 0.0, theta: float = 0.0, v: float = 0.0, omega: float = 0.0) -> EncoderOdometry:
    return EncoderOdometry(x, y, theta, v, omega)


@mark.parametrize(
    ("before", "after", "reach"),
    [
        (pose(1.0, 1.0), pose(1.0, 1.0), 0.3),  # at 0.3 m/s more than either reports, for 0.5 s longer
        (pose(1.0, 1.0, v=0.2), pose(1.0, 1.0), 0.5),
        (pose(1.0, 1.0, v=-0.2), pose(1.0, 1.0, v=0.1), 0.5),
        (pose(1.0, 1.0), pose(1.0, 1.0, v=-0.7), 1.0),
    ],
)
def test_a_board_that_is_farther_away_than_it_can_have_driven_has_restarted(
    before: EncoderOdometry, after: EncoderOdometry, reach: float
) -> None:
    for dx, dy in ((reach, 0.0), (-reach, 0.0), (0.0, reach), (0.6 * reach, -0.8 * reach)):
        for factor, so in ((0.999, False), (1.001, True)):
            there = pose(after.x + factor * dx, after.y + factor * dy, 0.0, after.v)
            assert jumped(before, there, 0.5) is so
            assert jumped(before, there, 0.45) or not so


@mark.parametrize(("before", "after"), [(0.4, 0.0), (0.0, 0.4), (-0.4, 0.2), (0.2, -0.4)])
def test_a_board_that_turned_farther_than_it_can_has_restarted(before: float, after: float) -> None:
    for turned, so in ((1.699, False), (-1.699, False), (1.701, True), (-1.701, True)):
        start = pose(1.0, 1.0, 3.0, 0.0, before)
        assert jumped(start, pose(1.0, 1.0, wrap_angle(3.0 + turned), 0.0, after), 0.0) is so
        assert not jumped(start, pose(1.0, 1.0, wrap_angle(3.0 + turned), 0.0, after), 0.1)


@mark.parametrize(
    ("before", "so"),
    [
        (pose(0.003), False),  # which rounding explains
        (pose(0.0, -0.003), False),
        (pose(0.0, 0.0, 0.003), False),
        (pose(0.0031), True),
        (pose(0.0, 0.0031), True),
        (pose(0.0, 0.0, 0.0031), True),
        (pose(0.0, 0.0, 2.0 * pi - 0.0031), True),
        (pose(0.0, 0.0, 2.0 * pi - 0.0029), False),
        (pose(0.047, v=0.3), False),  # 0.15 s of it
        (pose(0.0, 0.047, v=-0.3), False),
        (pose(0.049, v=0.3), True),
        (pose(0.0, 0.0, 0.092, omega=-0.6), False),
        (pose(0.0, 0.0, 0.094, omega=0.6), True),
        (pose(0.1, 0.0, 0.0, omega=5.0), True),
        (pose(0.0, 0.0, 0.1, v=5.0), True),
        (pose(), False),
    ],
)
def test_a_board_that_comes_to_stand_at_exactly_0_0_0_was_near_it_or_had_the_speed(
    before: EncoderOdometry, so: bool
) -> None:
    assert jumped(before, pose(), PERIOD) is so


def test_what_motion_just_explains_is_no_restart() -> None:
    assert not jumped(pose(1.0, 1.0, v=0.2), pose(1.5, 1.0), 0.5)
    assert not jumped(pose(1.0, 1.0, omega=0.4), pose(1.0, 1.0, 1.7), 0.0)


def test_only_a_pose_of_zeros_at_rest_is_that_of_power_up() -> None:
    assert at_origin(pose())
    for field in ("x", "y", "theta", "v", "omega"):
        assert not at_origin(pose(**{field: 0.001}))
        assert not jumped(pose(0.004, 0.0), pose(**{field: 0.001}), PERIOD)


@mark.parametrize(
    ("before", "after", "so"),
    [
        ((10.0, 10.0), (3.01, 4.99), True),
        ((10.0, 10.0), (3.0, 4.0), False),
        ((10.0, 10.0), (4.0, 5.0), False),
        ((10.0, 10.0), (4.0, 9.9), False),  # a pack that is bad
        ((10.0, 0.0), (4.0, 0.0), True),  # one that is not fitted says nothing
        ((10.0, 1.0), (4.0, 1.0), True),
        ((0.5, 1.0), (0.2, 0.4), False),
        ((10.0, 1.01), (4.0, 1.01), False),
    ],
)
def test_a_battery_filter_has_started_again_where_every_pack_fell_to_two_fifths(
    before: tuple[float, float], after: tuple[float, float], so: bool
) -> None:
    assert started_again(before, after) is so
    assert started_again(before[::-1], after[::-1]) is so


def test_the_steps_of_a_board_that_reads_low_are_turned_into_our_heading() -> None:
    """A board that reads half of everything drives a quarter of a turn, which it takes for an eighth."""
    before, after = pose(1.0, 0.0, 0.0), pose(1.5, 0.25, pi / 4, 0.2, 0.1)
    told = follow(Odometry(2.0, 3.0, pi / 2), before, after, 2.0)
    # its mean heading is pi / 8, ours pi / 2 + pi / 4: the step turns by 5 pi / 8
    c, s = cos(5 * pi / 8), sin(5 * pi / 8)
    assert told == approx((2.0 + c * 1.0 - s * 0.5, 3.0 + s * 1.0 + c * 0.5, pi, 0.4, 0.2))
    assert follow(None, before, after, 2.0) == approx((1.5, 0.25, pi / 4, 0.4, 0.2)), "the first pose is taken as it is"
    assert follow(Odometry(7.0), before, after, 1.0) == approx((1.5, 0.25, pi / 4, 0.2, 0.1)), "without a scale as well"

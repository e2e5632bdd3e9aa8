"""What the serial HAL makes of a board's poses."""

from math import cos, pi, sin

from hypothesis import given
from hypothesis import strategies as st
from pytest import approx, mark

from txt1.hal.serial import JUMP_TIME, follow, jumped
from txt1.model.kinematics import wrap_angle
from txt1.model.odometry import Odometry, advance
from txt1.protocol.messages import EncoderOdometry

PERIOD = 0.05
SPEEDS = st.floats(-1.5, 1.5)
CURVATURES = st.floats(-1.0 / 0.56, 1.0 / 0.56)


def sent(odometry: Odometry) -> EncoderOdometry:
    """The odometry as an original board sends it: whole mm and mrad, theta from 0 to 6.283."""
    return EncoderOdometry(
        round(odometry.x, 3), round(odometry.y, 3), round(odometry.theta % (2.0 * pi), 3),
        round(odometry.v, 3), round(odometry.omega, 3),
    )  # fmt: skip


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
    assert follow(None, None, pose, 1.0) == Odometry(1.234, -0.5, wrap_angle(6.0), 0.512, -0.128)


@given(curvature=CURVATURES, v=st.floats(0.1, 1.0))
def test_the_scale_corrects_a_board_that_reads_low(curvature: float, v: float) -> None:
    """Path and velocities as a board with the right wheels would have them, within its millimetres and milliradians."""
    low = 0.937
    true = board = Odometry()
    corrected, before = follow(None, None, sent(board), 1.0 / low), sent(board)
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
    start = follow(None, None, found, 1.1)
    after = follow(start, found, EncoderOdometry(2.0, 1.1, pi / 2, 0.5, 0.0), 1.1)
    assert (after.x, after.y) == (approx(2.0 + 0.11 * cos(pi / 2)), approx(1.0 + 0.11 * sin(pi / 2)))

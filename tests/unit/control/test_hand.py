"""The hand rule: what two axes ask of each car, by keys, gamepad and live view. The page's is in tests/browser."""

from __future__ import annotations

from math import copysign, inf, nan

import pytest
from hypothesis import given
from hypothesis import strategies as st

from txt1.config import Config, load
from txt1.control.hand import DEAD, DEFAULT_HAND, Hand, shaped
from txt1.control.limits import SetpointBounds
from txt1.gamepad.pad import PadParameters, PadState, velocity
from txt1.ui.teleop import Teleop

CARS = {name: load(None, [f"vehicle={name}"], {}, {}).config for name in ("txt1", "donkeycar", "f1tenth", "rover")}

share = st.floats(-1.0, 1.0)
any_car = st.sampled_from([*CARS.values()])


@given(any_car, st.floats(0.1, 10.0), share, share, st.booleans())
def test_the_safety_gate_clips_nothing_that_a_hand_asks_for(
    config: Config, speed: float, ahead: float, left: float, wheel: bool
) -> None:
    asked = config.hand().velocity(speed, ahead, left, wheel=wheel)
    v, omega = SetpointBounds(config.limits()).nearest(*asked)
    dead = abs(asked[0]) < config.safety.v_dead_band
    assert dead or (v, omega) == asked


@given(any_car, st.floats(0.1, 10.0), share, share)
def test_the_speed_is_a_share_of_the_chosen_one_and_left_is_counter_clockwise(
    config: Config, speed: float, ahead: float, left: float
) -> None:
    hand = config.hand()
    v, omega = hand.velocity(speed, ahead, left)
    assert v == min(speed, config.safety.v_max) * ahead
    assert omega * left >= 0.0
    assert hand.velocity(speed, ahead, -left) == (v, -omega)
    assert hand.velocity(speed, -ahead, left) == (-v, omega)


@given(any_car, st.floats(0.1, 10.0), share, share)
def test_on_a_wheel_a_car_that_steers_rolls_its_path_back_in_reverse(
    config: Config, speed: float, ahead: float, left: float
) -> None:
    hand = config.hand()
    v, omega = hand.velocity(speed, ahead, left, wheel=True)
    if v:
        back = hand.velocity(speed, -ahead, left, wheel=True)
        assert back == ((-v, omega) if hand.pivots else (-v, -omega))


@given(st.floats(0.1, 10.0), st.floats(0.01, 1.0), st.floats(0.01, 2.0), share)
def test_no_side_rolls_faster_than_the_chosen_speed_when_it_turns_in_place(
    speed: float, radius: float, track: float, left: float
) -> None:
    geometry = {"steering": "skid", "radius_min": radius, "track_width": track}
    config = Config.model_validate({"geometry": geometry, "safety": {"v_max": 10.0, "omega_max": 1e4}})
    v, omega = config.hand().velocity(speed, 0.0, left)
    assert v == 0.0
    assert abs(omega) * 0.5 * track <= speed * (1.0 + 1e-12)


@pytest.mark.parametrize(
    ("name", "radius", "v_max"), [("txt1", 0.56, 1.5), ("donkeycar", 0.45, 1.0), ("f1tenth", 0.742, 3.0)]
)
def test_each_car_has_its_own_circle_and_its_own_speed_by_every_hand(name: str, radius: float, v_max: float) -> None:
    config = CARS[name]
    hand = config.hand()
    full = PadState(axes={"lefty": -1.0, "leftx": -1.0})
    assert velocity(full, PadParameters(), hand) == pytest.approx((v_max, v_max / radius))
    keys = Teleop(9.9, hand._replace(turn=1.0))
    keys.key("w", 0.0)
    keys.key("a", 0.0)
    assert keys.command(0.0) == pytest.approx((v_max, v_max / radius))
    assert hand.on_the_spot(0.0, -0.5) == (pytest.approx(0.5 * radius), -0.5)
    at_rest = PadState(axes={"leftx": -1.0})
    assert velocity(at_rest, PadParameters(), hand) == (0.0, 0.0)


def test_a_rover_turns_in_place_by_every_hand() -> None:
    hand = CARS["rover"].hand()
    assert hand.radius == 0.3
    assert velocity(PadState(axes={"leftx": -1.0}), PadParameters(speed=0.3), hand) == (0.0, pytest.approx(1.0))
    keys = Teleop(0.3, hand._replace(turn=1.0))
    keys.key("a", 0.0)
    assert keys.command(0.0) == (0.0, pytest.approx(1.0))
    assert hand.on_the_spot(0.0, 1.0) == (0.0, 1.0)


@given(st.floats(allow_nan=True, allow_infinity=True))
def test_an_axis_is_at_rest_around_its_middle_and_goes_to_its_ends(value: float) -> None:
    size = shaped(value)
    assert -1.0 <= size <= 1.0
    assert (size == 0.0) == (value != value or abs(value) in (inf, DEAD) or abs(value) < DEAD)
    assert size == 0.0 or size * value > 0.0


def test_the_ends_of_an_axis() -> None:
    assert [shaped(value) for value in (-1.0, -DEAD, nan, DEAD, 1.0)] == [-1.0, 0.0, 0.0, 0.0, 1.0]
    assert Hand() == DEFAULT_HAND == CARS["txt1"].hand()


def test_no_velocity_is_minus_zero() -> None:
    assert [copysign(1.0, each) for each in Hand().velocity(0.5, -0.0, -0.0)] == [1.0, 1.0]

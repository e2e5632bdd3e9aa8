"""The extended Kalman filter: equal to another one's, consistent, and its covariance a covariance."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from tests.examples import examples
from txt1.estimation.filter import (
    BIAS,
    OMEGA,
    ROLLED,
    SIZE,
    SLIP,
    THETA,
    Array,
    Belief,
    Drift,
    Lean,
    Row,
    X,
    Y,
    antenna,
    belief_of,
    centred,
    encoders,
    outside,
    predict,
    turned,
    update,
    upright,
    velocities,
    wandering,
)
from txt1.model.kinematics import wrap_angle

WHEELBASE = 0.34
IDENTITY = np.eye(SIZE)
# the Jacobian of a pose, by rows
POSE = [tuple(row) for row in IDENTITY[:3].tolist()]
DENSITY = Drift().density()
# the row of a gyro, which tells its bias, too
GYRO = (0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0)


def covariance(rng: np.random.Generator, size: int) -> Array:
    root = rng.normal(size=(size, size))
    return root @ root.T + 0.1 * np.eye(size)


def noise(density: Sequence[float], dt: float, f: Array) -> Array:
    """Q of random walks, where the speed's change moves the pose by half of what it would over all of dt."""
    moved = 0.5 * f[:, ROLLED]
    moved[ROLLED] = 1.0
    q = np.diag(density) * dt
    q[ROLLED, ROLLED] = 0.0
    return q + density[ROLLED] * dt * np.outer(moved, moved)


def off(ours: Belief, nis: float, other: Any) -> float:
    """By how much a belief and its NIS differ from another library's filter; pytest.approx is slow on arrays."""
    differences = ours.mean - other.x, ours.covariance - other.P, nis - other.mahalanobis**2
    return max(float(np.abs(each).max()) for each in differences)


def test_straight_ahead_it_is_the_kalman_filter_of_another_library_to_1e_9() -> None:
    # heading and yaw rate known and 0: x and v are linear, a car that drives straight on
    rng = np.random.default_rng(1)
    density = Drift(heading=0.0, yaw_rate=0.0, bias=0.0, slip=0.0, width=0.0).density()
    initial = covariance(rng, SIZE)
    initial[THETA, :] = initial[:, THETA] = 0.0
    initial[OMEGA:, :] = initial[:, OMEGA:] = 0.0
    ours = belief_of([0.3, -0.2, 0.0, 0.5, 0.0, 0.0, 0.0, 0.0], initial)
    from filterpy.kalman import KalmanFilter  # brings all of SciPy

    other = KalmanFilter(dim_x=SIZE, dim_z=2)
    other.x, other.P, other.F = np.array(ours.mean), initial.copy(), IDENTITY.copy()
    other.F[X, ROLLED] = 0.02
    other.Q = noise(density, 0.02, other.F)
    sigmas = 0.6, 1.1
    other.H, other.R = IDENTITY[:2], np.diag(sigmas) ** 2
    # with v and heading 0 uncertain by nothing, y does not depend on the speed
    for _ in range(500):
        ours = predict(ours, 0.02, density)
        other.F[Y, THETA] = 0.02 * other.x[ROLLED]
        other.predict()
        z = rng.normal(size=2)
        ours, nis, _ = update(ours, (z - ours.mean[:2]).tolist(), POSE[:2], sigmas)
        other.update(z)
        assert off(ours, nis, other) < 1e-9


def test_in_curves_it_is_the_extended_kalman_filter_of_another_library() -> None:
    rng = np.random.default_rng(2)
    ours = belief_of([0.3, -0.2, 0.4, 0.5, 0.3, 0.01, 0.02, 0.0], covariance(rng, SIZE) * 1e-3)
    from filterpy.kalman import ExtendedKalmanFilter

    other = ExtendedKalmanFilter(dim_x=SIZE, dim_z=2)
    for _ in range(200):
        before = ours
        ours = predict(before, 0.02, DENSITY)
        other.x, other.P = np.array(before.mean), before.covariance
        other.F = numeric(lambda at: predict(belief_of(at, IDENTITY), 0.02, DENSITY).mean, np.array(before.mean))
        other.Q = noise(DENSITY, 0.02, other.F)
        other.predict()
        assert ours.covariance == pytest.approx(other.P, rel=5e-4, abs=1e-6)  # differences, not derivatives
        other.x, other.P = np.array(ours.mean), ours.covariance
        expected, h = encoders(ours.mean)
        residual, sigmas = rng.normal(size=2) * 0.01, rng.uniform(0.003, 0.03, 2)
        ours, nis, _ = update(ours, residual.tolist(), h, sigmas.tolist())
        other.R = np.diag(sigmas) ** 2
        other.update(expected + residual, lambda _, h=h: rows(h), lambda _, e=expected: np.array(e))
        assert off(ours, nis, other) < 1e-9


def test_a_car_whose_wheels_tell_another_speed_has_gained_it_on_its_way() -> None:
    known = belief_of([0.0] * SIZE, np.zeros((SIZE, SIZE)))
    gained, _, _ = update(predict(known, 0.02, DENSITY), (0.03,), (ROLLED,), (1e-4,))
    assert gained.mean[X] == pytest.approx(0.5 * 0.03 * 0.02, rel=0.01)


@pytest.mark.parametrize("v", [1.2, -1.2])
@pytest.mark.parametrize("omega", [2.0, -2.0])
def test_in_a_curve_the_car_slides_outwards(v: float, omega: float) -> None:
    belief = belief_of([0.0, 0.0, 0.0, v, omega, 0.0, 0.0, 0.0], IDENTITY * 1e-4)
    straight, sliding = (predict(belief, 0.001, DENSITY, each) for each in ((0.0, 0.0), (0.02, 0.01)))
    # towards the curve's middle is where v omega points
    outwards = -(sliding.mean[Y] - straight.mean[Y]) * np.sign(v * omega)
    assert outwards == pytest.approx(0.02 * v * v * abs(omega) * 0.001, rel=0.01)
    # what is not known of it counts across the way alone
    assert sliding.covariance[Y, Y] > straight.covariance[Y, Y]
    assert sliding.covariance[X, X] == pytest.approx(straight.covariance[X, X], rel=0.01)


def rows(h: Sequence[Row]) -> Array:
    """A Jacobian as an array."""
    return np.array([IDENTITY[row] if isinstance(row, int) else row for row in h])


def numeric(function: object, at: Array) -> Array:
    """The Jacobian by differences."""
    assert callable(function)
    columns = []
    for k in range(SIZE):
        step = np.zeros(SIZE)
        step[k] = 1e-6
        columns.append(np.subtract(function(at + step), function(at - step)) / 2e-6)
    return np.stack(columns, axis=1)


@given(
    st.floats(-1.5, 1.5).filter(lambda v: abs(v) > 0.06), st.floats(-1.7, 1.7), st.floats(-3.0, 3.0),
    st.floats(-0.2, 0.2), st.booleans(),
)  # fmt: skip
def test_the_jacobians_are_the_derivatives(v: float, curvature: float, theta: float, slip: float, exact: bool) -> None:
    mean = (1.0, 2.0, theta, v, curvature * v, 0.02, slip, 0.1)
    at = np.array(mean)
    by = numeric(lambda at: encoders(tuple(at), exact=exact)[0], at)
    assert rows(encoders(mean, exact=exact)[1]) == pytest.approx(by, abs=1e-6)
    assert rows(velocities(mean)[1]) == pytest.approx(numeric(lambda at: velocities(tuple(at))[0], at), abs=1e-6)
    _, h = antenna(mean, (-0.1, 0.05))
    assert np.array(h) == pytest.approx(numeric(lambda at: antenna(tuple(at), (-0.1, 0.05))[0], at), abs=1e-6)


def test_outside_it_tells_the_cars_speed_with_its_covariance() -> None:
    belief = belief_of([1.0, 2.0, 0.3, 0.5, 0.2, 0.01, 0.04, 0.0], covariance(np.random.default_rng(4), SIZE))
    v, told = outside(belief)
    j = numeric(lambda at: np.array([*at[:3], at[3] * (1.0 - at[6]), at[4]]), np.array(belief.mean))
    assert v == pytest.approx(0.48)
    assert np.reshape(told, (5, 5)) == pytest.approx(j @ belief.covariance @ j.T, abs=1e-6)


@given(st.floats(-1.5, 1.5).filter(lambda v: abs(v) > 0.06), st.floats(-1.7, 1.7), st.floats(0.0, 0.2))
def test_steered_wheels_tell_the_middles_motion_whatever_the_understeer(
    v: float, curvature: float, understeer: float
) -> None:
    # a hub's velocity on its wheel's heading, with the angle that the curvature takes with understeer
    omega = curvature * v
    phi = np.arctan(0.5 * WHEELBASE * curvature * (1.0 + understeer * v * v))
    rolls = v * np.cos(phi) + 0.5 * WHEELBASE * omega * np.sin(phi)
    assert centred(rolls, omega * np.cos(phi), WHEELBASE, float(phi)) == pytest.approx((v, omega))


def test_the_wheels_tell_their_own_angle_where_nobody_knows_it() -> None:
    # at full lock they roll more and turn less than the middle
    phi = np.arctan(0.5 * WHEELBASE / 0.56)
    assert 1.0 / np.cos(phi) == pytest.approx(1.045, abs=0.002)
    assert centred(0.56 / np.cos(phi), np.cos(phi), WHEELBASE, None) == pytest.approx((0.56, 1.0))
    assert centred(0.0, 1.0, WHEELBASE, None) == (0.0, 1.0)
    assert centred(0.5, 1.0, 0.0, None) == (0.5, 1.0), "wheels that do not steer"


@settings(max_examples=examples(50))
@given(st.integers(0, 2**32 - 1))
@example(180837)  # a measurement takes 10 digits away
def test_the_covariance_stays_symmetric_and_positive_whatever_is_measured(seed: int) -> None:
    rng = np.random.default_rng(seed)
    belief = belief_of(rng.normal(size=SIZE), covariance(rng, SIZE))
    for _ in range(30):
        belief = predict(belief, float(rng.uniform(0.0, 0.5)), DENSITY)
        before = np.abs(belief.covariance).max()
        h = rng.normal(size=(int(rng.integers(1, 4)), SIZE))
        h[:, slice(0, ROLLED) if rng.random() < 0.5 else slice(ROLLED, SIZE)] = 0.0
        sigmas = 10.0 ** rng.uniform(-4.0, 0.0, len(h))
        told = list(map(tuple, h.tolist()))
        belief, nis, _ = update(belief, rng.normal(size=len(h)).tolist(), told, sigmas.tolist())
        assert nis >= 0.0
        assert np.linalg.eigvalsh(belief.covariance).min() > -1e-14 * before, "but for rounding"


@pytest.mark.parametrize("wrong", [np.nan, np.inf])
def test_a_measurement_that_is_no_number_changes_nothing(wrong: float) -> None:
    belief = belief_of(np.zeros(SIZE), IDENTITY)
    after, nis, _ = update(belief, [wrong], [GYRO], [1.0])
    assert after is belief
    assert not np.isfinite(nis)


@pytest.mark.parametrize("state", [X, Y, BIAS, SLIP])
def test_a_state_that_has_no_row_by_its_index_is_not_taken_for_another(state: int) -> None:
    with pytest.raises(ValueError, match=f"state {state}"):
        update(belief_of(np.zeros(SIZE), IDENTITY), [1.0], [state], [1.0])


def test_another_frame_turns_the_pose_and_leaves_distances() -> None:
    belief = belief_of([1.0, 0.0, 0.5, 0.4, 0.3, 0.0, 0.0, 0.0], np.diag([0.04, 0.01, 0.1, 1.0, 1.0, 1.0, 1.0, 1.0]))
    after = turned(belief, np.pi / 2, 2.0, 3.0, np.zeros((3, 3)))
    assert after.mean[:3] == pytest.approx([2.0, 4.0, 0.5 + np.pi / 2])
    assert np.diag(after.covariance)[:3] == pytest.approx([0.01, 0.04, 0.1])
    assert after.mean[3:] == pytest.approx(belief.mean[3:])


def test_its_errors_are_as_large_as_it_says_and_so_are_its_surprises() -> None:
    """NEES and NIS of 400 seeded runs, all at once, lie in their 95 % bands (BLK 5.4.2)."""
    runs, cycles, dt = 400, 30, 0.02
    rng = np.random.default_rng(3)
    sigma = np.array([0.02, 0.02, 0.02, 0.02, 0.02, 0.01, 0.02, 0.05])
    density = Drift(yaw_rate=0.1).density()
    start = np.array([0.0, 0.0, 0.0, 0.5, 0.3, 0.0, 0.0, 0.0])
    of_wheels, of_gyro, of_pose = (0.005, 0.04), (0.005,), (0.02,) * 3
    errors, surprises, numbers = np.empty(runs), 0.0, 0
    for run in range(runs):
        truth = start + sigma * rng.normal(size=SIZE)
        belief = belief_of(start, np.diag(sigma**2))
        for cycle in range(cycles):
            moved = predict(belief_of(truth, IDENTITY), dt, density).mean
            truth = moved + np.sqrt(np.array(density) * dt) * rng.normal(size=SIZE)
            belief = predict(belief, dt, density)
            told = [
                (encoders(tuple(truth))[0], *encoders(belief.mean), of_wheels),
                ([np.dot(GYRO, truth)], [np.dot(GYRO, belief.mean)], [GYRO], of_gyro),
                (truth[:3], belief.mean[:3], POSE, of_pose),
            ]
            z, expected, h, sigmas = told[cycle % 3]
            residual = z + np.array(sigmas) * rng.normal(size=len(z)) - expected
            belief, nis, _ = update(belief, residual.tolist(), h, sigmas)
            surprises, numbers = surprises + nis, numbers + len(z)
        error = truth - belief.mean
        error[THETA] = wrap_angle(error[THETA])
        errors[run] = error @ np.linalg.solve(belief.covariance, error)
    nees = errors.mean()
    band = 1.96 * np.sqrt(2.0 * SIZE / runs)  # the mean of chi squares of 8, of so many runs
    assert abs(nees - SIZE) < band
    assert abs(surprises / numbers - 1.0) < 1.96 * np.sqrt(2.0 / numbers)


def test_a_belief_leans_by_what_a_gyro_that_reads_too_much_makes_of_it() -> None:
    """Two filters, one of whose gyro reads 0.01 % more: their means differ by how the first one leans."""
    scale, count = 1e-4, 200
    sigma = np.array([0.02, 0.02, 0.02, 0.1, 0.1, 0.01, 0.05, 0.05])
    first = belief_of(np.zeros(SIZE), np.diag(sigma**2), Lean(np.zeros(1), np.zeros((SIZE, 1)), np.eye(1) * 1e-12))
    second = belief_of(np.zeros(SIZE), np.diag(sigma**2))
    truth = belief_of([0.0, 0.0, 0.0, 0.5, 0.0, 0.0, 0.0, 0.0], IDENTITY)
    for cycle in range(count):
        omega = 1.0 if cycle < count // 2 else -0.5
        truth = predict(belief_of([*truth.mean[:4], omega, 0.0, 0.0, 0.0], IDENTITY), 0.02, DENSITY)
        place, _ = antenna(truth.mean, (-0.1, 0.0))
        found = []
        for belief, rate in ((first, omega), (second, (1.0 + scale) * omega)):
            belief = predict(belief, 0.02, DENSITY)
            (u, _), (rolling, _) = encoders(belief.mean)
            belief = update(belief, [0.5 - u], [rolling], [0.01])[0]
            left = rate - belief.mean[OMEGA] - belief.mean[5]
            belief = update(belief, [left], [GYRO], [0.005], leans=np.array([[omega]]))[0]
            if cycle % 10 == 0:
                expected, rows = antenna(belief.mean, (-0.1, 0.0))
                belief = update(belief, np.subtract(place, expected).tolist(), rows, [0.5, 0.5])[0]
            found.append(belief)
        first, second = found
    assert first.lean is not None
    moved = (np.array(second.mean) - first.mean) / scale
    assert moved == pytest.approx(first.lean.by[:, 0], rel=0.05, abs=0.01)
    assert abs(moved[THETA]) > 0.1


def test_a_belief_that_leans_tells_of_the_parameter_as_a_state_more_would() -> None:
    """Places on a line that are all off by the same amount: the Kalman filter of a place and that amount."""
    rng, sigma, before = np.random.default_rng(5), 0.3, 0.02
    belief = belief_of(
        np.zeros(SIZE), np.diag([1.0, *[1e-12] * 7]), Lean(np.zeros(1), np.zeros((SIZE, 1)), np.eye(1) * before**2)
    )
    both, spread, h = np.zeros(2), np.diag([1.0, before**2]), np.array([1.0, 1.0])
    for _ in range(30):
        told = 0.5 + 0.01 + sigma * float(rng.normal())
        belief = update(
            belief,
            [told - belief.mean[X] - (belief.lean.value[0] if belief.lean else 0.0)],
            POSE[:1],
            [sigma],
            leans=np.ones((1, 1)),
        )[0]
        gain = spread @ h / (h @ spread @ h + sigma**2)
        both, spread = both + gain * (told - h @ both), spread - np.outer(gain, h @ spread)
    assert belief.lean is not None
    ours = upright(belief)
    assert belief.lean.value[0] == pytest.approx(both[1], rel=1e-6)
    assert belief.lean.covariance[0, 0] == pytest.approx(spread[1, 1], rel=1e-6)
    assert ours.mean[X] == pytest.approx(both[0], rel=1e-6)
    assert ours.covariance[X, X] == pytest.approx(spread[0, 0], rel=1e-6)


def test_slip_that_wanders_moves_a_car_by_as_much_as_its_spectral_density_says() -> None:
    # straight on at 1 m/s: the way is the sum of a Gauss-Markov process, of variance 2 sigma^2 tau (T - tau) in the end
    sigma, lasts, dt, seconds = 0.05, 2.0, 0.02, 40.0
    spread = np.zeros((SIZE, SIZE))
    spread[SLIP, SLIP] = sigma**2
    belief = belief_of((0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0), spread)
    for _ in range(round(seconds / dt)):
        belief = predict(wandering(belief, dt, sigma, lasts), dt, (0.0,) * 8)
    assert belief.covariance[X, X] == pytest.approx(2.0 * sigma**2 * lasts * (seconds - lasts), rel=0.02)
    assert belief.covariance[SLIP, SLIP] == pytest.approx(sigma**2)

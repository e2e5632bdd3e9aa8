"""The extended Kalman filter: equal to another one's, consistent, and its covariance a covariance."""

import numpy as np
import pytest
from filterpy.kalman import ExtendedKalmanFilter, KalmanFilter
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from txt1.estimation.ekf import (
    BIAS,
    IDENTITY,
    OMEGA,
    ROLLED,
    SIZE,
    SLIP,
    THETA,
    Array,
    Belief,
    Drift,
    X,
    Y,
    antenna,
    encoders,
    picked,
    predict,
    turned,
    update,
    velocities,
    whitener,
)
from txt1.model.kinematics import wrap_angle

WHEELBASE = 0.34
GYRO = picked(OMEGA) + picked(BIAS)
DENSITY = Drift().density()


def covariance(rng: np.random.Generator, size: int) -> Array:
    root = rng.normal(size=(size, size))
    return root @ root.T + 0.1 * np.eye(size)


def test_straight_ahead_it_is_the_kalman_filter_of_another_library_to_1e_9() -> None:
    # heading and yaw rate known and 0: x and v are linear, a car that drives straight on
    rng = np.random.default_rng(1)
    drift = Drift(heading=0.0, yaw_rate=0.0, bias=0.0, slip=0.0)
    sure = [THETA, OMEGA, BIAS, SLIP]
    initial = covariance(rng, SIZE)
    initial[sure, :] = initial[:, sure] = 0.0
    ours = Belief(np.array([0.3, -0.2, 0.0, 0.5, 0.0, 0.0, 0.0]), initial)
    other = KalmanFilter(dim_x=SIZE, dim_z=2)
    other.x, other.P, other.Q = ours.mean.copy(), initial.copy(), drift.density() * 0.02
    other.F = IDENTITY.copy()
    other.F[X, ROLLED] = 0.02
    other.H, other.R = picked(X, Y), covariance(rng, 2)
    # with v and heading 0 uncertain by nothing, y does not depend on the speed
    for _ in range(500):
        ours = predict(ours, 0.02, drift.density())
        other.F[Y, THETA] = 0.02 * other.x[ROLLED]
        other.predict()
        z = rng.normal(size=2)
        ours, nis, _ = update(ours, z - ours.mean[:2], other.H, other.R)
        other.update(z)
        assert ours.mean == pytest.approx(other.x, abs=1e-9)
        assert ours.covariance == pytest.approx(other.P, abs=1e-9)
        assert nis == pytest.approx(other.mahalanobis**2, abs=1e-9)


def test_in_curves_it_is_the_extended_kalman_filter_of_another_library() -> None:
    rng = np.random.default_rng(2)
    ours = Belief(np.array([0.3, -0.2, 0.4, 0.5, 0.3, 0.01, 0.02]), covariance(rng, SIZE) * 1e-3)
    other = ExtendedKalmanFilter(dim_x=SIZE, dim_z=2)
    for _ in range(200):
        before = ours
        ours = predict(before, 0.02, DENSITY, bend=0.1)
        other.x, other.P, other.Q = before.mean.copy(), before.covariance.copy(), DENSITY * 0.02
        other.F = numeric(lambda mean: predict(Belief(mean, IDENTITY), 0.02, DENSITY, bend=0.1).mean, before.mean)
        other.predict()
        assert ours.covariance == pytest.approx(other.P, rel=5e-4, abs=1e-6)  # differences, not derivatives
        other.x, other.P = ours.mean.copy(), ours.covariance.copy()
        expected, h = encoders(ours.mean, WHEELBASE)
        residual, r = rng.normal(size=2) * 0.01, covariance(rng, 2) * 1e-3
        ours, _, _ = update(ours, residual, h, r)
        other.update(expected + residual, lambda _, h=h: h, lambda _, e=expected: np.array(e), r)
        assert ours.mean == pytest.approx(other.x, abs=1e-9)
        assert ours.covariance == pytest.approx(other.P, abs=1e-9)


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
    st.floats(-0.2, 0.2),
)  # fmt: skip
def test_the_jacobians_are_the_derivatives(v: float, curvature: float, theta: float, slip: float) -> None:
    mean = np.array([1.0, 2.0, theta, v, curvature * v, 0.02, slip])
    _, h = encoders(mean, WHEELBASE)
    assert h == pytest.approx(numeric(lambda at: encoders(at, WHEELBASE)[0], mean), abs=1e-6)
    assert velocities(mean)[1] == pytest.approx(numeric(lambda at: velocities(at)[0], mean), abs=1e-6)
    _, h = antenna(mean, (-0.1, 0.05))
    assert h == pytest.approx(numeric(lambda at: antenna(at, (-0.1, 0.05))[0], mean), abs=1e-6)


def test_the_encoders_tell_more_path_and_less_turn_than_the_centre_at_full_lock() -> None:
    told, _ = encoders(np.array([0.0, 0.0, 0.0, 0.56, 1.0, 0.0, 0.0]), WHEELBASE)
    assert told[0] / 0.56 == pytest.approx(1.045, abs=0.002)
    assert told[1] == pytest.approx(0.957, abs=0.002)


@given(
    arrays(float, (3, 3), elements=st.floats(-1.0, 1.0)), st.integers(1, 3), st.floats(1e-2, 1.0),
)  # fmt: skip
def test_whitened_numbers_are_independent_and_of_variance_1(root: Array, size: int, least: float) -> None:
    s = (root @ root.T)[:size, :size] + least * np.eye(size)
    white = np.array(whitener(s.tolist()))
    assert white @ s @ white.T == pytest.approx(np.eye(size), abs=1e-9)
    assert np.triu(white, 1) == pytest.approx(0.0, abs=0.0)


@settings(max_examples=50)
@given(st.integers(0, 2**32 - 1))
def test_the_covariance_stays_symmetric_and_positive_whatever_is_measured(seed: int) -> None:
    rng = np.random.default_rng(seed)
    belief = Belief(rng.normal(size=SIZE), covariance(rng, SIZE))
    for _ in range(30):
        belief = predict(belief, float(rng.uniform(0.0, 0.5)), DENSITY, float(rng.normal()))
        h = rng.normal(size=(int(rng.integers(1, 4)), SIZE))
        r = np.diag(10.0 ** rng.uniform(-8.0, 0.0, len(h)))
        belief, nis, _ = update(belief, rng.normal(size=len(h)), h, r)
        assert nis >= 0.0
        assert belief.covariance == pytest.approx(belief.covariance.T, abs=1e-9 * np.abs(belief.covariance).max())
        assert np.linalg.eigvalsh(belief.covariance).min() > -1e-9 * np.abs(belief.covariance).max()


@pytest.mark.parametrize("wrong", [100.0, np.nan, np.inf])
def test_a_measurement_beyond_the_gate_changes_nothing(wrong: float) -> None:
    belief = Belief(np.zeros(SIZE), IDENTITY)
    after, nis, _ = update(belief, np.array([wrong]), GYRO, np.eye(1), gate=25.0)
    assert after is belief
    assert not nis <= 25.0


def test_another_frame_turns_the_pose_and_leaves_distances() -> None:
    belief = Belief(np.array([1.0, 0.0, 0.5, 0.4, 0.3, 0.0, 0.0]), np.diag([0.04, 0.01, 0.1, 1.0, 1.0, 1.0, 1.0]))
    after = turned(belief, np.pi / 2, 2.0, 3.0, np.zeros((3, 3)))
    assert after.mean[:3] == pytest.approx([2.0, 4.0, 0.5 + np.pi / 2])
    assert np.diag(after.covariance)[:3] == pytest.approx([0.01, 0.04, 0.1])
    assert after.mean[3:] == pytest.approx(belief.mean[3:])


def test_its_errors_are_as_large_as_it_says_and_so_are_its_surprises() -> None:
    """NEES and NIS of 1000 seeded runs, all at once, lie in their 95 % bands (BLK 5.4.2)."""
    runs, cycles, dt = 1000, 30, 0.02
    rng = np.random.default_rng(3)
    sigma = np.array([0.02, 0.02, 0.02, 0.02, 0.02, 0.01, 0.02])
    density = Drift(yaw_rate=0.1).density()
    start = np.array([0.0, 0.0, 0.0, 0.5, 0.3, 0.0, 0.0])
    r_wheels, r_gyro, r_pose = np.diag([0.005, 0.04]) ** 2, np.eye(1) * 0.005**2, np.diag([0.02, 0.02, 0.02]) ** 2
    errors, surprises, numbers = np.empty(runs), 0.0, 0
    for run in range(runs):
        truth = start + sigma * rng.normal(size=SIZE)
        belief = Belief(start, np.diag(sigma**2))
        for cycle in range(cycles):
            moved = predict(Belief(truth, IDENTITY), dt, density).mean
            truth = moved + np.sqrt(np.diag(density) * dt) * rng.normal(size=SIZE)
            belief = predict(belief, dt, density)
            told = [
                (encoders(truth, WHEELBASE)[0], *encoders(belief.mean, WHEELBASE), r_wheels),
                (GYRO @ truth, GYRO @ belief.mean, GYRO, r_gyro),
                (truth[:3], belief.mean[:3], picked(X, Y, THETA), r_pose),
            ]
            which = told[cycle % 3]
            z = np.array(which[0]) + np.sqrt(np.diag(which[3])) * rng.normal(size=len(which[3]))
            belief, nis, _ = update(belief, z - np.array(which[1]), which[2], which[3])
            surprises, numbers = surprises + nis, numbers + len(z)
        error = truth - belief.mean
        error[THETA] = wrap_angle(error[THETA])
        errors[run] = error @ np.linalg.solve(belief.covariance, error)
    nees = errors.mean()
    band = 1.96 * np.sqrt(2.0 * SIZE / runs)  # the mean of chi squares of 7, of 1000 runs
    assert abs(nees - SIZE) < band
    assert abs(surprises / numbers - 1.0) < 1.96 * np.sqrt(2.0 / numbers)

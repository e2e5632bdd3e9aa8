"""The metrics of responses whose answers are known."""

from math import exp, inf, log, pi

import numpy as np
import pytest

from txt1.experiments.metrics import (
    QUANTUM,
    battery,
    circle,
    cross_track,
    difference,
    droops,
    even,
    judge,
    leg_metrics,
    paths_apart,
    repeated_steps,
    response,
    settled_after,
    smooth,
    steps,
)
from txt1.experiments.profile import Profile
from txt1.experiments.recording import Instant, Recording, load, mean_of, save
from txt1.experiments.runner import Leg
from txt1.model.battery import pack_voltage, remaining_time

DT = 0.02
TAU = 0.5


def step_response(truth: bool, after: float = 0.5, overshoot: float = 0.0) -> Recording:
    """1 s of rest, then a response of first order with TAU, with a bump that decays; by truth or by the encoders."""
    samples = []
    way = 0.0
    for k in range(600):
        t = k * DT - 1.0
        s = max(t, 0.0)
        v = after * (1.0 - exp(-s / TAU) + overshoot * 2.0 * s / TAU * exp(-s / TAU)) if t > 0.0 else 0.0
        set_v = after if t >= 0.0 else 0.0
        way += v * DT
        samples.append(
            Instant(k * DT, set_v, true_v=v, true_omega=0.0, true_x=0.0)
            if truth
            else Instant(k * DT, set_v, v=v, read=k * DT, way=way)
        )
    return Recording(samples)


@pytest.mark.parametrize("after", [0.5, -0.5])
def test_a_first_order_response_rises_in_2_2_and_settles_in_3_time_constants(after: float) -> None:
    [step] = steps(step_response(True, after))
    assert step.rise == pytest.approx(TAU * log(9.0), abs=0.06)  # the means over 0.2 s round the corner
    assert step.settling == pytest.approx(TAU * log(20.0), abs=0.06)
    assert step.overshoot == pytest.approx(0.0, abs=1e-3)
    assert step.steady_error == pytest.approx(0.0, abs=1e-3)


def test_an_overshoot_is_found() -> None:
    [step] = steps(step_response(True, overshoot=1.0))
    # 1 + (2 s - 1) exp(-s) with s in time constants is largest at s = 1.5
    assert step.overshoot == pytest.approx(2.0 * exp(-1.5), abs=0.01)


def test_a_response_that_creeps_up_to_its_end_has_not_overshot() -> None:
    samples = [Instant(k * DT, 0.5, true_v=0.5 - 0.1 * exp(-k * DT / 3.0), true_x=0.0) for k in range(300)]
    [step] = steps(Recording(samples))
    assert step.overshoot == 0.0


def test_settling_is_timed_between_samples() -> None:
    deviation = np.array([1.0, 0.3, -0.1, 0.05])
    assert settled_after(deviation, 0.2, np.arange(4.0)) == pytest.approx(1.25)
    assert settled_after(-deviation, 0.2, np.arange(4.0)) == pytest.approx(1.25)
    assert settled_after(deviation, 2.0, np.arange(4.0)) == 0.0
    assert settled_after(deviation, 0.01, np.arange(4.0)) == inf


def noisy(seed: int, bump: float, runs: int) -> list[Recording]:
    """Steps of 0.5 m/s that overshoot by a bump at 1 s, over a floor that makes each other speed 2 % off."""
    rng = np.random.default_rng(seed)
    times = np.arange(0.0, 6.0, DT)
    return [
        Recording(
            Instant(t, 0.5, true_v=0.5 * (1.0 + bump * exp(-(((t - 1.0) / 0.3) ** 2)) + noise), true_x=0.0)
            for t, noise in zip(times, 0.02 * rng.standard_normal(len(times)), strict=True)
        )
        for _ in range(runs)
    ]


def test_of_repeated_runs_noise_is_no_overshoot() -> None:
    found = [repeated_steps(noisy(seed, 0.0, 10))[0] for seed in range(20)]
    highest = [steps(mean_of(noisy(seed, 0.0, 10)))[0].overshoot for seed in range(20)]
    assert min(highest) > 0.002, "the highest of the mean would call it one"
    mean = np.mean([step.overshoot for step in found])
    assert mean < 0.002
    assert all(step.overshoot_error is not None and step.overshoot < 3.0 * step.overshoot_error for step in found)


def test_of_repeated_runs_an_overshoot_is_found_within_its_standard_error() -> None:
    found = [repeated_steps(noisy(seed, 0.03, 10))[0] for seed in range(20)]
    off = [(step.overshoot - 0.03) / (step.overshoot_error or 0.0) for step in found]
    assert abs(np.mean(off)) < 1.0
    assert np.std(off) < 2.0
    assert repeated_steps(noisy(1, 0.03, 1))[0].overshoot_error is None


def behind_a_line(late: float, jitter: float, rounded: float) -> Recording:
    """A step and what a host hears of it: odometry every 50 ms, later than it was read, in whole mm."""
    rng = np.random.default_rng(3)
    arrives = [(0.05 * n + late + jitter * rng.random(), 0.05 * n) for n in range(200)]
    samples = []
    for k in range(450):
        heard = [pair for pair in arrives if pair[0] <= k * DT] or [(0.0, 0.0)]
        arrived, read = heard[-1]
        s = max(read - 1.0, 0.0)
        way = 0.5 * (s - TAU * (1.0 - exp(-s / TAU)))
        samples.append(
            Instant(
                k * DT,
                0.5 if k * DT >= 1.0 else 0.0,
                v=0.5 * (1.0 - exp(-s / TAU)),
                read=arrived,
                way=rounded * round(way / rounded),
            )
        )
    return Recording(samples)


def test_means_behind_a_line_are_taken_from_the_way_not_from_arrivals() -> None:
    plain = behind_a_line(0.0, 0.0, 1e-9)
    later = behind_a_line(0.03, 0.04, 0.001)
    found = difference(plain, later, "v")
    assert found is not None
    assert 0.04 <= found.delay[0] == found.delay[1] <= 0.06
    assert found.rms < 0.003
    assert found.largest < 0.01
    assert difference(plain, later, "omega") is None
    jitter = response(later, "v")[300:] - 0.5
    assert np.abs(jitter).max() < 0.01, "40 ms of 0.2 s would be 100 mm/s"


def test_readings_that_come_late_in_pairs_keep_their_pace() -> None:
    """As a host sees them that was busy: two at once, and a lost one."""
    read = np.array([0.0, 50.0, 100.0, 180.0, 200.7, 250.0, 349.0, 395.0, 451.0]) / 1000.0
    between = np.diff(even(read))
    assert between / between[0] == pytest.approx(np.array([1.0, 1.0, 1.0, 1.0, 1.0, 2.0, 1.0, 1.0]))
    assert between[0] == pytest.approx(0.05, rel=0.02)


def test_on_hardware_no_band_is_narrower_than_an_encoder_count() -> None:
    [truth], [encoders] = steps(step_response(True, 0.1)), steps(step_response(False, 0.1))
    assert truth.band == pytest.approx(0.005)
    assert encoders.band == QUANTUM["v"]
    assert truth.settling is not None and encoders.settling is not None and encoders.settling < truth.settling


def test_a_response_that_never_rests_has_no_settling_time() -> None:
    samples = [
        Instant(k * DT, 0.5 if k >= 50 else 0.0, true_v=0.5 + 0.2 * np.sin(k * DT * 2.0), true_x=0.0)
        for k in range(600)
    ]
    [step] = steps(Recording(samples))
    assert step.settling is None


def test_a_stop_is_told_apart_from_a_step() -> None:
    samples = [Instant(k * DT, 0.5 if k < 100 else 0.0, true_v=0.5 if k < 100 else 0.0, true_x=0.0) for k in range(200)]
    recording = Recording(samples)
    assert [step.after for step in steps(recording)] == [0.5]
    assert len(steps(recording, stops=True)) == 1


def test_the_droop_is_the_share_of_speed_that_is_lost() -> None:
    samples = []
    for k in range(300):
        turning = k >= 150
        v = 0.45 if 150 <= k < 180 else 0.5
        samples.append(Instant(k * DT, 0.5, 0.8 if turning else 0.0, true_v=v, true_x=0.0))
    [droop] = droops(Recording(samples))
    assert droop.droop == pytest.approx(0.1, abs=0.005)


@pytest.mark.parametrize("drift", [0.0, 0.004])
def test_a_circle_has_its_radius_and_the_distance_of_its_laps(drift: float) -> None:
    samples = []
    for k in range(2000):
        angle = 0.5 * k * DT
        samples.append(
            Instant(
                k * DT,
                0.5,
                0.5,
                true_v=0.5,
                true_omega=0.5,
                true_x=np.cos(angle) + drift * angle,
                true_y=np.sin(angle),
                true_theta=angle + pi / 2.0,
            )
        )
    found = circle(Recording(samples))
    assert found is not None
    assert found.asked == 1.0
    assert found.radius == pytest.approx(1.0, abs=1e-3 + drift)
    assert found.lap_to_lap == pytest.approx(2.0 * pi * drift, abs=2e-3)


def test_paths_apart_is_the_distance_of_places_from_the_line() -> None:
    straight = Recording([Instant(k * DT, 0.5, x=0.01 * k) for k in range(200)])
    beside = Recording([Instant(k * DT, 0.5, x=0.013 * k, y=0.02) for k in range(150)])
    assert paths_apart(straight, beside) == pytest.approx((0.02, 0.02))


def test_cross_track_is_left_positive_and_counted_round_the_corner_only() -> None:
    samples = [Instant(k * DT, 0.5, true_x=0.01 * k, true_y=0.05) for k in range(400)]
    recording = Recording(samples)
    legs = [Leg(0.0, (-1.0, 0.0), (0.0, 0.0)), Leg(0.0, (0.0, 0.0), (4.0, 0.0))]
    assert cross_track(recording, legs[1]) == pytest.approx(0.05)
    assert leg_metrics(recording, []) == [], "stopped before the first leg"
    [leg] = leg_metrics(recording, legs)
    assert leg.rms == pytest.approx(0.05)


def test_the_discharge_line_is_recovered() -> None:
    samples = [
        Instant(60.0 * m, voltage=pack_voltage(m), remaining=remaining_time(pack_voltage(m)))
        for m in np.arange(0, 50, 0.1)
    ]
    found = battery(Recording(samples))
    assert found is not None
    assert found.slope_error == pytest.approx(0.0, abs=1e-6)
    assert found.intercept_error == pytest.approx(0.0, abs=1e-6)
    assert found.remaining_worst == pytest.approx(0.0, abs=0.1)


def test_means_keep_a_constant_and_halve_no_edge() -> None:
    times = np.arange(50) * DT
    assert smooth(np.full(50, 3.0), times) == pytest.approx(3.0)


def test_nothing_measured_is_no_error() -> None:
    profile = Profile.model_validate(
        {"title": "t", "figure": "velocities", "steps": [{"v": 0, "omega": 0, "seconds": 1}]}
    )
    assert judge(Recording([]), [], profile) == {"judged_by": "encoders"}
    assert circle(Recording([])) is None
    assert battery(Recording([])) is None


def test_a_recording_survives_its_file(tmp_path) -> None:  # type: ignore[no-untyped-def]
    recording = step_response(True)
    save(recording, tmp_path)
    again = load(tmp_path)
    assert again["true_v"] == pytest.approx(recording["true_v"], abs=1e-6)
    assert again.knows_truth
    assert not again.without_truth().knows_truth


def test_the_mean_of_recordings_keeps_their_set_points() -> None:
    one, two = step_response(True), step_response(True, overshoot=0.4)
    mean = mean_of([one, two])
    assert (mean["set_v"] == one["set_v"]).all()
    assert mean["true_v"] == pytest.approx(0.5 * (one["true_v"] + two["true_v"]))

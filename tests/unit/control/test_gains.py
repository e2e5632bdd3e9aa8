"""Which gains a vehicle is not given, whoever asks for them."""

from __future__ import annotations

from math import e, inf, nan, nextafter

import pytest
from hypothesis import given
from hypothesis import strategies as st

from txt1.config import Config, load
from txt1.config.sources import recorded, with_values
from txt1.control.gains import WEAKER_FACTOR, GainLimits, gain_limits
from txt1.control.pid import CLEAR, Gains, pid
from txt1.control.schedule import ANGULAR_GAINS, LINEAR_GAINS, GainSet
from txt1.errors import ConfigError
from txt1.model.vehicle import Geometry
from txt1.protocol.layout import encode
from txt1.protocol.messages import PidSet
from txt1.tasks.serial import gain_table


def txt1() -> GainLimits:
    """The limits of the TXT-1 as it is configured by default."""
    return Config().gain_limits()


PLACES = [(loop, name) for loop in GainLimits._fields for name in Gains._fields]
places = st.sampled_from(PLACES)


def outside(limit: float) -> st.SearchStrategy[float]:
    """What is no gain: below 0, above the limit, or no number."""
    above = st.floats(nextafter(limit, inf))
    return st.one_of(st.floats(max_value=0.0, exclude_max=True), above, st.just(nan))


def asked(loop: str, name: str, value: float) -> tuple[Gains, list[GainSet]]:
    """The thesis's gains, but for one."""
    if loop == "linear":
        return LINEAR_GAINS._replace(**{name: value}), list(ANGULAR_GAINS)
    one = ANGULAR_GAINS[2]
    return LINEAR_GAINS, [*ANGULAR_GAINS[:2], one._replace(gains=one.gains._replace(**{name: value}))]


@given(places, st.data())
def test_no_gain_outside_its_limits_passes_and_the_words_name_it(place: tuple[str, str], data: st.DataObject) -> None:
    loop, name = place
    value = data.draw(outside(getattr(getattr(txt1(), loop), name)))
    refused = txt1().refused(*asked(loop, name, value))
    assert refused is not None
    assert refused[0] == (f"linear.{name}" if loop == "linear" else f"angular.2.{name}")
    assert refused[2].startswith("give 0 to") and "counts per m" in refused[2]


@given(places, st.floats(0.0, 1.0))
def test_every_gain_within_its_limits_passes_and_passes_again_behind_the_wire(
    place: tuple[str, str], share: float
) -> None:
    loop, name = place
    linear, sets = asked(loop, name, share * getattr(getattr(txt1(), loop), name))
    assert txt1().refused(linear, sets) is None
    message = PidSet(linear, tuple((s.v_max, *s.gains) for s in sets))
    thousandths = PidSet(
        tuple(round(k, 3) for k in message.linear),  # type: ignore[arg-type]
        tuple(tuple(round(k, 3) for k in each) for each in message.angular),  # type: ignore[misc]
    )
    assert encode(message) == encode(thousandths)
    table = gain_table(thousandths)
    assert table is not None and txt1().refused(table.linear, table.angular.sets) is None


@pytest.mark.parametrize("bad", [nan, inf, -inf, 10**400])
def test_gains_that_are_no_floats_are_no_table(bad: float) -> None:
    assert gain_table(PidSet((bad, 0.0, 0.0), ())) is None
    assert gain_table(PidSet((1.0, 0.0, 0.0), ((1.0, 1.0, bad, 0.0),))) is None


@pytest.mark.parametrize(
    ("vehicle", "linear", "angular"),
    [
        # 2 S = 4 (1 + a) / ((1 - a) K), a = exp(-0.02 / tau), K = 1000 speed_gain; steered: a = 0, K = 300 / (R 18000)
        ("txt1", (181.886, 18188.552, 1.819), (67.2, 6720.0, 0.672)),
        # no wheel steers: the lag of the speed, and K = 2/3 of its 1000 speed_gain over 0.172 m
        ("rover", (250.208, 25020.83, 2.502), (64.554, 6455.374, 0.646)),
    ],
)
def test_the_limits_are_those_of_the_equations(
    vehicle: str, linear: tuple[float, ...], angular: tuple[float, ...]
) -> None:
    config = load(overrides=[f"vehicle={vehicle}"]).config
    assert config.gain_limits() == GainLimits(Gains(*linear), Gains(*angular))
    car, k = config.sim.vehicle, 1000.0 * config.sim.vehicle.speed_gain
    a = e ** (-0.02 / car.speed_time_constant)
    assert linear[0] == pytest.approx(2.0 * (1.0 + a) / ((1.0 - a) * k), rel=1e-5)
    if vehicle == "rover":
        wider = load(overrides=[f"vehicle={vehicle}", f"sim.vehicle.skid={2.0 * car.skid}"]).config.gain_limits()
        assert wider.angular.kp == pytest.approx(2.0 * angular[0], rel=1e-4), "it turns half as fast"
        turn = k * 2.0 / (3.0 * config.geometry.track_width * car.skid)
        assert angular[0] == pytest.approx(2.0 * (1.0 + a) / ((1.0 - a) * turn), rel=1e-5)
    else:
        assert angular[0] == pytest.approx(2.0 / (300.0 / (config.geometry.radius_min * 18000.0)), rel=1e-5)


@given(
    st.sampled_from(("both", "front", "skid")),
    st.floats(0.01, 10.0),
    st.floats(1e-6, 0.1),
    st.floats(1e-3, 1e3),
    st.floats(0.5, 5.0),
    st.sampled_from((0.02, 0.05)),
)
def test_the_thesis_gains_pass_on_any_vehicle(
    steering: str, length: float, speed_gain: float, time_constant: float, skid: float, period: float
) -> None:
    geometry = Geometry(steering=steering, radius_min=length, track_width=length)  # type: ignore[arg-type]
    limits = gain_limits(geometry, speed_gain, time_constant, skid, period)
    assert limits.refused(LINEAR_GAINS, ANGULAR_GAINS) is None
    assert limits.refused(Gains(99999.0 * limits.linear.kp), ()) is not None


@pytest.mark.parametrize("name", Gains._fields)
@pytest.mark.parametrize(("share", "swings"), [(0.9, False), (1.1, True)])
def test_a_loop_swings_beyond_the_bound_and_not_within(name: str, share: float, swings: bool) -> None:
    # without the margin, on the vehicle that the equations are about
    period, lag, k = 0.02, 2.718281828459045 ** (-0.02 / 0.3), 0.33
    gains = Gains(**{name: share / WEAKER_FACTOR * getattr(txt1().linear, name)})
    past, y, ys = CLEAR, 0.0, []
    for _ in range(2000):
        past = pid(past, (1.0 if len(ys) < 5 else 0.0) - y, gains, period, 1e6)
        y = lag * y + (1.0 - lag) * k * past[0]
        ys.append(y)
    # at the bound the output flips between its limits; a derivative alone ends where another root leaves the circle
    late = [abs(b - a) for a, b in zip(ys[-20:], ys[-19:], strict=False)]
    assert (min(late) > 1e3) is swings


@pytest.mark.parametrize("value", ["-5", "99999", "-0.001"])
@pytest.mark.parametrize(
    "key", ["control.linear.kp", "control.linear.ki", "control.linear.kd", "serial.host.linear.kp"]
)
def test_a_setting_that_is_no_gain_is_refused_by_its_name(key: str, value: str) -> None:
    with pytest.raises(ConfigError, match=rf"{key}: {float(value)}: give 0 to .* \(from --set {key}={value}\)"):
        load(overrides=[f"{key}={value}"])
    with pytest.raises(ConfigError, match=f"{key}: .*give 0 to"):
        with_values(Config(), {key: float(value)})


def test_a_recordings_gains_stay_as_they_were_driven_with() -> None:
    old = recorded({"control": {"linear": {"kp": -5.0, "ki": 0.0, "kd": 0.0}}})
    assert old.control.linear.kp == -5.0
    assert with_values(old, {"name": "a"}).control.linear.kp == -5.0

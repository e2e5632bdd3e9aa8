"""The world that settings compose: each option does what it says."""

from __future__ import annotations

from math import cos, hypot, pi
from typing import Any

import numpy as np
import pytest

from txt1.config import load
from txt1.config.sources import with_values
from txt1.errors import ConfigError
from txt1.learning import env
from txt1.model.light_sensors import MOUNT
from txt1.model.odometry import Odometry
from txt1_learners.composed import Composed

POSE = (1.0, 0.0, pi / 2.0)


def world(options: dict[str, Any] | None = None, **settings: Any) -> Composed:
    values = {"learning.world": "composed", "learning.world_options": options or {}, "sim.light.noise": 0.0}
    return Composed(with_values(load().config, values | settings), np.random.default_rng(1))


def lux(options: dict[str, Any] | None = None, now: float = 0.0, **settings: Any) -> list[float]:
    return list(world(options, **settings).see(now, POSE))


def test_without_options_it_is_the_configured_light() -> None:
    squares = [hypot(1.0 - left, ahead) ** 2 for ahead, left in MOUNT]
    assert lux() == pytest.approx([135.0 / each for each in squares])
    assert lux(**{"sim.light.gains": (2.0, 1.0, 1.0, 1.0)})[0] == pytest.approx(2.0 * lux()[0])
    assert world().goal(3.0) == (0.0, 0.0)


@pytest.mark.parametrize(
    ("options", "now", "told"),
    [
        ({"lamps": [{}, {}]}, 0.0, lambda usual: [2.0 * each for each in usual]),
        ({"lamps": [{"intensity": 13.5}]}, 0.0, lambda usual: [0.1 * each for each in usual]),
        ({"lamps": [{"exponent": 1.0}]}, 0.0, lambda usual: [135.0 * (each / 135.0) ** 0.5 for each in usual]),
        ({"lamps": [{"height": 2.0}]}, 0.0, lambda usual: [135.0 / (135.0 / each + 4.0) for each in usual]),
        ({"lamps": [{"dark_every": 1e-9, "dark_for": 1e9}]}, 1.0, lambda usual: [1.0] * 4),
        ({"ambient": 5.0}, 0.0, lambda usual: [5.0 + each for each in usual]),
        ({"gradient": [3.0, 0.0]}, 0.0, lambda usual: [usual[k] + 3.0 * (1.0 - MOUNT[k][1]) for k in range(4)]),
        ({"sensors": [{"gain": 0.5}]}, 0.0, lambda usual: [0.5 * each for each in usual]),
        ({"sensors": [{"offset": 4.0}]}, 0.0, lambda usual: [4.0 + each for each in usual]),
        ({"sensors": [{"high": 100.0}]}, 0.0, lambda usual: [min(100.0, each) for each in usual]),
        ({"sensors": [{"low": 130.0}]}, 0.0, lambda usual: [max(130.0, each) for each in usual]),
        ({"sensors": [{"quantum": 50.0}]}, 0.0, lambda usual: [50.0 * round(each / 50.0) for each in usual]),
        ({"sensors": [{"lies": 42.0}, {}, {}, {}]}, 0.0, lambda usual: [42.0, *usual[1:]]),
        ({"sensors": [{"drop_out": 1.0}]}, 0.0, lambda usual: [0.0] * 4),
    ],
)  # fmt: skip
def test_lamps_and_sensors(options: dict[str, Any], now: float, told: Any) -> None:
    assert lux(options, now) == pytest.approx(told(lux()))


def test_lamps_move_swing_go_round_and_flicker() -> None:
    assert world({"lamps": [{"velocity": [0.1, -0.2]}]}).goal(5.0) == pytest.approx((0.5, -1.0))
    assert world({"lamps": [{"x": 1.0, "swing": [0.3, 0.0]}]}).goal(1.0) == pytest.approx((1.3, 0.0))
    assert world({"lamps": [{"circle": 0.5, "period": 8.0}]}).goal(4.0) == pytest.approx((-1.0, 0.0))
    flickers = world({"lamps": [{"flicker": 1.0, "flicker_period": 1.0}]})
    seen = [flickers.see(0.016 * k, POSE)[0] for k in range(63)]
    assert min(seen) < 0.1 * max(seen) and np.mean(seen) == pytest.approx(lux()[0], rel=0.05)


def test_sensors_lag_are_late_and_hang() -> None:
    far = (3.0, 0.0, pi / 2.0)
    for errs, after in (({"lag": 0.16}, 1.0), ({"delay": 0.16}, 0.176)):
        late = world({"sensors": [errs]})
        late.see(0.0, far)
        soon = late.see(0.016, POSE)[0]
        for k in range(2, round(after / 0.016) + 1):
            last = late.see(0.016 * k, POSE)[0]
        assert soon < 0.5 * lux()[0] < last == pytest.approx(lux()[0], rel=0.01)
    hangs = world({"sensors": [{"hangs_every": 1e-9, "hangs_for": 1e9}]})
    assert hangs.see(1.0, far) == hangs.see(2.0, POSE)


def test_before_an_episode_late_sensors_stood_on_its_start() -> None:
    for errs, least, most in (({"lag": 10.0}, 0.0, 0.02), ({"delay": 1.0}, 0.1, 0.4)):
        began = world({"sensors": [errs]}, **{"sim.light.noise": 0.2})
        seen = np.array([began.see(0.016 * k, POSE)[0] for k in range(30)]) / lux()[0]
        assert seen.mean() == pytest.approx(1.0, abs=0.15) and least <= seen.std() <= most


def test_a_post_throws_a_shadow() -> None:
    behind = {"sim.obstacles": [{"kind": "post", "x": 0.5, "y": 0.0, "radius": 0.3}]}
    assert lux(**behind) == [1.0] * 4
    assert lux({"ambient": 9.0}, **behind) == [9.0] * 4


def test_odometry_drifts_scales_and_is_missing() -> None:
    def told(**errors: Any) -> Odometry:
        one = world({"odometry": errors})
        for k in range(1, 101):
            found = one.odometry(0.02 * k, Odometry(0.01 * k, 0.0, 0.0, 0.5, 0.0))
        return found

    assert told() == (1.0, 0.0, 0.0, 0.5, 0.0)
    assert told(ways=1.5)[::3] == pytest.approx((1.485, 0.75))
    drifting = told(drift=0.1)
    assert drifting.theta == pytest.approx(0.2) and drifting.omega == pytest.approx(0.1)
    assert hypot(drifting.x, drifting.y) == pytest.approx(0.99, abs=0.01) and drifting.x < cos(0.05)
    assert told(missing=True) == Odometry()
    turning = world({"odometry": {"turns": 0.5}})
    turning.odometry(0.0, Odometry())
    assert turning.odometry(0.1, Odometry(theta=0.2)).theta == pytest.approx(0.1)


def test_actions_are_swapped_from_a_time_on_and_options_change_with_an_episode() -> None:
    swaps = world({"turning": -1.0, "turning_from": 2.0})
    assert swaps.command(1.0, (0.3, 0.5)) == (0.3, 0.5) and swaps.command(2.0, (0.3, 0.5)) == (0.3, -0.5)
    changes = world({"ambient": 1.0, "changes": [{"episode": 3, "set": {"ambient": 50.0}}]})
    seen = []
    for episode in (1, 2, 3, 4):
        changes.begin(episode)
        seen.append(changes.see(0.0, POSE)[0] - lux()[0])
    assert seen == pytest.approx([1.0, 1.0, 50.0, 50.0])


@pytest.mark.parametrize(
    ("options", "told"),
    [
        ({"ambient": -1.0}, r"learning\.world_options\.ambient"),
        ({"lamps": []}, r"learning\.world_options\.lamps"),
        ({"sensors": [{}, {}]}, r"learning\.world_options\.sensors: 2 of them; give one for all, or four"),
        ({"lamps": [{"velocity": [float("inf"), 0.0]}]}, r"learning\.world_options\.lamps"),
        ({"changes": [{"episode": 2, "set": {"ambeint": 3.0}}]}, r"learning\.world_options\.ambeint"),
    ],
)
def test_wrong_options_are_refused_by_their_names(options: dict[str, Any], told: str) -> None:
    with pytest.raises(ConfigError, match=told):
        world(options)


def test_a_world_drives_an_environment() -> None:
    settings = [
        "learning.world=composed",
        "learning.world_options={odometry: {drift: 0.5}, lamps: [{}], turning: -1.0}",
    ]
    told, plain = env.DriveEnv(config=load(overrides=settings).config), env.DriveEnv()
    for each in (told, plain):
        each.reset(seed=1)
    for _ in range(4):
        odd, usual = told.step(np.int64(2))[0], plain.step(np.int64(2))[0]
    assert odd[5] == pytest.approx(0.5 - usual[5], abs=0.1), "it turned the other way, and odometry drifts"

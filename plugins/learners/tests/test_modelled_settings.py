"""No setting without effect: each key of the schema has one, or is refused by its name."""

from __future__ import annotations

from collections.abc import Callable
from itertools import chain
from typing import Any

import numpy as np
import pytest

from txt1.config import Config, completed, flatten, load
from txt1.config.sources import with_values
from txt1.errors import ConfigError, LightFault, Txt1Error
from txt1.learning.registry import make
from txt1.learning.solvability import refuse_unsolvable
from txt1.learning.world import settled
from txt1_learners.studies import suite
from txt1_learners.studies.floor import TICKS, Search, floor_of
from txt1_learners.studies.lockstep import shown, trials, world_at
from txt1_learners.studies.modelled_settings import LOCKSTEP, refuse_others
from txt1_learners.worlds import groups

BASE = {"learning.time_limit": 4.0, "car.known": True}  # short, and with loops that have a use for their settings
WITH = {  # what a key has no use without
    "learning.thesis.temperature_floor": {"learning.thesis.temperature": 0.01},
    "learning.thesis.learn_on": {"learning.thesis.training": 0},
}
OTHER: dict[str, Any] = {  # another value, where one cannot be made of the default
    "hal": "serial",
    "hal_options": {"x": 1},
    "calibrated": ["limits"],
    "geometry.steering": "front",
    "control.angular": [{"kp": 0.5, "ki": 12.0, "kd": 0.0, "v_max": 1.5}],
    "control.speed_map": [[-4000.0, -1.0], [4000.0, 1.0]],
    "safety.motor_max": 900,
    "safety.auto_arm": "never",
    "sim.start": [1.0, 0.0, 0.0],
    "sim.room.map": "laboratory",
    "sim.room.light": [7.0, 0.0],
    "sim.obstacles": [{"kind": "post", "x": 0.0, "y": 0.0, "radius": 0.95}],
    "sim.physics": "mujoco",
    "sim.movers": [{"length": 1.4, "width": 1.4, "path": [[1.0, 0.0], [1.2, 0.0]], "speed": 0.3}],
    "sim.battery.used_1": 2.0,
    "sim.battery.used_2": 2.0,
    "sim.faults.voltage": 8.0,
    "sim.light.exponent": 4,
    "sim.light.noise": 0.0,
    "sim.light.mount": [[0.1, 0.1], [0.1, -0.1], [-0.1, 0.1], [-0.1, -0.1]],
    "sim.light.faults": ["frozen", "none", "none", "none"],
    "serial.control": "host",
    "serial.transport": "serialx",
    "rc.protocol": "sbus",
    "estimation.track_sigma": 0.1,
    "serial.host.angular": [{"kp": 0.4, "ki": 12.0, "kd": 0.0, "v_max": 1.5}],
    "commander.timeouts": {"x": 0.1},
    "commander.priorities": {"x": 1},
    "sensors": {"laser": {"driver": "sim_laser"}},
    "learning.actions": [[0.2, -0.3], [0.2, 0.0], [0.2, 0.3]],
    "learning.changes": [{"episode": 2, "set": {"sim.vehicle.slip": 0.2}}],
    "learning.randomised": {"sim.vehicle.slip": [0.1, 0.2]},
    "learning.drift": {"sim.vehicle.slip": [0.0, 0.2]},
    "learning.boundary": 0.9,
    "learning.goal_period": 0.1,
    "learning.goal_radius": 1.2,
    "learning.thesis.temperature": 0.05,
    "learning.thesis.temperature_decay": 0.001,
    "learning.pose": "odometry",
    "learning.thesis.remedy": "hold",
    "learning.thesis.policy": "random",
    "learning.thesis.rate": "per_state",
    "learning.thesis.cooling": "decisions",
    "learning.thesis.direction": "summed",
    "learning.thesis.training": 0,
    "learning.thesis.temperature_floor": 5.0,
    "odometry.scale": 1.1,
}
OTHER |= {f"gamepad.{what}": "rightx" for what in ("ahead", "steer", "forward", "reverse")}
OTHER |= {
    f"{wired}.{name}.trim": 900.0 for wired in ("channels", "sim.channels") for name in ("motor", "front", "rear")
}
OTHER |= {
    f"{wired}.{name}": -1
    for wired in ("channels", "sim.channels")
    for name in (
        *(f"{channel}.direction" for channel in ("motor", "front", "rear", "right", "left")),
        *("right_encoder", "left_encoder"),
    )
}
NULLS = (
    "never",
    "lz4",
    "gyro",
    "none",
    "robot",
    "original",
    {"imu": {}},
    "x",
    1.5,
    3,
    ["encoders"],
    [0.0, 0.0, 0.0],
    {"x": 1},
)  # in place of null
ELSEWHERE = {  # what says who and when, and the settings of learners that are not asked here
    *("name", "seed", "vehicle", "calibrated"),
    "learning.options",
    "estimation.start_sigma",  # has no use without estimation.start, which is refused
}


def other(key: str, value: Any) -> Any:
    """Another value of a key."""
    if key in OTHER:
        return OTHER[key]
    if isinstance(value, bool):
        return not value
    if isinstance(value, int):
        return value + 100 if value > 10 else value + 1
    if isinstance(value, float):
        return 0.7 * value if value else 0.2
    if isinstance(value, list):
        return [0.7 * each for each in value]
    return None


def driven(config: Config) -> list[float]:
    """How two short episodes of the thesis's learner went: the robot's way, and its table."""
    (one,) = trials(config, lambda rng: make("thesis", config, rng), [1], 2, 1)
    table = one.agent.table().values
    return [value for each in one.episodes for value in (each.time, *each.start)] + list(chain(*table))


def drives(config: Config) -> list[float]:
    """The same with every place and reading on the way."""
    seen: list[float] = []

    class Noting:
        """A learner, and what it was shown."""

        def __init__(self, agent: Any) -> None:
            self.agent = agent

        def __getattr__(self, name: str) -> Any:
            return getattr(self.agent, name)

        def see(self, readings: Any, odometry: Any) -> None:
            seen.extend((*readings, *odometry))
            self.agent.see(readings, odometry)

    (one,) = trials(config, lambda rng: Noting(make("thesis", config, rng)), [1], 2, 1)  # type: ignore[arg-type, return-value]
    return seen + list(chain(*one.agent.table().values)) + [each.time for each in one.episodes]


KEYS = [
    *((key, value) for key, value in flatten(completed(Config())) if key not in ELSEWHERE),
    *(("learning.changes", ()), ("learning.drift", {})),
]


def changed(key: str, value: Any, base: dict[str, Any]) -> Config | None:
    """The configuration with another value of a key; None: the schema refuses every one that was thought of."""
    for each in (
        NULLS if (value is None or value == {} or isinstance(value, str)) and key not in OTHER else (other(key, value),)
    ):
        each = not base.get(key, False) if key == "car.known" else each
        try:
            return with_values(load().config, base | {key: each})
        except ConfigError:
            continue
    return None


def effect_or_refusal(key: str, value: Any, base: dict[str, Any], run: Callable[[Config], list[float]]) -> None:
    """Fail where another value of a key makes no difference, and nobody says so."""
    one = changed(key, value, base)
    if one is None:
        pytest.fail(f"{key}: {other(key, value)} is no value of it; name another in OTHER")
    usual = run(with_values(load().config, base))
    try:
        assert run(one) != usual, f"{key} has no effect, and is not refused"
    except LightFault:
        pass  # a sensor that is not believed
    except Txt1Error as error:
        assert key in str(error), f"{key} is refused, but by another name: {error}"


@pytest.mark.long  # they are compiled
@pytest.mark.parametrize(("key", "value"), KEYS, ids=[key for key, _ in KEYS])
def test_each_key_has_an_effect_in_lockstep_or_is_refused(key: str, value: Any) -> None:
    effect_or_refusal(key, value, BASE | WITH.get(key, {}), drives)


SEES_ALL = (  # a floor knows where the light is, has no noise, and learns nothing
    *("sim.light", "sim.noise.drag", "sensors", "learning.pose", "learning.thesis", "learning.time_limit"),
    *("sim.room.light",),  # it is asked for a place in the robot's frame
    *("sim.vehicle.coast_time_constant", "sim.vehicle.coast_friction"),  # who is in a hurry does not coast
    *("learning.goal_period",),  # the value here is its own; another is refused below
)


@pytest.mark.long  # they are compiled
@pytest.mark.parametrize(
    ("key", "value"), [(key, value) for key, value in KEYS if not key.startswith(SEES_ALL)], ids=str
)
def test_each_key_has_an_effect_on_a_floor_or_is_refused(key: str, value: Any) -> None:
    def searched(config: Config) -> list[float]:
        search = Search(config)
        away = search.task.start_radius
        lights = [(0.3 * away, 0.9 * away), (-away, 0.1)]
        return [n for place in lights for n in search.best(np.tile(place, (search.horizon * TICKS + 1, 1)))]

    effect_or_refusal(key, value, {"car.known": True}, searched)


def test_a_floor_of_our_physics_is_none_of_anothers() -> None:
    other = load(None, ["sim.physics=mujoco"], {}, {}).config
    with pytest.raises(ConfigError, match=r"not mujoco; set sim\.physics=plain, or take one robot"):
        floor_of(other)


@pytest.mark.parametrize("name", sorted(groups()["usual"]))
def test_every_world_of_ours_is_modelled(name: str) -> None:
    (world,) = suite.worlds("usual", [], [name])
    for episode in (1, 16, 31):
        refuse_others(world_at(world.config, episode, 31), LOCKSTEP, "trials in lockstep")


def test_what_a_vehicle_brings_along_is_not_refused_but_the_same_by_hand_is() -> None:
    refuse_others(load(options={"vehicle": "f1tenth"}).config, LOCKSTEP, "trials in lockstep")
    with pytest.raises(ConfigError, match=r"safety\.v_max: 3\.0: trials in lockstep do not model it"):
        refuse_others(load(overrides=["safety.v_max=3.0"]).config, LOCKSTEP, "trials in lockstep")


@pytest.mark.parametrize("setting", ["delay=0.3", "drop_out=0.3", "period=0.1", "options={seed: [1]}"])
def test_an_option_of_a_light_sensor_is_refused_by_its_name(setting: str) -> None:
    config = load(overrides=["sensors.light.driver=sim_light", f"sensors.light.{setting}"]).config
    with pytest.raises(ConfigError, match=rf"^sensors\.light\.{setting.split('=')[0]}: "):
        refuse_others(config, LOCKSTEP, "trials in lockstep")


def test_floors_refuse_what_they_do_not_model() -> None:
    with pytest.raises(ConfigError, match=r"sim\.obstacles: .* floors do not model it"):
        floor_of(with_values(Config(), {"sim.obstacles": OTHER["sim.obstacles"]}))
    for values, told in (
        ({"learning.goal_period": 0.5}, "learning.goal_period: 0.5: floors do not model it"),
        ({"learning.changes": OTHER["learning.changes"]}, "learning.changes: .* floors do not model it"),
        ({"learning.boundary": 2.0}, "learning.boundary: 2: floors do not know it, .* set at least 2.37"),
    ):
        with pytest.raises(ConfigError, match=told):
            Search(with_values(Config(), values))


@pytest.mark.long
@pytest.mark.parametrize("vectorised", [False, True], ids=["one robot", "many robots"])
@pytest.mark.parametrize(("key", "value"), KEYS, ids=[key for key, _ in KEYS])
def test_each_key_has_an_effect_in_an_environment_or_is_refused(key: str, value: Any, vectorised: bool) -> None:
    env = pytest.importorskip("txt1.learning.env")

    def run(config: Config) -> list[float]:
        one = env.DriveVectorEnv(2, config=config) if vectorised else env.DriveEnv(config=config)
        found = []
        for seed in (1, 2, 4, 6):  # not every start comes near the goal, or a wall, within the time
            seen, _ = one.reset(seed=seed)
            found += seen.ravel().tolist()
            for k in range(9):
                seen, rewards, over, late, _ = one.step(np.array([k % 2, 2]) if vectorised else np.int64(k % 3))
                found += [*seen.ravel().tolist(), *np.atleast_1d(rewards), *np.atleast_1d(over), *np.atleast_1d(late)]
                if not vectorised and (over or late):
                    break
        return found

    if key.startswith("learning.thesis.") and (key in WITH or not vectorised):
        pytest.skip("the same for one robot as for many, and for all these keys")
    base = {"learning.time_limit": 4.0, "learning.actions": [[0.3, -0.5], [0.05, 0.0], [0.3, 0.5]]}
    effect_or_refusal(key, value, base | ({} if vectorised else {"car.known": True}), run)


def test_every_world_of_the_suite_can_be_had_and_solved() -> None:
    found = suite.worlds("hostile", [])
    assert len(found) >= 80
    for world in found:
        assert not world.wrong, world.name
        config = settled(world.config)
        refuse_others(config, LOCKSTEP, "trials in lockstep")
        refuse_unsolvable(config)
        shown(config, np.random.default_rng(1))

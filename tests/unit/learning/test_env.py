"""The learning task as a Gymnasium environment."""

from __future__ import annotations

import asyncio
import re
import subprocess
import sys
import textwrap
import warnings
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import txt1
from tests.patience import LIMIT
from txt1.config import load
from txt1.errors import ConfigError, NoDirection
from txt1.hal.registry import create_sim
from txt1.installing import installs
from txt1.learning import env, picture
from txt1.learning.best_time import known_floor
from txt1.learning.drive_tasks import PAYS
from txt1.learning.light_direction import corrected_direction, sector
from txt1.learning.trial import COMMANDS
from txt1.model.light_sensors import Readings
from txt1.model.odometry import Odometry
from txt1.robot import Robot


def test_the_environment_passes_gymnasiums_own_check() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        made = gymnasium.make("txt1/LightSeeking-v0", render_mode="rgb_array")
        check_env(made.unwrapped)


def test_many_robots_at_once_refuse_physics_that_they_do_not_have() -> None:
    other = load(None, ["sim.physics=mujoco"], {}, {}).config
    with pytest.raises(ConfigError, match=r"not mujoco; set sim\.physics=plain, or take one robot"):
        env.DriveVectorEnv(2, "light", other)
    assert known_floor(load(None, (), {}, {}).config) is not None
    assert known_floor(other) is None


@pytest.mark.parametrize("setting", ["sim.room.light=[9,0]", "learning.goal_radius=0.01", "learning.start_radius=20"])
def test_many_robots_at_once_refuse_a_world_that_cannot_be_solved(setting: str) -> None:
    for begin in (env.DriveVectorEnv, env.many):
        with pytest.raises(ConfigError, match=re.escape(setting.split("=")[0])):
            begin(2, "light", load(None, [setting]).config)


@pytest.mark.parametrize(
    "imports",
    ["gymnasium", *(pytest.param(each, marks=pytest.mark.long) for each in ("gymnasium, txt1", "txt1, gymnasium"))],
)
def test_the_environment_is_found_whatever_was_imported_first(imports: str) -> None:
    made = "gymnasium.make('txt1.learning.env:txt1/LightSeeking-v0', render_mode='rgb_array')"
    program = f"import {imports}; print({made}.reset(seed=1)[0].shape)"
    shown = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True, timeout=LIMIT)
    assert shown.stdout == "(6,)\n"


def whole() -> env.DriveEnv:
    """An environment of one robot in the whole simulation, which is not compiled."""
    return env.DriveEnv(render_mode="rgb_array")


def steered(seen: np.ndarray) -> int:
    """The action that turns to where the readings are brightest."""
    try:
        where = sector(corrected_direction(Readings(*(1000.0 ** seen[:4]).tolist())))
    except NoDirection:
        return 1
    return 1 if where == 4 else 2 if where > 4 else 0


def test_who_drives_at_the_light_reaches_it_and_time_is_what_it_costs() -> None:
    made = whole()
    seen, info = made.reset(seed=3)
    total = steps = 0.0
    over = False
    while not over:
        seen, gained, over, late, told = made.step(np.int64(steered(seen)))
        total += gained
        steps += 1
        assert not late
    assert told["success"]
    assert 0.5 * steps > info["optimal_time"] > 2.0
    # the way from the start pays for 2.5 s
    assert total == pytest.approx(PAYS + 2.5 - 0.5 * steps, abs=0.6)


def test_without_numba_the_first_environment_says_what_to_install() -> None:
    program = """import sys, warnings
sys.modules["numba"] = None
from txt1.learning.env import DriveVectorEnv
with warnings.catch_warnings(record=True) as told:
    warnings.simplefilter("always")
    DriveVectorEnv(2), DriveVectorEnv(2)
print(*(each.message for each in told if "numba" in str(each.message)), sep="\\n")
"""
    shown = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True, timeout=LIMIT)
    (told,) = shown.stdout.splitlines()
    assert told.startswith("simulated robots take") and told.endswith(installs("fast"))


@pytest.mark.long  # it is compiled
def test_one_robot_and_one_of_many_have_the_same_numbers() -> None:
    one, many = env.DriveEnv(), env.DriveVectorEnv(1)
    assert isinstance(one.drives.bodies, env.ManyBodies), "the quick simulation takes one robot, too"
    first, _ = one.reset(seed=5)
    other, _ = many.reset(seed=5)
    assert np.array_equal(first, other[0])
    for action in (0, 1, 2, 1):
        seen, reward, over, late, _ = one.step(np.int64(action))
        all_seen, rewards, terminated, truncated, _ = many.step(np.array([action]))
        assert np.array_equal(seen, all_seen[0])
        assert (reward, over, late) == (rewards[0], terminated[0], truncated[0])


@pytest.mark.long  # it is compiled
def test_the_quick_simulation_and_the_whole_one_agree() -> None:
    """Without noise, from the same start, by the same actions."""
    calm = ["sim.light.noise=0", "sim.noise.drag=0"]
    quick = env.DriveEnv("light", load(None, calm).config)
    whole = env.DriveEnv("light", load(None, calm).config, render_mode="rgb_array")
    assert isinstance(whole.drives.bodies, env.OneBody)
    assert np.allclose(quick.reset(seed=5)[0][:4], whole.reset(seed=5)[0][:4], atol=0.01)
    for action in (1, 1, 2, 0):
        seen, reward, *_ = quick.step(np.int64(action))
        other, earned, *_ = whole.step(np.int64(action))
        assert np.allclose(seen[:4], other[:4], atol=0.03)
        assert reward == pytest.approx(earned, abs=0.05)


@pytest.mark.long  # it is compiled
def test_domain_randomisation_gives_each_robot_a_world_of_its_own() -> None:
    ranges = "learning.randomised={sim.light.intensity: [50, 400], sim.vehicle.scrub: [0.0, 0.2]}"
    config = load(None, [ranges, "sim.light.noise=0"]).config
    many = env.DriveVectorEnv(4, "light", config)
    seen, _ = many.reset(seed=1)
    lux = 1000.0 ** seen[:, :4].astype(float)
    assert np.ptp(lux.max(axis=1)) > 30.0
    again, _ = many.reset()
    assert not np.allclose(seen, again)
    one = env.DriveEnv("light", load(None, [ranges, "learning.delay=0.1"]).config)
    brightest = {round(float(one.reset(seed=seed)[0][:4].max()), 2) for seed in range(4)}
    assert len(brightest) > 2
    with pytest.raises(ConfigError, match="do not differ in it"):
        env.DriveVectorEnv(2, "light", load(None, ["learning.randomised={learning.goal_radius: [0.4, 0.5]}"]).config)


def test_the_pages_lines_make_environments() -> None:
    page = (Path(__file__).parents[3] / "docs" / "environments.md").read_text()
    lines = [line for line in page.splitlines() if line.startswith(("    import ", "    gymnasium."))]
    assert sum("make" in line for line in lines) == 3
    exec(textwrap.dedent("\n".join(lines)), {})


@pytest.mark.long  # it is compiled
@pytest.mark.parametrize("task", ["pose", "clear", "track"])
def test_each_task_is_an_environment(task: str) -> None:
    config = load(None, ["sim.room.map=oval"] if task == "track" else []).config
    one = gymnasium.make("txt1/Drive-v0", task=task, config=config).unwrapped
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(one)
    one.reset(seed=1)
    total, moved = 0.0, 0
    for _ in range(40):
        _, reward, over, late, told = one.step(np.array([1.0, 0.0], np.float32))
        total, moved = total + float(reward), moved + 1
        if over or late:
            break
    assert moved > 3 and np.isfinite(total)
    assert bool(told["touched"]) is (over and not told["success"])


def test_the_environments_robot_drives_as_the_running_robot_does() -> None:
    config = load(overrides=["seed=4", "sim.room={length: 20, width: 20}"]).config
    commands = [COMMANDS[k] for k in (1, 2, 0, 0, 1, 2, 2)]

    async def drive() -> tuple[Odometry, tuple[float, ...]]:
        async with Robot.open(config=config) as robot:
            await robot.linked(1.0)
            robot.arm()
            await robot.load_gains()
            for k, (v, omega) in enumerate(commands):
                for tenth in range(10):
                    await asyncio.sleep(1.01 + k + 0.1 * tenth - robot.now)
                    robot.command(v, omega)
            await asyncio.sleep(1.005 + len(commands) - robot.now)
            return robot.odometry, robot.pose

    running, pose = txt1.run(drive(), speed="max")
    car = env.EpisodeCar(create_sim(config), config)
    for tick in range(50 * (1 + len(commands)) + 1):
        k = (20 * tick - 1010) // 1000
        car.control(tick * 20 / 1000.0, *((0.0, 0.0) if k < 0 else commands[k]))
    assert car.wheels.odometry == running
    assert running.v > 0.2
    assert car.pose(1.0 + len(commands)) == pose


def test_the_same_seed_is_the_same_episode() -> None:
    one, other = whole(), whole()
    assert np.array_equal(one.reset(seed=5)[0], other.reset(seed=5)[0])
    for action in (0, 1, 2, 2, 1):
        first, second = one.step(np.int64(action)), other.step(np.int64(action))
        assert np.array_equal(first[0], second[0])
        assert first[1:] == second[1:]
    assert not np.array_equal(one.reset()[0], other.reset(seed=6)[0])


def test_a_seed_tells_the_episode_to_the_last_bit_whatever_was_driven_before() -> None:
    one = env.DriveEnv()

    def driven_anew() -> list[float]:
        one.reset(seed=5)
        return [float(one.step(action)[1]) for action in (1, 0, 2, 0)]

    assert driven_anew() == driven_anew()


@pytest.mark.long  # to compile takes long
def test_many_robots_at_once_find_the_light_as_one_does_and_begin_anew() -> None:
    count = 64
    many = gymnasium.make_vec("txt1/LightSeeking-v0", num_envs=count, vectorization_mode="vector_entry_point")
    seen, _ = many.reset(seed=1)
    assert many.observation_space.contains(seen)
    inner = many.unwrapped
    assert isinstance(inner, env.DriveVectorEnv)
    episodes = won = 0
    for _ in range(80):
        seen, _, terminated, truncated, info = many.step(np.array([steered(each) for each in seen]))
        assert many.observation_space.contains(seen)
        assert not truncated.any()
        episodes += int(terminated.sum())
        won += int((terminated & info["success"]).sum())
    assert episodes > 2 * count
    assert won == episodes
    start = np.hypot(*inner.bodies.batch.poses[inner.drives.steps == 0, :2].T)
    assert start == pytest.approx(np.full(len(start), 1.25))


def test_actions_outside_the_space_are_refused() -> None:
    one = whole()
    one.reset(seed=1)
    for wrong in (-1, 3, 1.7):
        with pytest.raises(ValueError, match="from 0 to 2"):
            one.step(wrong)  # type: ignore[arg-type]


@pytest.mark.long  # it is compiled
def test_actions_outside_the_space_are_refused_for_each_of_many_robots() -> None:
    many = env.DriveVectorEnv(2)
    many.reset(seed=1)
    for wrong in (-1, 3, 1.7):
        with pytest.raises(ValueError, match="from 0 to 2"):
            many.step(np.array([wrong, 0]))


def test_the_environment_has_the_configured_actions_and_delay() -> None:
    slow = env.DriveEnv("light", load(None, ["learning.actions=[[0.3, 0.0], [0.3, 0.5]]", "learning.delay=0.5"]).config)
    slow.reset(seed=1)
    assert slow.action_space == gymnasium.spaces.Discrete(2)
    first, *_ = slow.step(np.int64(0))
    second, *_ = slow.step(np.int64(0))
    assert first[4] == 0.0 and second[4] > 0.1


def test_a_dead_sensor_is_lived_with() -> None:
    dead = env.DriveEnv("light", load(None, ["sim.light.faults=[dead, nan, none, none]"]).config)
    seen, _ = dead.reset(seed=1)
    assert seen[0] == 0.0 and np.isfinite(seen).all()
    assert np.isfinite(dead.step(np.int64(1))[0]).all()


@pytest.mark.long  # it is compiled
def test_a_mask_begins_some_robots_anew_and_leaves_the_others_as_they_are() -> None:
    many = env.DriveVectorEnv(3)
    many.reset(seed=1)
    many.step(np.array([1, 1, 1]))
    before = many.bodies.batch.robots.copy()
    many.reset(options={"reset_mask": np.array([False, True, False])})
    assert (many.bodies.batch.robots[:, [0, 2]] == before[:, [0, 2]]).all()
    assert (many.bodies.batch.poses[1] != before[:3, 1]).any() and list(many.drives.steps) == [1, 0, 1]
    with pytest.raises(ValueError, match="reset_mask"):
        many.reset(options={"reset_mask": [1, 2]})


def test_stable_baselines3s_own_check_passes() -> None:
    checker = pytest.importorskip("stable_baselines3.common.env_checker")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        checker.check_env(env.DriveEnv(render_mode="rgb_array"), warn=True)


def driven(one: env.DriveEnv, seed: int = 2, steps: int = 60) -> dict[str, object]:
    """What came of an episode that is steered at the light."""
    seen, _ = one.reset(seed=seed)
    told: dict[str, object] = {}
    for _ in range(steps):
        seen, _, over, late, told = one.step(np.int64(steered(seen)))
        if over or late:
            break
    return told


def test_touching_a_post_ends_an_episode_and_the_next_one_begins() -> None:
    around = ", ".join(f"{{kind: post, x: {x}, y: {y}, radius: 0.2}}" for x in (-0.5, 0.5) for y in (-0.5, 0.5))
    one = env.DriveEnv("light", load(overrides=[f"sim.obstacles=[{around}]"]).config)
    assert {bool(driven(one, seed)["touched"]) for seed in range(6)} >= {True}
    assert driven(one)["success"] is not None


def test_a_start_where_something_stands_is_drawn_again() -> None:
    wall = "sim.obstacles=[{kind: box, x: 1.7, y: 0.0, length: 0.5, width: 3.0}]"
    one = env.DriveEnv("light", load(overrides=[wall]).config)
    for seed in range(8):
        one.reset(seed=seed)


def test_a_picture_has_the_robot_the_light_and_posts() -> None:
    post, box = "{kind: post, x: 0.6, y: 0.4, radius: 0.1}", "{kind: box, x: -0.6, y: 0.4, length: 0.1, width: 0.2}"
    settings = [f"sim.obstacles=[{post}, {box}]"]
    one = env.DriveEnv("light", load(overrides=settings).config, render_mode="rgb_array")
    one.reset(seed=3)
    first = one.render()
    one.step(np.int64(1))
    second = one.render()
    assert first is not None and second is not None
    assert first.shape == (400, 400, 3) and first.dtype == np.uint8 and (first != second).any()
    colours = {tuple(each) for each in first.reshape(-1, 3).tolist()}
    assert {picture.FLOOR, picture.GOAL, picture.LIGHT, picture.WALL, picture.CARS[0]} <= colours
    assert env.DriveEnv().render() is None
    with pytest.raises(ConfigError, match="render_mode: human"):
        env.DriveEnv(render_mode="human")


def test_many_robots_have_what_one_has_where_the_quick_simulation_lacks_it() -> None:
    config = load(overrides=["learning.delay=0.5", "sim.light.faults=[dead, none, none, none]"]).config
    with pytest.warns(RuntimeWarning, match=r"2 single environments side by side, which is slower: sim\.light\.faults"):
        two = gymnasium.make_vec("txt1/LightSeeking-v0", 2, vectorization_mode="vector_entry_point", config=config)
    seen, _ = two.reset(seed=[1, 2])
    one = env.DriveEnv("light", config)
    assert np.array_equal(seen[1], one.reset(seed=2)[0])
    assert seen[0, 0] == 0.0
    two.step(np.array([1, 1]))
    kept, _ = two.reset(options={"reset_mask": np.array([True, False])})
    assert np.array_equal(kept[1], one.step(np.int64(1))[0])
    with pytest.raises(ConfigError, match=r"safety\.v_max"):
        env.many(2, "light", load(overrides=["safety.v_max=3.0"]).config)

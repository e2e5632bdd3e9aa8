"""The configuration: which source wins, what is refused and how, and what a run can be told of it."""

from __future__ import annotations

import ast
import inspect
from collections.abc import Callable, Iterator
from dataclasses import FrozenInstanceError, fields, is_dataclass
from itertools import pairwise
from math import inf
from pathlib import Path
from textwrap import dedent
from typing import Any, get_args, get_type_hints

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from pydantic import BaseModel, ValidationError

from txt1 import additions
from txt1.config import Config, checked, completed, flatten, load, origin_of, recorded
from txt1.config.renamed import names_now, translated
from txt1.control.parameters import Limits
from txt1.control.schedule import ANGULAR_GAINS, LINEAR_GAINS
from txt1.errors import ConfigError
from txt1.experiments.profile import load_profile
from txt1.fleet.plan import plan_of
from txt1.model.vehicle import Geometry
from txt1.sim.parameters import Noise

ROBOT = Path(__file__).parents[2] / "config" / "txt1.yaml"

OTHERS = additions.strangers().found  # sections of plug-ins
KEYS = [key for key, _ in flatten(completed(Config())) if key.partition(".")[0] not in OTHERS]

Write = Callable[[str], Path]


@pytest.fixture
def write(tmp_path: Path) -> Write:
    """Writes a configuration file and returns where."""

    def write(text: str) -> Path:
        path = tmp_path / "robot.yaml"
        path.write_text(text)
        return path

    return write


def refusal(*arguments: object, **options: object) -> str:
    """The message with which a configuration is refused, which is one line."""
    with pytest.raises(ConfigError) as error:
        load(*arguments, **options)  # type: ignore[arg-type]
    message = str(error.value)
    assert "\n" not in message
    return message


# -- sources ---------------------------------------------------------------------------------------------------


def test_nothing_set_means_the_defaults_of_the_thesis() -> None:
    config, origins = load()
    assert config == Config()
    assert origins == {}
    assert config.control.linear.gains() == LINEAR_GAINS == (11.0, 18.0, 0.25)
    assert config.control.schedule().sets == tuple(ANGULAR_GAINS)
    assert config.geometry == Geometry()
    assert config.limits() == Limits()


def test_options_win_over_set_over_environment_over_file(write: Write) -> None:
    file = write("seed: 1")
    environment = {"TXT1_SEED": "2"}
    assert load(file).config.seed == 1
    assert load(file, (), environment).config.seed == 2
    assert load(file, ["seed=3"], environment).config.seed == 3
    assert load(file, ["seed=3"], environment, {"seed": 4}).config.seed == 4


def test_of_two_overrides_the_later_one_wins() -> None:
    config, origins = load(overrides=["seed=1", "seed=2"])
    assert (config.seed, origins["seed"]) == (2, "--set seed=2")


def test_the_environment_is_read_only_when_it_is_given(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TXT1_SEED", "9")
    assert load().config.seed == 0


def test_environment_variables_are_the_keys_in_capitals_with_double_underscores() -> None:
    environment = {
        "TXT1_CONTROL__LINEAR__KP": "9",
        "TXT1_SIM__START": "[1, 0, 0]",
        "TXT1_HAL_OPTIONS__PORT": "/dev/ttyUSB0",
        "TXT2_SEED": "5",
        "SEED": "5",
        "HOME": "/root",
    }
    config, origins = load(environment=environment)
    assert config.control.linear.kp == 9.0
    assert config.sim.start == (1.0, 0.0, 0.0)
    assert config.hal_options == {"port": "/dev/ttyUSB0"}
    assert origins == {
        "control.linear.kp": "environment TXT1_CONTROL__LINEAR__KP",
        "sim.start": "environment TXT1_SIM__START",
        "hal_options.port": "environment TXT1_HAL_OPTIONS__PORT",
    }


@pytest.mark.parametrize("text", ["", "# nothing but a comment\n", "{}", "control:\n", "sim:\n  room:\n"])
def test_an_empty_file_or_section_means_the_defaults(write: Write, text: str) -> None:
    assert load(write(text)) == (Config(), {})


def test_a_section_set_in_part_keeps_its_other_defaults(write: Write) -> None:
    config = load(write("control: {linear: {kp: 9}}\nsim: {room: {length: 8}}")).config
    assert config.control.linear.gains() == (9.0, 18.0, 0.25)
    assert config.control.angular == Config().control.angular
    assert (config.sim.room.length, config.sim.room.width) == (8.0, 5.0)


@pytest.mark.parametrize("source", ["file", "environment", "override"])
def test_a_mapping_sets_what_is_in_it_whatever_its_source(write: Write, source: str) -> None:
    mapping = "{linear: {kp: 9}}"
    config = {
        "file": lambda: load(write(f"control: {mapping}")),
        "environment": lambda: load(environment={"TXT1_CONTROL": mapping}),
        "override": lambda: load(overrides=[f"control={mapping}"]),
    }[source]().config
    assert config.control.linear.gains() == (9.0, 18.0, 0.25)


def test_sources_that_set_different_keys_of_a_section_add_up(write: Write) -> None:
    config = load(
        write("control: {linear: {kp: 1}}"), ["control.linear.kd=0.3"], {"TXT1_CONTROL__LINEAR__KI": "2"}
    ).config
    assert config.control.linear.gains() == (1.0, 2.0, 0.3)


def test_a_list_replaces_the_default_as_a_whole(write: Write) -> None:
    config = load(write("control: {angular: [{v_max: 0.5, kp: 1, ki: 2, kd: 0}]}")).config
    assert [s.v_max for s in config.control.angular] == [0.5]


def test_settings_of_another_packages_hal_pass_as_they_are(write: Write) -> None:
    file = write("hal_options: {port: /dev/ttyUSB0, nested: {Deep: [1, 2]}, nothing: null}")
    config = load(file, ["hal_options.baud=57600"]).config
    assert config.hal_options == {
        "port": "/dev/ttyUSB0",
        "nested": {"Deep": [1, 2]},
        "nothing": None,
        "baud": 57600,
    }


def test_walls_may_be_infinitely_far_and_a_pack_missing() -> None:
    config = load(overrides=["sim.room.length=.inf", "sim.battery.used_1=null"]).config
    assert (config.sim.room.length, config.sim.battery.used_1) == (inf, None)


@given(st.floats(0.0, Config().gain_limits().linear.kp))
def test_any_gain_that_is_loaded_given_as_text_arrives_exactly(kp: float) -> None:
    assert load(overrides=[f"control.linear.kp={kp!r}"]).config.control.linear.kp == kp
    assert load(environment={"TXT1_CONTROL__LINEAR__KP": str(kp)}).config.control.linear.kp == kp


def test_sources_may_have_shorter_time_outs_than_the_gate_and_no_longer_ones() -> None:
    assert load(overrides=["commander.timeouts={gamepad: 0.1}"]).config.commander.timeouts == {"gamepad": 0.1}
    assert load(overrides=["commander.timeouts.gamepad=0.1"]).config.commander.timeouts == {"gamepad": 0.1}
    with pytest.raises(ConfigError, match=r"timeouts\.web: 0\.3 s; use at most safety\.command_timeout, 0\.25 s"):
        load(overrides=["commander.timeouts.web=0.3"])
    with pytest.raises(ConfigError, match="greater than 0"):
        load(overrides=["commander.timeouts.web=0"])


def test_a_gain_that_no_board_can_take_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"control\.linear\.kp"):
        load(overrides=["control.linear.kp=1e8"])


# -- refusals --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("key", "remedy"),
    [
        ("control.linear.kpp", "did you mean 'control.linear.kp'?"),
        ("saftey.v_max", "did you mean 'safety'?"),
        ("sim.vehicle.deadband", "did you mean 'sim.vehicle.dead_band'?"),
        ("control.linear.gain", "known here: kp, ki, kd"),
        ("", "known here: hal, hal_options, name, vehicle, seed"),
    ],
)
def test_an_unknown_key_is_refused_with_the_nearest_one(write: Write, key: str, remedy: str) -> None:
    if key:
        assert refusal(overrides=[f"{key}=1"]).startswith(f"{key}: unknown key (from --set {key}=1); {remedy}")
        name = "TXT1_" + key.upper().replace(".", "__")
        assert refusal(environment={name: "1"}).startswith(f"{key}: unknown key (from environment {name}); {remedy}")
    nested: object = 1
    for part in reversed(key.split(".")):
        nested = {part: nested}
    file = write(yaml.safe_dump(nested))
    assert refusal(file).startswith(f"{key}: unknown key (from {file}); {remedy}")


def test_a_key_with_dots_in_a_file_is_told_how_to_write_it(write: Write) -> None:
    file = write("safety.motor_max: 3000")
    remedy = "in a file one key is below the other: 'safety', and in it 'motor_max'"
    assert refusal(file) == f"safety.motor_max: unknown key 'safety.motor_max' (from {file}); {remedy}"
    file = write("safety: {motor.max: 3000}")
    assert refusal(file).endswith("did you mean 'safety.motor_max'?")


def test_an_obstacle_without_a_kind_is_told_the_kinds() -> None:
    for obstacle, wrong in (
        ("{x: 1, y: 1}", "it has no kind"),
        ("{kind: cone, x: 1, y: 1}", "there is no kind 'cone'"),
    ):
        told = refusal(overrides=[f"sim.obstacles=[{obstacle}]"])
        assert told.startswith(f"sim.obstacles.0: {wrong}; give kind: box or kind: post (from --set")


def test_a_key_below_a_value_is_refused() -> None:
    assert refusal(overrides=["seed.low=1"]) == (
        "seed.low: there is nothing below 'seed' (from --set seed.low=1); give that key one value"
    )
    assert "nothing below 'control.angular'" in refusal(overrides=["control.angular.0.kp=1"])


@pytest.mark.parametrize(
    ("key", "text", "value", "problem"),
    [
        ("control.linear.kp", "abc", "'abc'", "valid number"),
        ("control.linear.kp", ".nan", "nan", "finite number"),
        ("control.linear.kp", ".inf", "inf", "finite number"),
        ("control.linear.kp", "true", "True", "number, not true or false"),
        ("control.linear.kp", "null", "None", "valid number"),
        ("control.linear", "3", "3", "valid dictionary"),
        ("control.angular", "3", "3", "valid tuple"),
        ("seed", "1.5", "1.5", "valid integer"),
        ("seed", "-1", "-1", "greater than or equal to 0"),
        ("seed", "yes", "True", "number, not true or false"),
        ("hal", "", "None", "valid string"),
        ("hal", "''", "''", "at least 1 character"),
        ("hal_options", "3", "3", "valid dictionary"),
        ("geometry.wheelbase", "0", "0", "greater than 0"),
        ("geometry.wheelbase", "26", "26", "less than or equal to 3 m; lengths are in metres"),
        ("geometry.track_width", "20", "20", "less than or equal to 3 m; lengths are in metres"),
        ("geometry.counts_per_rev", "0.5", "0.5", "valid integer"),
        ("safety.v_max", "10.1", "10.1", "less than or equal to 10"),
        ("safety.v_max", "0", "0", "greater than 0"),
        ("safety.v_max", ".nan", "nan", "finite number"),
        ("safety.motor_max", "24001", "24001", "less than or equal to 24000"),
        ("safety.command_timeout", "2.1", "2.1", "less than or equal to 2"),
        ("safety.auto_arm", "sometimes", "'sometimes'", "'auto', 'always' or 'never'"),
        ("sim.room.length", ".nan", "nan", "greater than 0"),
        ("sim.battery.used_1", "-1", "-1", "greater than or equal to 0"),
        ("sim.battery.used_1", "yes", "True", "number, not true or false"),
        ("sim.vehicle.slip", "1.5", "1.5", "less than or equal to 1"),
        ("host.allow_shutdown", "maybe", "'maybe'", "valid boolean"),
        ("teleop.speed", "0", "0", "greater than or equal to 0.1"),
    ],
)
def test_a_wrong_value_names_key_value_problem_and_origin(key: str, text: str, value: str, problem: str) -> None:
    message = refusal(overrides=[f"{key}={text}"])
    assert message.startswith(f"{key}: {value}: ")
    assert problem in message
    assert f"(from --set {key}={text})" in message
    assert "txt1 config show" in message


def test_the_origin_of_a_wrong_value_is_the_source_that_set_it(write: Write) -> None:
    file = write("seed: -3\n")
    assert f"seed: -3: input should be greater than or equal to 0 (from {file})" in refusal(file)
    assert "(from environment TXT1_SEED)" in refusal(file, (), {"TXT1_SEED": "-2"})
    assert "(from --seed)" in refusal(file, (), {"TXT1_SEED": "-2"}, {"seed": -1})


@pytest.mark.parametrize(
    ("value", "where", "problem"),
    [
        ("[{v_max: 1, kp: 1, ki: 1, kd: 1}, {v_max: 0.5, kp: 1, ki: 1, kd: 1}]", "control.angular", "v_max must rise"),
        ("[{v_max: 1, kp: 1, ki: 1, kd: 1}, {v_max: 1, kp: 1, ki: 1, kd: 1}]", "control.angular", "v_max must rise"),
        ("[{v_max: 1, kp: 1, ki: 1}]", "control.angular.0.kd", "field required"),
        ("[{v_max: 1, kp: x, ki: 1, kd: 1}]", "control.angular.0.kp", "'x': input should be a valid number"),
        (str([{"v_max": i, "kp": 1, "ki": 1, "kd": 1} for i in range(15)]), "control.angular", "at most 14 items"),
    ],
)
def test_a_wrong_gain_schedule_names_the_part_that_is_wrong(write: Write, value: str, where: str, problem: str) -> None:
    file = write(f"control:\n  angular: {value}\n")
    message = refusal(file)
    assert message.startswith(f"{where}: ")
    assert problem in message
    assert f"(from {file})" in message


@pytest.mark.parametrize("length", [0, 2, 4])
def test_a_start_pose_has_three_numbers(length: int) -> None:
    assert refusal(overrides=[f"sim.start={[0] * length}"]).startswith("sim.start")


def test_of_several_mistakes_the_first_is_told() -> None:
    assert refusal(overrides=["control.linear.kp=a", "seed=b"]).count("input should") == 1


@pytest.mark.parametrize(
    ("text", "line", "problem"),
    [
        ("seed: 1\ncontrol: [1,\n", 3, "expected the node content"),
        ("seed: 1\ncontrol:\n\tlinear: 1\n", 3, "cannot start any token"),
        ("seed: 1: 2\n", 1, "mapping values are not allowed here"),
        ("a: 1\nb: &x 1\nc: *y\n", 3, "found undefined alias 'y'"),
        ("seed: !!python/name:os.system\n", 1, "could not determine a constructor"),
        ("safety: {v_max: 0.5}\nseed: 1\nsafety: {stop_ramp: 1.0}\n", 3, "'safety' is there twice"),
    ],
)
def test_a_yaml_mistake_names_file_and_line(write: Write, text: str, line: int, problem: str) -> None:
    file = write(text)
    message = refusal(file)
    assert message.startswith(f"{file}:{line}:")
    assert problem in message


@pytest.mark.parametrize(("text", "kind"), [("- 1\n", "a list"), ("hello\n", "text"), ("3\n", "a number")])
def test_a_file_that_is_no_mapping_is_refused(write: Write, text: str, kind: str) -> None:
    file = write(text)
    assert refusal(file) == f"{file}: expected 'key: value' lines, found {kind}"


def test_a_file_that_cannot_be_read_is_named(tmp_path: Path) -> None:
    missing = tmp_path / "missing.yaml"
    assert refusal(missing) == f"{missing}: cannot read the configuration: No such file or directory; check --config"
    assert "it is a directory, not a file" in refusal(tmp_path)
    (tmp_path / "binary.yaml").write_bytes(b"\xff\xfe\x00")
    assert refusal(tmp_path / "binary.yaml").endswith("binary.yaml: not a text file in UTF-8")


@pytest.mark.parametrize("text", ["seed", "=3", " =3", ""])
def test_an_override_without_a_key_or_value_is_refused(text: str) -> None:
    assert refusal(overrides=[text]).endswith("expected key=value, for example --set control.linear.kp=9")


def test_an_override_that_is_no_yaml_is_refused() -> None:
    assert refusal(overrides=["sim.start=[1,"]).startswith("--set sim.start=[1,:1:4: not a valid value: ")
    assert refusal(environment={"TXT1_SIM__START": "[1,"}).startswith("TXT1_SIM__START:1:4: not a valid value: ")


def bomb(join: str) -> str:
    """A few lines that stand for 9^9 values; `join` is a list or a merge of nine aliases."""
    lines = ["a0: &a0 {k: 1}", *(f"a{n}: &a{n} {join}".replace("*", f"*a{n - 1}") for n in range(1, 10))]
    return "\n".join(lines)


@pytest.mark.parametrize("join", ["[*, *, *, *, *, *, *, *, *]", "{<<: [*, *, *, *, *, *, *, *, *]}"])
def test_aliases_that_stand_for_too_many_values_are_refused(write: Write, join: str) -> None:
    file = write(bomb(join))
    problem = "stands for more than 100000 values"
    assert problem in refusal(file)
    for reading in (plan_of, load_profile):
        with pytest.raises(ConfigError, match=problem):
            reading(str(file))


@pytest.mark.parametrize("text", ["&a [*a]", "[" * 1000, "!!int x"])
def test_a_plan_and_a_profile_that_yaml_cannot_make_are_refused(write: Write, text: str) -> None:
    file = write(text)
    for reading in (plan_of, load_profile):
        with pytest.raises(ConfigError, match=r"YAML: (nested|invalid)"):
            reading(str(file))


def test_an_alias_is_read_as_what_it_stands_for(write: Write) -> None:
    config = load(write("control: {linear: &g {kp: 3, ki: 2, kd: 1}}\nhal_options: {gains: *g}")).config
    assert config.hal_options["gains"] == {"kp": 3, "ki": 2, "kd": 1}


@pytest.mark.parametrize(
    ("value", "problem"),
    [
        ("!!int x", "invalid literal for int()"),
        ("!!float x", "could not convert string to float"),
        ("!!bool x", "'x'"),
        ("!!timestamp x", "no attribute"),
        ("[" * 1000, "nested more than 20 deep"),
        ("{a: " * 5000 + "}" * 5000, "nested more than 20 deep"),
        ("&a [*a]", "nested more than 20 deep"),
        ("9" * 5000, "4300 digits"),
        ("2001-99-99", "month must be in 1..12"),
        ("0x_", "invalid literal for int()"),
    ],
)
def test_a_value_that_yaml_cannot_make_is_refused_whatever_its_source(write: Write, value: str, problem: str) -> None:
    for key in ("safety.v_max", "hal_options"):
        message = refusal(overrides=[f"{key}={value}"])
        assert message.startswith(f"--set {key}=")
        assert problem in message
    assert problem in refusal(environment={"TXT1_SAFETY__V_MAX": value})
    file = write(f"safety: {{v_max: {value}}}")
    assert refusal(file).startswith(str(file))


@pytest.mark.parametrize("value", ["=!!timestamp x", "1:2:3x", "!!set {1}", "2001-01-01"])
def test_a_value_of_another_kind_is_no_number(value: str) -> None:
    assert refusal(overrides=[f"safety.v_max={value}"]).startswith("safety.v_max")


@pytest.mark.parametrize("name", ["TXT1_POSE_PAIRS", "TXT1_TEST_PORT", "TXT1_", "TXT1", "TXT1_BUILD"])
def test_a_variable_of_another_program_is_ignored(name: str) -> None:
    assert load(environment={name: "20"}) == (Config(), {})


@pytest.mark.parametrize(
    ("name", "meant"),
    [
        ("TXT1_SAFETY_V_MAX", "TXT1_SAFETY__V_MAX"),
        ("TXT1_CONTROL_LINEAR_KP", "TXT1_CONTROL__LINEAR__KP"),
        ("TXT1_HAL_OPTIONS_PORT", "TXT1_HAL_OPTIONS__PORT"),
        ("TXT1_OBSTACLE_STOP_ENABLED", "TXT1_OBSTACLE_STOP__ENABLED"),
    ],
)
def test_a_key_with_single_underscores_is_refused_and_spelt(name: str, meant: str) -> None:
    assert meant in refusal(environment={name: "1"})


@pytest.mark.parametrize("name", ["TXT1_SEDE", "TXT1_SAFTEY", "TXT1_POSE__PAIRS"])
def test_a_variable_that_is_nearly_a_key_or_has_a_double_underscore_is_refused(name: str) -> None:
    assert "unknown key" in refusal(environment={name: "20"})


# -- the configuration as a value --------------------------------------------------------------------------------


@pytest.mark.parametrize("section", ["", "control", "safety", "sim", "geometry", "host"])
def test_a_configuration_does_not_change(section: str) -> None:
    part = getattr(Config(), section) if section else Config()
    name = next(iter(vars(part) if not is_dataclass(part) else (f.name for f in fields(part))))
    with pytest.raises((ValidationError, FrozenInstanceError)):
        setattr(part, name, getattr(part, name))


def is_section(kind: object) -> bool:
    return isinstance(kind, type) and (issubclass(kind, BaseModel) or is_dataclass(kind))


def sections(kind: Any) -> set[type]:
    """The sections within a type, however deep, and it itself if it is one."""
    if is_section(kind):
        return {kind}.union(*map(sections, get_type_hints(kind).values()))
    return set().union(*map(sections, get_args(kind)))


def undocumented(section: type) -> Iterator[str]:
    """The settings of a section without a text below them; a setting that is a section has the section's text."""
    (definition,) = ast.parse(dedent(inspect.getsource(section))).body
    assert isinstance(definition, ast.ClassDef)
    for each, below in pairwise([*definition.body, ast.Pass()]):
        match each, below:
            case ast.AnnAssign(), ast.Expr(ast.Constant(str(text))) if text.strip():
                pass
            case ast.AnnAssign(target=ast.Name(name)), _ if not is_section(get_type_hints(section)[name]):
                yield f"{section.__name__}.{name}"


def test_every_setting_is_documented() -> None:
    found = {base for each in sections(Config) for base in each.__mro__ if base.__module__.startswith("txt1.")}
    assert {Config, Geometry, Noise} < found
    assert [name for each in found for name in undocumented(each)] == []


def test_flatten_lists_every_value_by_its_key() -> None:
    values = dict(flatten(completed(load(overrides=["control.linear.kp=9", "hal_options.a.b=1"]).config)))
    assert values["control.linear.kp"] == 9.0
    assert values["hal_options"] == {"a": {"b": 1}}
    assert values["sim.start"] == [0.0, 0.0, 0.0]
    assert [key for key in values if key.partition(".")[0] not in OTHERS] == KEYS


def test_every_listed_key_can_be_set() -> None:
    config = Config()
    for key, value in flatten(config):
        assert load(overrides=[f"{key}={yaml.safe_dump(value, default_flow_style=True, width=inf)}"]).config == config


def test_origin_of_finds_the_source_of_a_value_or_of_the_section_it_came_with(write: Write) -> None:
    file = write("control: {linear: {kp: 1}}\nhal_options: {port: x}")
    origins = load(file, ["seed=3"], {"TXT1_SAFETY__V_MAX": "1"}).origins
    assert origin_of("control.linear.kp", origins) == str(file)
    assert origin_of("control.linear.ki", origins) == "default"
    assert origin_of("hal_options", origins) == str(file)
    assert origin_of("hal_options.port", origins) == str(file)
    assert origin_of("seed", origins) == "--set seed=3"
    assert origin_of("safety.v_max", origins) == "environment TXT1_SAFETY__V_MAX"
    assert origin_of("sim.room.length", origins) == "default"


@pytest.mark.parametrize(
    "overrides",
    [
        [],
        ["sim.room.length=.inf", "sim.battery.used_1=null", "control.linear.kp=0.1", "safety.auto_arm=never"],
        ["control.angular=[]", "hal=mycar", "hal_options={port: x, deep: {a: [1, null]}}", "sim.start=[1, 2, 3]"],
    ],
)
def test_a_configuration_written_as_yaml_loads_as_the_same(write: Write, overrides: list[str]) -> None:
    config = load(overrides=overrides).config
    assert load(write(yaml.safe_dump(config.model_dump(mode="json")))).config == config


# -- the robot's file --------------------------------------------------------------------------------------------


def test_the_robots_file_is_the_defaults() -> None:
    assert completed(load(ROBOT).config) == completed(Config())


def test_the_robots_file_sets_every_key() -> None:
    assert sorted(load(ROBOT).origins) == sorted(KEYS)


def test_the_robots_file_comments_every_setting() -> None:
    lines = ROBOT.read_text().splitlines()
    settings = [line for line in lines if ": " in line and not line.lstrip().startswith(("#", "-"))]
    assert len(settings) > 40
    assert [line for line in settings if "#" not in line] == []


# -- the options of parts ----------------------------------------------------------------------------------------


def test_the_options_of_a_part_are_checked_as_the_configuration_is() -> None:
    assert checked(Noise, {"drag": 0.1}, "learning.options") == Noise(drag=0.1)
    for options, message in (
        (
            {"drags": 1},
            "learning.options.drags: unknown key (from learning.options); did you mean 'learning.options.drag'?",
        ),
        ({"drag": -1}, "learning.options.drag: -1: input should be greater than or equal to 0 (from learning.options)"),
    ):
        with pytest.raises(ConfigError) as error:
            checked(Noise, options, "learning.options")
        assert str(error.value).startswith(message)


# -- settings that were renamed ----------------------------------------------------------------------------------

NAMES = {"car.weight": "body.mass", "wheels": "body.wheels", "gear": "body.drive.gear"}


def test_a_recordings_settings_get_their_present_names() -> None:
    tree = {"car": {"weight": 5, "colour": "red"}, "wheels": {"count": 4}, "gear": 2, "body": {"length": 0.5}}
    assert translated(tree, NAMES) == {
        "car": {"colour": "red"},
        "body": {"length": 0.5, "mass": 5, "wheels": {"count": 4}, "drive": {"gear": 2}},
    }
    assert tree["gear"] == 2, "the recording's own is left as it was"
    assert translated({"car.weight": 5, "wheels.count": 4, "seed": 1}, NAMES) == {
        "body.mass": 5,
        "body.wheels.count": 4,
        "seed": 1,
    }


def test_every_present_name_is_a_setting_and_no_former_one_is() -> None:
    for former, now in names_now().items():
        assert now in KEYS
        assert former not in KEYS


def test_a_configuration_of_an_older_recording_is_read() -> None:
    assert recorded({"learning": {"gamma": 0.7, "goal_radius": 0.4}}).learning.thesis.gamma == 0.7
    assert recorded({}, {"learning.gamma": 0.6}).learning.thesis.gamma == 0.6
    with pytest.raises(ConfigError, match=r"sim\.goal: 1\.0: unknown key \(from the recording\)"):
        recorded({"sim": {"goal": 1.0}})


def test_a_recording_keeps_the_settings_of_a_learner_that_is_not_installed() -> None:
    config = recorded({"learning": {"absent": {"x": 1}, "goal_radius": 0.4}})
    assert dict(flatten(config))["learning.absent.x"] == 1
    assert config.learning.goal_radius == 0.4
    with pytest.raises(ConfigError, match=r"learning\.absent\.x: unknown key"):
        load(overrides=["learning.absent.x=1"])


def test_a_renamed_setting_is_refused_with_its_present_name(write: Write) -> None:
    path = write("learning: {gamma: 0.7}")
    told = f"learning.gamma: renamed, it is 'learning.thesis.gamma' now (from {path}); use that name"
    assert refusal(path) == told
    assert "it is 'learning.thesis.alpha' now (from --set learning.alpha=1)" in refusal(None, ["learning.alpha=1"])

"""The profile of an experiment: steps of velocities, or waypoints, from a YAML file."""

from __future__ import annotations

import difflib
from itertools import pairwise
from math import inf
from pathlib import Path
from typing import Annotated, Final, Literal

import yaml
from pydantic import ConfigDict, Field, ValidationError, model_validator

from txt1.config.schema import Section
from txt1.errors import ConfigError
from txt1.file_limits import read_text
from txt1.safe_yaml import read_yaml
from txt1.units import Positive

# folder of the thesis's experiments
PROFILES: Final = Path(__file__).parent / "profiles"
EXAMPLE: Final = "for example {title: Turn, figure: path, steps: [{v: 0.5, omega: 0.3, seconds: 10}]}"


class ProfileStep(Section):
    """A velocity and how long to command it."""

    v: Annotated[float, Field(ge=-1.5, le=1.5)]  # m/s
    # rad/s; the safety gate clips what R_min does not allow at this v, and counts it
    omega: float
    seconds: Annotated[float, Field(ge=0.1, le=36000.0)]


class Waypoints(Section):
    """Places to drive to, in order."""

    model_config = ConfigDict(ser_json_inf_nan="strings")

    # x and y, m
    points: Annotated[tuple[tuple[float, float], ...], Field(min_length=2)]
    # number of laps; .inf: until the batteries are empty
    laps: Annotated[float, Field(gt=0.0, allow_inf_nan=True)] = 1.0
    # m/s, the largest speed
    speed: Annotated[float, Field(gt=0.0, le=1.5)] = 0.5
    look_ahead: Positive = 1.0  # m
    # source of the robot's pose; "true" in simulation only,
    pose: Literal["odometry", "true", "fused", "map"] = "odometry"
    # "fused" from all sensors (estimation), "map" on the map in which it drives (mapping)
    # name of the GPS on whose grid the points are, in latitude and longitude; empty: m
    earth: str = ""

    @model_validator(mode="after")
    def _legs(self) -> Waypoints:
        for number, (a, b) in enumerate(pairwise((*self.points, self.points[0]))):
            if a == b:
                raise ValueError(f"the leg from points.{number} ends where it begins, at ({a[0]:g}, {a[1]:g})")
        return self


class Profile(Section):
    """An experiment."""

    model_config = ConfigDict(ser_json_inf_nan="strings")

    # title of its figure
    title: str
    # style of the figure: 4.3 and 4.4, 4.5 and 4.6, with errors, 3.13
    figure: Literal["velocities", "path", "waypoints", "battery"]
    # s between two samples
    sample: Annotated[float, Field(ge=0.02, le=10.0)] = 0.02
    # velocities to command, in order
    steps: tuple[ProfileStep, ...] = ()
    # places to drive to, in order
    waypoints: Waypoints | None = None

    @model_validator(mode="after")
    def _either(self) -> Profile:
        if bool(self.steps) is (self.waypoints is not None):
            raise ValueError("give either steps or waypoints")
        if self.figure in ("waypoints", "battery") and self.waypoints is None:
            raise ValueError(f"the figure '{self.figure}' needs waypoints")
        return self

    @property
    def duration(self) -> float:
        """Duration in s; for waypoints an estimate from the distance, infinite for endless laps."""
        if self.waypoints is None:
            return sum(step.seconds for step in self.steps)
        points = self.waypoints.points
        lap = sum(abs(complex(*b) - complex(*a)) for a, b in zip(points, (*points[1:], points[0]), strict=True))
        return self.waypoints.laps * lap / self.waypoints.speed if self.waypoints.laps < inf else inf


def names() -> list[str]:
    """Return the names of the thesis's experiments."""
    return sorted(file.stem for file in PROFILES.glob("*.yaml"))


def load_profile(name: str) -> Profile:
    """Return the profile of this name, or in this file; raises ConfigError: there is none, or it is not valid."""
    file = PROFILES / f"{name}.yaml" if "/" not in name and not name.endswith((".yaml", ".yml")) else Path(name)
    try:
        tree = read_yaml(read_text(file))
    except FileNotFoundError:
        near = difflib.get_close_matches(name, names(), n=1)
        hint = f"did you mean '{near[0]}'?" if near else "give a YAML file of your own"
        raise ConfigError(f"there is no experiment '{name}'; known: {', '.join(names())}; {hint}") from None
    except OSError as error:
        raise ConfigError(f"{name}: cannot read the profile: {error.strerror}") from None
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        mark = getattr(error, "problem_mark", None)
        place = "" if mark is None else f":{mark.line + 1}:{mark.column + 1}"
        problem = str(getattr(error, "problem", None) or error).splitlines()[0]
        raise ConfigError(f"{name}{place}: is no YAML: {problem}") from None
    if not isinstance(tree, dict):
        raise ConfigError(f"{name}: holds no profile; give title, figure, and steps or waypoints, {EXAMPLE}")
    try:
        return Profile.model_validate(tree)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        key = ".".join(map(str, first["loc"])) or "the profile"
        message = first["msg"].removeprefix("Value error, ")
        given = f": {first['input']!r}" if isinstance(first["input"], str | int | float) else ""
        raise ConfigError(f"{name}: {key}{given}: {message[0].lower()}{message[1:]}; {EXAMPLE}") from None

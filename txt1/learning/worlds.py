"""The worlds that come with the package (config/worlds): configurations for `txt1 learn --world`."""

from pathlib import Path
from typing import Final

from txt1.errors import ConfigError
from txt1.resources import resource

WORLDS: Final = "config/worlds"
# the default world of a learner
OWN: Final = {"thesis": "thesis-simulation"}


def world_file(name: str) -> Path:
    """Return the file of a world, by its name or its path; raises ConfigError: there is none."""
    path = Path(name) if name.endswith(".yaml") else resource(WORLDS) / f"{name}.yaml"
    if not path.is_file():
        known = ", ".join(sorted(each.stem for each in resource(WORLDS).glob("*.yaml")))
        raise ConfigError(f"--world {name}: there is no such world; give a .yaml file, or one of {known}")
    return path

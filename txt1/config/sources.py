"""The sources of the configuration's values, and the errors in them.

A later source wins: the defaults, then the file, then the environment (``TXT1_CONTROL__LINEAR__KP=9``), then
``--set control.linear.kp=9``. Unknown keys are refused; an error names the key, the value, its origin and the remedy.
"""

from __future__ import annotations

import difflib
import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

import yaml
from pydantic import ValidationError

from txt1.config.schema import Config, Section
from txt1.errors import ConfigError

ENVIRONMENT_PREFIX: Final = "TXT1_"


class Setting(NamedTuple):
    """One value that somebody set: its path, the value as given, and where it came from."""

    path: tuple[str, ...]
    value: Any
    origin: str


class LoadedConfig(NamedTuple):
    """A configuration, and the origin of every value that is not a default, by dotted key."""

    config: Config
    origins: dict[str, str]


def load(
    file: str | os.PathLike[str] | None = None,
    overrides: Sequence[str] = (),
    environment: Mapping[str, str] | None = None,
    options: Mapping[str, Any] | None = None,
) -> LoadedConfig:
    """The effective configuration.

    Args:
        file: a YAML file; None for the defaults alone.
        overrides: ``a.b=c`` each, as given to ``--set``.
        environment: the variables to look through, usually ``os.environ``; None for none.
        options: values of command-line options of their own, by dotted key, whose last part is their name; they win.

    Raises:
        ConfigError: with one line that says what is wrong and what to do.

    """
    settings: list[Setting] = []
    if file is not None:
        settings += _from_file(Path(file))
    settings += _from_environment(environment or {})
    for text in overrides:
        settings += _from_override(text)
    settings += [Setting(tuple(k.split(".")), v, f"--{k.rpartition('.')[2]}") for k, v in (options or {}).items()]

    tree = Config().model_dump()
    origins: dict[str, str] = {}
    for setting in settings:
        _check_key(setting)
        _insert(tree, setting)
        key = ".".join(setting.path)
        # what was set below this key before is gone with it
        origins = {k: o for k, o in origins.items() if not k.startswith(key + ".")}
        origins[key] = setting.origin
    try:
        return LoadedConfig(Config.model_validate(tree), origins)
    except ValidationError as error:
        raise ConfigError(_explain(error, origins)) from None


def flatten(config: Config) -> Iterator[tuple[str, Any]]:
    """Every value of a configuration as (dotted key, value), in order; lists and free-form options whole."""
    yield from _leaves(config.model_dump(mode="json"), ())


def _leaves(tree: Mapping[str, Any], path: tuple[str, ...]) -> Iterator[tuple[str, Any]]:
    for key, value in tree.items():
        if isinstance(value, dict) and (*path, key) != ("hal_options",):
            yield from _leaves(value, (*path, key))
        else:
            yield ".".join((*path, key)), value


def origin_of(key: str, origins: Mapping[str, str]) -> str:
    """Where the value of a dotted key came from; a section set as a whole is the origin of all that is in it."""
    parts = key.split(".")
    for length in range(len(parts), 0, -1):
        origin = origins.get(".".join(parts[:length]))
        if origin is not None:
            return origin
    return "default"


# -- the sources -----------------------------------------------------------------------------------------------


def _from_file(path: Path) -> list[Setting]:
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise ConfigError(f"{path}: cannot read the configuration: {error.strerror}; check --config") from None
    except UnicodeDecodeError:
        raise ConfigError(f"{path}: not a text file in UTF-8") from None
    try:
        tree = yaml.safe_load(text)
    except yaml.YAMLError as error:
        raise ConfigError(f"{path}{_place(error)}: not valid YAML: {_problem(error)}") from None
    if tree is None or tree == {}:
        return []
    if not isinstance(tree, dict):
        raise ConfigError(f"{path}: expected 'key: value' lines, found {_kind(tree)}")
    return list(_walk(tree, (), str(path)))


def _walk(value: Any, path: tuple[str, ...], origin: str) -> Iterator[Setting]:
    """A value as settings: a mapping sets what is in it and leaves the rest of its section alone."""
    if isinstance(value, dict) and value and path != ("hal_options",):
        for key, inner in value.items():
            yield from _walk(inner, (*path, str(key)), origin)
    elif value is not None or not _is_section(path):  # an empty section sets nothing
        yield Setting(path, value, origin)


def _from_environment(environment: Mapping[str, str]) -> Iterator[Setting]:
    for name, text in sorted(environment.items()):
        if name.startswith(ENVIRONMENT_PREFIX):
            path = tuple(name.removeprefix(ENVIRONMENT_PREFIX).lower().split("__"))
            yield from _walk(_parse(text, name), path, f"environment {name}")


def _from_override(text: str) -> Iterator[Setting]:
    key, equals, value = text.partition("=")
    if not equals or not key.strip():
        raise ConfigError(f"--set {text}: expected key=value, for example --set control.linear.kp=9")
    yield from _walk(_parse(value, f"--set {text}"), tuple(key.strip().split(".")), f"--set {text}")


def _parse(text: str, origin: str) -> Any:
    """A value from text, by YAML's rules: numbers, true/false, null, [lists]."""
    try:
        return yaml.safe_load(text)
    except yaml.YAMLError as error:
        raise ConfigError(f"{origin}: not a valid value: {_problem(error)}") from None


def _insert(tree: dict[str, Any], setting: Setting) -> None:
    for key in setting.path[:-1]:
        child = tree.get(key)
        if not isinstance(child, dict):
            child = tree[key] = {}
        tree = child
    tree[setting.path[-1]] = setting.value


# -- clear errors ----------------------------------------------------------------------------------------------


def _check_key(setting: Setting) -> None:
    """Refuse a key that does not exist, with the nearest one that does."""
    model: Any = Config
    for depth, name in enumerate(setting.path):
        if not (isinstance(model, type) and issubclass(model, Section)):
            if model is dict:
                return
            raise ConfigError(
                f"{'.'.join(setting.path)}: there is nothing below '{'.'.join(setting.path[:depth])}' "
                f"(from {setting.origin}); give that key one value"
            )
        fields = model.model_fields
        if name not in fields:
            near = difflib.get_close_matches(name, fields, n=1)
            prefix = "".join(f"{p}." for p in setting.path[:depth])
            remedy = f"did you mean '{prefix}{near[0]}'?" if near else f"known here: {', '.join(fields)}"
            raise ConfigError(f"{'.'.join(setting.path)}: unknown key (from {setting.origin}); {remedy}")
        annotation = fields[name].annotation
        model = dict if name == "hal_options" else annotation


def _is_section(path: tuple[str, ...]) -> bool:
    model: Any = Config
    for name in path:
        field = model.model_fields.get(name) if isinstance(model, type) and issubclass(model, Section) else None
        if field is None:
            return False
        model = field.annotation
    return isinstance(model, type) and issubclass(model, Section)


def _explain(error: ValidationError, origins: Mapping[str, str]) -> str:
    """One line for the first thing that is wrong: key, value, origin, remedy."""
    first = error.errors(include_url=False)[0]
    key = ".".join(str(part) for part in first["loc"])
    message = first["msg"].removeprefix("Value error, ")
    message = message[0].lower() + message[1:]
    # a list or a mapping is long, and the message names the part of it that is wrong
    given = "" if isinstance(first["input"], dict | list | tuple | Section) else f": {first['input']!r}"
    return f"{key}{given}: {message} (from {origin_of(key, origins)}); see 'txt1 config show' for the defaults"


def _place(error: yaml.YAMLError) -> str:
    mark = getattr(error, "problem_mark", None)
    return f":{mark.line + 1}:{mark.column + 1}" if mark is not None else ""


def _problem(error: yaml.YAMLError) -> str:
    return str(getattr(error, "problem", None) or error).splitlines()[0]


def _kind(value: Any) -> str:
    return {list: "a list", str: "text", bool: "true or false"}.get(type(value), "a number")

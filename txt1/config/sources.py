"""The sources of the configuration's values, and the errors in them.

A later source wins: the defaults, then the vehicle's file that `vehicle` names, then the file, then the environment
(``TXT1_CONTROL__LINEAR__KP=9``), then ``--set control.linear.kp=9``. Unknown keys are refused; an error names the key,
the value, its origin and the remedy.

Other programs have variables that begin with ``TXT1_`` too. A variable is a setting when its name has a double
underscore, or is a key of the first level. A name that nearly is such a key is refused as a typing mistake. A key with
single underscores between its parts, such as ``TXT1_SAFETY_V_MAX``, is refused as well. Any other name is ignored.
"""

import difflib
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any, Final, NamedTuple, TypeVar, cast, get_args, get_origin, get_type_hints

from pydantic import BaseModel, ConfigDict, ValidationError, create_model

from txt1 import additions
from txt1.config.schema import RECORDED, Config
from txt1.errors import ConfigError
from txt1.resources import resource

T = TypeVar("T")

ENVIRONMENT_PREFIX: Final = "TXT1_"
VEHICLES: Final = "config/vehicles"
# similarity from which the name of an environment variable counts as a mistyped key
NEARLY: Final = 0.7


class Setting(NamedTuple):
    """A value that was set: its path, the value as given, and its origin."""

    path: tuple[str, ...]
    value: Any
    origin: str


class LoadedConfig(NamedTuple):
    """A configuration, and the origin of each value that is not a default, by dotted key."""

    config: Config
    origins: dict[str, str]


def load(
    file: str | os.PathLike[str] | Mapping[str, Any] | None = None,
    overrides: Sequence[str] = (),
    environment: Mapping[str, str] | None = None,
    options: Mapping[str, Any] | None = None,
) -> LoadedConfig:
    """Return the effective configuration, from a YAML file, the environment, and `overrides` such as ``"a.b=c"``.

    In place of the file its content may be given, sections by name.

    `options` are values of command-line options, by dotted key; the last part of the key is the option's name. They win
    over all other sources.

    Raises ConfigError: a line with the mistake and the remedy.
    """
    if isinstance(file, Mapping):
        settings = list(_walk(file, (), "the given content")) if file else []
    else:
        settings = [] if file is None else _from_file(Path(file))
    settings += _from_environment(environment or {})
    for text in overrides:
        settings += _from_override(text)
    settings += [Setting(tuple(k.split(".")), v, f"--{k.rpartition('.')[2]}") for k, v in (options or {}).items()]
    settings = _of_vehicle(settings) + settings

    tree = Config().model_dump()
    origins: dict[str, str] = {}
    for setting in settings:
        _check(setting)
        _insert(tree, setting)
        key = ".".join(setting.path)
        # a value for a whole section replaces values that were set below it
        origins = {k: o for k, o in origins.items() if not k.startswith(key + ".")}
        origins[key] = setting.origin
    try:
        return LoadedConfig(Config.model_validate(tree), origins)
    except ValidationError as error:
        raise ConfigError(_explain(error, origins)) from None


def recorded(tree: Mapping[str, Any], values: Mapping[str, Any] | None = None) -> Config:
    """Return the configuration of a recording; renamed settings are translated.

    `values` are the robot's own settings, by dotted key. Raises ConfigError as `load` does.
    """
    from txt1.config.renamed import translated

    try:
        config = Config.model_validate(translated(tree), context=RECORDED)
    except ValidationError as error:
        raise ConfigError(_explain(error, {"": "the recording"})) from None
    return config if values is None else with_values(config, translated(values))


def with_values(config: Config, values: Mapping[str, Any]) -> Config:
    """Return the configuration with some values changed, by dotted key; raises ConfigError as `load` does."""
    tree = config.model_dump()
    for key, value in values.items():
        setting = Setting(tuple(key.split(".")), value, f"{key}={value}")
        _check(setting)
        _insert(tree, setting)
    # the configuration may be a recording's, which keeps its gains; changed gains are checked
    try:
        return Config.model_validate(
            tree, context={**RECORDED, "gains": any(key.startswith(("control", "serial")) for key in values)}
        )
    except ValidationError as error:
        raise ConfigError(_explain(error, {key: f"{key}={value}" for key, value in values.items()})) from None


def checked(kind: type[T], options: Mapping[str, Any], key: str) -> T:
    """Return a part's own settings, a dataclass with constraints, from free-form options.

    Raises ConfigError: an option is unknown or wrong; `key` is where they are set, such as "hal_options".
    """
    name = key.rpartition(".")[2]
    model = _options(cast("Any", kind), name)
    try:
        return cast("T", getattr(model.model_validate({name: options}), name))
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        if first["type"] == "unexpected_keyword_argument" and len(first["loc"]) == 2:
            from txt1.unknown import setting as unknown

            path = (*key.split("."), str(first["loc"][1]))
            raise unknown(path, len(path) - 1, _keys(cast("Any", kind)), key, "") from None
        raise ConfigError(_explain(error, {key: key}, key.removesuffix(name))) from None


@cache
def _options(kind: type[Any], name: str) -> type[BaseModel]:
    field: dict[str, Any] = {name: (kind, ...)}
    return create_model("Options", __config__=ConfigDict(extra="forbid", allow_inf_nan=False), **field)


def flatten(config: Config) -> Iterator[tuple[str, Any]]:
    """Yield every value of a configuration as (dotted key, value), in order; lists and free-form options whole."""
    for setting in _walk(config.model_dump(mode="json"), (), ""):
        yield ".".join(setting.path), setting.value


def completed(config: Config) -> Config:
    """Return the configuration with the sections of all additions, by default with their defaults."""
    absent = [name for name in additions.sections() if name not in config.given]
    return config.model_copy(update={name: additions.settings_of(name)() for name in absent})


def with_sections(config: Config, asked: Mapping[str, object]) -> Config:
    """Return the configuration with the given settings of additions as sections, so that a recording has them."""
    kinds = {name: each.settings for name in asked if (each := additions.named(name)) is not None and each.settings}
    return config.model_copy(
        update={name: asked[name] for name, kind in kinds.items() if type(asked[name]) is additions.load(kind)}
    )


def origin_of(key: str, origins: Mapping[str, str]) -> str:
    """Return the origin of a dotted key's value; a section set as a whole is the origin of its values."""
    while key and key not in origins:
        key = key.rpartition(".")[0]
    return origins.get(key, "default")


def vehicles() -> list[str]:
    """The names of the vehicles that come with the package."""
    return sorted(path.stem for path in resource(VEHICLES).glob("*.yaml"))


def vehicle_file(name: str) -> Path | None:
    """Return the path of a vehicle's file, which may not exist; None for the TXT-1, whose values are the defaults."""
    if name == Config().vehicle:
        return None
    return Path(name) if name.endswith((".yaml", ".yml")) else resource(VEHICLES) / f"{name}.yaml"


def _of_vehicle(settings: Sequence[Setting]) -> list[Setting]:
    """Return the settings in the file of the vehicle that was chosen last; none for the TXT-1."""
    chosen = [setting for setting in settings if setting.path == ("vehicle",)]
    if not chosen or not isinstance(chosen[-1].value, str):
        return []
    _, name, origin = chosen[-1]
    file = vehicle_file(name)
    if file is None:
        return []
    if not file.is_file():
        known = ", ".join([Config().vehicle, *vehicles()])
        raise ConfigError(f"vehicle: there is none '{name}' (from {origin}); there are: {known}; or give a YAML file")
    return [setting for setting in _from_file(file) if setting.path != ("vehicle",)]


def _from_file(path: Path) -> list[Setting]:
    # a robot without a file does not load it
    from txt1.file_limits import read_text

    try:
        text = read_text(path, pipes=True)
    except OSError as error:
        raise ConfigError(f"{path}: cannot read the configuration: {error.strerror}; check --config") from None
    except UnicodeDecodeError:
        raise ConfigError(f"{path}: not a text file in UTF-8") from None
    tree = _parse(text, str(path), "not valid YAML") or {}
    if not isinstance(tree, dict):
        kind = {list: "a list", str: "text", bool: "true or false"}.get(type(tree), "a number")
        raise ConfigError(f"{path}: expected 'key: value' lines, found {kind}")
    return list(_walk(tree, (), str(path))) if tree else []


def _walk(value: Any, path: tuple[str, ...], origin: str) -> Iterator[Setting]:
    """Yield the settings in a value. A mapping sets its own keys and leaves the rest of its section unchanged."""
    kind = _kind_at(path)
    # free-form options, with any keys
    if isinstance(value, dict) and value and kind != dict[str, Any]:
        for key, inner in value.items():
            yield from _walk(inner, (*path, str(key)), origin)
    elif value is not None or not _keys(kind):
        # an empty section sets nothing
        yield Setting(path, value, origin)


def _from_environment(environment: Mapping[str, str]) -> Iterator[Setting]:
    known = [*_keys(Config), *additions.ours()]
    for name, text in sorted(environment.items()):
        key = name.removeprefix(ENVIRONMENT_PREFIX).lower()
        if key == name.lower():
            continue
        if "__" not in key and key not in known:
            if (meant := _parts(key, Config)) is not None:
                spelt = ENVIRONMENT_PREFIX + "__".join(meant).upper()
                raise ConfigError(f"{name}: two underscores stand between the parts of a key; did you mean '{spelt}'?")
            if not difflib.get_close_matches(key, known, 1, NEARLY):
                continue
        path = tuple(key.split("__"))
        yield from _walk(_parse(text, name), path, f"environment {name}")


def _parts(text: str, kind: Any) -> tuple[str, ...] | None:
    """Split a key below a section, whose parts are joined by single underscores; None if there is no such key."""
    if get_origin(kind) is dict and text:
        return (text,)
    for name in (*_keys(kind), *(additions.ours() if kind is Config else ())):
        if text == name:
            return (name,)
        if text.startswith(f"{name}_") and (below := _parts(text[len(name) + 1 :], _below(kind, name))) is not None:
            return (name, *below)
    return None


def _from_override(text: str) -> Iterator[Setting]:
    key, equals, value = text.partition("=")
    if not equals or not key.strip():
        raise ConfigError(f"--set {text}: expected key=value, for example --set control.linear.kp=9")
    yield from _walk(_parse(value, f"--set {text}"), tuple(key.strip().split(".")), f"--set {text}")


def _parse(text: str, origin: str, problem: str = "not a valid value") -> Any:
    from txt1.safe_yaml import parse

    return parse(text, origin, problem)


def _insert(tree: dict[str, Any], setting: Setting) -> None:
    for key in setting.path[:-1]:
        if not isinstance(tree.get(key), dict):
            tree[key] = {}
        tree = tree[key]
    tree[setting.path[-1]] = setting.value


def _check(setting: Setting) -> None:
    """Refuse an unknown key, with the most similar known key, and yes or no in place of a number."""
    kind: Any = Config
    key = ".".join(setting.path)
    for depth, name in enumerate(setting.path):
        section, kind = kind, _below(kind, name)
        if get_origin(section) is dict:
            if kind is Any:
                return
        elif not _keys(section):
            _refuse_renamed(key, setting.origin)
            raise ConfigError(
                f"{key}: there is nothing below '{'.'.join(setting.path[:depth])}' "
                f"(from {setting.origin}); give that key one value"
            )
        elif kind is None:
            _refuse_renamed(key, setting.origin)
            from txt1.unknown import setting as unknown

            brought = getattr(section, "brought", None)
            known = [*_keys(section), *(brought.names() if brought else ())]
            raise unknown(setting.path, depth, known, setting.origin, brought.group if brought else "")
    # pydantic would take true and false for 1 and 0
    if setting.value is True or setting.value is False:
        kinds = {kind, *get_args(kind)}
        if bool not in kinds and kinds & {int, float}:
            raise ConfigError(
                f"{key}: {setting.value}: input should be a number, not true or false (from {setting.origin}); "
                "see 'txt1 config show' for the defaults"
            )


def _refuse_renamed(key: str, origin: str) -> None:
    """Refuse an unknown key that had a meaning before, with its name now."""
    from txt1.config.renamed import name_now

    if (now := name_now(key)) is not None:
        raise ConfigError(f"{key}: renamed, it is '{now}' now (from {origin}); use that name")


@cache
def _keys(kind: Any) -> dict[str, Any]:
    """Return the keys of a section with their types; empty for any other type."""
    names: Iterable[str] = getattr(kind, "model_fields", ()) or getattr(kind, "__dataclass_fields__", ())
    hints = get_type_hints(kind) if names else {}
    return {name: hints[name] for name in names}


def _below(kind: Any, name: str) -> Any:
    """Return the type of a section's value of this name; None if there is none."""
    if get_origin(kind) is dict:
        return get_args(kind)[1]
    found, brought = _keys(kind).get(name), getattr(kind, "brought", None)
    return brought.kind(name) if found is None and brought is not None else found


def _kind_at(path: Sequence[str]) -> Any:
    """Return the type of the value at a path; None if there is none."""
    kind: Any = Config
    for name in path:
        kind = _below(kind, name)
    return kind


def _explain(error: ValidationError, origins: Mapping[str, str], prefix: str = "") -> str:
    """Return the first mistake as a line: key, value, origin, remedy."""
    first = error.errors(include_url=False)[0]
    key = prefix + ".".join(str(part) for part in first["loc"])
    message = first["msg"].removeprefix("Value error, ")
    if first["type"] in ("unexpected_keyword_argument", "extra_forbidden"):
        message = "unknown key"
    if first["type"] in ("union_tag_not_found", "union_tag_invalid") and first["loc"][:2] == ("sim", "obstacles"):
        tag = first["ctx"].get("tag")
        wrong = "it has no kind" if tag is None else f"there is no kind {tag!r}"
        message = f"{wrong}; give kind: box or kind: post"
    if first["type"] == "less_than_equal" and key.startswith("geometry."):
        message += " m; lengths are in metres"
    message = message[0].lower() + message[1:]
    # a list or a mapping is long, and the message names the wrong part of it
    given = "" if isinstance(first["input"], dict | list | tuple | BaseModel) else f": {first['input']!r}"
    return f"{key}{given}: {message} (from {origin_of(key, origins)}); see 'txt1 config show' for the defaults"

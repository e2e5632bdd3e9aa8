"""Additions: everything that a plain robot drives without, each in a folder of its own.

How it works. A folder of the package that holds an ``addition.py`` is an addition: the filter, a guard, the recorder, a
bridge. Its ``addition.py`` holds one `Addition` of literals and texts. It imports nothing heavy, so the program reads
all of them whenever it starts. Each text names a function or class as "module:name", which is imported only when it is
needed. The robot asks three things of an addition:

- `watch`, a context from before the first tick until after the stop, such as the recorder's;
- `prepare`, a function that is called when the sensors are open and no tick has come, such as a guard's;
- `beside`, a context while the robot runs, left before it is stopped, such as a bridge's.

An addition takes part when its section of the configuration says so (`wanted`), or when it is asked for by name, with
its settings, as the command line does (`options`). Additions take part by `order`, then by name. Guards see a set-point
in this order, and tasks of equal priority run in it, so a recording can be replayed.

When an addition raises an error, the error names the addition (`blamed`). An error at its beginning keeps the robot
from starting; a later error stops the robot safely.

The package's own additions are found by listing folders. Other packages have an entry point ``txt1.additions``. It is
read only for a name that is not the package's own: reading the metadata of all packages takes longer than starting.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractAsyncContextManager, contextmanager
from functools import cache
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from pkgutil import resolve_name
from typing import TYPE_CHECKING, Any, Final, NamedTuple, Protocol

from txt1.errors import AdditionFault, ConfigError, Txt1Error

if TYPE_CHECKING:
    from argparse import Namespace
    from collections.abc import Collection
    from types import TracebackType

GROUP: Final = "txt1.additions"
FOLDERS: Final = ("*", "guards/*", "cars/*")
"""Places of the package's own additions, below the package."""


class Configuration(Protocol):
    """The part of `txt1.config.Config` that is used here: the configuration knows additions, not the reverse."""

    @property
    def given(self) -> Collection[str]:
        """The names of the sections that are given."""

    def section(self, kind: type[Any], /) -> Any:
        """Return the section of this class."""


class Addition(NamedTuple):
    """The contents of an addition; the texts are "module:name"."""

    name: str
    """Name of its folder, and of its section in the configuration."""
    order: int = 0
    """Additions of a lower order come first; equal orders are sorted by name."""
    settings: str = ""
    """Class of its section: a `txt1.config.schema.Section`, or a dataclass, which can be read without pydantic."""
    wanted: Callable[[Any], bool] | None = None
    """Whether a configuration (`txt1.config.Config`) asks for it; None: if its section is given."""
    on_request: bool = False
    """Whether only a request by name lets it take part, such as its options, and its section is not enough."""
    watch: str = ""
    """(Runtime, settings) -> async context."""
    prepare: str = ""
    """async (Runtime, settings) -> an object that others find by `Runtime.part`, or None."""
    beside: str = ""
    """(Robot, settings) -> async context."""
    options: str = ""
    """Its `Options` of ``txt1 run``."""
    parts: Mapping[str, Mapping[str, str]] = {}
    """Its entries for the tables of parts: by group, such as ``txt1.hal``, names and "module:function"."""
    sources: Mapping[str, int] = {}
    """Its sources of commands, and the priority of each (`txt1.control.commander`)."""
    renamed: Mapping[str, str] = {}
    """The present names of settings or sections, by their former names; both dotted."""
    commands: Mapping[str, tuple[str, str]] = {}
    """Its commands: by name, the module with `add_arguments(parser)` and `main(arguments)`, and a line of help."""


class Options(NamedTuple):
    """The options of ``txt1 run`` with which a user asks for an addition."""

    title: str
    """Title of their group in the help."""
    arguments: Mapping[str, Mapping[str, Any]]
    """Settings of argparse for each option, by its name."""
    asked: Callable[[Namespace, Any], object | None]
    """(arguments, `txt1.config.Config`) -> the addition's settings, None if it is not asked for.

    It refuses wrong options (ConfigError) before a robot starts.
    """


class Active(NamedTuple):
    """An addition that takes part, and its settings."""

    addition: Addition
    settings: Any


def load(text: str) -> Any:
    """Return the object that "module:name" names; raises ImportError or AttributeError."""
    return resolve_name(text)


@contextmanager
def blamed(name: str, function: str) -> Iterator[None]:
    """Turn an error of the block into an AdditionFault, which names the addition and the function.

    The package's deliberate errors pass unchanged. So do errors of the operating system, such as a full disk, from the
    package's own additions.
    """
    try:
        yield
    except Exception as error:
        if isinstance(error, Txt1Error) or (isinstance(error, OSError) and name in ours()):
            raise
        raise AdditionFault(name, function, error) from error


def brought(addition: Addition, text: str) -> Any:
    """Return the object that "module:name" of an addition names; raises AdditionFault."""
    with blamed(addition.name, text):
        return load(text)


class Contained:
    """The context of an addition; `subject` is its Runtime or Robot, `tell` adds a line to the event log.

    An error of the block passes through. If the addition then raises an error on leaving, it is only logged.
    """

    def __init__(self, active: Active, function: str, subject: object, tell: Callable[[str], None]) -> None:
        self._active, self._function, self._subject, self._tell = active, function, subject, tell
        self._context: AbstractAsyncContextManager[object]

    async def __aenter__(self) -> None:
        with blamed(self._active.addition.name, self._function):
            self._context = load(self._function)(self._subject, self._active.settings)
            await self._context.__aenter__()

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            with blamed(self._active.addition.name, self._function):
                await self._context.__aexit__(kind, error, trace)
        except AdditionFault as fault:
            if fault.__cause__ is not error:
                self._tell(str(fault))
                if not isinstance(error, Exception):
                    raise


@cache
def ours() -> Mapping[str, Addition]:
    """Return the package's own additions by their names."""
    package = Path(__file__).parent
    files = sorted(file for folder in FOLDERS for file in package.glob(f"{folder}/addition.py"))
    return {each.name: each for each in map(_addition_of, files)}


def _addition_of(file: Path) -> Addition:
    """Read an addition.py as a separate module: importing it would import its package, which may be large."""
    spec = spec_from_file_location(f"txt1_addition_{file.parent.name}", file)
    assert spec is not None and spec.loader is not None
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    addition: Addition = module.ADDITION
    return addition


class Strangers(NamedTuple):
    """The additions of other packages."""

    found: Mapping[str, Addition]
    wrong: Mapping[str, str]
    """Why an addition cannot be used, in a line, by its name."""


@cache
def strangers() -> Strangers:
    """Return the additions of other packages by their names."""
    # takes 15 ms, which most runs save
    from importlib.metadata import entry_points

    found: dict[str, Addition] = {}
    wrong: dict[str, str] = {}
    origins = dict.fromkeys(ours(), "ours")
    for point in entry_points(group=GROUP):
        origin = f"{point.value} of the package '{point.dist.name if point.dist else '?'}'"
        if point.name in origins:
            wrong[point.name] = (
                f"there are two additions '{point.name}': {origins[point.name]}, and {origin}; uninstall one of them"
            )
            found.pop(point.name, None)
            continue
        origins[point.name] = origin
        try:
            found[point.name] = point.load()._replace(name=point.name)
        except Exception as error:
            told = f"{type(error).__name__}: {error}"
            wrong[point.name] = f"the addition '{point.name}' ({origin}) cannot be imported: {told}"
    return Strangers(found, wrong)


def known() -> dict[str, Addition]:
    """Return the package's own additions by their names, and strangers' once `strangers` has found them."""
    return {**ours(), **(strangers().found if strangers.cache_info().currsize else {})}


def named(name: str) -> Addition | None:
    """Return the addition of this name, the package's own or a stranger's; None: it is not installed.

    Raises ConfigError: it is installed and cannot be used.
    """
    if name in ours():
        return ours()[name]
    if name in strangers().wrong:
        raise ConfigError(strangers().wrong[name])
    return strangers().found.get(name)


def priority_of(source: str) -> int | None:
    """Return the priority of a source of commands that an addition defines, None for any other source."""
    return next((each.sources[source] for each in known().values() if source in each.sources), None)


def settings_of(name: str) -> Any:
    """Return the class of an addition's section; None: there is no such addition, or it has no section."""
    addition = named(name)
    return brought(addition, addition.settings) if addition is not None and addition.settings else None


def sections() -> list[str]:
    """Return the names of all sections that additions have."""
    strangers()
    return [each.name for each in known().values() if each.settings]


def active(config: Configuration, asked: Mapping[str, object] | None = None) -> tuple[Active, ...]:
    """Return the additions that take part, in their order: the wanted, and those in `asked`, with their settings.

    Raises ConfigError: an addition that is asked for is not installed.
    """
    asked = asked or {}
    there = {**ours(), **{name: each for name in (*config.given, *asked) if (each := named(name)) is not None}}
    if missing := [name for name in asked if name not in there]:
        raise ConfigError(
            f"there is no addition '{missing[0]}': install its package, or name one of {', '.join(sorted(there))}"
        )
    found = []
    for name, each in there.items():
        if name in asked:
            found.append(Active(each, asked[name]))
        elif _wanted(each, config):
            found.append(Active(each, config.section(brought(each, each.settings)) if each.settings else None))
    return tuple(sorted(found, key=lambda one: (one.addition.order, one.addition.name)))


def _wanted(addition: Addition, config: Configuration) -> bool:
    if addition.wanted is None:
        return addition.name in config.given and not addition.on_request
    with blamed(addition.name, "wanted"):
        return addition.wanted(config)

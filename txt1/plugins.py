"""Parts by name, imported when used: the package's own from a table or an addition, others' from entry points."""

import asyncio
from collections.abc import Awaitable, Callable, Mapping
from importlib.metadata import EntryPoint, entry_points
from typing import Any, NamedTuple

from txt1 import additions
from txt1.errors import HalError, Txt1Error

Factory = Callable[..., Any]


class Registry(NamedTuple):
    """One kind of part."""

    # the word for it in error messages, such as "HAL"
    kind: str
    # group of the entry points, such as "txt1.hal"
    group: str
    # the spine's own parts: the function that makes the part, or "module:function"
    table: Mapping[str, Factory | str]
    # raised when a part cannot be imported or made
    error: type[Txt1Error] = Txt1Error

    @property
    def ours(self) -> Mapping[str, Factory | str]:
        """The parts of the table and of additions, also of strangers' once found; the package's own come first."""
        brought = [addition.parts.get(self.group, {}) for addition in additions.known().values()]
        return {**{name: place for each in reversed(brought) for name, place in each.items()}, **self.table}

    def names(self) -> list[str]:
        """The names of all installed parts."""
        additions.strangers()
        return sorted({*self.ours, *(point.name for point in entry_points(group=self.group))})

    def make(self, key: str, name: str, *arguments: Any) -> Any:
        """Make the part of this name with these arguments; `key` is the setting that named it.

        Raises ConfigError: the name is unknown, or its settings are wrong; MissingPlugin: its plug-in is not installed;
        `error`: it cannot be imported or made, with
        the cause chained.
        """
        factory, origin = self.find(key, name)
        try:
            return factory(*arguments)
        except Exception as error:
            from txt1.unknown import OURS

            if origin.partition(".")[0] in OURS or isinstance(error, Txt1Error):
                raise
            raise self._failed(name, origin, "made", error) from error

    def find(self, key: str, name: str) -> tuple[Factory, str]:
        """Return the function that makes the part of this name, and its origin; raises as `make`."""
        place = self.place(key, name)
        if callable(place):
            return place, "txt1"
        try:
            return EntryPoint(name, place, self.group).load(), place
        except Exception as error:
            raise self._failed(name, place, "imported", error) from error

    def place(self, key: str, name: str) -> Factory | str:
        """Return the function that makes the part, or "module:function", not imported; raises as `make`."""
        if name in self.ours:
            return self.ours[name]
        for point in entry_points(group=self.group, name=name):
            return point.value
        # takes a while
        additions.strangers()
        if name in self.ours:
            return self.ours[name]
        from txt1.unknown import part

        raise part(self.kind, self.group, key, name, self.names())

    def _failed(self, name: str, origin: str, done: str, error: Exception) -> Txt1Error:
        text = f"the {self.kind} '{name}' ({origin}) cannot be {done}: {type(error).__name__}: {error}"
        return self.error(text)


async def settled(who: str, done: str, method: Callable[[], Awaitable[None]], limit: float | None = None) -> None:
    """Wait for a part to be opened or closed, for at most `limit` s.

    Any error of a stranger's part becomes a HalError that names the part.
    """
    timeout = asyncio.timeout(limit)
    try:
        async with timeout:
            await method()
    except Txt1Error:
        raise
    except Exception as error:
        if timeout.expired():
            raise HalError(f"{who} is not {done} after {limit:g} s") from None
        raise HalError(f"{who} cannot be {done}: {type(error).__name__}: {error}") from error

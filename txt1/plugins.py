"""Parts by name: ours from a table or an addition, those of other packages through entry points; imported when used."""

import asyncio
import difflib
from collections.abc import Awaitable, Callable, Mapping
from importlib.metadata import EntryPoint, entry_points
from typing import Any, NamedTuple

from txt1 import additions
from txt1.errors import ConfigError, HalError, Txt1Error

Factory = Callable[..., Any]


class Registry(NamedTuple):
    """One kind of part."""

    kind: str  # its word in error messages, such as "HAL"
    group: str  # of the entry points, such as "txt1.hal"
    table: Mapping[str, Factory | str]  # the spine's own: the function that makes one, or "module:function"
    error: type[Txt1Error] = Txt1Error  # raised when one cannot be imported or made

    @property
    def ours(self) -> Mapping[str, Factory | str]:
        """Those of the table and of additions, of strangers' ones once they were found; ours come first."""
        brought = [addition.parts.get(self.group, {}) for addition in additions.known().values()]
        return {**{name: place for each in reversed(brought) for name, place in each.items()}, **self.table}

    def names(self) -> list[str]:
        """The names of all that are installed."""
        additions.strangers()
        return sorted({*self.ours, *(point.name for point in entry_points(group=self.group))})

    def make(self, key: str, name: str, *arguments: Any) -> Any:
        """The part of this name, made with these arguments; `key` is the setting that named it.

        A ConfigError when there is none of that name, or its settings are wrong; `error` when it cannot be imported or
        made, the cause chained.
        """
        factory, origin = self.find(key, name)
        try:
            return factory(*arguments)
        except Exception as error:
            if origin.partition(".")[0] == "txt1" or isinstance(error, Txt1Error):
                raise
            raise self._failed(name, origin, "made", error) from error

    def find(self, key: str, name: str) -> tuple[Factory, str]:
        """The function that makes the part of this name, and where it comes from; raises as `make`."""
        place = self.place(key, name)
        if callable(place):
            return place, "txt1"
        try:
            return EntryPoint(name, place, self.group).load(), place
        except Exception as error:
            raise self._failed(name, place, "imported", error) from error

    def place(self, key: str, name: str) -> Factory | str:
        """The function that makes the part of this name, or "module:function", not imported; raises as `make`."""
        if name in self.ours:
            return self.ours[name]
        for point in entry_points(group=self.group, name=name):
            return point.value
        additions.strangers()  # which takes a while
        if name in self.ours:
            return self.ours[name]
        near = difflib.get_close_matches(name, self.names(), n=1)
        hint = f"; did you mean '{near[0]}'?" if near else ""
        installed = ", ".join(self.names()) or "none"
        raise ConfigError(f"{key}: there is no {self.kind} '{name}'; installed: {installed}{hint}")

    def _failed(self, name: str, origin: str, done: str, error: Exception) -> Txt1Error:
        text = f"the {self.kind} '{name}' ({origin}) cannot be {done}: {type(error).__name__}: {error}"
        return self.error(text)


async def settled(who: str, done: str, method: Callable[[], Awaitable[None]], limit: float | None = None) -> None:
    """Wait for a part to be opened or closed, for at most `limit` s.

    Whatever a stranger's raises becomes a HalError that names the part.
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

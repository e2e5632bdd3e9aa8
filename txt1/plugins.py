"""Parts by name: ours from a table, other packages' through a group of entry points, imported when first asked for."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Mapping
from importlib import import_module
from importlib.metadata import entry_points
from typing import Any, NamedTuple

from txt1.errors import ConfigError, Txt1Error

Factory = Callable[..., Any]


class Registry(NamedTuple):
    """One kind of part.

    Attributes:
        kind: its word in error messages, such as "HAL".
        group: of the entry points, such as "txt1.hal".
        ours: the package's own: the function that makes one, or "module:function" to be imported.
        error: raised when one cannot be imported or made.

    """

    kind: str
    group: str
    ours: Mapping[str, Factory | str]
    error: type[Txt1Error] = Txt1Error

    def names(self) -> list[str]:
        """The names of all that are installed."""
        return sorted({*self.ours, *(point.name for point in entry_points(group=self.group))})

    def make(self, key: str, name: str, *arguments: Any) -> Any:
        """The part of this name, made with these arguments; `key` is the setting that named it.

        Raises:
            ConfigError: there is none of that name (the message lists those there are), or its settings are wrong.
            Txt1Error: it cannot be imported or made (see `error`); the cause is chained.

        """
        factory, origin = self.find(key, name)
        if name in self.ours:
            return factory(*arguments)
        try:
            return factory(*arguments)
        except Txt1Error:
            raise
        except Exception as error:
            raise self.error(
                f"the {self.kind} '{name}' ({origin}) cannot be made: {type(error).__name__}: {error}"
            ) from error

    def find(self, key: str, name: str) -> tuple[Factory, str]:
        """The function that makes the part of this name, and where it comes from; raises as `make`."""
        one = self.ours.get(name)
        if callable(one):
            return one, "txt1"
        if one is not None:
            module, function = one.split(":")
            return getattr(import_module(module), function), "txt1"
        for point in entry_points(group=self.group, name=name):
            try:
                return point.load(), point.value
            except Exception as error:
                raise self.error(
                    f"the {self.kind} '{name}' ({point.value}) cannot be imported: {type(error).__name__}: {error}"
                ) from error
        raise self._unknown(key, name)

    def _unknown(self, key: str, name: str) -> ConfigError:
        near = difflib.get_close_matches(name, self.names(), n=1)
        hint = f"; did you mean '{near[0]}'?" if near else ""
        return ConfigError(f"{key}: there is no {self.kind} '{name}'; installed: {', '.join(self.names())}{hint}")
